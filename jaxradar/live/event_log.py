"""What happened, for machines: a log of JSON lines."""

from __future__ import annotations

import contextlib
import errno
import json
import os
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from jaxradar._errors import ConfigError
from jaxradar.live.artefact import Header
from jaxradar.live.board import Fault, names
from jaxradar.live.detect import LiveDecision
from jaxradar.live.printed import event_record
from jaxradar.live.run import Listener, Moment
from jaxradar.live.sweeps import LiveSweep, Source
from jaxradar.live.tally import Tally
from jaxradar.live.writer import Writer
from jaxradar.units import NANOSECONDS

__all__ = ["EventLog", "Lines"]


class Lines:
    """A file that lines are appended to: half a line, of a full disk or of a program that was killed, is ended before
    the next one. `lost`: lines that were not taken whole.

    Raises `OSError` if it cannot be opened, and for a line that is lost.
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
        """One line with its end."""
        if not text:
            return
        content = b"\n" * self._cut + text.encode()
        try:
            written = self._file.write(content) or 0
            if written:
                self._cut = content[:written][-1:] != b"\n"
            if written < len(content):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError:
            self.lost += 1
            raise

    def flush(self) -> None:
        """Nothing is held back."""

    def close(self) -> None:
        """Close it."""
        with contextlib.suppress(OSError):
            self._file.close()


class EventLog(Listener):
    """Appends a JSON line to a file for each detection, each time that other faults are there, each loss of the source,
    what others say, the begin and the end; each with the time of the day, in UTC, and detections and faults with that
    of the sweeps, in seconds.

    `say`: takes a sentence when the disk takes no lines, which are then lost, and when it takes them again; the run
    goes on. Raises `ConfigError` if the file cannot be opened.
    """

    def __init__(self, path: Path, say: Callable[[str], None] = lambda sentence: None) -> None:
        self._path, self._say_aloud, self._problem = path, say, ""
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
            self._look(moment.time_ns, self._of_moment)
            self._of_moment = Fault(0)

    def idle(self, moment: Moment) -> None:
        self._look(moment.time_ns, moment.faults)

    def lost(self, why: str) -> None:
        self._note("lost", {"why": why})

    def end(self, tally: Tally) -> None:
        self._note("end", tally.record())
        with contextlib.suppress(OSError):  # which was said
            self._writer.close()
        self._file.close()
        if lost := self._file.lost + self._writer.dropped:
            tally.more["events"] = {"lost": lost}

    def say(self, sentence: str) -> None:
        """What others have to say."""
        self._note("said", {"sentence": sentence})

    def _look(self, time_ns: int, faults: Fault) -> None:
        """Note other faults, and say whether lines are taken, where that has changed."""
        if faults != self._faults:
            self._faults = faults
            self._note("faults", {"time_s": time_ns / NANOSECONDS, "faults": names(faults)})
        if (problem := self._writer.problem) != self._problem:
            self._problem = problem
            self._say_aloud(f"{self._path}: {problem}. Trying again." if problem else f"{self._path}: written again.")

    def _note(self, what: str, record: dict[str, Any]) -> None:
        now = datetime.now(UTC).isoformat(timespec="milliseconds")
        self._writer.say(json.dumps({"utc": now, what: record}))
