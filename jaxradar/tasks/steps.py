"""Steps in the road: who misses how many, and how late, when all raise equally many false alarms."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from jaxradar._numerics import compiled
from jaxradar.drive import Drive, RoadStep
from jaxradar.matching import MatchWindow, match_steps
from jaxradar.pareto import Candidate, Case, Data, Estimate, Program, Score, Task, percentile, proportion, rate
from jaxradar.sim import SURFACES, RoadScene, StepUp, drive_seeds, held_out_seeds, load_scene, simulate_batch
from jaxradar.systems.step import (
    ApproachDetector,
    DefaultDetector,
    LabLiveDetector,
    RangeRateDetector,
    ShiftDetector,
    StepDetector,
    SweepBatch,
    ThesisDetector,
    detect_batch,
    precision,
    stack,
)

__all__ = ["StepDetection", "StepDrives", "StepInputs"]

AFTER_S = 0.75  # until the sensor's line of sight meets the step
VIEW = MatchWindow(seconds=0.0)  # as far before the impact as the sensor can see the step
LOWEST, HIGHEST, HALVINGS = 0.25, 1024.0, 9  # times a detector's own threshold, within 2 %
KMH = 3.6


class StepDrives(NamedTuple):
    """A batch as `detect_batch` takes it, beside each sweep's time and the truth."""

    batch: SweepBatch
    times_s: tuple[np.ndarray, ...]
    steps: tuple[tuple[RoadStep, ...], ...]
    view_s: np.ndarray  # from where the step comes into the range window to the impact, NaN without a step

    @property
    def durations_s(self) -> np.ndarray:
        """(drives,) seconds from the first to the last sweep."""
        return np.array([times[-1] for times in self.times_s])


@dataclasses.dataclass(frozen=True, eq=False)
class StepInputs:
    """`tuning`: drives without a step that thresholds are set on; `drives`: held out, with steps and without."""

    tuning: StepDrives
    drives: StepDrives


def _batch(drives: Sequence[Drive], view_s: Sequence[float]) -> StepDrives:
    series = [drive.sensors[0] for drive in drives]
    steps = tuple(drive.truth.steps if drive.truth else () for drive in drives)
    return StepDrives(stack(series), tuple(one.times_s for one in series), steps, np.asarray(view_s))


