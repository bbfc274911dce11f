"""Oblique steps: what one sensor in the middle reports too late for the wheel that is first, and what two recover."""

from __future__ import annotations

import dataclasses
import itertools
import math
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxradar.drive import Drive
from jaxradar.estimate.intervals import Estimate, percentile, proportion
from jaxradar.matching import MatchWindow
from jaxradar.sim import RoadScene, held_out_seeds, simulate_each
from jaxradar.suite.run import IN_TIME
from jaxradar.suite.scenes import KMH, StepCell, lead_allowed_s
from jaxradar.survey.pair import PairEvent, SensorPair, corner_detector, pair_events
from jaxradar.systems.step import StepDetector, detect_batch, stack
from jaxradar.systems.step.pipeline import trace_of
from jaxradar.systems.step.result import StepTrace

__all__ = ["Oblique", "ObliqueCell", "measure_oblique", "oblique_grid", "oblique_total"]

ROADS = (("wet", 0.02), ("wet", 0.03), ("specular", 0.02))
ANGLES_DEG = (20.0, 30.0, 40.0)
SPEEDS_KMH = (10.0, 20.0, 30.0, 40.0)
HALF_WIDTH_M = 1.1  # of the strip of road: what a sensor at either side sees too
FIELDS = ("range_m", "speed_m_s", "strength", "statistic", "impact_in_s", "valid", "saturated", "event")


@dataclass(frozen=True)
class ObliqueCell:
    """Drives over a step whose edge lies at an angle; seen by sensors at 0 and at ± `lateral_m`."""

    road: str
    speed_kmh: float
    height_m: float
    oblique_deg: float
    lateral_m: float = 0.5

    @property
    def name(self) -> str:
        """As tables show it."""
        return f"{self.road}, {self.speed_kmh:g} km/h, {1e3 * self.height_m:+g} mm, {self.oblique_deg:g}°"


@dataclass(frozen=True, eq=False)
class Oblique:
    """Of one cell or of several, each (drives,), NaN where there is none; leads are to the wheel that is first.

    - `one_s`, `two_s`: lead of the sensor in the middle, and of the pair; below 0 where the wheel was earlier.
    - `allowed_s`: what geometry allows a sensor in line with that wheel.
    - `angle_error_deg`, `wheels_error_s` (drives, 2): of the angle and of the two wheels' contacts, as predicted.
    """

    one_s: np.ndarray
    two_s: np.ndarray
    allowed_s: np.ndarray
    angle_error_deg: np.ndarray
    wheels_error_s: np.ndarray

    @property
    def late(self) -> np.ndarray:
        """Whether one sensor reports less than `IN_TIME` of what geometry allows before the impact, or nothing."""
        return ~(self.one_s >= IN_TIME * self.allowed_s)

    @property
    def told_late(self) -> np.ndarray:
        """Those of `late` that it reports at all: of the rest neither place nor angle is to blame, but a faint echo."""
        return self.late & ~np.isnan(self.one_s)

    @property
    def after(self) -> np.ndarray:
        """Whether it reports after the wheel has touched, or nothing."""
        return ~(self.one_s >= 0.0)

    @property
    def recovered(self) -> np.ndarray:
        """Of those that are `late`, which the pair reports in time."""
        return self.late & (self.two_s >= IN_TIME * self.allowed_s)

    def record(self) -> dict[str, Any]:
        """Counts and shares with their intervals, as JSON knows it."""
        drives, late = len(self.one_s), int(self.late.sum())
        angle = self.angle_error_deg[~np.isnan(self.angle_error_deg)]
        wheels = self.wheels_error_s[~np.isnan(self.wheels_error_s).any(axis=1)]

        def spread(values: np.ndarray) -> list[float]:
            return [float(one) for one in np.percentile(values, (16.0, 50.0, 84.0))] if values.size else []

        two_late = ~(self.two_s >= IN_TIME * self.allowed_s)
        return {
            "drives": drives,
            "late": late,
            "late_share": _share(late, drives),
            "told_late": int(self.told_late.sum()),
            "told_late_recovered": int((self.told_late & self.recovered).sum()),
            "told_late_recovered_share": _share(
                int((self.told_late & self.recovered).sum()), int(self.told_late.sum())
            ),
            "after": int(self.after.sum()),
            "never": int(np.isnan(self.one_s).sum()),
            "recovered": int(self.recovered.sum()),
            "recovered_share": _share(int(self.recovered.sum()), late),
            "pair_late_share": _share(int(two_late.sum()), drives),
            "pair_after": int((~(self.two_s >= 0.0)).sum()),
            "angle_known": int(angle.size),
            "angle_error_deg": spread(angle),
            "left_wheel_error_s": spread(wheels[:, 0]),
            "right_wheel_error_s": spread(wheels[:, 1]),
        }

    def gain_s(self) -> Estimate:
        """Median of what the pair is earlier by, where both report."""
        gain = (self.two_s - self.one_s)[~np.isnan(self.two_s - self.one_s)]
        return percentile(gain, 50.0) if gain.size else Estimate(math.nan, math.nan, math.nan)


