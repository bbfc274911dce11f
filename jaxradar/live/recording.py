"""The recorder as a listener of a run."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path

from jaxradar.live.artefact import Header
from jaxradar.live.board import Fault
from jaxradar.live.detect import LiveDecision
from jaxradar.live.recorder import Recorder, folder_for_drives
from jaxradar.live.run import Listener, Moment
from jaxradar.live.sweeps import LiveSweep, Source
from jaxradar.live.tally import Tally

__all__ = ["Recording"]

_LATELY_S = 1.0  # so long after a loss the recorder is said to be failing


class Recording(Listener):
    """Every sweep that comes, and every acceleration that a board tells, into drives in a folder.

    `say`: takes a sentence when something goes wrong. Raises `ConfigError` if the folder cannot be made.
    """

    def __init__(
        self,
        folder: Path,
        *,
        accelerations: bool = False,
        rotate_bytes: int | None = None,
        rotate_s: float | None = None,
        say: Callable[[str], None] = lambda sentence: None,
    ) -> None:
        self._folder, self._accelerations, self._say = folder_for_drives(folder), accelerations, say
        given = {"rotate_bytes": rotate_bytes, "rotate_s": rotate_s}
        self._options = {name: value for name, value in given.items() if value is not None}
        self.recorder: Recorder | None = None
        self._dropped, self._until_s, self._problem = 0, 0.0, ""
        self._heard = False

    @property
    def fault(self) -> Fault:  # type: ignore[override]
        """`RECORDER` while the disk takes nothing, and a moment after sweeps were lost."""
        if self.recorder is None:
            return Fault(0)
        recorded = self.recorder.recorded
        if recorded.dropped > self._dropped:
            self._dropped, self._until_s = recorded.dropped, time.monotonic() + _LATELY_S
        if recorded.problem != self._problem:
            self._problem = recorded.problem
            self._say(f"{self._problem} Trying again." if self._problem else f"{self._folder}: recording again.")
        return Fault.RECORDER if recorded.problem or time.monotonic() < self._until_s else Fault(0)

    def state(self) -> str:
        """In a few words, for people."""
        return "not recording" if self.recorder is None else f"{self.recorder.recorded.sweeps} recorded"

    def begin(self, source: Source, header: Header, problems: Sequence[str]) -> None:
        self.recorder = Recorder(
            self._folder,
            source.sensors,
            source.range_m,
            source.dtype,
            accelerations=self._accelerations,
            waits=source.waits and source.period_s is None,
            **self._options,  # type: ignore[arg-type]
        )

    def came(self, live: LiveSweep) -> None:
        assert self.recorder is not None
        self.recorder.take(live)

    def hear(self, live: LiveSweep, decision: LiveDecision, moment: Moment) -> None:
        self._heard = True
        if live.last and self.recorder is not None:
            self.recorder.wake()

    def accelerated(self, time_ns: int, value: float) -> None:
        """A board has told its vertical acceleration in m/s². Before the first sweep the sweeps have no clock."""
        if self.recorder is not None and self._heard:
            self.recorder.take_acceleration(time_ns, value)

    def end(self, tally: Tally) -> None:
        assert self.recorder is not None
        self.recorder.close()
        tally.more["recorded"] = self.recorder.recorded._asdict()
