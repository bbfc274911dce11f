"""The height of a step, with its uncertainty, out of the sweeps around it.

The road that the sensor looks down on comes nearer by h as the edge passes below it; the front tyre touches only then,
and the body stays behind for some tens of milliseconds. Before that the sensor's own height and the road's backscatter
are fitted to the sweeps over the flat road (`calibrate`); then each height, each moment of the passage (`impact_in_s`
says roughly when) and each strength of the corner is held against the sweeps (`height_likelihood`), and the height's
mean and standard deviation are those of the product, all heights being equally likely beforehand.

Neighbouring cells and sweeps share their speckle. By how much is seen in the sweeps before: the variance of the sum of
their score over what it would be if all were independent; so many times less the likelihood says (Ribatet, Cooley and
Davison, Statistica Sinica 22, 2012; the variance after Newey and West, Econometrica 55, 1987).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxradar._errors import ConfigError
from jaxradar._settings import Settings, part, setting
from jaxradar._types import Setting
from jaxradar.drive import Motion, SensorSeries
from jaxradar.survey.ground import Beam, Ground, strips_of
from jaxradar.survey.height_grid import Car, Passage, height_likelihood, road_table, slopes_of
from jaxradar.survey.mounting import Calibration, calibrate, mean_powers
from jaxradar.systems.step.approach import ApproachDetector
from jaxradar.systems.step.pipeline import detect
from jaxradar.systems.step.result import StepEvent

__all__ = ["HeightFinder", "StepHeight", "step_height", "step_heights"]

ANGLES_DEG = (45.0,)  # where fits to the road before begin
HEIGHTS_M = np.arange(-0.1, 0.1001, 0.0025)
CORNERS = np.array([0.0, *np.geomspace(1e-4, 1.0, 9)])
TIMES, SPREAD = 25, 2.5  # moments of the passage that are tried, as far as so many standard deviations
LEVEL_M = 0.0025
SWEEPS = 32  # windows are multiples of so many sweeps
AROUND_M = (0.12, 0.3)  # of the leading edge, ranges that are looked at
BEFORE_M = 3.0
CLEAR_M = 0.45  # so far before the edge the road counts as flat
SPEED_SHARE, PLACE_M = 0.1, 0.03  # scatter of an approach's speed and place
LONGEST_LAG = 12
LONGEST_GAP_S = 0.05  # between samples of an acceleration that is integrated


class HeightFinder(Settings):
    """How the height of a step is found. The car's defaults are a small electric one's.

    `follows`: where the body's rise is not measured it is worked out from `body_hz` and `damping`, and a sweep counts
    less the more of the step the body has followed: e^(−½ (share/follows)²).
    """

    front_wheel_m: Setting = setting(0.15, -5.0, 10.0, "m", "how far the front axle lies behind the sensor")
    tyre_radius_m: Setting = setting(0.2, 0.02, 1.0, "m", "of the front wheels")
    body_hz: Setting = setting(1.8, 0.1, 20.0, "Hz", "of the body on its front springs")
    damping: Setting = setting(0.3, 0.0, 0.95, "", "of it, as a share of critical")
    lever: Setting = setting(1.125, 0.0, 5.0, "", "rise of the sensor over that of the body at the front axle")
    lag_s: Setting = setting(0.011, 0.0, 1.0, "s", "the wheel, which swings on its tyre, takes the body along so late")
    follows: Setting = setting(0.3, 0.01, 10.0, "", "a guessed rise of this share of the step is no longer trusted")
    look_s: Setting = setting(0.12, 0.0, 2.0, "s", "after the passage sweeps are looked at so long")
    look_measured_s: Setting = setting(0.25, 0.0, 2.0, "s", "and so long where the body's acceleration is recorded")
    ahead_m: Setting = setting(0.3, 0.0, 5.0, "m", "and from so far before the edge")
    beam: Beam = part(Beam)


@dataclass(frozen=True)
class StepHeight:
    """`height_m` of a step, positive upwards, with its standard deviation; `passes_s`: when its edge passed below the
    sensor, in seconds since the first sweep of the drive, and `looks`: how many sweeps over it count as independent."""

    height_m: float
    sd_m: float
    passes_s: float
    looks: float


def step_heights(
    series: SensorSeries, events: Sequence[StepEvent], finder: HeightFinder | None = None, **known: Any
) -> tuple[StepHeight | None, ...]:
    """`step_height` of each event; None where it cannot be had."""
    found: list[StepHeight | None] = []
    for event in events:
        try:
            found.append(step_height(series, event, finder, **known))
        except ConfigError:
            found.append(None)
    return tuple(found)


def step_height(
    series: SensorSeries,
    event: StepEvent,
    finder: HeightFinder | None = None,
    *,
    motion: Motion | None = None,
    approach: ApproachDetector | None = None,
    speed_m_s: float | None = None,
    passes_s: float | None = None,
) -> StepHeight:
    """Height of the step of an event, out of the sweeps before and after it.

    `motion`: the car's, as far as it was recorded: its speed, and the body's vertical acceleration over the front axle,
    which says how far the body followed. `speed_m_s` and `passes_s`, when the edge passed below the sensor, where these
    are known; otherwise what `approach` (with its defaults if None) says at the event. Raises `ConfigError` where the
    event has no `impact_in_s`, and for too few sweeps before or after it.
    """
    finder = finder or HeightFinder()
    speed = speed_m_s or _speed(series, event, motion, approach or ApproachDetector())
    if passes_s is None:
        passes, sd = _expected(event, speed, approach or ApproachDetector())
    else:
        passes, sd = passes_s, 0.0
    times = series.times_s
    use = ~series.invalid
    before = use & (times < passes - CLEAR_M / speed) & (times > passes - BEFORE_M / speed)
    road = dataclasses.replace(series, flags=np.where(before, 0, 1).astype(np.uint16))
    flat = calibrate(road, finder.beam, ANGLES_DEG)
    look_s = float(finder.look_s)
    rise = _rise(motion, passes - float(finder.ahead_m) / speed, passes + look_s, float(finder.lever))
    if rise is not None:
        look_s = float(finder.look_measured_s)
    window = use & (times >= passes - float(finder.ahead_m) / speed) & (times <= passes + look_s)
    if not (window & (times > passes)).any():
        raise ConfigError(f"no sweep with data after the step at {passes:.3f} s; its height is not known.")
    return _best(series, finder, flat, before, window, passes, sd, speed, rise)


def _best(
    series: SensorSeries,
    finder: HeightFinder,
    flat: Calibration,
    before: np.ndarray,
    window: np.ndarray,
    passes_s: float,
    sd_s: float,
    speed: float,
    rise: Any,
) -> StepHeight:
    range_m, powers = mean_powers(series, window)
    # As many cells, whatever the height, so that all series of one axis share a program.
    cell_m = range_m[1] - range_m[0]
    count = min(round(sum(AROUND_M) / cell_m), len(range_m))
    first = int(np.clip(round((flat.height_m - AROUND_M[0] - range_m[0]) / cell_m), 0, len(range_m) - count))
    near = slice(first, first + count)
    strips = strips_of(finder.beam, float(range_m[-1]))
    range_m, powers = range_m[near], powers[:, near]
    ground = Ground(*(jnp.asarray(one, float) for one in flat.ground))
    most = float(HEIGHTS_M[-1]) + 0.03
    levels = flat.height_m + np.arange(-most, most, LEVEL_M)
    table = road_table(finder.beam, ground, *(jnp.asarray(one, float) for one in (levels, strips, range_m)))
    mean, slope = (np.asarray(one, np.float64) for one in slopes_of(table, ground))
    score = (mean_powers(series, before)[1][:, near] / mean - 1.0) @ slope
    shared = _inflation(score, float(slope @ slope))
    padded_to = SWEEPS * math.ceil(int(window.sum()) / SWEEPS)
    away = np.linspace(-SPREAD, SPREAD, TIMES) * sd_s if sd_s else np.zeros(1)
    times = series.times_s[window] - passes_s
    padded = lambda values, fill: np.concatenate([values, np.full(padded_to - len(values), fill)])  # noqa: E731
    passage = (
        padded(times, times[-1]),
        np.concatenate([powers, np.ones((padded_to - len(powers), powers.shape[1]))]),
        padded(np.ones(len(times)), 0.0),
        padded(np.full(len(times), np.nan) if rise is None else rise(series.times_s[window]), np.nan),
        away,
        -0.5 * np.linspace(-SPREAD, SPREAD, len(away)) ** 2 * shared if sd_s else np.zeros(1),
        speed,
        HEIGHTS_M,
        CORNERS,
    )
    held = Passage(*(jnp.asarray(one, float) for one in passage))
    springs = (2.0 * math.pi * float(finder.body_hz), finder.damping, finder.lever, finder.lag_s, finder.follows)
    car = Car(*(jnp.asarray(one, float) for one in (finder.front_wheel_m, finder.tyre_radius_m, *springs)))
    found = height_likelihood(finder.beam, ground, table, jnp.asarray(range_m, float), car, held)
    said = np.asarray(found, np.float64) / shared
    belief = np.exp(said - said.max())
    belief /= belief.sum()
    of_height = belief.sum(axis=(0, 1))
    height = float(of_height @ HEIGHTS_M)
    variance = float(of_height @ (HEIGHTS_M - height) ** 2) + (HEIGHTS_M[1] - HEIGHTS_M[0]) ** 2 / 12.0
    passed = passes_s + float(belief.sum(axis=(1, 2)) @ away)
    sd = math.sqrt(variance + flat.height_sd_m**2)
    after = float(((series.times_s[window] > passed).sum()) / shared)
    return StepHeight(height, sd, passed, after)


def _inflation(score: np.ndarray, expected: float) -> float:
    """Variance of a sum of scores over what it would be of independent cells and sweeps; 1 at least."""
    score = score - score.mean()
    total = float(np.mean(score**2))
    for lag in range(1, min(LONGEST_LAG, len(score) // 4) + 1):
        total += 2.0 * (1.0 - lag / (LONGEST_LAG + 1)) * float(np.mean(score[lag:] * score[:-lag]))
    return max(total / expected, 1.0)


def _speed(series: SensorSeries, event: StepEvent, motion: Motion | None, approach: ApproachDetector) -> float:
    if motion is not None and motion.speed_m_s is not None and len(motion.speed_m_s.values):
        channel = motion.speed_m_s
        return max(abs(float(np.interp(event.time_s, channel.times_s, channel.values))), 0.1)
    trace = detect(approach, series)
    height = float(approach.height_m)
    range_m, rate = trace.range_m[event.sweep], trace.speed_m_s[event.sweep]
    if not (trace.impact_in_s[event.sweep] > 0 and range_m > height):
        raise ConfigError(f"the speed at {event.time_s:.3f} s is not known; give `speed_m_s` or the car's motion.")
    return float(-rate * range_m / math.sqrt(range_m**2 - height**2))


def _expected(event: StepEvent, speed: float, approach: ApproachDetector) -> tuple[float, float]:
    """When the edge passes below the sensor, and the standard deviation of that."""
    if event.impact_in_s is None:
        raise ConfigError(f"the event at {event.time_s:.3f} s does not say when the impact is; give `passes_s`.")
    until = event.impact_in_s - (float(approach.front_wheel_m) - float(approach.contact_m)) / speed
    return event.time_s + until, math.hypot(SPEED_SHARE * until, PLACE_M / speed)


def _rise(motion: Motion | None, from_s: float, until_s: float, lever: float) -> Callable[[np.ndarray], Any] | None:
    """The sensor's rise in metres over time: the acceleration integrated twice, both 0 at `from_s`; NaN beyond the end
    of what was recorded. None where that does not cover the time from `from_s` to `until_s`, or has gaps."""
    channel = None if motion is None else motion.acceleration_m_s2
    if channel is None:
        return None
    some = np.isfinite(channel.values) & (channel.times_s >= from_s - LONGEST_GAP_S)
    times, values = channel.times_s[some], channel.values[some]
    within = np.concatenate([[from_s], times[(times > from_s) & (times < until_s)], [until_s]])
    covers = times.size > 1 and times[0] <= from_s + LONGEST_GAP_S and times[-1] >= until_s - LONGEST_GAP_S
    if not covers or np.diff(within).max() > LONGEST_GAP_S:
        return None
    later = times >= from_s
    times, values = times[later], values[later]
    steps = np.diff(times)
    climb = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * steps)])
    rise = np.concatenate([[0.0], np.cumsum(0.5 * (climb[1:] + climb[:-1]) * steps)])
    return lambda at: lever * np.interp(at, times, rise, right=math.nan)