def _share(count: int, total: int) -> dict[str, float] | None:
    return dataclasses.asdict(proportion(count, total)) if total else None


def oblique_grid(lateral_m: float = 0.5) -> Iterator[ObliqueCell]:
    """Wet and mirror-like roads, 10 to 40 km/h, edges at 20 to 40°."""
    for (road, height), speed, angle in itertools.product(ROADS, SPEEDS_KMH, ANGLES_DEG):
        yield ObliqueCell(road, speed, height, angle, lateral_m)


def oblique_total(found: Sequence[Oblique]) -> Oblique:
    """All of these together."""
    names = [one.name for one in dataclasses.fields(Oblique)]
    return Oblique(*(np.concatenate([getattr(one, name) for one in found]) for name in names))


def measure_oblique(
    cell: ObliqueCell,
    detector: StepDetector[Any, Any],
    count: int,
    seed: int = 0,
    told: Callable[[int], None] = lambda done: None,
    seeds: Callable[[int, int], list[int]] = held_out_seeds,
) -> Oblique:
    """What one sensor in the middle and a pair of sensors report in `count` drives of a cell.

    The three sensors are three scenes of one seed that differ in `mount.lateral_m` alone, so they see the same road,
    and the noise of their receivers is the same too. `told` hears how many drives are done.
    """
    drawn = seeds(zlib.crc32(cell.name.encode()) ^ seed, count + 1)
    random = np.random.default_rng(drawn[-1])
    usual = StepCell(cell.road, cell.speed_kmh, cell.height_m, oblique_deg=cell.oblique_deg)
    longer = (0.6 * math.tan(math.radians(cell.oblique_deg)) + 0.2) / (cell.speed_kmh / KMH)
    scenes = [
        dataclasses.replace(one, half_width_m=HALF_WIDTH_M, duration_s=one.duration_s + longer)
        for one in usual.scenes(count, random)
    ]
    middle, left, right = (_driven(scenes, drawn[:-1], place) for place in (0.0, cell.lateral_m, -cell.lateral_m))
    approach, pair = corner_detector(detector), SensorPair(first_m=cell.lateral_m, second_m=-cell.lateral_m)
    one = [trace.events for trace in _traces(detector, middle)]
    sides = [_traces(detector, side) for side in (left, right)]
    tracks = [_traces(approach, side) for side in (left, right)]
    rows = []
    for place, scene in enumerate(scenes):
        traces, corners = [side[place] for side in sides], [side[place] for side in tracks]
        rows.append(_row(scene, middle[place], one[place], pair_events(traces, corners, approach, pair), cell))
        told(place + 1)
    columns = list(zip(*rows, strict=True))
    return Oblique(*(np.array(column, float) for column in columns))


def _driven(scenes: Sequence[RoadScene], seeds: Sequence[int], lateral_m: float) -> list[Drive]:
    moved = [
        dataclasses.replace(scene, mount=dataclasses.replace(scene.mount, lateral_m=lateral_m)) for scene in scenes
    ]
    return list(simulate_each(moved, seeds))


def _traces(detector: StepDetector[Any, Any], drives: Sequence[Drive]) -> list[StepTrace]:
    series = [drive.sensors[0] for drive in drives]
    batch = stack(series, [drive.motion for drive in drives])
    found: Mapping[str, Any] = detect_batch(detector, *batch, fields=FIELDS)
    host = {name: np.asarray(values) for name, values in found.items()}
    return [
        trace_of(detector, one, {name: values[place, : len(one)] for name, values in host.items()})
        for place, one in enumerate(series)
    ]


def _row(
    scene: RoadScene, drive: Drive, one: Sequence[Any], two: Sequence[PairEvent], cell: ObliqueCell
) -> tuple[float, float, float, float, tuple[float, float]]:
    assert drive.truth is not None
    step = drive.truth.steps[0]
    assert step.wheels_s is not None
    speed = float(scene.motion.speed_m_s)
    right, left = step.wheels_s[:2]
    last = max(time for time in (right, left) if time is not None)
    # Who sits at one side, or looks across the edge, is right to report from farther away.
    aside = math.tan(math.radians(cell.oblique_deg))
    begin = step.impact_s - MatchWindow(metres=1.0 + aside * (0.5 + cell.lateral_m)).before(speed)

    def lead(times: Sequence[float]) -> float:
        return next((step.impact_s - time for time in times if begin <= time <= last), math.nan)

    alarms = [event for event in two if not event.is_roll]
    told = next((event for event in alarms if begin <= event.time_s <= last), None)
    angle, wheels = math.nan, (math.nan, math.nan)
    if told is not None and told.angle_deg is not None and told.wheels_s is not None:
        angle = told.angle_deg - cell.oblique_deg
        wheels = tuple(  # type: ignore[assignment]
            math.nan if true is None else predicted - true
            for predicted, true in zip(told.wheels_s, (left, right), strict=True)
        )
    allowed = lead_allowed_s(scene, speed, cell.height_m)
    return lead([event.time_s for event in one]), lead([event.time_s for event in alarms]), allowed, angle, wheels
