"""Acconeer's own A111 distance detector beside ours, sweep for sweep: `python benches/run.py acconeer`.

Needs `acconeer-exptool`, in an environment of its own if need be: it asks for an old rich.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

import numpy as np
import subject
from data import UnavailableError, make_batch
from measure import around, figure, ratio, rounds, say, spread
from report import Row, Section
from settings import Settings

__all__ = ["measure"]

BINS, SPAN_M = 827, (0.2, 0.6)  # the detector's default interval at the sensor's 0.484 mm
THEIRS = ("fixed", "cfar")  # kinds of threshold; all other settings but the averaging are the default ones
NEAR_M, MOST_FAR = 0.010, 0.05  # the top of an echo of 40 mm wanders by some millimetres in noise


def _theirs(threshold: str, sweeps: np.ndarray) -> Callable[[], list[float]]:
    """A call that feeds all sweeps to a new processor; the distance of its main peak in each, or nothing."""
    try:
        a111 = importlib.import_module("acconeer.exptool.a111")
        theirs = importlib.import_module("acconeer.exptool.a111.algo.distance_detector")
    except ImportError as why:
        raise UnavailableError(f"acconeer-exptool cannot be imported ({why}).") from None
    sensor: Any = a111.EnvelopeServiceConfig()
    sensor.range_interval, sensor.update_rate, sensor.running_average_factor = list(SPAN_M), 300.0, 0.0
    session = {"data_length": BINS, "range_start_m": SPAN_M[0], "range_length_m": SPAN_M[1] - SPAN_M[0]}
    settings = theirs.ProcessingConfiguration()
    settings.threshold_type = settings.ThresholdType[threshold.upper()]
    settings.nbr_average = 1  # a decision for each sweep, as ours makes one
    settings.peak_sorting_type = settings.PeakSorting.STRONGEST

    @np.errstate(invalid="ignore")  # the variance of its background is now and then rounded to below 0
    def run() -> list[float]:
        processor = theirs.Processor(sensor, settings, session)
        found = (processor.process(sweep, None)["found_peaks"] for sweep in sweeps)
        return [float(processor.r[peaks[0]]) if peaks else np.nan for peaks in found]

    return run


def _agrees(found: np.ndarray, track_m: np.ndarray) -> tuple[float, float]:
    """Median distance to the simulated echo in mm, and the share of sweeps in which it is more than `NEAR_M`."""
    error = np.abs(np.asarray(found, np.float64) - track_m)
    return float(np.nanmedian(error)) * 1e3, float(np.mean(~(error <= NEAR_M)))


def measure(settings: Settings) -> Section:
    logs, fed = (2, 100) if settings.quick else (16, 400)
    title = f"{BINS} bins; theirs fed {fed} sweeps one by one, ours a batch of {logs} logs; {settings.rounds} rounds"
    columns = ("detector", "us a sweep", "10..90 %", "/fixed", "10..90 %", "median error mm", "off by > 10 mm")
    section = Section("acconeer", title, columns)
    batch = make_batch(logs, BINS, SPAN_M, distinct=4, white=False)
    calls: dict[str, Callable[[], Any]] = {}
    sweeps: dict[str, int] = {}
    errors: dict[str, tuple[float, float]] = {}
    try:
        for threshold in THEIRS:
            name = f"Acconeer, {threshold} threshold"
            calls[name], sweeps[name] = _theirs(threshold, batch.sweeps[0, :fed]), fed
            errors[name] = _agrees(np.array(calls[name]()), batch.track_m[0, :fed])
    except UnavailableError as why:
        section.notes.append(f"Skipped: {why}")
        return section
    for row in ("thesis", "default"):
        detector = subject.build(row, batch.range_m)
        name = f"jaxradar, {row}"
        calls[name] = subject.runner(detector, batch, subject.place(detector, batch))
        sweeps[name] = batch.count
        errors[name] = _agrees(calls[name]().distance[0], batch.track_m[0])
    for name, (_, far) in errors.items():
        if far > MOST_FAR:
            section.failed = True
            section.notes.append(f"WRONG, not timed: {name}: more than 10 mm off in {far:.1%} of the sweeps.")
            del calls[name]
    first = f"Acconeer, {THEIRS[0]} threshold"
    if first not in calls:
        return section
    say("the maker's detector takes milliseconds a sweep")
    times = rounds(calls, settings.rounds, "acconeer")
    each = {name: seconds / sweeps[name] for name, seconds in times.items()}
    for name, values in each.items():
        took, against = spread(values).scaled(1e6), ratio(values, each[first])
        cells = [name, figure(took.median), around(took), figure(against.median), around(against)]
        cells += [figure(errors[name][0]), f"{errors[name][1]:.2%}"]
        section.rows.append(Row(name, cells, {"us": took.median}, None if name == first else against))
    section.notes.append("Theirs also keeps what its plot shows; it is made for one sensor, not for batches.")
    return section
