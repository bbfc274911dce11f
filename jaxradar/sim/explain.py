"""Which effects of a scene matter: what each contributes to the record, what it costs, and which may go."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import numpy as np

from jaxradar._numerics import compiled
from jaxradar.sim.plan import Plan, plan_scene
from jaxradar.sim.radar import range_axis
from jaxradar.sim.render import Rendered, render
from jaxradar.sim.road.scene import RoadScene
from jaxradar.sim.scene import Effect

__all__ = ["Contribution", "Significance", "Tolerance", "significant", "without"]

MOST_SWEEPS = 2000  # of a scene that are looked at
ROUNDS = 3


@dataclass(frozen=True)
class Tolerance:
    """What may be left out: a change of the record below all of these. `level_db` is relative to the record's own rms,
    `range_mm` an rms shift of the strongest echo, `time_ms` an rms shift of the recorded times, `acceleration_m_s2` an
    rms change of the recorded acceleration."""

    level_db: float = -40.0
    range_mm: float = 0.1
    time_ms: float = 0.05
    acceleration_m_s2: float = 0.05


@dataclass(frozen=True)
class Contribution:
    """What one effect does to a scene's record, all else as it is.

    `level_db`, `range_mm`, `time_ms`, `acceleration_m_s2` as in `Tolerance`, −∞ or 0 where nothing changes; `lost`:
    share of sweeps that are missing for it. `operations` and `microseconds`: what it adds to a sweep's cost, as the
    compiler counts and as measured (a difference of two measurements, so it may come out below 0).
    """

    effect: str
    level_db: float
    range_mm: float
    time_ms: float
    acceleration_m_s2: float
    lost: float
    operations: float
    microseconds: float
    kept: bool
    why: str


@dataclass(frozen=True)
class Significance:
    """The scene with the effects that matter, and the table that says why; `bare_operations` and `bare_microseconds`
    are the cost of a sweep without any effect."""

    scene: RoadScene
    table: tuple[Contribution, ...]
    bare_operations: float
    bare_microseconds: float


def without(scene: RoadScene, *effects: Effect) -> RoadScene:
    """The scene without some of its effects."""
    rest = tuple(one for one in scene.effects if not any(one is gone for gone in effects))
    return dataclasses.replace(scene, effects=rest)


def significant(
    scene: RoadScene,
    tolerance: Tolerance | None = None,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> Significance:
    """Measure what each effect contributes and drop those below the tolerance.

    Each is taken away from the whole scene in turn; the others keep their draws, so that the difference is its alone.
    The first `MOST_SWEEPS` sweeps are looked at. Every variant is a program of its own, seconds to compile; `progress`
    is told when one is ready. Raises `ConfigError` for a scene that is too large.
    """
    tolerance = Tolerance() if tolerance is None else tolerance
    looked_at = min(scene.duration_s, MOST_SWEEPS / scene.radar.rate_hz)
    short = dataclasses.replace(scene, duration_s=looked_at)
    variants = {"the whole scene": short, "the scene without effects": without(short, *short.effects)}
    variants |= {f"{place}: without {one.name}": without(short, one) for place, one in enumerate(short.effects)}
    with ThreadPoolExecutor(2) as pool:
        # Compiling takes the time; what is measured is measured afterwards, alone.
        ready = list(pool.map(lambda name: _compiled(variants[name], seed, name, progress), variants))
    (whole, whole_cost), (_, bare_cost), *others = (_run(one) for one in ready)
    table, kept = [], []
    for effect, original, (other, cost) in zip(short.effects, scene.effects, others, strict=True):
        found = _contribution(effect, whole, other, short, tolerance, whole_cost, cost)
        table.append(found)
        if found.kept:
            kept.append(original)
    return Significance(dataclasses.replace(scene, effects=tuple(kept)), tuple(table), *bare_cost)


class _Compiled(NamedTuple):
    plan: Plan
    operations: float
    call: Callable[[], Rendered]


def _compiled(scene: RoadScene, seed: int, name: str, progress: Callable[[str], None] | None) -> _Compiled:
    plan = plan_scene(scene)
    with jax.enable_x64(True):
        key = jax.random.key(seed)
        # jit's own method, which a plain callable's type does not have
        program = compiled(partial(render, plan)).lower(scene, key).compile()  # type: ignore[attr-defined]
    if progress is not None:
        progress(name)
    operations = float((program.cost_analysis() or {}).get("flops", math.nan))
    return _Compiled(plan, operations, lambda: program(scene, key))


def _run(ready: _Compiled) -> tuple[Rendered, tuple[float, float]]:
    """The record, and operations and microseconds for each of its sweeps."""
    with jax.enable_x64(True):
        found = jax.block_until_ready(ready.call())
        took = []
        for _ in range(ROUNDS):
            start = time.perf_counter()
            jax.block_until_ready(ready.call())
            took.append(time.perf_counter() - start)
    sweeps, block = ready.plan.sweeps, ready.plan.block
    # The compiler counts the body of the loop over blocks once.
    operations = ready.operations * -(-sweeps // block) / sweeps
    return jax.tree.map(np.asarray, found), (operations, 1e6 * min(took) / sweeps)


def _contribution(
    effect: Effect,
    whole: Rendered,
    other: Rendered,
    scene: RoadScene,
    tolerance: Tolerance,
    whole_cost: tuple[float, float],
    cost: tuple[float, float],
) -> Contribution:
    lost = float(np.mean(other.clock.kept) - np.mean(whole.clock.kept)) if len(whole.clock.kept) else 0.0
    drift = np.concatenate(
        [
            np.ravel(whole.clock.recorded_s - other.clock.recorded_s),
            np.ravel((whole.clock.motion_pace - other.clock.motion_pace) * whole.clock.taken_s),
        ]
    )
    time_ms = 1e3 * float(np.sqrt(np.mean(drift**2))) if drift.size else 0.0
    felt = 0.0
    if whole.acceleration_m_s2 is not None and other.acceleration_m_s2 is not None:
        felt = float(np.sqrt(np.mean((whole.acceleration_m_s2 - other.acceleration_m_s2) ** 2)))
    level_db, range_mm, resampled = -math.inf, 0.0, whole.sweeps.shape != other.sweeps.shape
    if not resampled and whole.sweeps.size:
        one, two = (np.asarray(held.sweeps, np.float64) for held in (whole, other))
        power = np.mean(one**2)
        change = np.mean((one - two) ** 2)
        level_db = (
            10.0 * math.log10(change / power) if change > 0 and power > 0 else (-math.inf if not change else math.inf)
        )
        axis = range_axis(scene.radar)
        axis = axis if len(axis) == one.shape[1] else np.linspace(axis[0], axis[-1], one.shape[1])
        range_mm = 1e3 * float(np.sqrt(np.mean((_centre(one, axis) - _centre(two, axis)) ** 2)))
    reasons = [
        (resampled, "the record has other range bins for it"),
        (lost > 0, f"{lost:.1%} of the sweeps are lost to it"),
        (level_db > tolerance.level_db, f"it changes amplitudes by {level_db:.1f} dB of their rms"),
        (range_mm > tolerance.range_mm, f"it moves the strongest echo by {range_mm:.2g} mm"),
        (time_ms > tolerance.time_ms, f"it moves the recorded times by {time_ms:.2g} ms"),
        (felt > tolerance.acceleration_m_s2, f"it changes the recorded acceleration by {felt:.2g} m/s²"),
    ]
    because = [text for holds, text in reasons if holds]
    why = (
        because[0]
        if because
        else (
            f"dropped: {level_db:.1f} dB, {range_mm:.2g} mm, {time_ms:.2g} ms and {felt:.2g} m/s² are below the "
            f"tolerance of {tolerance.level_db:g} dB, {tolerance.range_mm:g} mm, {tolerance.time_ms:g} ms and "
            f"{tolerance.acceleration_m_s2:g} m/s²"
        )
    )
    return Contribution(
        effect.name,
        level_db,
        range_mm,
        time_ms,
        felt,
        lost,
        whole_cost[0] - cost[0],
        whole_cost[1] - cost[1],
        bool(because),
        why,
    )


def _centre(sweeps: np.ndarray, range_m: np.ndarray) -> np.ndarray:
    """Centre of what is above half of each sweep's maximum around it, in metres: smooth enough to show 0.01 mm."""
    top = sweeps.max(axis=1, keepdims=True)
    at = sweeps.argmax(axis=1)
    near = np.abs(range_m[None, :] - range_m[at][:, None]) < 0.05
    weight = np.where(near, np.maximum(sweeps - 0.5 * top, 0.0), 0.0)
    total = weight.sum(axis=1)
    centre = (weight * range_m).sum(axis=1) / np.where(total > 0, total, 1.0)
    return np.where(total > 0, centre, range_m[0])
