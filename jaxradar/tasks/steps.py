"""Steps in the road: who misses how many, and how late, when all raise equally many false alarms."""

from __future__ import annotations

import bisect
import dataclasses
import math
from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np

from jaxradar._numerics import compiled
from jaxradar.drive import Drive, RoadStep
from jaxradar.evaluation import match_steps
from jaxradar.pareto import Candidate, Case, Figure, Program, Score, Task, mean, percentile, share
from jaxradar.sim import SURFACES, RoadScene, StepUp, drive_seeds, load_scene, simulate_batch
from jaxradar.systems.step import (
    DefaultDetector,
    LabLiveDetector,
    RangeAxis,
    RangeRateDetector,
    StepDetector,
    ThesisDetector,
    detect_batch,
    precision,
    time_steps,
)

__all__ = ["HELD_OUT", "StepDetection", "StepDrives"]

SPEEDS_KMH = (10.0, 20.0, 30.0, 40.0)
HEIGHTS_M = (0.02, 0.04, 0.06)
AFTER_S = 0.75  # until the sensor's line of sight meets the step
HELD_OUT = 1_000_003  # the seed that held-out drives come of; nothing may be tuned on these
FACTORS = tuple(2.0 ** (0.5 * step) for step in range(-4, 21))  # of a detector's own threshold
KMH = 3.6


class StepDrives(NamedTuple):
    """A batch as `detect_batch` takes it, beside its times and its truth."""

    sweeps: np.ndarray
    flags: np.ndarray
    dt: np.ndarray
    lengths: np.ndarray
    times_s: np.ndarray
    steps: tuple[tuple[RoadStep, ...], ...]
    allowed_s: np.ndarray  # the lead that geometry allows, NaN without a step

    @property
    def duration_s(self) -> float:
        last = np.maximum(self.lengths - 1, 0)
        return float(np.take_along_axis(self.times_s, last[:, None], axis=1).sum())


@dataclasses.dataclass(frozen=True, eq=False)
class StepInputs:
    """`tuning`: drives without a step that thresholds are set on; `drives`: held out, with steps and without."""

    axis: RangeAxis
    tuning: StepDrives
    drives: StepDrives


def _batch(drives: Sequence[Drive], allowed_s: Sequence[float]) -> StepDrives:
    series = [drive.sensors[0] for drive in drives]
    lengths = np.array([len(one) for one in series], np.int32)
    rows = int(lengths.max())

    def padded(values: list[np.ndarray]) -> np.ndarray:
        whole = np.zeros((len(values), rows, *values[0].shape[1:]), values[0].dtype)
        for place, one in enumerate(values):
            whole[place, : len(one)] = one
        return whole

    return StepDrives(
        padded([np.asarray(one.sweeps) for one in series]),
        padded([one.flags for one in series]),
        padded([time_steps(one.times_ns) for one in series]),
        lengths,
        padded([one.times_s for one in series]),
        tuple(drive.truth.steps if drive.truth else () for drive in drives),
        np.asarray(allowed_s),
    )