class StepDetection(Task):
    """Drives over a step up, and over none, on one surface at several speeds.

    Each detector's threshold is set on tuning drives without a step, to the least that raises at most
    `false_alarms_per_s` there; then it is held against drives of other seeds. A step counts as missed unless a
    detection comes between the moment at which it comes into the sensor's range window (`VIEW`) and the tyre's touch.
    The delay counts from the moment at which the line of sight meets it, and is negative before; "by luck" is the share
    of the steps that detections at the rate of the false alarms would find.
    """

    name = "steps"
    title = "Steps in the road"
    item = "sweep"
    error_name = "missed"
    unit = "%"

    def __init__(
        self,
        drives: int | None = None,
        false_alarms_per_s: float = 0.2,
        seed: int = 0,
        surfaces: Sequence[str] = tuple(SURFACES),
        speeds_kmh: Sequence[float] = (10.0, 20.0, 30.0, 40.0),
        heights_m: Sequence[float] = (0.02, 0.04, 0.06),
    ) -> None:
        """`drives`: of each speed and height, and three times as many without a step of each speed; 20, or 8 if quick.
        Raises `ValueError` for a rate that is not above 0."""
        if not false_alarms_per_s > 0:
            raise ValueError(f"`StepDetection(false_alarms_per_s=...)` must be > 0; got {false_alarms_per_s}.")
        self.drives, self.false_alarms_per_s, self.seed = drives, false_alarms_per_s, seed
        self.surfaces, self.speeds_kmh, self.heights_m = tuple(surfaces), tuple(speeds_kmh), tuple(heights_m)

    def cases(self, quick: bool = False) -> Sequence[Case]:
        """One surface each; if `quick` one, wet asphalt where it is among them, at two speeds and one height."""
        if quick:
            # On a dry one speckle hides what is ahead: hardly any detector sees a step, and all are alike.
            surface = "wet-asphalt" if "wet-asphalt" in self.surfaces else self.surfaces[0]
            return [self._case(surface, self.speeds_kmh[1:3], self.heights_m[1:2], self.drives or 8)]
        return [self._case(name, self.speeds_kmh, self.heights_m, self.drives or 20) for name in self.surfaces]

    def _case(self, surface: str, speeds: Sequence[float], heights: Sequence[float], count: int) -> Case:
        return Case(
            name=surface,
            draw=lambda: self._data(surface, speeds, heights, count),
            about=(
                f"{len(speeds) * len(heights) * count} steps up of {_span(heights, 1e3)} mm on {surface} at "
                f"{_span(speeds)} km/h, at most {self.false_alarms_per_s:g} false alarms/s"
            ),
            conditions={"false_alarms_per_s": self.false_alarms_per_s},
        )

    def _data(self, surface: str, speeds: Sequence[float], heights: Sequence[float], count: int) -> Data:
        base = load_scene("trial")
        effects = tuple(one for one in base.effects if one.name != "accelerometer")
        base = dataclasses.replace(base, surface=SURFACES[surface], vehicle=None, duration_s=1.1, effects=effects)
        over = [_over(base, speed, height) for speed in speeds for height in heights for _ in range(count)]
        quiet = [_over(base, speed, 0.0) for speed in speeds for _ in range(3 * count)]
        held = simulate_batch([*over, *quiet], held_out_seeds(self.seed, len(over) + len(quiet)))
        tuning = simulate_batch(quiet, drive_seeds(self.seed, len(quiet)))
        nothing = [math.nan] * len(quiet)
        drives = _batch(held, [*(VIEW.before(float(scene.motion.speed_m_s)) for scene in over), *nothing])
        inputs = StepInputs(_batch(tuning, nothing), drives)
        return Data(inputs, drives.steps, int(drives.batch.lengths.sum()))

    def candidates(self, quick: bool = False) -> Sequence[Candidate]:
        held: dict[str, StepDetector[Any, Any]] = {
            "default": DefaultDetector(),
            "shift": ShiftDetector(),
            "approach": ApproachDetector(),
            "thesis": ThesisDetector(),
            "range-rate, soft-argmax": RangeRateDetector(),
        }
        if not quick:
            held |= {
                "range-rate, arg-max": RangeRateDetector(peak="arg-max"),
                "range-rate, parabola": RangeRateDetector(peak="parabola"),
                "range-rate, matched filter": RangeRateDetector(peak="matched filter"),
                "lab-live": LabLiveDetector(),
                "shift, cells of 10 mm": ShiftDetector(cell_m=0.01),
                "shift, cells of 40 mm": ShiftDetector(cell_m=0.04),
            }
        return [self.candidate(name, one) for name, one in held.items()]

    def candidate(self, name: str, detector: StepDetector[Any, Any]) -> Candidate:
        """A detector, one's own for instance; its threshold is tuned, the rest is as it is."""
        settings: dict[str, float | str] = {"detector": detector.name}
        return Candidate(name, partial(self._prepare, detector), settings, default=name == "default")

    def _prepare(self, detector: StepDetector[Any, Any], data: Data) -> Program:
        inputs: StepInputs = data.inputs
        tuned = self._tuned(detector, inputs)
        return Program(lambda: _events(tuned, inputs.drives), data.items, _single(tuned, inputs.drives.batch))

    def _tuned(self, detector: StepDetector[Any, Any], inputs: StepInputs) -> StepDetector[Any, Any]:
        most = self.false_alarms_per_s * float(inputs.tuning.durations_s.sum())

        def tuned(factor: float) -> StepDetector[Any, Any]:
            return detector.with_threshold(factor * float(detector.threshold))

        def quiet(factor: float) -> bool:
            return sum(map(len, _events(tuned(factor), inputs.tuning))) <= most

        low, high = LOWEST, HIGHEST
        if quiet(low):
            return tuned(low)
        if not quiet(high):
            raise ValueError(f"not even {HIGHEST:g} times its threshold keeps false alarms that rare.")
        for _ in range(HALVINGS):
            middle = math.sqrt(low * high)
            low, high = (low, middle) if quiet(middle) else (middle, high)
        return tuned(high)

    def score(self, data: Data, answer: Any, items: int) -> Score:
        drives: StepDrives = data.inputs.drives
        missed = steps = false = 0
        leads: list[float] = []
        delays: list[float] = []
        reach: list[float] = []
        for times, its_steps, view_s in zip(answer, drives.steps, drives.view_s, strict=True):
            if not its_steps:
                false += len(times)
                continue
            window = MatchWindow(float(view_s), 0.0)
            found = match_steps(times, its_steps, window=window)
            steps, missed = steps + len(found.steps), missed + found.misses
            reach.append(window.seconds)
            leads += found.lead_s
            delays += [float(times[hit]) - AFTER_S for hit in found.hit_by if hit is not None]
        quiet_s = sum(time for time, its in zip(drives.durations_s, drives.steps, strict=True) if not its)
        alarms = rate(false, float(quiet_s))
        luck = [
            100.0 * float(-np.expm1(-one * np.array(reach)).mean()) for one in (alarms.value, alarms.low, alarms.high)
        ]
        details = {"false alarms/s": alarms, "by luck %": Estimate(*luck)}
        if leads:
            details["lead ms"] = percentile(np.array(leads), 50.0).scaled(1e3)
            details["delay ms"] = percentile(np.array(delays), 50.0).scaled(1e3)
        return Score(proportion(missed, steps).scaled(100.0), details)


def _span(values: Sequence[float], factor: float = 1.0) -> str:
    ends = sorted({factor * min(values), factor * max(values)})
    return " to ".join(f"{one:g}" for one in ends)


def _over(base: RoadScene, speed_kmh: float, height_m: float) -> RoadScene:
    """A step that the line of sight meets after `AFTER_S`."""
    speed = speed_kmh / KMH
    at_m = speed * AFTER_S + float(base.mount.height_m) / math.tan(math.radians(float(base.mount.angle_deg)))
    motion = dataclasses.replace(base.motion, speed_m_s=speed)
    return dataclasses.replace(base, motion=motion, road=(StepUp(at_m=at_m, height_m=height_m),))


def _events(detector: StepDetector[Any, Any], drives: StepDrives) -> list[np.ndarray]:
    """Times of the detections in each drive."""
    found = detect_batch(detector, *drives.batch, fields=("event",))
    return [times[hit[: len(times)]] for times, hit in zip(drives.times_s, np.asarray(found["event"]), strict=True)]


def _single(detector: StepDetector[Any, Any], batch: SweepBatch) -> Any:
    """One sweep at a time, as a car does it."""

    # The axis is an argument: NumPy's array in a program's closure would be single for all later programs (jax 0.10).
    def step(detector: Any, axis: Any, state: Any, sweep: Any, flags: Any, dt: Any) -> Any:
        return detector.track(axis, state, detector.observe(axis, sweep, flags), None, dt)

    program = compiled(step)
    with precision(detector):
        state = detector.init(batch.axis)

    def call() -> Any:
        with precision(detector):
            return program(detector, batch.axis, state, batch.sweeps[0, 0], batch.flags[0, 0], batch.dt[0, 1])

    return call
