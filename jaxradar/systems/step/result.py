"""What a step detector says of one series of sweeps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["StepEvent", "StepTrace"]


@dataclass(frozen=True)
class StepEvent:
    """One detection.

    `time_s` is the time of the sweep whose arrival made the decision, in seconds since the first sweep of the drive,
    never back-dated; `sweep` its index; `impact_in_s` the predicted time from then until a front wheel touches the
    step, None where it is not known. `range_m` is the slant range then, `strength` the echo's amplitude over the noise
    floor in the log's own counts, `statistic` what was compared with `threshold`.
    """

    time_s: float
    range_m: float
    strength: float
    statistic: float
    threshold: float
    sweep: int
    impact_in_s: float | None = None


@dataclass(frozen=True, eq=False)
class StepTrace:
    """All that a detector found out about one series, one value for each sweep.

    - `times_s`: (sweeps,) float64.
    - `range_m`: (sweeps,) slant range of the echo that is followed; NaN where `valid` is false.
    - `speed_m_s`: (sweeps,) its rate of change; NaN where `valid` is false, 0 where nothing came before.
    - `strength`: (sweeps,) amplitude over the noise floor.
    - `statistic`: (sweeps,) what is compared with `threshold`, 0 where there is none.
    - `impact_in_s`: (sweeps,) predicted time until a front wheel touches what is coming, 0 where that is not known.
    - `valid`, `saturated`: (sweeps,) bool.
    - `events`: in order of the sweeps.
    - `statistic_name`, `statistic_unit`: for axes and tables.
    """

    sensor: int
    times_s: np.ndarray
    range_m: np.ndarray
    speed_m_s: np.ndarray
    strength: np.ndarray
    statistic: np.ndarray
    impact_in_s: np.ndarray
    valid: np.ndarray
    saturated: np.ndarray
    threshold: float
    statistic_name: str
    statistic_unit: str
    events: tuple[StepEvent, ...]