class StepDetection(Task):
    """Drives over a step up, and over none, on one surface at several speeds.

    Each detector's threshold is set on tuning drives without a step, to the least on a grid of half octaves that
    raises at most `false_alarms_per_s`; then it is held against drives of other seeds. A step counts as missed unless
    `match_steps` finds a detection for it. The delay counts from when the sensor's line of sight meets the step.
    """

    name = "steps"
    title = "Steps in the road"
    item = "sweep"
    error_name = "missed"
    unit = "%"

    def __init__(self, drives: int | None = None, false_alarms_per_s: float = 0.2, seed: int = 0) -> None:
        """`drives`: of each speed and height, and as many times three without a step of each speed."""
        if not false_alarms_per_s > 0:
            raise ValueError(f"`StepDetection(false_alarms_per_s=...)` must be > 0; got {false_alarms_per_s}.")
        self.drives, self.false_alarms_per_s, self.seed = drives, false_alarms_per_s, seed

    def cases(self, quick: bool = False) -> Sequence[Case]:
        names = ("asphalt",) if quick else tuple(SURFACES)
        speeds, heights = ((20.0, 30.0), (0.04,)) if quick else (SPEEDS_KMH, HEIGHTS_M)
        return [self._case(name, speeds, heights, self.drives or (12 if quick else 20)) for name in names]

    def _case(self, surface: str, speeds: Sequence[float], heights: Sequence[float], count: int) -> Case:
        base = dataclasses.replace(
            load_scene("trial-averaged"), surface=SURFACES[surface], vehicle=None, duration_s=1.1
        )
        base = dataclasses.replace(base, effects=tuple(one for one in base.effects if one.name != "accelerometer"))
        over = [_over(base, speed, height) for speed in speeds for height in heights for _ in range(count)]
        quiet = [_over(base, speed, 0.0) for speed in speeds for _ in range(3 * count)]
        held = _drives([*over, *quiet], drive_seeds(HELD_OUT + self.seed, len(over) + len(quiet)))
        tuning = _drives(quiet, drive_seeds(self.seed, len(quiet)))
        axis = RangeAxis.of(held[0].sensors[0].range_m)
        allowed = [*(_allowed_s(scene) for scene in over), *([math.nan] * len(quiet))]
        inputs = StepInputs(axis, _batch(tuning, [math.nan] * len(quiet)), _batch(held, allowed))
        return Case(
            name=surface,
            inputs=inputs,
            truth=inputs.drives.steps,
            items=int(inputs.drives.lengths.sum()),
            about=(
                f"{len(over)} steps up of {' to '.join(f'{1e3 * one:g}' for one in _ends(heights))} mm on {surface} at "
                f"{' to '.join(f'{one:g}' for one in _ends(speeds))} km/h, at most {self.false_alarms_per_s:g} "
                f"false alarms/s"
            ),
            setting={"false_alarms_per_s": self.false_alarms_per_s},
        )

    def candidates(self, quick: bool = False) -> Sequence[Candidate]:
        held: dict[str, StepDetector[Any, Any]] = {
            "default": DefaultDetector(),
            "thesis": ThesisDetector(),
            "range-rate, soft-argmax": RangeRateDetector(),
        }
        if not quick:
            held |= {
                "range-rate, arg-max": RangeRateDetector(peak="arg-max"),
                "range-rate, parabola": RangeRateDetector(peak="parabola"),
                "range-rate, matched filter": RangeRateDetector(peak="matched filter"),
                "lab-live": LabLiveDetector(),
                "default, cells of 10 mm": DefaultDetector(cell_m=0.01),
                "default, cells of 40 mm": DefaultDetector(cell_m=0.04),
            }
        return [
            Candidate(name, partial(self._prepare, one), {"detector": one.name}, default=name == "default")
            for name, one in held.items()
        ]

    def _prepare(self, detector: StepDetector[Any, Any], case: Case) -> Program:
        inputs: StepInputs = case.inputs
        tuned = self._tuned(detector, inputs)
        return Program(
            lambda: _events(tuned, inputs.axis, inputs.drives), case.items, _single(tuned, inputs.axis, inputs.drives)
        )

    def _tuned(self, detector: StepDetector[Any, Any], inputs: StepInputs) -> StepDetector[Any, Any]:
        most = self.false_alarms_per_s * inputs.tuning.duration_s

        def quiet(place: int) -> bool:
            tuned = with_threshold(detector, FACTORS[place])
            return sum(map(len, _events(tuned, inputs.axis, inputs.tuning))) <= most

        # The higher the threshold, the fewer.
        place = bisect.bisect_left(range(len(FACTORS)), True, key=quiet)
        if place == len(FACTORS):
            raise ValueError(f"not even {FACTORS[-1]:g} times its threshold keeps false alarms that rare.")
        return with_threshold(detector, FACTORS[place])

    def score(self, case: Case, answer: Any, items: int) -> Score:
        inputs: StepInputs = case.inputs
        missed = steps = 0
        leads: list[float] = []
        delays: list[float] = []
        false: list[float] = []
        for place, times in enumerate(answer):
            found = match_steps(times, inputs.drives.steps[place])
            if found.steps:
                steps += len(found.steps)
                missed += found.misses
                leads += found.lead_s
                delays += [float(inputs.drives.allowed_s[place]) - lead for lead in found.lead_s]
            else:
                false.append(float(found.false_alarms))
        each_s = inputs.drives.duration_s / len(answer)
        details: dict[str, Figure] = {"false alarms/s": mean(np.array(false)).scaled(1.0 / each_s)}
        if leads:
            details["lead ms"] = percentile(np.array(leads), 50.0).scaled(1e3)
            details["delay ms"] = percentile(np.array(delays), 50.0).scaled(1e3)
        return Score(share(missed, steps).scaled(100.0), details)


def _ends(values: Sequence[float]) -> Sequence[float]:
    return values if len(values) < 2 else (min(values), max(values))


def _over(base: RoadScene, speed_kmh: float, height_m: float) -> RoadScene:
    """A step that the line of sight meets after `AFTER_S`."""
    speed = speed_kmh / KMH
    at_m = speed * AFTER_S + float(base.mount.height_m) / math.tan(math.radians(float(base.mount.angle_deg)))
    motion = dataclasses.replace(base.motion, speed_m_s=speed)
    return dataclasses.replace(base, motion=motion, road=(StepUp(at_m=at_m, height_m=height_m),))


def _allowed_s(scene: RoadScene) -> float:
    """From when the line of sight meets the step until its axle is above it; the tyre touches it earlier."""
    mount = scene.mount
    ahead = float(mount.front_wheel_m) + float(mount.height_m) / math.tan(math.radians(float(mount.angle_deg)))
    return ahead / float(scene.motion.speed_m_s)


def _drives(scenes: Sequence[RoadScene], seeds: Sequence[int]) -> list[Drive]:
    return simulate_batch(scenes, seeds)


def with_threshold(detector: StepDetector[Any, Any], factor: float) -> StepDetector[Any, Any]:
    """The detector with its threshold, and the hysteresis that hangs on it, times `factor`, within their bounds."""
    changed = {}
    for one in dataclasses.fields(detector):
        value = getattr(detector, one.name)
        if value is detector.threshold or one.name == "release":
            changed[one.name] = min(factor * float(value), one.metadata["high"])
    return dataclasses.replace(detector, **changed)


def _events(detector: StepDetector[Any, Any], axis: RangeAxis, drives: StepDrives) -> list[np.ndarray]:
    """Times of the detections in each drive."""
    dt = drives.dt if detector.float64 else drives.dt.astype(np.float32)
    found = detect_batch(detector, axis, drives.sweeps, drives.flags, dt, drives.lengths, ("event",))
    return [times[hit] for times, hit in zip(drives.times_s, np.asarray(found["event"]), strict=True)]


def _single(detector: StepDetector[Any, Any], axis: RangeAxis, drives: StepDrives) -> Any:
    """One sweep at a time, as a car does it."""

    def step(detector: Any, state: Any, sweep: Any, flags: Any, dt: Any) -> Any:
        return detector.track(axis, state, detector.observe(axis, sweep, flags), None, dt)

    program = compiled(step)
    with precision(detector):
        state = detector.init(axis)

    def call() -> Any:
        with precision(detector):
            return jax.block_until_ready(
                program(detector, state, drives.sweeps[0, 0], drives.flags[0, 0], drives.dt[0, 1])
            )

    return call
