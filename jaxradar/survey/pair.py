"""Two sensors side by side: the earliest of either is the alarm, and both together know the angle of the edge.

An edge at the angle ψ to the crosswise direction is nearer to the sensor, and to the wheel, on one side. The foot of
its face that a sensor sees lies across the edge, at the distance a = (x − y tan ψ) cos ψ from a sensor at the lateral
place y, x the way left in the middle. So two sensors differ by

    a₁ − a₂ = −(y₁ − y₂) sin ψ,

whatever the speed, and each shrinks at u = v cos ψ. A wheel at y_w has a₁/cos ψ + (y₁ − y_w) tan ψ to go.

A roll φ (left side up) lifts a sensor by y φ: what of the two ranges' changes is opposite is a roll, what is common is
the road, or the body's heave.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from jaxradar._errors import ConfigError
from jaxradar._settings import Settings, setting
from jaxradar._types import Setting
from jaxradar.drive import SensorSeries
from jaxradar.systems.step.approach import ApproachDetector
from jaxradar.systems.step.config import StepDetector
from jaxradar.systems.step.default import DefaultDetector
from jaxradar.systems.step.pipeline import detect
from jaxradar.systems.step.result import StepEvent, StepTrace

__all__ = ["PairEvent", "SensorPair", "corner_detector", "detect_pair", "pair_events"]

TRACK_S = 0.04  # of a corner's track before its detection that is held to be of the same corner
TRACK_M = 0.05  # scatter of a track's place, neighbouring sweeps taken as one
SPEED_SHARE = 0.1  # scatter of a track's speed: half of the way to the next of the bank
ROUNDS = 60
STEEPEST = 0.95  # of sin ψ
STILL_S = (0.3, 0.1)  # before an event: the ranges from which a roll moves them
MOSTLY = 2.0  # a change is a roll where its opposite part is so many times its common one


class SensorPair(Settings):
    """Two sensors on one car, in one row across it. Raises `ValueError` for two at one lateral place."""

    first_m: Setting = setting(0.35, -5.0, 5.0, "m", "how far left of the middle line the first sensor sits")
    second_m: Setting = setting(-0.35, -5.0, 5.0, "m", "and the second; below 0 on the right")
    half_track_m: Setting = setting(0.5, 0.0, 2.0, "m", "from the middle line to the front wheels")
    within_s: Setting = setting(0.5, 0.0, 10.0, "s", "so long after the first sensor the other may follow")

    def __check_init__(self) -> None:
        if float(self.first_m) == float(self.second_m):
            raise ValueError(
                "`SensorPair(first_m=..., second_m=...)` must be two lateral places; "
                f"got {float(self.first_m):g} m for both."
            )


@dataclass(frozen=True)
class PairEvent:
    """One step, as a pair of sensors sees it; times in seconds since the first sweep of the drive.

    - `time_s`: of the alarm, the earliest of either sensor; `place`: which of the two, 0 or 1; `event`: its own.
    - `followed_s`: when the other detected it too; None if it did not, and so the rest.
    - `angle_deg`: ψ of the edge, above 0 where the left wheel is first; `speed_m_s`: of the car.
    - `wheels_s`: when the front left and the front right wheel will touch it, as predicted at `followed_s`.
    - `roll_deg`: of the body, left side up, since a moment before the alarm, out of the echoes' ranges; None where
      these are not known. `is_roll`: whether it explains the alarm; never of a corner that closes in.
    """

    time_s: float
    place: int
    event: StepEvent
    followed_s: float | None = None
    angle_deg: float | None = None
    speed_m_s: float | None = None
    wheels_s: tuple[float, float] | None = None
    roll_deg: float | None = None
    is_roll: bool = False


class _Track(NamedTuple):
    """Where the corner was, of the sweeps in which it was followed."""

    times_s: np.ndarray
    ahead_m: np.ndarray
    speed_m_s: np.ndarray


def corner_detector(detector: StepDetector[Any, Any]) -> ApproachDetector:
    """What of a detector follows corners. Raises `ConfigError` if nothing does."""
    found = detector.approach if isinstance(detector, DefaultDetector) else detector
    if not isinstance(found, ApproachDetector):
        raise ConfigError(f"a pair of sensors needs a detector that follows corners; `{detector.name}` does not.")
    return found


def detect_pair(
    detector: StepDetector[Any, Any],
    series: Sequence[SensorSeries],
    pair: SensorPair | None = None,
    *,
    speed_m_s: float | None = None,
) -> tuple[PairEvent, ...]:
    """Find the steps in the sweeps of two sensors on one car, whose clocks are the drive's.

    `detector`: `default` or `approach`; `series`: of the first and the second sensor of `pair`; `speed_m_s`: of the
    car where it is known, otherwise that of the corner's tracks. Raises `ConfigError` for another detector and for
    series that share no time, `ValueError` unless there are two series.
    """
    if len(series) != 2:
        raise ValueError(f"`detect_pair` takes the series of two sensors; got {len(series)}.")
    approach = corner_detector(detector)
    traces = [detect(detector, one) for one in series]
    tracks = traces if detector is approach else [detect(approach, one) for one in series]
    return pair_events(traces, tracks, approach, pair or SensorPair(), speed_m_s=speed_m_s)


def pair_events(
    traces: Sequence[StepTrace],
    tracks: Sequence[StepTrace],
    approach: ApproachDetector,
    pair: SensorPair,
    *,
    speed_m_s: float | None = None,
) -> tuple[PairEvent, ...]:
    """The pair's events, in order, out of each sensor's own.

    `traces`: of the detector that decides; `tracks`: of `approach` over the same series, which says where corners are.
    Each event of either is an alarm, unless it follows one of the other sensor that nobody followed yet. Raises
    `ConfigError` for traces that share no time.
    """
    _check_times(traces)
    ordered = sorted((event.time_s, place, event) for place, one in enumerate(traces) for event in one.events)
    made: list[PairEvent] = []
    for time_s, place, event in ordered:
        leader = next(
            (
                at
                for at, one in enumerate(made)
                if one.place != place and one.followed_s is None and time_s - one.time_s <= float(pair.within_s)
            ),
            None,
        )
        if leader is None:
            roll, is_roll = _roll(traces, pair, event)
            made.append(PairEvent(time_s, place, event, roll_deg=roll, is_roll=is_roll))
        else:
            made[leader] = _followed(made[leader], time_s, tracks, approach, pair, speed_m_s)
    return tuple(made)


def _check_times(traces: Sequence[StepTrace]) -> None:
    if len(traces) != 2:
        raise ValueError(f"a pair has two traces; got {len(traces)}.")
    spans = [(float(one.times_s.min()), float(one.times_s.max())) for one in traces if len(one.times_s)]
    if len(spans) == 2 and max(low for low, _ in spans) >= min(high for _, high in spans):
        said = " and ".join(f"{low:g} to {high:g} s" for low, high in spans)
        raise ConfigError(f"the two sensors' series share no time: {said}. They must count from the same moment.")


def _followed(
    event: PairEvent,
    time_s: float,
    tracks: Sequence[StepTrace],
    approach: ApproachDetector,
    pair: SensorPair,
    speed_m_s: float | None,
) -> PairEvent:
    """With what both know at the moment at which the second saw it too."""
    since = [event.time_s if place == event.place else time_s for place in range(2)]
    held = [_track(one, float(approach.height_m), begin, time_s) for one, begin in zip(tracks, since, strict=True)]
    if not all(len(one.times_s) for one in held):
        return _with(event, followed_s=time_s)
    first, second = float(pair.first_m), float(pair.second_m)
    sine, closing = 0.0, _closing(held)
    for _ in range(ROUNDS if speed_m_s is not None else 1):  # a known speed closes in at v cos ψ
        if speed_m_s is not None:
            closing = abs(speed_m_s) * math.sqrt(1.0 - sine**2)
        ahead = [float(np.mean(one.ahead_m - closing * (time_s - one.times_s))) for one in held]
        told = max(-STEEPEST, min(-(ahead[0] - ahead[1]) / (first - second), STEEPEST))
        sine = told if speed_m_s is None else 0.5 * (sine + told)
    cosine = math.sqrt(1.0 - sine**2)
    speed = abs(speed_m_s) if speed_m_s is not None else closing / cosine
    middle = 0.5 * (ahead[0] + ahead[1]) / cosine + 0.5 * (first + second) * sine / cosine
    wheel = middle + float(approach.front_wheel_m) - float(approach.contact_m)
    aside = float(pair.half_track_m) * sine / cosine
    wheels = (time_s + (wheel - aside) / speed, time_s + (wheel + aside) / speed)
    angle = math.degrees(math.asin(sine))
    return _with(event, followed_s=time_s, angle_deg=angle, speed_m_s=speed, wheels_s=wheels)


def _with(event: PairEvent, **changed: Any) -> PairEvent:
    return PairEvent(**{**vars(event), **changed})


def _track(trace: StepTrace, height_m: float, since_s: float, until_s: float) -> _Track:
    """Of the sweeps from shortly before its detection on in which the corner was followed."""
    use = (trace.impact_in_s > 0) & (trace.times_s >= since_s - TRACK_S) & (trace.times_s <= until_s)
    use &= np.nan_to_num(trace.range_m) > height_m
    range_m = trace.range_m[use]
    ahead = np.sqrt(range_m**2 - height_m**2)
    return _Track(trace.times_s[use], ahead, -trace.speed_m_s[use] * range_m / ahead)


def _closing(held: Sequence[_Track]) -> float:
    """The speed at which both corners close in: that of the bank, and the slope of the places as far as it is known."""
    bank = float(np.mean([np.mean(one.speed_m_s) for one in held]))
    away = [one.times_s - one.times_s.mean() for one in held]
    spread = sum(float(np.mean(one**2)) for one in away)
    slope = -sum(float(np.mean(one * track.ahead_m)) for one, track in zip(away, held, strict=True))
    prior = (TRACK_M / (SPEED_SHARE * bank)) ** 2
    return (slope + prior * bank) / (spread + prior)


def _roll(traces: Sequence[StepTrace], pair: SensorPair, event: StepEvent) -> tuple[float | None, bool]:
    """Roll in degrees since a moment before an event, and whether it is what moved the ranges."""
    changes = []
    for one in traces:
        before = (one.times_s >= event.time_s - STILL_S[0]) & (one.times_s <= event.time_s - STILL_S[1]) & one.valid
        now = np.flatnonzero((one.times_s <= event.time_s) & one.valid)
        if not before.any() or not now.size:
            return None, False
        changes.append(float(one.range_m[now[-1]] - np.median(one.range_m[before])))
    common, opposite = 0.5 * (changes[0] + changes[1]), 0.5 * (changes[0] - changes[1])
    roll = 2.0 * opposite / float(pair.first_m - pair.second_m)
    return math.degrees(roll), event.impact_in_s is None and abs(opposite) > MOSTLY * abs(common)
