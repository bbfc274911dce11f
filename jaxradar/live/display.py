"""What is going on, in one line of a terminal that is written over, five times a second."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Sequence

from jaxradar.live.artefact import Header
from jaxradar.live.board import Fault, in_words
from jaxradar.live.detect import LiveDecision
from jaxradar.live.printed import CLEAR
from jaxradar.live.run import Listener, Moment
from jaxradar.live.sweeps import LiveSweep, Source
from jaxradar.live.tally import Tally
from jaxradar.live.writer import Writer
from jaxradar.units import NANOSECONDS

__all__ = ["Display"]

_EVERY_NS = NANOSECONDS // 5
_GAP = "   "


class Display(Listener):
    """Time, range, speed, statistic over threshold, sweeps a second, detections, what others have to tell (`more`, a
    few words each), faults of the last moment that was shown and of those since."""

    def __init__(self, more: Sequence[Callable[[], str]] = ()) -> None:
        self._more = more
        self._next_ns = self._since_ns = 0
        self._sweeps = self._events = self._before = 0
        self._faults = Fault(0)
        self._last: LiveDecision | None = None

    def begin(self, source: Source, header: Header, problems: Sequence[str]) -> None:
        self._header = header
        self._writer = Writer(sys.stderr)
        self._since_ns = time.monotonic_ns()

    def hear(self, live: LiveSweep, decision: LiveDecision, moment: Moment) -> None:
        self._sweeps += 1
        self._events += decision.event
        self._last = decision
        self._show(moment)

    def idle(self, moment: Moment) -> None:
        self._show(moment)

    def end(self, tally: Tally) -> None:
        self._writer.say(CLEAR, end="")
        self._writer.close()

    def _show(self, moment: Moment) -> None:
        self._faults |= moment.faults
        now_ns = time.monotonic_ns()
        if now_ns < self._next_ns or self._writer.waiting:
            return
        self._next_ns = now_ns + _EVERY_NS
        seconds = max(now_ns - self._since_ns, 1) / NANOSECONDS
        rate = (self._sweeps - self._before) / seconds
        self._since_ns, self._before = now_ns, self._sweeps
        self._writer.say(CLEAR + self.line(moment.time_ns / NANOSECONDS, rate, _columns()), end="")
        self._faults = Fault(0)

    def line(self, time_s: float, rate_hz: float, columns: int = 0) -> str:
        """As it is shown: the longest parts are left out where it does not fit so many `columns` (0: any number), for
        what runs over into the next line is not written over. Time and faults stay."""
        last, header = self._last, self._header
        parts = [f"{time_s:8.1f} s"]
        if last is not None:
            parts += [
                f"{last.range_m:.3f} m",
                f"{last.speed_m_s:+5.1f} m/s",
                f"{header.statistic_name} {last.statistic:.3g} of {header.threshold:.3g}",
            ]
        parts += [f"{rate_hz:.0f}/s", f"{self._events} detection{'' if self._events == 1 else 's'}"]
        parts += [one() for one in self._more]
        parts.append(in_words(self._faults))
        while columns and len(parts) > 2 and len(_GAP.join(parts)) >= columns:
            parts.remove(max(parts[1:-1], key=len))
        line = _GAP.join(parts)
        return line[: columns - 1] if columns else line


def _columns() -> int:
    """Of the terminal; 0 where it does not say."""
    try:
        return os.get_terminal_size(sys.stderr.fileno()).columns
    except (OSError, ValueError):
        return 0
