"""`sim.render` at the bounds of a scene's settings: finite with its gradient, single precision near double.

Both are the same function: its oracles are in `test_sim_radar.py`.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from stability_report import UNHURRIED

from jaxradar import sim

HEIGHTS_M, ANGLES_DEG, SPEEDS_M_S = (0.06, 0.35, 1.0), (0.0, 45.0, 90.0), (0.0, -3.0, 30.0)
ROAD = (sim.StepUp(at_m=0.3, height_m=0.04),)
# One at a time away from the usual, as all together are 27.
SCENES = {
    **{f"height {one:g} m": (one, 45.0, 8.0) for one in HEIGHTS_M},
    **{f"angle {one:g}°": (0.35, one, 8.0) for one in ANGLES_DEG},
    **{f"{one:g} m/s": (0.35, 45.0, one) for one in SPEEDS_M_S},
}


def scene(height_m: Any, angle_deg: Any, speed_m_s: Any) -> sim.RoadScene:
    return sim.RoadScene(
        duration_s=0.03,
        radar=sim.Radar(bins=32, bin_m=0.028),
        road=ROAD,
        mount=sim.Mount(height_m=height_m, angle_deg=angle_deg),
        motion=sim.CarMotion(speed_m_s=speed_m_s),
        spacing_m=0.05,  # and no noise: it is drawn in the precision asked for, and would differ
    )


# A minute to compile: what the plain run checks of scenes is in `test_sim_scene.py`.
@pytest.mark.long
def test_scenes_at_their_bounds() -> None:
    columns = [np.array(one) for one in zip(*SCENES.values(), strict=True)]
    scenes = [scene(*map(float, one)) for one in SCENES.values()]
    plan = sim.plan_scene(jax.tree.map(lambda *leaves: np.stack(leaves), *scenes))

    def sweeps(dtype: Any, *settings: Any) -> jax.Array:
        return sim.render(plan, scene(*settings), jax.random.key(0), dtype).sweeps

    def loudness(*settings: Any) -> jax.Array:
        return jnp.mean(sweeps(jnp.float64, *settings))

    with jax.enable_x64(True), jax.debug_nans(True):
        single, double = (
            np.asarray(jax.jit(jax.vmap(lambda *one, dtype=dtype: sweeps(dtype, *one)))(*columns), np.float64)
            for dtype in (jnp.float32, jnp.float64)
        )
        slope = jax.grad(loudness, argnums=(0, 1, 2))
        slopes = jax.jit(jax.vmap(slope), compiler_options=UNHURRIED)(*columns)
    assert np.isfinite(single).all()
    for name, one, other in zip(SCENES, single, double, strict=True):
        assert np.abs(one - other).max() <= 3e-4 * np.abs(other).max(), name
    assert double.max(axis=(1, 2)).min() > 0
    assert all(np.isfinite(one).all() for one in jax.tree.leaves(slopes))
