"""What of a scene is fixed before it is traced: sizes, and the numbers that set them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from jaxradar._errors import ConfigError
from jaxradar.signal.pulses import SIGMA_PER_FWHM
from jaxradar.sim.radar import ECHOES_A_PASS, reach_of
from jaxradar.sim.road.motion import along
from jaxradar.sim.road.scene import RoadScene

__all__ = ["Plan", "plan_scene"]

FINE_S = 0.0005  # between two moments at which the car's motion is worked out
FINE_START_S = -0.1  # before the first sweep, so that one taken early has a moment on either side
LOOK_S = 0.02  # between two looks at how far the car goes
BEAM = 1.36  # two-way amplitude is 0.6 % so many half-power widths off the line of sight
BLOCK = 256  # sweeps that are made side by side
MOST_POINTS = 20_000_000
POINTS_STEP = 256  # so that scenes of nearly one speed share a program
MOST_AMPLITUDES = 2_000_000_000  # of a record: 8 GB
MOST_MOMENTS = 100_000_000  # at which the motion is worked out: 14 hours
MOST_CLIMB_M_S = 1.0  # of the sensor on its springs, as far as range walk is concerned
BAND = 3.5  # the pulse's band ends at so many over σ


@dataclass(frozen=True)
class Plan:
    """Sizes of a scene's arrays; hashable, so that two scenes with one plan share a program.

    - `sweeps`, `block`: of the drive, and how many are made side by side.
    - `first_point`, `points`: which points of the ground there are, 0 being at the sensor's foot at the start.
    - `behind_m`, `visible`: how far behind the sensor's foot the visible points begin, and how many there are.
    - `fine_steps`: moments at which the motion is worked out, `FINE_S` apart, from `FINE_START_S` on.
    - `fwhm_m`: the pulse that nodes were laid for; `widening`: how many times wider the band may become.
    """

    sweeps: int
    block: int
    first_point: int
    points: int
    behind_m: float
    visible: int
    fine_steps: int
    fwhm_m: float
    widening: float


def _values(scene: RoadScene) -> RoadScene:
    """The scene with all its settings as NumPy numbers. Raises `TypeError` where they are traced."""
    for leaf in jax.tree.leaves(scene):
        if isinstance(leaf, jax.core.Tracer):
            raise TypeError("a plan is made of a scene's values, outside of what is traced: `plan_scene(scene)`.")
    return jax.tree.map(np.asarray, scene)


def plan_scene(scene: RoadScene) -> Plan:
    """The plan of a scene, or of a batch of scenes of one structure, whose settings have a leading axis: the same sizes
    for all of them. Raises `ConfigError` for a scene that is too large to be held."""
    scene = _values(scene)
    widest = lambda value: float(np.max(value))  # noqa: E731
    least = lambda value: float(np.min(value))  # noqa: E731
    radar, mount = scene.radar, scene.mount
    sweeps = max(1, round(scene.duration_s * radar.rate_hz))
    fwhm = least(radar.fwhm_m)
    # The car's way, looked at often enough.
    start_s, stop_s = FINE_START_S, scene.duration_s + 0.5
    times = np.linspace(start_s, stop_s, min(1_000_000, max(512, math.ceil((stop_s - start_s) / LOOK_S))))
    batched = any(np.ndim(leaf) for leaf in jax.tree.leaves(scene.motion))
    with jax.enable_x64(True):
        way = lambda motion: along(motion, jnp.asarray(times))[:2]  # noqa: E731
        path_m, speed_m_s = (np.asarray(one) for one in (jax.vmap(way) if batched else way)(scene.motion))
    nearest, farthest = float(path_m.min()), float(path_m.max())
    # As far as the range window and a pulse reach, behind also no further than the beam does.
    end_m = radar.start_m + radar.bins * radar.bin_m + 1.25 * reach_of(widest(radar.fwhm_m))
    height = least(mount.height_m)
    ahead_m = math.sqrt(max(end_m**2 - height**2, 0.0)) if end_m > height else 0.0
    past = math.radians(min(max(BEAM * widest(radar.vertical_beam_deg) + widest(mount.angle_deg) - 90.0, 15.0), 85.0))
    behind_m = min(widest(mount.height_m) * math.tan(past), max(ahead_m, 0.1))
    visible = ECHOES_A_PASS * math.ceil(((ahead_m + behind_m) / scene.spacing_m + 2) / ECHOES_A_PASS)
    first = math.floor((nearest - behind_m) / scene.spacing_m) - 1
    points = math.ceil((farthest - nearest) / scene.spacing_m) + visible + 4
    points = POINTS_STEP * math.ceil(points / POINTS_STEP)
    moments = math.ceil((stop_s - start_s) / FINE_S) + 1
    for count, most, what, way_out in (
        (points, MOST_POINTS, "road holds {} scatterers", "shorten `duration_s` or widen `spacing_m`"),
        (sweeps * radar.bins, MOST_AMPLITUDES, "record holds {} amplitudes", "lower `duration_s`, `rate_hz` or `bins`"),
        (moments, MOST_MOMENTS, "motion has {} moments", "shorten `duration_s`"),
    ):
        if count > most:
            raise ConfigError(f"the scene's {what.format(f'{count:,}')}, more than {most:,}: {way_out}.")
    return Plan(
        sweeps=sweeps,
        block=_block(sweeps),
        first_point=first,
        points=points,
        behind_m=behind_m,
        visible=visible,
        fine_steps=moments,
        fwhm_m=fwhm,
        widening=_widening(scene, fwhm, float(np.abs(speed_m_s).max())),
    )


def _block(sweeps: int) -> int:
    """How many sweeps to make side by side: all of few; of many a number that goes into them, so that no last block
    is cut, which would take a copy of all."""
    if sweeps <= BLOCK:
        return sweeps
    return next((size for size in range(BLOCK, BLOCK // 2, -1) if sweeps % size == 0), BLOCK)


def _widening(scene: RoadScene, fwhm_m: float, speed_m_s: float) -> float:
    """How many times wider the field's band is than the pulse's: bins that are sampled one after the other turn the
    phase of what closes in, 4π v/λ for each second, and so shift its band."""
    fastest = speed_m_s + MOST_CLIMB_M_S
    turn_rad_m = sum(effect.turn_rad_m(scene.radar, fastest) for effect in scene.effects)
    # In steps, so that scenes of nearly one speed share a program.
    return 1.0 + 0.25 * math.ceil(4.0 * turn_rad_m * SIGMA_PER_FWHM * fwhm_m / BAND)
