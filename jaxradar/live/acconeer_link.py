"""The connection under Acconeer's client: one TCP stream whose end and whose silence are noticed.

The client's own (`SocketLink` of acconeer-exptool 7.18) takes a server's hanging up for a short read: in the middle of
a sweep it then reads nothing again and again, for ever. Nor does it bound how much it reads.
"""

from __future__ import annotations

import contextlib
import json
import socket
import time
from typing import Any

from jaxradar._errors import ConfigError, SourceError

__all__ = ["INSTALL", "ExplorationLink", "client_package"]

INSTALL = "pip install 'acconeer-exptool>=7.18,<8'"
_CHUNK = 1 << 16
_MOST_LINE = 1 << 20
_MOST_PAYLOAD = 1 << 24


class ExplorationLink:
    """In place of the client's link, with its methods. `timeout` (s) is how long a whole message may take; the client
    sets it to `DEFAULT_TIMEOUT` plus one period of the sensor.

    All methods raise `SourceError`, which says what the server did.
    """

    def __init__(self, host: str, port: int, timeout_s: float) -> None:
        self._address = (host, port)
        self.place = f"{host}:{port}"
        self.DEFAULT_TIMEOUT = timeout_s
        self.timeout = timeout_s
        self._line = b""
        self._buffer = bytearray()
        self._socket: socket.socket | None = None

    @property
    def answer(self) -> dict[str, Any]:
        """The last line that the server sent, empty if it is no JSON object."""
        try:
            answer = json.loads(self._line)
        except (ValueError, RecursionError):
            return {}
        return answer if isinstance(answer, dict) else {}

    def connect(self) -> None:
        self.timeout = self.DEFAULT_TIMEOUT
        try:
            self._socket = socket.create_connection(self._address, self.timeout)
        except (OSError, UnicodeError) as error:  # a host's name may be none that can be looked up
            raise SourceError(
                f"no exploration server at {self.place} ({_reason(error)}); expected Acconeer's to run there."
            ) from error
        self._buffer.clear()

    def send(self, data: bytes | bytearray) -> None:
        connected = self._connected()
        connected.settimeout(self.timeout)
        try:
            connected.sendall(data)
        except OSError as error:
            raise SourceError(f"lost the connection to {self.place} ({_reason(error)}).") from error

    def recv(self, count: int) -> bytes:
        """The next `count` bytes."""
        if count > _MOST_PAYLOAD:
            raise SourceError(f"the server at {self.place} announces a sweep of {count} bytes; that is none.")
        deadline = time.monotonic() + self.timeout
        while len(self._buffer) < count:
            self._read(deadline)
        return self._take(count)

    def recv_until(self, mark: bytes) -> bytes:
        """The next bytes up to `mark` and with it."""
        deadline = time.monotonic() + self.timeout
        while (end := self._buffer.find(mark)) < 0:
            if len(self._buffer) > _MOST_LINE:
                raise SourceError(f"what answers at {self.place} is no exploration server: it sends no lines.")
            self._read(deadline)
        self._line = self._take(end + len(mark))
        return self._line

    def wake(self) -> None:
        """Let a `recv` in another thread, or one that a signal has interrupted, fail at once."""
        if self._socket is not None:
            with contextlib.suppress(OSError):
                self._socket.shutdown(socket.SHUT_RD)  # the server can still be told to stop

    def disconnect(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _connected(self) -> socket.socket:
        if self._socket is None:
            raise SourceError(f"not connected to {self.place}.")
        return self._socket

    def _take(self, count: int) -> bytes:
        taken = bytes(self._buffer[:count])
        del self._buffer[:count]
        return taken

    def _read(self, deadline: float) -> None:
        connected = self._connected()
        left = deadline - time.monotonic()
        try:
            if left <= 0:
                raise TimeoutError
            connected.settimeout(left)
            got = connected.recv(_CHUNK)
        except TimeoutError as error:
            raise SourceError(f"the server at {self.place} has not answered for {self.timeout:.3g} s.") from error
        except OSError as error:
            raise SourceError(f"lost the connection to {self.place} ({_reason(error)}).") from error
        if not got:
            raise SourceError(f"the server at {self.place} has closed the connection.")
        self._buffer += got


def _reason(error: Exception) -> str:
    if isinstance(error, TimeoutError):
        return "no answer"
    return str(getattr(error, "strerror", None) or error).lower()


def client_package() -> Any:
    """The maker's. Raises `ConfigError` where it cannot be imported."""
    try:
        from acconeer.exptool import a111
    except ImportError as error:
        raise ConfigError(
            f"live sweeps of an A111 need Acconeer's own client, which cannot be imported ({error!s:.80}); {INSTALL}."
        ) from error
    return a111
