"""Sweeps in, detections out: the loop of live detection, who listens to it, and what it came to.

The loop belongs to `run`, in the thread of who calls it: it takes each sweep from the source, has it decided on, and
tells the listeners, one after the other. It ends when the source does. Whoever else wants it to end, a signal or
another thread, closes the source.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from jaxradar.drive import SweepFlag
from jaxradar.live.artefact import Header
from jaxradar.live.detect import LiveDecision, LiveDetector
from jaxradar.live.sweeps import LiveSweep, Source
from jaxradar.units import NANOSECONDS

__all__ = ["Listener", "Tally", "run"]

KEPT = 1 << 16  # durations: a sweep's place in there is its number modulo this


@dataclass
class Tally:
    """What a run came to so far: sweeps, those without data, detections, and what the detector took of each sweep.

    `missed`: sweeps that the source lost, `misfits`: those of a wrong length; both known at the end.
    """

    sweeps: int = 0
    invalid: int = 0
    events: int = 0
    first_ns: int = 0
    last_ns: int = 0
    missed: int = 0
    misfits: int = 0
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

    @property
    def duration_s(self) -> float:
        """Seconds from the first sweep to the last, on the clock of the source."""
        return (self.last_ns - self.first_ns) / NANOSECONDS

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
            "duration_s": self.duration_s,
            "took_us": {"median": self.took_us(0.5), "p99": self.took_us(0.99)},
            "missed": self.missed,
            "misfits": self.misfits,
        }


class Listener:
    """Hears of a run, in the thread of its loop: what may take longer than a sweep, a disk or a serial line, goes
    through a thread of its own. What a method raises ends the run. By itself it does nothing."""

    def begin(self, source: Source, header: Header, problems: Sequence[str]) -> None:
        """Before the first sweep: the source is open and gives what the detector takes. `problems`: what is not as it
        should be all the same, a sentence each."""

    def hear(self, live: LiveSweep, decision: LiveDecision) -> None:
        """A sweep, and what the detector says of it."""

    def end(self, tally: Tally) -> None:
        """After the last sweep, also where an error ended the run. Called once for each `begin` that returned."""


def run(
    source: Source, detector: LiveDetector, listeners: Sequence[Listener] = (), *, most: int | None = None
) -> Tally:
    """Through the sweeps of an open source to its end, or `most` of them; returns what they came to.

    Raises `ConfigError` if the detector does not take the source's sweeps, `SourceError` when the source fails, and
    what a listener raises; those that have begun hear `end` in any case, the last one first.
    """
    header = detector.header
    header.check_axis(source.range_m)
    header.check_amplitudes(source.dtype)
    tally, clock = Tally(), time.perf_counter_ns
    with contextlib.ExitStack() as ends:
        for listener in listeners:
            listener.begin(source, header, (*source.problems, *_blind(source, header)))
            ends.callback(listener.end, tally)
        ends.callback(_count_losses, tally, source, detector)  # before the listeners hear of the end
        for live in source:
            begin = clock()
            decision = detector.take(live)
            tally.add(live, decision, clock() - begin)
            for listener in listeners:
                listener.hear(live, decision)
            if tally.sweeps == most:
                break
    return tally


def _count_losses(tally: Tally, source: Source, detector: LiveDetector) -> None:
    tally.missed, tally.misfits = source.missed, detector.misfits


def _blind(source: Source, header: Header) -> list[str]:
    if not header.motion or source.tells_motion:
        return []
    return [f"{header.detector} goes by the car's motion too, of which this source tells nothing: by the sweeps alone."]
