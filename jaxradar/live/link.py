"""The serial line to a board: opened again whenever it is lost, and never waited for."""

from __future__ import annotations

import array
import contextlib
import errno
import fcntl
import os
import termios
import threading
import time
from typing import Any, NamedTuple

from jaxradar._errors import ConfigError
from jaxradar.live.board import Told
from jaxradar.live.wires import Heard, Wire

__all__ = ["Link", "LinkCounts"]

BAUD = 115200  # thesis, appendix C.1, line 44
FIRST_WAIT_S, LONGEST_WAIT_S = 0.1, 5.0  # between attempts to open it, doubled each time
SILENT_S = 1.0  # a board that has said nothing for so long is said to be silent, one that takes nothing is lost
_MOST_BEHIND = 4  # messages that wait in the line
_MOST_READ = 4096
_LAST_S = 0.2  # for the last message to go out
_BABBLE = 4  # times what a board sends in a period; the rest of one period is not looked at


class LinkCounts(NamedTuple):
    """`told`: messages that went out; `dropped`: that did not, as the board was away or took nothing; `heard`: messages
    that came in; `garbage`: bytes that were none; `opened`: how often the line was opened."""

    told: int
    dropped: int
    heard: int
    garbage: int
    opened: int


class Link:
    """A board at the end of a serial line.

    `open` begins to look for it; from then on `exchange` sends one message and takes what has come, and never waits.
    A message that the line does not take at once is dropped, not kept: what is said late is wrong. Where the board is
    away, was unplugged, or takes nothing for `SILENT_S`, a thread opens the line again, with a growing pause between
    the attempts.

    `port`: a device such as /dev/ttyACM0, or a pseudo-terminal.
    """

    def __init__(self, port: str, wire: Wire, period_s: float) -> None:
        self._port, self._wire, self._period_s = port, wire, period_s
        self._line: Any = None  # what exchanges use; only ever set by the opener and unset by `exchange`
        self._lost: Any = None
        self._wanted = threading.Event()
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None
        self._told = self._dropped = self._heard = self._garbage = self._opened = 0
        self._took_s = self._said_s = 0.0
        self.problem = ""

    @property
    def counts(self) -> LinkCounts:
        """So far."""
        return LinkCounts(self._told, self._dropped, self._heard, self._garbage, self._opened)

    @property
    def is_open(self) -> bool:
        """Whether there is a line just now."""
        return self._line is not None

    @property
    def is_silent(self) -> bool:
        """Whether a board that is there has said nothing for `SILENT_S`."""
        return self._line is not None and time.monotonic() - self._said_s > SILENT_S

    def open(self, wait_s: float = 1.0) -> None:
        """Begin to look for the board, and give it a moment to be there. Raises `ConfigError` without pyserial."""
        _serial()
        self._wanted.set()
        self._thread = threading.Thread(target=self._keep_open, name="link", daemon=True)
        self._thread.start()
        until_s = time.monotonic() + wait_s
        while self._line is None and not self.problem and time.monotonic() < until_s:
            time.sleep(0.005)

    def exchange(self, told: Told) -> Heard:
        """Send one message, and take what has come since the last one."""
        message = self._wire.tell(told, self._period_s)  # its sequence counts on while the board is away
        line = self._line
        if line is None:
            self._dropped += 1
            return Heard(None, 0, 0)
        now_s = time.monotonic()
        try:
            if self._goes_out(line, message):
                self._told += 1
                self._took_s = now_s
            else:
                self._dropped += 1
                if now_s - self._took_s > SILENT_S:
                    raise OSError(errno.EIO, f"takes nothing for {SILENT_S:g} s")
            content = self._come_in(line)
        except OSError as error:
            self._give_up(error)
            return Heard(None, 0, 0)
        heard = self._wire.hear(content)
        if heard.messages:
            self._said_s = now_s
        self._heard += heard.messages
        self._garbage += heard.garbage
        return heard

    def close(self, told: Told | None = None) -> None:
        """Send a last message, and end."""
        self._ended.set()
        self._wanted.set()
        line, self._line = self._line, None
        if line is not None:
            with contextlib.suppress(OSError):
                if told is not None:
                    os.write(line.fileno(), self._wire.tell(told, self._period_s))
                _close(line)
        if self._thread is not None:
            self._thread.join(timeout=1.0)

    @staticmethod
    def _goes_out(line: Any, message: bytes) -> bool:
        # What still waits in the line is older than this: it must not be heard first.
        if _waiting(line) > _MOST_BEHIND * len(message):
            _flush(line, termios.TCOFLUSH)
        try:
            return os.write(line.fileno(), message) == len(message)
        except BlockingIOError:
            _flush(line, termios.TCOFLUSH)
            return False

    def _come_in(self, line: Any) -> bytes:
        try:
            content = os.read(line.fileno(), _MOST_READ)
        except BlockingIOError:
            return b""
        if not content and not os.isatty(line.fileno()):
            raise OSError(errno.EIO, "is closed at the other end")
        most = _BABBLE * self._wire.reads
        if len(content) > most:
            self._garbage += len(content) - most
            content = content[-most:]
        return content

    def _give_up(self, error: OSError) -> None:
        self.problem = f"{self._port}: {error.strerror or error}"
        self._lost, self._line = self._line, None
        self._wanted.set()

    def _keep_open(self) -> None:
        serial, wait_s = _serial(), FIRST_WAIT_S
        while not self._ended.is_set():
            self._wanted.wait()
            if self._lost is not None:
                with contextlib.suppress(OSError):
                    _close(self._lost)
                self._lost = None
            if self._ended.is_set():
                return
            try:
                line = serial.Serial(self._port, BAUD, timeout=0, write_timeout=0, exclusive=True)
            except (OSError, ValueError, termios.error) as error:  # pyserial's own are the first two
                self.problem = f"{self._port}: cannot be opened ({_reason(error)})"
                self._ended.wait(wait_s)
                wait_s = min(2.0 * wait_s, LONGEST_WAIT_S)
                continue
            self._wire.forget()
            self._took_s = self._said_s = time.monotonic()
            self._opened += 1
            self.problem, wait_s = "", FIRST_WAIT_S
            self._wanted.clear()
            self._line = line


