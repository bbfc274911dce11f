"""What systemd is told of a service, and the unit that runs one."""

from __future__ import annotations

import contextlib
import os
import re
import socket
import time
from collections.abc import Callable, Sequence
from pathlib import Path

__all__ = ["Notifier", "unit"]

_UNIT = """\
[Unit]
Description=Road steps ahead, by radar ({name})
Documentation=man:systemd.service(5)
After=network.target
StartLimitIntervalSec=0

[Service]
Type=notify
ExecStart={command}
WorkingDirectory={folder}
Restart=always
RestartSec=1
WatchdogSec=5
TimeoutStopSec=15
SuccessExitStatus=129 130 143
Nice=-10

[Install]
WantedBy=multi-user.target
"""
_ESCAPED = {"\\": "\\\\", '"': '\\"', "\n": "\\n", "\t": "\\t", "\r": "\\r"}


class Notifier:
    """Tells systemd that the service is ready, alive, or ending (`sd_notify(3)`); does nothing where systemd does not
    run it. Never waits."""

    def __init__(self) -> None:
        place = os.environ.get("NOTIFY_SOCKET", "")
        self._place = f"\0{place[1:]}" if place.startswith("@") else place
        micros = os.environ.get("WATCHDOG_USEC", "")
        # As sd_watchdog_enabled(3) asks: twice as often as it is waited for.
        self._every_s = int(micros) / 2e6 if micros.isdecimal() else None
        self._next_s = 0.0

    def ready(self, status: str) -> None:
        """Sweeps are coming."""
        self._send(f"READY=1\nSTATUS={status}")

    def alive(self, status: Callable[[], str]) -> None:
        """To be called every period: the loop goes round. Sent no more often than the watchdog waits for it."""
        if self._every_s is not None and time.monotonic() >= self._next_s:
            self._next_s = time.monotonic() + self._every_s
            self._send(f"WATCHDOG=1\nSTATUS={status()}")

    def stopping(self) -> None:
        """The program ends."""
        self._send("STOPPING=1")

    def _send(self, text: str) -> None:
        if not self._place:
            return
        with (
            contextlib.suppress(OSError),
            socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as out,
        ):
            out.setblocking(False)
            out.sendto(text.encode(), self._place)


def unit(command: Sequence[str], name: str) -> str:
    """A systemd unit that runs a command in the folder of today, as soon as the machine is up and again whenever it
    ends: without a limit of starts, as a server may be up only minutes after this. SIGHUP, SIGINT and SIGTERM are
    no failures.

    `%` and `$` stand for themselves, as systemd.service(5) asks for them to be written.
    """
    words = " ".join(map(_quoted, command)).replace("%", "%%").replace("$", "$$")
    return _UNIT.format(name=name.replace("%", "%%"), command=words, folder=str(Path.cwd()).replace("%", "%%"))


def _quoted(word: str) -> str:
    """As systemd.syntax(7) has it, which is not a shell's: quotes stand around whole words alone, and a backslash
    counts within them too."""
    if re.fullmatch(r"[\w@%+=:,./$-]+", word, re.ASCII):
        return word
    inner = "".join(_ESCAPED.get(sign, sign) for sign in word)
    return f'"{inner}"'
