"""What a run came to."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from jaxradar.drive import SweepFlag
from jaxradar.live.detect import LiveDecision
from jaxradar.live.sweeps import LiveSweep
from jaxradar.units import NANOSECONDS

__all__ = ["Durations", "Tally"]

KEPT = 1 << 16  # durations


class Durations:
    """The last `KEPT` of them, in memory that does not grow."""

    def __init__(self) -> None:
        self._ns = np.full(KEPT, 0, np.int64)  # `zeros` is given its memory page by page, and a run would seem to leak
        self.count = 0

    def add(self, ns: int) -> None:
        """One more, in nanoseconds."""
        self._ns[self.count % KEPT] = ns
        self.count += 1

    def us(self, share: float) -> float:
        """Their quantile `share` in microseconds; 0 before the first."""
        held = self._ns[: self.count]
        return float(np.quantile(held, share)) / 1e3 if len(held) else 0.0

    def record(self) -> dict[str, float]:
        """For JSON, in microseconds."""
        return {"median": self.us(0.5), "p99": self.us(0.99), "p99.9": self.us(0.999), "most": self.us(1.0)}


@dataclass
class Tally:
    """What a run came to so far: sweeps, those without data, detections, and what the detector took of each sweep.

    `late`: sweeps that were decided on more than a period after they came; `silent`: periods without a sweep. Known at
    the end: `missed`, sweeps that the source lost; `misfits`, those of a wrong length; `dropped`, those that came
    faster than they were taken; `reopened`, how often the source was opened again; `busy`, the share of a processor
    that the whole program took meanwhile; `more`, what listeners have to tell.
    """

    sweeps: int = 0
    invalid: int = 0
    events: int = 0
    first_ns: int = 0
    last_ns: int = 0
    late: int = 0
    silent: int = 0
    missed: int = 0
    misfits: int = 0
    dropped: int = 0
    reopened: int = 0
    busy: float = 0.0
    took: Durations = field(default_factory=Durations)
    more: dict[str, dict[str, Any]] = field(default_factory=dict)

    def add(self, live: LiveSweep, decision: LiveDecision, took_ns: int) -> None:
        """Count one sweep."""
        if not self.sweeps:
            self.first_ns = live.time_ns
        self.last_ns = live.time_ns
        self.took.add(took_ns)
        self.sweeps += 1
        self.invalid += bool(live.flags & SweepFlag.INVALID)
        self.events += decision.event

    @property
    def duration_s(self) -> float:
        """Seconds from the first sweep to the last, on the clock of the source."""
        return (self.last_ns - self.first_ns) / NANOSECONDS

    def record(self) -> dict[str, Any]:
        """For JSON."""
        names = ("sweeps", "invalid", "events", "missed", "misfits", "late", "silent", "dropped", "reopened")
        held = {name: getattr(self, name) for name in names}
        return (
            held
            | {"duration_s": self.duration_s, "processor_share": self.busy, "took_us": self.took.record()}
            | self.more
        )
