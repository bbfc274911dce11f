"""What a run prints: detections on standard output as they come, in words or as JSON, and at the end a summary."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from typing import Any

from jaxradar.live.artefact import Header
from jaxradar.live.detect import LiveDecision
from jaxradar.live.run import Listener, Tally
from jaxradar.live.sweeps import LiveSweep, Source
from jaxradar.units import NANOSECONDS

__all__ = ["InJson", "InWords", "event_record"]


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


class InWords(Listener):
    """A line for each detection; problems and the summary on standard error."""

    def begin(self, source: Source, header: Header, problems: Sequence[str]) -> None:
        """Say the problems."""
        self._header = header
        for problem in problems:
            print(problem, file=sys.stderr)

    def hear(self, live: LiveSweep, decision: LiveDecision) -> None:
        """Say a detection, at once."""
        if decision.event:
            print(self.line(decision), flush=True)

    def end(self, tally: Tally) -> None:
        """Say the summary."""
        print(_summary(tally), file=sys.stderr)

    def line(self, decision: LiveDecision) -> str:
        """A detection."""
        impact = f", impact in {decision.impact_in_s * 1e3:.0f} ms" if decision.impact_in_s else ""
        return (
            f"{decision.time_ns / NANOSECONDS:10.3f} s  sensor {decision.sensor}: step {decision.range_m:.3f} m away"
            f"{impact} ({self._header.statistic_name} {decision.statistic:.3g}, above {self._header.threshold:.3g})"
        )


class InJson(InWords):
    """The same as JSON lines, `{"event": ...}` and at the end `{"summary": ...}`; problems in words."""

    def line(self, decision: LiveDecision) -> str:
        """A detection."""
        return json.dumps({"event": event_record(decision, self._header.threshold)})

    def end(self, tally: Tally) -> None:
        """Print the summary."""
        print(json.dumps({"summary": tally.record()}), flush=True)


def _summary(tally: Tally) -> str:
    parts = [
        f"{tally.sweeps} sweeps in {tally.duration_s:.1f} s",
        f"{tally.events} detection{'' if tally.events == 1 else 's'}",
    ]
    lost = ((tally.missed, "missed"), (tally.misfits, "of a wrong length"))
    parts += [f"{count} {what}" for count, what in lost if count]
    if tally.sweeps:
        parts.append(f"{tally.took_us(0.5):.0f} µs a sweep (99 %: {tally.took_us(0.99):.0f})")
    return ", ".join(parts) + "."
