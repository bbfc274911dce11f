"""Sweeps in, detections out: the loop of live detection, and what it came to."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from jaxradar.drive import SweepFlag
from jaxradar.live.detect import LiveDecision, LiveDetector
from jaxradar.live.sweeps import LiveSweep, Source
from jaxradar.units import NANOSECONDS

__all__ = ["Tally", "event_record", "run"]

KEPT = 1 << 16  # durations: a sweep's place in there is its number modulo this


@dataclass
class Tally:
    """What a run came to so far: sweeps, those without data, detections, and what the detector took of each sweep."""

    sweeps: int = 0
    invalid: int = 0
    events: int = 0
    first_ns: int = 0
    last_ns: int = 0
    _took_ns: np.ndarray = field(default_factory=lambda: np.zeros(KEPT, np.int64))

    def add(self, live: LiveSweep, decision: LiveDecision, took_ns: int) -> None:
        """Count one sweep."""
        if not self.sweeps:
            self.first_ns = live.time_ns
        self.last_ns = live.time_ns
        self._took_ns[self.sweeps % KEPT] = took_ns
        self.sweeps += 1
        self.invalid += bool(live.flags & SweepFlag.INVALID)
        self.events += decision.event

    def took_us(self, share: float) -> float:
        """The quantile `share` of what the detector took of the last sweeps, in microseconds; 0 before the first."""
        took = self._took_ns[: self.sweeps]
        return float(np.quantile(took, share)) / 1e3 if len(took) else 0.0

    def record(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "sweeps": self.sweeps,
            "invalid": self.invalid,
            "events": self.events,
            "duration_s": (self.last_ns - self.first_ns) / NANOSECONDS,
            "took_us": {"median": self.took_us(0.5), "p99": self.took_us(0.99)},
        }


def event_record(decision: LiveDecision, threshold: float) -> dict[str, Any]:
    """A detection for JSON, under the names of `jaxradar.StepEvent`."""
    return {
        "sensor": decision.sensor,
        "sweep": decision.place,
        "time_s": decision.time_ns / NANOSECONDS,
        "range_m": decision.range_m,
        "strength": decision.strength,
        "statistic": decision.statistic,
        "threshold": threshold,
        "impact_in_s": decision.impact_in_s or None,
    }


def run(source: Source, detector: LiveDetector, tally: Tally, each: Callable[[LiveDecision], None]) -> None:
    """Through all sweeps of an open source. `each` hears every decision."""
    for live, decision, took_ns in _decided(source, detector):
        tally.add(live, decision, took_ns)
        each(decision)


def _decided(source: Source, detector: LiveDetector) -> Iterator[tuple[LiveSweep, LiveDecision, int]]:
    clock = time.perf_counter_ns
    for live in source:
        begin = clock()
        decision = detector.take(live)
        yield live, decision, clock() - begin
