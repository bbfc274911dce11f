"""A run as a service: what systemd is told, and a log of what happened for machines."""

from __future__ import annotations

import json
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from jaxradar._errors import ConfigError
from jaxradar.live.artefact import Header
from jaxradar.live.board import Fault
from jaxradar.live.detect import LiveDecision
from jaxradar.live.printed import event_record
from jaxradar.live.run import Listener, Moment
from jaxradar.live.sweeps import LiveSweep, Source
from jaxradar.live.systemd import Notifier
from jaxradar.live.tally import Tally
from jaxradar.live.writer import Writer

__all__ = ["EventLog", "Serving"]


class Serving(Listener):
    """Says to systemd that it is ready with the first sweep, alive as long as the loop goes round, and ending."""

    def __init__(self) -> None:
        self._notifier = Notifier()
        self._sweeps = self._events = 0

    def hear(self, live: LiveSweep, decision: LiveDecision, moment: Moment) -> None:
        self._events += decision.event
        if not self._sweeps:
            self._notifier.ready("sweeps are coming")
        self._sweeps += 1
        self._alive(moment.faults)

    def idle(self, moment: Moment) -> None:
        self._alive(moment.faults)

    def end(self, tally: Tally) -> None:
        self._notifier.stopping()

    def _alive(self, faults: Fault) -> None:
        self._notifier.alive(lambda: f"{self._sweeps} sweeps, {self._events} detections; {named(faults) or 'all well'}")


class EventLog(Listener):
    """Appends a JSON line to a file for each detection, each time that other faults are there, each loss of the source,
    what others say, the begin and the end; each with the time of the day, in UTC, and of the sweeps.

    Raises `ConfigError` if the file cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        try:
            self._file = path.open("a", encoding="utf-8")
        except OSError as error:
            raise ConfigError(f"{path}: cannot be written ({error.strerror}).") from None
        self._faults = Fault(0)

    def begin(self, source: Source, header: Header, problems: Sequence[str]) -> None:
        self._header = header
        self._writer = Writer(self._file, direct=source.waits and source.period_s is None)
        self._note("begin", {"detector": header.detector, "sensors": list(source.sensors), "problems": list(problems)})

    def hear(self, live: LiveSweep, decision: LiveDecision, moment: Moment) -> None:
        if decision.event:
            self._note("event", event_record(decision, self._header.threshold))
        if moment.faults != self._faults:
            self._change(moment)

    def idle(self, moment: Moment) -> None:
        if moment.faults != self._faults:
            self._change(moment)

    def lost(self, why: str) -> None:
        self._note("lost", {"why": why})

    def end(self, tally: Tally) -> None:
        self._note("end", tally.record())
        try:
            self._writer.close()
        finally:
            self._file.close()

    def say(self, sentence: str) -> None:
        """What others have to say."""
        self._note("said", {"sentence": sentence})

    def _change(self, moment: Moment) -> None:
        self._faults = moment.faults
        self._note("faults", {"time_s": moment.time_ns / 1e9, "faults": names(moment.faults)})

    def _note(self, what: str, record: dict[str, Any]) -> None:
        now = datetime.now(UTC).isoformat(timespec="milliseconds")
        self._writer.say(json.dumps({"utc": now, what: record}))


def names(faults: Fault) -> list[str]:
    """Of `jaxradar.live.board.Fault`, in lower case."""
    return [one.name.lower() for one in Fault if one in faults and one.name]


def named(faults: Fault) -> str:
    """The same as text."""
    return ", ".join(names(faults)).replace("_", " ")
