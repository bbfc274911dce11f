"""What happened, for machines: a log of JSON lines."""

from __future__ import annotations

import contextlib
import json
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

__all__ = ["EventLog"]


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
            self._file = path.open("a", encoding="utf-8")
        except OSError as error:
            raise ConfigError(f"{path}: cannot be written ({error.strerror}).") from None
        self._faults = Fault(0)

    def begin(self, source: Source, header: Header, problems: Sequence[str]) -> None:
        self._header = header
        self._writer = Writer(self._file, direct=source.waits and source.period_s is None, lossy=True)
        self._note("begin", {"detector": header.detector, "sensors": list(source.sensors), "problems": list(problems)})

    def hear(self, live: LiveSweep, decision: LiveDecision, moment: Moment) -> None:
        if decision.event:
            self._note("event", event_record(decision, self._header.threshold))
        self._look(moment)

    def idle(self, moment: Moment) -> None:
        self._look(moment)

    def lost(self, why: str) -> None:
        self._note("lost", {"why": why})

    def end(self, tally: Tally) -> None:
        self._note("end", tally.record())
        self._writer.close()
        with contextlib.suppress(OSError):  # a full disk does not take what is left
            self._file.close()

    def say(self, sentence: str) -> None:
        """What others have to say."""
        self._note("said", {"sentence": sentence})

    def _look(self, moment: Moment) -> None:
        """Note other faults, and say whether lines are taken, where that has changed."""
        if moment.faults != self._faults:
            self._faults = moment.faults
            self._note("faults", {"time_s": moment.time_ns / NANOSECONDS, "faults": names(moment.faults)})
        if (problem := self._writer.problem) != self._problem:
            self._problem = problem
            self._say_aloud(f"{self._path}: {problem}. Trying again." if problem else f"{self._path}: written again.")

    def _note(self, what: str, record: dict[str, Any]) -> None:
        now = datetime.now(UTC).isoformat(timespec="milliseconds")
        self._writer.say(json.dumps({"utc": now, what: record}))