def _waiting(line: Any) -> int:
    held = array.array("i", [0])
    try:
        fcntl.ioctl(line.fileno(), termios.TIOCOUTQ, held)
    except OSError as error:
        if error.errno in (errno.ENOTTY, errno.EINVAL):  # a line that does not tell
            return 0
        raise
    return held[0]


def _close(line: Any) -> None:
    with contextlib.suppress(OSError):
        until_s = time.monotonic() + _LAST_S
        while _waiting(line) and time.monotonic() < until_s:
            time.sleep(0.01)
        if _waiting(line):  # or closing waits until a board that takes nothing has taken all
            _flush(line, termios.TCOFLUSH)
    line.close()


def _flush(line: Any, which: int) -> None:
    try:
        termios.tcflush(line.fileno(), which)
    except termios.error as error:  # which is no `OSError`
        raise OSError(*error.args) from None


def _reason(error: Exception) -> str:
    below = error.__context__ if isinstance(error.__context__, termios.error) else error  # what pyserial puts in words
    number = below.args[0] if isinstance(below, termios.error) else getattr(error, "errno", None)
    if number == errno.EWOULDBLOCK:
        return "another program has it"
    if number == errno.ENOTTY:
        return "it is no serial line"
    return os.strerror(number) if number else f"{error!s:.100}"


def _serial() -> Any:
    try:
        import serial  # type: ignore[import-untyped]
    except ImportError:
        raise ConfigError("a link to a board needs pyserial; install it with `pip install pyserial`.") from None
    return serial
