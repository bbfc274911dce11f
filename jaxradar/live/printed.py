"""What a run prints: detections on standard output as they come, in words or as JSON, and at the end a summary."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from typing import Any

from jaxradar.live.artefact import Header
from jaxradar.live.detect import LiveDecision
from jaxradar.live.run import Listener, Moment
from jaxradar.live.sweeps import LiveSweep, Source
from jaxradar.live.tally import Tally
from jaxradar.live.writer import Writer, close_all
from jaxradar.units import NANOSECONDS

__all__ = ["CLEAR", "InJson", "InWords", "event_record"]

CLEAR = "\r\x1b[K"  # a terminal's line, from its begin on


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
    """A line for each detection; problems and the summary on standard error. `before`: is printed before each line, to
    clear what a display shows there."""

    def __init__(self, before: str = "") -> None:
        self._before = before

    def begin(self, source: Source, header: Header, problems: Sequence[str]) -> None:
        """Say the problems."""
        self._header = header
        direct = source.waits and source.period_s is None
        self._out, self._err = Writer(sys.stdout, direct=direct), Writer(sys.stderr, direct=direct)
        for problem in problems:
            self._err.say(problem)

    def hear(self, live: LiveSweep, decision: LiveDecision, moment: Moment) -> None:
        """Say a detection, at once."""
        if decision.event:
            self._out.say(self._before + self.line(decision))

    def lost(self, why: str) -> None:
        """Say that the source is being opened again."""
        self.say(f"{why} Trying again.")

    def say(self, sentence: str) -> None:
        """Something that others have to say, once it has begun."""
        self._err.say(self._before + sentence)

    def end(self, tally: Tally) -> None:
        """Say the summary."""
        self._err.say(_summary(tally))
        close_all(self._out, self._err)

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
        self._out.say(json.dumps({"summary": tally.record()}))
        close_all(self._out, self._err)


def _summary(tally: Tally) -> str:
    parts = [
        f"{tally.sweeps} sweeps in {tally.duration_s:.1f} s",
        f"{tally.events} detection{'' if tally.events == 1 else 's'}",
    ]
    lost = (
        (tally.missed, "missed"),
        (tally.misfits, "of a wrong length"),
        (tally.late, "late"),
        (tally.dropped, "dropped"),
    )
    parts += [f"{count} {what}" for count, what in lost if count]
    if tally.reopened:
        parts.append(f"the sensor back {tally.reopened} times")
    if tally.sweeps:
        parts.append(f"{tally.took.us(0.5):.0f} µs a sweep (99 %: {tally.took.us(0.99):.0f})")
        parts.append(f"{100 * tally.busy:.0f} % of a processor")
    more = [words(tally.more[name]) for name, words in _MORE.items() if name in tally.more]
    return ". ".join([", ".join(parts), *more]) + "."


def _board(found: Mapping[str, Any]) -> str:
    took = found["told_after_us"]
    lost = f", {found['dropped']} not" if found["dropped"] else ""
    return (
        f"Board told {found['told']} times{lost}, {took['median']:.0f} µs after the sweep (99.9 %: {took['p99.9']:.0f})"
    )


def _recorded(found: Mapping[str, Any]) -> str:
    lost = f", {found['dropped']} not" if found["dropped"] else ""
    why = f" ({found['problem']})" if found["problem"] else ""
    return f"{found['sweeps']} sweeps recorded{lost}{why}"


def _events(found: Mapping[str, Any]) -> str:
    return f"{found['lost']} lines of the event log were not taken by the disk"


_MORE = {"board": _board, "recorded": _recorded, "events": _events}
