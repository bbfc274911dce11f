"""How a board is told, byte by byte, and what it says in return.

`nucleo`, the lab's (thesis, appendix C.1): each period one byte out, 1 while a step is coming and else 0, and one byte
in, the body's vertical acceleration plus 128. What a count of it means the thesis does not say; 1 m/s² is assumed.

`framed`: 18 bytes out and 12 in, each with a checksum. Whole numbers are little-endian.

    out  0  u8  0xA5                 in  0  u8  0xA5
         1  u8  0x5A                     1  u8  0x5A
         2  u8  1, host to board         2  u8  2, board to host
         3  u8  12, bytes that follow    3  u8  6
            before the checksum
         4  u16 sequence number          4  u16 sequence number of the last frame that was taken
         6  u16 number of the            6  i16 vertical acceleration, 0.01 m/s²; -32768 not known
            detection, 0 before any      8  u16 what the board has to say of itself, 0 nothing
         8  u8  1 while a step is       10  u16 checksum
            coming, else 0
         9  u8  period, ms: silence for three of them is a time-out, and what was said before is over
        10  u16 time to impact, 0.1 ms; 65535 not known
        12  i16 height of the step, 0.1 mm; -32768 not known
        14  u16 faults, `jaxradar.live.board.Fault`
        16  u16 checksum

The checksum is CRC-16/CCITT-FALSE (polynomial 0x1021, begun at 0xFFFF, not reflected) of bytes 2 up to itself. Each
frame is a heartbeat: one comes every period, fault or none. `scripts/jaxradar_link.h` is the board's side in C.
"""

from __future__ import annotations

import binascii
import math
import struct
from typing import NamedTuple, Protocol, runtime_checkable

from jaxradar.live.board import Told

__all__ = ["Framed", "Heard", "Nucleo", "Wire"]

SYNC = b"\xa5\x5a"
_TELL = struct.Struct("<BBHHBBHhH")
_REPLY = struct.Struct("<BBHhH")
_CRC = struct.Struct("<H")
_TELL_BYTES, _REPLY_BYTES = 12, 6
_UNKNOWN_U16, _UNKNOWN_I16 = 0xFFFF, -0x8000
_ACCELERATION_M_S2 = 0.01
_MOST_HELD = 256  # bytes of a frame that is not whole yet, and of what is none


class Heard(NamedTuple):
    """What a board said in one period: the last acceleration in m/s², None if none, and how many messages and bytes
    that were none."""

    acceleration_m_s2: float | None
    messages: int
    garbage: int


@runtime_checkable
class Wire(Protocol):
    """One way to talk to a board. It holds what has come of a message that is not whole yet."""

    reads: int  # bytes that a board sends in a period

    def tell(self, told: Told, period_s: float) -> bytes:
        """The message of one period."""
        ...

    def hear(self, content: bytes) -> Heard:
        """What of a message is in the bytes that have come since the last call."""
        ...

    def forget(self) -> None:
        """Begin anew, with a board that was just connected."""
        ...


class Nucleo:
    """The lab's wire. `scale_m_s2`: what a count of the board's acceleration means."""

    reads = 1

    def __init__(self, scale_m_s2: float = 1.0) -> None:
        self._scale = scale_m_s2

    def tell(self, told: Told, period_s: float) -> bytes:
        return b"\x01" if told.event else b"\x00"

    def hear(self, content: bytes) -> Heard:
        if not content:
            return Heard(None, 0, 0)
        return Heard((content[-1] - 128) * self._scale, len(content), 0)

    def forget(self) -> None:
        pass


class Framed:
    """The framed wire, as in the module's docstring."""

    reads = _REPLY_BYTES + 6

    def __init__(self) -> None:
        self._sequence = 0
        self._held = b""

    def tell(self, told: Told, period_s: float) -> bytes:
        self._sequence = (self._sequence + 1) & 0xFFFF
        body = _TELL.pack(
            1,
            _TELL_BYTES,
            self._sequence,
            told.number,
            told.event,
            min(max(math.ceil(1e3 * period_s), 1), 255),
            _UNKNOWN_U16 if told.impact_in_s is None else min(round(1e4 * told.impact_in_s), _UNKNOWN_U16 - 1),
            _UNKNOWN_I16 if told.height_m is None else min(max(round(1e4 * told.height_m), -0x7FFF), 0x7FFF),
            int(told.faults),
        )
        return SYNC + body + _CRC.pack(binascii.crc_hqx(body, 0xFFFF))

    def hear(self, content: bytes) -> Heard:
        held = self._held + content
        acceleration: float | None = None
        messages = garbage = at = 0
        while True:
            found = held.find(SYNC, at)
            if found < 0:
                # The first byte of a mark may be the last that has come.
                end = len(held) - (held[-1:] == SYNC[:1] and at < len(held))
                garbage += end - at
                at = end
                break
            garbage += found - at
            at = found
            frame = held[at : at + self.reads]
            if len(frame) < self.reads and self._may_become(frame):
                break
            if len(frame) == self.reads and (value := self._taken(frame)) is not None:
                messages += 1
                acceleration = None if math.isnan(value) else value
                at += self.reads
            else:
                garbage += 1
                at += 1
        self._held = held[at:][-_MOST_HELD:]
        return Heard(acceleration, messages, garbage)

    def forget(self) -> None:
        self._held = b""

    @staticmethod
    def _may_become(frame: bytes) -> bool:
        return bytes([2, _REPLY_BYTES]).startswith(frame[2:4])

    @staticmethod
    def _taken(frame: bytes) -> float | None:
        """The acceleration, NaN where the board does not know; None if it is no frame of a board."""
        kind, size, _, counts, _ = _REPLY.unpack(frame[2:-2])
        if (kind, size) != (2, _REPLY_BYTES) or _CRC.unpack(frame[-2:])[0] != binascii.crc_hqx(frame[2:-2], 0xFFFF):
            return None
        return math.nan if counts == _UNKNOWN_I16 else counts * _ACCELERATION_M_S2
