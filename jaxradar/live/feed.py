"""Sweeps out of a source that may stall or fail, for a loop that must go round every period."""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from jaxradar._errors import ConfigError, JaxradarError, SourceError
from jaxradar.live.sweeps import LiveSweep, Source

__all__ = ["Came", "Direct", "Ended", "Feed", "Lost"]

MOST_WAITING = 64  # sweeps; the oldest goes, as what is old is of no use
_LOOK_S = 1e-3  # how often a source that waits looks whether there is room
FIRST_WAIT_S, LONGEST_WAIT_S = 0.5, 10.0  # between attempts to open a source again, doubled each time


class Came(NamedTuple):
    """A sweep, and when it came, in nanoseconds of `time.monotonic_ns`."""

    live: LiveSweep
    came_ns: int


class Lost(NamedTuple):
    """The source has failed, and is being opened again."""

    why: str


class Ended(NamedTuple):
    """No more sweeps come. `error`: why, if it was not the end of a recording, nor `close`."""

    error: JaxradarError | None


class Feed:
    """Iterates over an open source in a thread.

    Of a source that does not wait, sweeps that are not taken in time are dropped, the oldest first, and counted in
    `dropped`. Times go on counting across a source that was opened again. A source whose range axis is another one then
    ends the feed.

    `each`: hears of every sweep as it comes, also of those that are dropped, in the feed's own thread. `again`: whether
    a source that fails is opened again, with a growing pause between the attempts; otherwise that ends the feed.
    """

    def __init__(self, source: Source, each: Callable[[LiveSweep], None], *, again: bool = False) -> None:
        self._source, self._each, self._again = source, each, again
        self._axis = source.range_m
        self._queue: queue.SimpleQueue[Came | Lost | Ended] = queue.SimpleQueue()
        self._closing = threading.Event()
        self.dropped = 0
        self.reopened = 0
        self._thread = threading.Thread(target=self._read, name="source", daemon=True)
        self._thread.start()

    def take(self, wait_s: float) -> Came | Lost | Ended | None:
        """The next of them, None if there is none within `wait_s`."""
        try:
            return self._queue.get(timeout=wait_s) if wait_s > 0 else self._queue.get_nowait()
        except queue.Empty:
            return None

    def close(self, wait_s: float = 3.0) -> None:
        """End soon; a source that hangs is not waited for."""
        self._closing.set()
        self._source.close()
        self._thread.join(wait_s)

    def _read(self) -> None:
        wait_s, offset_ns, first_came_ns = FIRST_WAIT_S, 0, None
        while True:
            begun = False
            try:
                for live in self._source:
                    came_ns = time.monotonic_ns()
                    if first_came_ns is None:
                        first_came_ns = came_ns - live.time_ns
                    elif not begun and self.reopened:
                        offset_ns = came_ns - first_came_ns - live.time_ns
                    begun, wait_s = True, FIRST_WAIT_S
                    moved = live._replace(time_ns=live.time_ns + offset_ns) if offset_ns else live
                    self._each(moved)
                    self._put(Came(moved, came_ns))
                return self._end(None)
            except SourceError as error:
                if not self._again or self._closing.is_set():
                    return self._end(error)
                self._queue.put(Lost(str(error)))
                if not begun:  # it opens, and fails before the first sweep: as long a pause as if it did not open
                    if self._closing.wait(wait_s):
                        return self._end(None)
                    wait_s = min(2.0 * wait_s, LONGEST_WAIT_S)
            except JaxradarError as error:
                return self._end(error)
            except Exception as error:
                return self._end(_unforeseen(error))
            try:
                while not self._opened():
                    if self._closing.wait(wait_s):
                        return self._end(None)
                    wait_s = min(2.0 * wait_s, LONGEST_WAIT_S)
            except Exception as error:
                return self._end(_unforeseen(error))
            if not np.array_equal(self._source.range_m, self._axis):
                return self._end(ConfigError("the source came back with another range axis; start again."))

    def _opened(self) -> bool:
        """Whether it could be, or need not be any more."""
        if self._closing.is_set():
            return True  # iteration then ends at once
        with contextlib.suppress(JaxradarError):
            self._source.close()
        try:
            self._source.open()
        except JaxradarError as error:
            self._queue.put(Lost(str(error)))
            return False
        self.reopened += 1
        return True

    def _put(self, came: Came) -> None:
        while self._queue.qsize() >= MOST_WAITING:
            if self._source.waits:
                if self._closing.wait(_LOOK_S):
                    return
                continue
            with contextlib.suppress(queue.Empty):
                self._queue.get_nowait()
                self.dropped += 1
        self._queue.put(came)

    def _end(self, error: JaxradarError | None) -> None:
        self._queue.put(Ended(error))


def _unforeseen(error: Exception) -> SourceError:
    return SourceError(f"the source fails ({type(error).__name__}: {error!s:.200}).")


class Direct:
    """As `Feed`, in the caller's own thread: of a source that waits, as fast as it goes."""

    dropped = reopened = 0

    def __init__(self, source: Source, each: Callable[[LiveSweep], None]) -> None:
        self._source, self._each = source, each
        self._sweeps: Iterator[LiveSweep] = iter(source)

    def take(self, wait_s: float) -> Came | Ended:
        """The next of them, however long it takes."""
        live = next(self._sweeps, None)
        if live is None:
            return Ended(None)
        self._each(live)
        return Came(live, time.monotonic_ns())

    def close(self) -> None:
        """End soon."""
        self._source.close()
