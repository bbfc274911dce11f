"""A run as a service: what systemd is told, and a log of what happened for machines."""

from __future__ import annotations

import contextlib
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

__all__ = ["EventLog", "Lines", "Serving"]


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


class Lines:
    """A file that lines are appended to, each whole or not at all as far as who reads it is concerned: half a line,
    of a full disk or of a program that was killed, is ended before the next one.

    Raises `OSError` if it cannot be opened, and never after that.
    """

    def __init__(self, path: Path) -> None:
        self.lost = 0
        self._file = path.open("ab", buffering=0)
        self._cut = False
        with contextlib.suppress(OSError, ValueError), path.open("rb") as before:  # a pipe cannot be looked at
            if before.seekable() and before.seek(0, 2):
                before.seek(-1, 2)
                self._cut = before.read(1) != b"\n"

    def write(self, text: str) -> None:
        """One line with its end, or none where it is not taken."""
        content = b"\n" * self._cut + text.encode()
        written = 0
        with contextlib.suppress(OSError):
            written = self._file.write(content) or 0
        if written:
            self._cut = content[:written][-1:] != b"\n"
        self.lost += written < len(content)

    def flush(self) -> None:
        """Nothing is held back."""

    def close(self) -> None:
        """Close it."""
        with contextlib.suppress(OSError):
            self._file.close()


class EventLog(Listener):
    """Appends a JSON line to a file for each detection, each time that other faults are there, each loss of the source,
    what others say, the begin and the end; each with the time of the day, in UTC, and of the sweeps.

    A disk that does not take a line loses that line and ends nothing. Raises `ConfigError` if the file cannot be
    opened.
    """

    def __init__(self, path: Path) -> None:
        try:
            self._file = Lines(path)
        except OSError as error:
            raise ConfigError(f"{path}: cannot be written ({error.strerror}).") from None
        self._faults = self._of_moment = Fault(0)

    def begin(self, source: Source, header: Header, problems: Sequence[str]) -> None:
        self._header = header
        self._writer = Writer(self._file, direct=source.waits and source.period_s is None)
        self._note("begin", {"detector": header.detector, "sensors": list(source.sensors), "problems": list(problems)})

    def hear(self, live: LiveSweep, decision: LiveDecision, moment: Moment) -> None:
        if decision.event:
            self._note("event", event_record(decision, self._header.threshold))
        # Of all sensors together, or one that fails beside one that does not is news at each of their sweeps.
        self._of_moment |= moment.faults
        if live.last:
            self._change(moment.time_ns, self._of_moment)
            self._of_moment = Fault(0)

    def idle(self, moment: Moment) -> None:
        self._change(moment.time_ns, moment.faults)

    def lost(self, why: str) -> None:
        self._note("lost", {"why": why})

    def end(self, tally: Tally) -> None:
        self._note("end", tally.record())
        self._writer.close()
        self._file.close()
        if lost := self._file.lost + self._writer.dropped:
            tally.more["events"] = {"lost": lost}

    def say(self, sentence: str) -> None:
        """What others have to say."""
        self._note("said", {"sentence": sentence})

    def _change(self, time_ns: int, faults: Fault) -> None:
        if faults != self._faults:
            self._faults = faults
            self._note("faults", {"time_s": time_ns / 1e9, "faults": names(faults)})

    def _note(self, what: str, record: dict[str, Any]) -> None:
        now = datetime.now(UTC).isoformat(timespec="milliseconds")
        self._writer.say(json.dumps({"utc": now, what: record}))


def names(faults: Fault) -> list[str]:
    """Of `jaxradar.live.board.Fault`, in lower case."""
    return [one.name.lower() for one in Fault if one in faults and one.name]


def named(faults: Fault) -> str:
    """The same as text."""
    return ", ".join(names(faults)).replace("_", " ")
