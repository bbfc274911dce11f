"""Text to a terminal, a pipe or a file, without waiting for who reads it."""

from __future__ import annotations

import contextlib
import queue
import threading
from typing import Any

__all__ = ["Writer", "close_all"]

MOST_WAITING = 1000  # lines


class Writer:
    """Writes lines in a thread of its own; where the reader stalls they are dropped and counted, not waited for.

    `stream`: of text. `direct`: write at once and wait, for who is in no hurry. A reader that is gone is raised by the
    next `say`. A disk that does not take a line loses it, which may be over soon: later ones are tried, `problem` says
    why, empty while lines are taken, and `close` raises it.
    """

    def __init__(self, stream: Any, *, direct: bool = False) -> None:
        self._stream = stream
        self.problem = ""
        self._queue: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._error: OSError | None = None
        self._untaken: OSError | None = None
        self.dropped = 0
        self._thread: threading.Thread | None = None
        if not direct:
            self._thread = threading.Thread(target=self._work, name="writer", daemon=True)
            self._thread.start()

    @property
    def waiting(self) -> int:
        """Lines that have not gone out."""
        return self._queue.qsize()

    def say(self, text: str, end: str = "\n") -> None:
        """One line. Raises `BrokenPipeError` if nobody reads."""
        if self._error is not None:
            raise self._error
        if self._thread is None:
            self._write(text + end)
        elif self._queue.qsize() >= MOST_WAITING:
            self.dropped += 1
        else:
            self._queue.put(text + end)

    def close(self, wait_s: float = 2.0) -> None:
        """Let what waits go out; a reader that does not take it in `wait_s` is not waited for. Raises the `OSError`
        that something was answered with."""
        if self._thread is not None:
            self._queue.put(None)
            self._thread.join(wait_s)
            self._thread = None
        error, self._error, self._untaken = self._error or self._untaken, None, None
        if error is not None:
            raise error

    def _work(self) -> None:
        try:
            while (text := self._queue.get()) is not None:
                self._write(text, flush=not self._queue.qsize())
            self._write("")
        except OSError as error:
            self._error = error
        except ValueError:  # closed meanwhile
            self._error = BrokenPipeError()

    def _write(self, text: str, flush: bool = True) -> None:
        try:
            self._stream.write(text)
            if flush:
                self._stream.flush()
            self.problem = ""
        except BrokenPipeError:
            raise
        except OSError as error:
            self._untaken, self.problem = error, error.strerror or str(error)


def close_all(*writers: Writer) -> None:
    """Close them, whatever one of them raises."""
    with contextlib.ExitStack() as stack:
        for writer in writers:
            stack.callback(writer.close)
