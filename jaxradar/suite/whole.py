"""The suite as a whole: roads without a step, then every cell, and what of it goes into tables."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxradar.estimate.intervals import Estimate, percentile, proportion, rate
from jaxradar.suite.run import Found, Quiet, measure_negative, measure_step, threshold_at
from jaxradar.suite.scenes import NEGATIVES, StepCell
from jaxradar.systems.step import StepDetector

__all__ = ["CellScore", "QuietScore", "Suite", "run_suite", "suite_record"]

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class QuietScore:
    """Of one detector over roads without a step: detections an hour, the share of drives with any, and hours."""

    per_hour: Estimate
    drives: Estimate
    hours: float


@dataclass(frozen=True)
class CellScore:
    """Of one detector over one cell.

    - `in_time`: share of the drives in which it detected with 80 % of the lead that geometry allows, `ever`: at all
      before the impact; `at_one_per_hour`: in time, at the threshold of one false alarm an hour.
    - `lead_s`: percentiles 5, 50 and 95 of the lead, `of_allowed`: the median as a share of what geometry allows.
    - `impact_error_s`: percentiles 16, 50 and 84 of predicted minus true time to the impact; empty where it predicts
      none. `false`: false alarms a drive.
    """

    in_time: Estimate
    ever: Estimate
    at_one_per_hour: Estimate
    lead_s: tuple[Estimate, ...]
    of_allowed: float
    impact_error_s: tuple[float, ...]
    false: float


@dataclass(frozen=True, eq=False)
class Suite:
    """What came out: by detector, then by road or cell; `thresholds`: of one false alarm an hour, as a multiple of each
    detector's own; `roc`: rows of (multiple of the threshold, false alarms an hour, share of the steps of `roc_of`
    that are detected in time)."""

    quiet: Mapping[str, Mapping[str, QuietScore]]
    cells: Mapping[str, Mapping[StepCell, CellScore]]
    thresholds: Mapping[str, float]
    roc: Mapping[str, np.ndarray]
    roc_of: str


def run_suite(
    detectors: Mapping[str, StepDetector[Any, Any]],
    cells: Sequence[StepCell],
    count: int,
    hours: float,
    seed: int = 0,
    told: Progress = lambda what, share: None,
) -> Suite:
    """Every detector over `count` drives of each cell, and over so many hours without a step, all of held-out seeds."""
    parts = [max(8, math.ceil(3600.0 * hours * one.share / one.duration_s)) for one in NEGATIVES]
    seconds = sum(one.duration_s * part for one, part in zip(NEGATIVES, parts, strict=True))
    total = seconds + len(cells) * count * 1.5  # a drive over a step takes about so long
    done = 0.0

    def hear(name: str, weight: float) -> Callable[[int], None]:
        before = done
        return lambda drives: told(name, (before + weight * drives) / total)

    quiet: dict[str, dict[str, Quiet]] = {name: {} for name in detectors}
    for negative, part in zip(NEGATIVES, parts, strict=True):
        raised = measure_negative(negative, detectors, part, seed, hear(negative.name, negative.duration_s))
        for name, one in raised.items():
            quiet[name][negative.name] = one
        done += negative.duration_s * part
    thresholds = {
        name: threshold_at(
            np.concatenate([one.tops for one in held.values()]), sum(one.settled_hours for one in held.values())
        )
        for name, held in quiet.items()
    }
    found: dict[str, dict[StepCell, Found]] = {name: {} for name in detectors}
    for cell in cells:
        for name, held in measure_step(cell, detectors, count, seed, hear(cell.name, 1.5)).items():
            found[name][cell] = held
        done += 1.5 * count
    usual = [cell for cell in cells if not cell.variation and cell.height_m >= 0.02 and cell.speed_kmh >= 10.0]
    return Suite(
        quiet={name: {key: _quiet(one) for key, one in held.items()} for name, held in quiet.items()},
        cells={name: {key: _score(one, thresholds[name]) for key, one in held.items()} for name, held in found.items()},
        thresholds={name: _times(float(thresholds[name]), detectors[name]) for name in detectors},
        roc={name: _roc(quiet[name], [found[name][cell] for cell in usual], detectors[name]) for name in detectors},
        roc_of="steps up of 20 mm and more at 10 km/h and more",
    )


def _quiet(one: Quiet) -> QuietScore:
    return QuietScore(rate(one.events, one.hours), proportion(one.drives_with, one.drives), one.hours)


def _score(one: Found, threshold: float) -> CellScore:
    count = len(one.lead_s)
    seen = ~np.isnan(one.lead_s)
    leads = one.lead_s[seen]
    error = (one.expected_s - one.lead_s)[~np.isnan(one.expected_s)]
    return CellScore(
        in_time=proportion(int(one.in_time.sum()), count),
        ever=proportion(int(seen.sum()), count),
        at_one_per_hour=proportion(int((one.top > threshold).sum()), count),
        lead_s=tuple(percentile(leads, share) for share in (5.0, 50.0, 95.0)) if leads.size > 1 else (),
        of_allowed=float(np.median(leads / one.allowed_s[seen])) if leads.size else math.nan,
        impact_error_s=tuple(float(one) for one in np.percentile(error, (16.0, 50.0, 84.0))) if error.size else (),
        false=float(one.false.mean()),
    )


def _roc(quiet: Mapping[str, Quiet], found: Sequence[Found], detector: StepDetector[Any, Any]) -> np.ndarray:
    """Rates of false alarms and of detections over the threshold."""
    tops = np.sort(np.concatenate([one.tops for one in quiet.values()]))[::-1]
    hours = sum(one.settled_hours for one in quiet.values())
    steps = np.sort(np.concatenate([one.top for one in found])) if found else np.zeros(0)
    ranks = np.unique(np.geomspace(1, len(tops), 60).astype(int)) - 1
    thresholds = tops[ranks]
    share = np.full(len(thresholds), math.nan)
    if len(steps):
        share = 1.0 - np.searchsorted(steps, thresholds, side="right") / len(steps)
    times = np.array([_times(float(one), detector) for one in thresholds])
    # Of equal ones none exceeds itself.
    exceed = np.searchsorted(-tops, -thresholds, side="left")
    return np.stack([times, exceed / hours, share], axis=1)


def _times(threshold: float, detector: StepDetector[Any, Any]) -> float:
    """A threshold as a multiple of a detector's own."""
    own = float(detector.threshold)
    return threshold / own if own > 0 else math.nan


def suite_record(suite: Suite) -> dict[str, Any]:
    """As JSON knows it."""
    return {
        "quiet": {
            name: {key: dataclasses.asdict(one) for key, one in held.items()} for name, held in suite.quiet.items()
        },
        "cells": {
            name: [
                {"cell": cell.name, **dataclasses.asdict(cell), **dataclasses.asdict(one)} for cell, one in held.items()
            ]
            for name, held in suite.cells.items()
        },
        "threshold_of_one_false_alarm_an_hour": dict(suite.thresholds),
        "roc": {name: held.tolist() for name, held in suite.roc.items()},
        "roc_of": suite.roc_of,
    }
