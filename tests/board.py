"""A suspension's board as a process of its own at the end of a pseudo-terminal.

`python tests/board.py LINK KIND [LOG]` makes a pseudo-terminal, lets the symbolic link LINK name it, as udev does with
a device, prints `ready`, and behaves as KIND says until it is killed: `nucleo` answers each byte with one, `framed`
each frame with one, `silent` reads and says nothing, `stalling` never reads, `babbling` sends garbage without end. LOG:
each byte that has come, in lines of nanoseconds (of `time.monotonic_ns`) and the bytes in hexadecimal.
"""

from __future__ import annotations

import os
import random
import struct
import subprocess
import sys
import time
import tty
from collections.abc import Callable
from pathlib import Path
from typing import IO, NamedTuple

ACCELERATION = 137  # 9 m/s² and 128
FRAME_BYTES = 18  # of a host


def crc16(content: bytes) -> int:
    """CRC-16/CCITT-FALSE, bit by bit."""
    held = 0xFFFF
    for byte in content:
        held ^= byte << 8
        for _ in range(8):
            held = (held << 1) ^ 0x1021 if held & 0x8000 else held << 1
            held &= 0xFFFF
    return held


class Frame(NamedTuple):
    """A host's frame, as the docstring of `jaxradar.live.wires` lays it out; counts and units are those on the line."""

    kind: int
    bytes: int
    sequence: int
    number: int
    event: int
    period_ms: int
    impact: int
    height: int
    faults: int
    checksum: int


def frames(sent: bytes) -> list[Frame]:
    """Of what has come to a board without garbage between; a frame that is not whole at the end is left out."""
    found = []
    for at in range(0, len(sent) - FRAME_BYTES + 1, FRAME_BYTES):
        frame = sent[at : at + FRAME_BYTES]
        assert frame[:2] == b"\xa5\x5a"
        found.append(Frame(*struct.unpack("<BBHHBBHhHH", frame[2:])))
        assert found[-1][:2] == (1, 12)
        assert found[-1].checksum == crc16(frame[2:-2])
    return found


def until(true: Callable[[], bool], seconds: float = 20.0) -> None:
    """Waits for it, and fails if it does not come."""
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end
        time.sleep(0.01)


def reply(sequence: int, acceleration: int, status: int = 0) -> bytes:
    """A board's frame, as the docstring of `jaxradar.live.wires` lays it out."""
    body = bytes([2, 6]) + sequence.to_bytes(2, "little") + acceleration.to_bytes(2, "little", signed=True)
    body += status.to_bytes(2, "little")
    return b"\xa5\x5a" + body + crc16(body).to_bytes(2, "little")


def main() -> None:
    place, kind = Path(sys.argv[1]), sys.argv[2]
    log = os.open(sys.argv[3], os.O_WRONLY | os.O_CREAT | os.O_APPEND) if len(sys.argv) > 3 else None
    master, slave = os.openpty()
    tty.setraw(slave)
    fresh = place.with_name(f"{place.name}.new")
    fresh.unlink(missing_ok=True)
    fresh.symlink_to(os.ttyname(slave))
    fresh.replace(place)
    print("ready", flush=True)
    held = b""
    noise = random.Random(0)
    while True:
        if kind == "stalling":
            time.sleep(1.0)
            continue
        if kind == "babbling":
            os.write(master, noise.randbytes(512))
            time.sleep(0.001)
            continue
        content = os.read(master, 4096)
        if log is not None:
            os.write(log, f"{time.monotonic_ns()} {content.hex()}\n".encode())
        if kind == "nucleo":
            os.write(master, bytes([ACCELERATION]) * len(content))
        if kind == "framed":
            held += content
            while len(held) >= FRAME_BYTES:
                os.write(master, reply(int.from_bytes(held[4:6], "little"), 981))
                held = held[FRAME_BYTES:]


class Board:
    """The process, started and ready; ends with the `with` block."""

    def __init__(self, place: Path, kind: str, log: Path | None = None) -> None:
        command = [sys.executable, __file__, str(place), kind, *([str(log)] if log else [])]
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        out: IO[str] | None = self._process.stdout
        assert out is not None
        assert out.readline() == "ready\n"
        self.log = log

    def heard(self) -> list[tuple[int, bytes]]:
        """Time and content of what has come so far."""
        assert self.log is not None
        lines = [line.split() for line in self.log.read_text().splitlines()]
        return [(int(line[0]), bytes.fromhex(line[1])) for line in lines if len(line) == 2]

    def bytes(self) -> bytes:
        """All that has come so far."""
        return b"".join(content for _, content in self.heard())

    def kill(self) -> None:
        """As a board that is unplugged."""
        self._process.kill()
        self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()

    def __enter__(self) -> Board:
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()


if __name__ == "__main__":
    main()
