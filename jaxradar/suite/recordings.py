"""Real recordings of a car that stands: what a detector raises on them, and what it finds of steps put into them.

A step that is put in displaces the whole profile from one sweep on. That says whether a detector still sees through
real noise and real echoes, not how it does on a road.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from jaxradar.drive import SensorSeries
from jaxradar.estimate.intervals import Estimate, proportion
from jaxradar.sim.inject import inject_step, retimed
from jaxradar.systems.step import StepDetector, detect_batch, stack, thin

__all__ = ["FORMS", "Form", "Recorded", "found_in_time", "measure_recordings", "recorded_record"]

Form = Literal["scaled", "pencil"]
INJECTED_M = (0.01, 0.02, 0.03, 0.05, 0.08)
RATES_HZ = (None, 100.0, 300.0)  # None: a recording's own
FORMS: tuple[Form, Form] = ("scaled", "pencil")
FIRST_SWEEPS = (35, 50, 65, 80)
READY_S, DEADLINE_S = 0.1, 0.040
SENSOR_HEIGHT_M = 0.335  # over the road, of the public recordings at 45°


@dataclass(frozen=True)
class Recorded:
    """Of one detector over standing recordings.

    - `alarms`: detections by sweep rate, None for a recording's own; `seconds`: how long they are at it.
    - `injected`: by sweep rate and height, the share of the steps put in that it finds within 40 ms. The interval is of
      as many as there are recordings: what is found in one at one place is likely found in it at another.
    """

    alarms: Mapping[float | None, int]
    seconds: Mapping[float | None, float]
    injected: Mapping[tuple[float, float], Estimate]


def measure_recordings(
    detectors: Mapping[str, StepDetector[Any, Any]],
    recordings: Sequence[SensorSeries],
    told: Callable[[str, float], None] = lambda what, share: None,
) -> dict[str, Recorded]:
    """Every detector over recordings of a car that stands, at their own rate and with their times rewritten.

    Steps are put into those long enough: `FIRST_SWEEPS` say where.
    """
    alarms: dict[str, dict[float | None, int]] = {name: dict.fromkeys(RATES_HZ, 0) for name in detectors}
    seconds: dict[float | None, float] = dict.fromkeys(RATES_HZ, 0.0)
    work = len(RATES_HZ) + len(RATES_HZ[1:]) * len(INJECTED_M)
    done = 0
    for rate in RATES_HZ:
        for series in recordings:
            timed = series if rate is None else retimed(series, rate)
            seconds[rate] += timed.duration_s
            batch = stack([timed])
            for name, detector in detectors.items():
                alarms[name][rate] += int(np.asarray(detect_batch(detector, *batch, fields=("event",))["event"]).sum())
        done += 1
        told("standing recordings", done / work)
    injected: dict[str, dict[tuple[float, float], Estimate]] = {name: {} for name in detectors}
    for rate in RATES_HZ[1:]:
        assert rate is not None
        for height_m in INJECTED_M:
            for name, detector in detectors.items():
                found = [
                    found_in_time(detector, series, height_m, SENSOR_HEIGHT_M, form, rate)
                    for form in FORMS
                    for series in recordings
                    if _long_enough(series, rate)
                ]
                if found:
                    share, trials = float(np.mean(found)), len(found) // len(FORMS)
                    injected[name][rate, height_m] = _of_so_many(share, trials)
            done += 1
            told("steps put into recordings", done / work)
    return {name: Recorded(alarms[name], seconds, injected[name]) for name in detectors}


def found_in_time(
    detector: StepDetector[Any, Any],
    series: SensorSeries,
    height_m: float,
    sensor_height_m: float,
    form: Form,
    rate_hz: float,
    bins: int | None = None,
) -> float:
    """Share of the steps put into a recording, one at a time at each of `FIRST_SWEEPS`, that a detector finds within
    `DEADLINE_S`, `READY_S` into the log; a height of 0 puts nothing in, and gives what it finds of nothing. With `bins`
    it sees so many of them."""
    parts = list(_injected(series, height_m, sensor_height_m, form, rate_hz))
    parts = [thin(part, bins) for part in parts] if bins else parts
    event = np.asarray(detect_batch(detector, *stack(parts), fields=("event",))["event"])
    return float(event[:, round(READY_S * rate_hz) :].any(axis=1).mean())


def _injected(
    series: SensorSeries, height_m: float, sensor_height_m: float, form: Form, rate_hz: float
) -> Iterator[SensorSeries]:
    before, after = _around(rate_hz)
    for first in FIRST_SWEEPS:
        cut = slice(first - before, first + after + 1)
        part = dataclasses.replace(
            series, times_ns=series.times_ns[cut], sweeps=series.sweeps[cut], flags=series.flags[cut]
        )
        yield inject_step(retimed(part, rate_hz), height_m, before, sensor_height_m, form)


def _around(rate_hz: float) -> tuple[int, int]:
    """Sweeps before the step and after it."""
    return round(READY_S * rate_hz), int(DEADLINE_S * rate_hz + 1e-9)


def _long_enough(series: SensorSeries, rate_hz: float) -> bool:
    before, after = _around(rate_hz)
    return before <= FIRST_SWEEPS[0] and FIRST_SWEEPS[-1] + after < len(series)


def _of_so_many(share: float, trials: int) -> Estimate:
    """A share with the interval that it has among so many independent ones."""
    exact = proportion(round(share * trials), trials)
    return Estimate(share, min(exact.low, share), max(exact.high, share))


def recorded_record(one: Recorded) -> dict[str, Any]:
    """As JSON knows it."""
    return {
        "alarms": [
            {"rate_hz": rate, "alarms": count, "seconds": one.seconds[rate]} for rate, count in one.alarms.items()
        ],
        "injected": [
            {"rate_hz": rate, "height_m": height, **dataclasses.asdict(share)}
            for (rate, height), share in one.injected.items()
        ],
    }
