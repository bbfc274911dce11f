"""What is kept of one sensor of one log: small enough to be kept of thousands, and to be sent between machines."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxradar.drive import Drive, SensorSeries
from jaxradar.matching import Matching, Score
from jaxradar.systems.step import StepEvent, StepTrace

__all__ = ["Drawn", "Events", "Failure", "Picture", "SeriesResult", "failure_record", "record_of"]


@dataclass(frozen=True)
class Failure:
    """A log that could not be evaluated: `path`, and a sentence that says why. `wrong_option`: because it has not got
    what was selected."""

    path: str
    error: str
    wrong_option: bool = False


@dataclass(frozen=True, eq=False)
class Picture:
    """A series small enough for a page: columns of equal time.

    - `start_s`, `stop_s`: of the first and the last column.
    - `range_m`: (2, columns) float32, least and greatest of the followed range; NaN where nothing was valid.
    - `speed_m_s`: (2, columns) float32, likewise of its rate of change.
    - `statistic`: (columns,) float32, the greatest. `event`: (columns,) bool, whether there is a detection.
    - `amplitude`: (rows, columns) uint8, of some single sweeps, the mean over some bins, as a share of its 99.9th
      percentile under a square root; row 0 is the nearest.
    - `near_m`, `far_m`: of its first and last bin.
    """

    start_s: float
    stop_s: float
    range_m: np.ndarray
    speed_m_s: np.ndarray
    statistic: np.ndarray
    event: np.ndarray
    amplitude: np.ndarray
    near_m: float
    far_m: float


@dataclass(frozen=True, eq=False)
class Drawn:
    """What a figure is drawn of: kept only where it is asked for."""

    drive: Drive
    series: SensorSeries
    trace: StepTrace
    matching: Matching | None


@dataclass(frozen=True, eq=False)
class Events:
    """What was detected, in columns: a detector that alarms at every sweep is kept in a few numbers each.

    `time_s`, `range_m`, `strength`, `statistic`, `impact_in_s`: float64, as in `StepEvent`, the last NaN where it is
    not known. `sweep`: int64, its index in the log.
    """

    time_s: np.ndarray
    range_m: np.ndarray
    strength: np.ndarray
    statistic: np.ndarray
    impact_in_s: np.ndarray
    sweep: np.ndarray
    threshold: float

    def __len__(self) -> int:
        return len(self.time_s)

    def __iter__(self) -> Iterator[StepEvent]:
        columns = (self.time_s, self.range_m, self.strength, self.statistic, self.impact_in_s, self.sweep)
        for *values, impact_in_s, sweep in zip(*(column.tolist() for column in columns), strict=True):
            known = None if math.isnan(impact_in_s) else impact_in_s
            time_s, range_m, strength, statistic = values
            yield StepEvent(time_s, range_m, strength, statistic, self.threshold, sweep, known)


@dataclass(frozen=True, eq=False)
class SeriesResult:
    """One sensor of one log.

    - `path`: the log. `sensor`: its number.
    - `sweeps`, `duration_s`, `sweep_rate_hz`: of the part that was looked at.
    - `invalid_sweeps`: in which the log or the detector saw no echo.
    - `events`: what was detected.
    - `score`: steps, which of them were hit, and false alarms; None where the truth is not known.
    - `problems`: sentences of the log's reader.
    """

    path: str
    sensor: int
    sweeps: int
    duration_s: float
    sweep_rate_hz: float | None
    invalid_sweeps: int
    events: Events
    score: Score | None
    problems: tuple[str, ...] = ()
    picture: Picture | None = None
    drawn: Drawn | None = None


def record_of(result: SeriesResult) -> dict[str, Any]:
    """A result as JSON knows it."""
    score = result.score
    return {
        "path": result.path,
        "sensor": result.sensor,
        "sweeps": result.sweeps,
        "duration_s": result.duration_s,
        "sweep_rate_hz": result.sweep_rate_hz,
        "invalid_sweeps": result.invalid_sweeps,
        "problems": list(result.problems),
        "detections": [vars(event) for event in result.events],
        "hits": None if score is None else score.hits,
        "misses": None if score is None else score.misses,
        "false_alarms": None if score is None else score.false_alarms,
        "lead_s": None if score is None else list(score.lead_s),
    }


def failure_record(failure: Failure) -> dict[str, Any]:
    """Likewise."""
    return {"path": failure.path, "error": failure.error}
