"""The C header for a board's side, compiled here, against the Python side of the line."""

from __future__ import annotations

import ctypes
import random
import shutil
import subprocess
from pathlib import Path

import pytest

from jaxradar.live.board import Fault, Told
from jaxradar.live.wires import Framed

HEADER = Path(__file__).parent.parent / "scripts" / "jaxradar_link.h"
SOURCE = """
#include "jaxradar_link.h"
static struct jaxradar_link link_;
void begin(void) { memset(&link_, 0, sizeof link_); }
int take(const uint8_t *bytes, int count, uint32_t now_ms) {
    int frames = 0;
    for (int i = 0; i < count; i++) frames += jaxradar_take(&link_, bytes[i], now_ms);
    return frames;
}
int coming(uint32_t now_ms) { return jaxradar_step_is_coming(&link_, now_ms); }
void told(int32_t *out) {
    out[0] = link_.sequence; out[1] = link_.number; out[2] = link_.event; out[3] = link_.period_ms;
    out[4] = link_.impact; out[5] = link_.height; out[6] = link_.faults; out[7] = (int32_t)link_.damaged;
}
void answer(int16_t acceleration, uint16_t status, uint8_t *out) { jaxradar_reply(&link_, acceleration, status, out); }
"""


@pytest.fixture(scope="module")
def board(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("there is no C compiler")
    folder = tmp_path_factory.mktemp("board")
    (folder / "board.c").write_text(SOURCE)
    warnings = ["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror", "-O2", "-shared", "-fPIC"]
    subprocess.run(
        [compiler, *warnings, f"-I{HEADER.parent}", str(folder / "board.c"), "-o", str(folder / "board.so")], check=True
    )
    return ctypes.CDLL(str(folder / "board.so"))


def take(board: ctypes.CDLL, content: bytes, now_ms: int) -> int:
    found = board.take(content, len(content), ctypes.c_uint32(now_ms))
    assert isinstance(found, int)
    return found


def told(board: ctypes.CDLL) -> list[int]:
    out = (ctypes.c_int32 * 8)()
    board.told(out)
    return list(out)


def coming(board: ctypes.CDLL, now_ms: int) -> bool:
    return bool(board.coming(ctypes.c_uint32(now_ms)))


def test_what_is_told_is_heard_through_garbage(board: ctypes.CDLL) -> None:
    random_ = random.Random(1)
    board.begin()
    wire, before = Framed(), 0
    for place in range(1, 500):
        event = random_.random() < 0.5
        impact = random_.choice([None, random_.random()])
        height = random_.choice([None, random_.uniform(-0.1, 0.1)])
        message = Told(event, random_.randrange(1000), impact, height, Fault(random_.randrange(128)))
        noise = random_.randbytes(random_.randrange(30)) + random_.choice([b"", b"\xa5", b"\xa5\x5a\x01", b"\xa5\x5a"])
        before += take(board, noise, place)
        assert before == 0
        frame = wire.tell(message, 0.0034)
        # A begin of a frame right before one may take it along; the one after it is then heard.
        if take(board, frame, place) == 0:
            assert take(board, frame, place) == 1
        found = told(board)
        assert found[:4] == [place, message.number, event, 4]
        assert found[4] == (0xFFFF if impact is None else round(1e4 * impact))
        assert found[5] == (-0x8000 if height is None else round(1e4 * height))
        assert found[6] == message.faults


def test_a_step_is_over_with_its_impact_or_when_frames_stay_away(board: ctypes.CDLL) -> None:
    for begin_ms in (1000, 2**32 - 10):  # and where the clock wraps around
        board.begin()
        assert not coming(board, begin_ms)
        take(board, Framed().tell(Told(True, 1, 0.02), 0.01), begin_ms)
        later = [coming(board, (begin_ms + ms) % 2**32) for ms in (0, 20, 21)]
        assert later == [True, True, False]
        take(board, Framed().tell(Told(True, 1), 0.01), begin_ms)
        later = [coming(board, (begin_ms + ms) % 2**32) for ms in (0, 30, 31)]
        assert later == [True, True, False]
        take(board, Framed().tell(Told(), 0.01), begin_ms)
        assert not coming(board, begin_ms)


def test_the_answer_is_heard(board: ctypes.CDLL) -> None:
    wire = Framed()
    take(board, wire.tell(Told(), 0.01), 0)
    out = (ctypes.c_uint8 * 12)()
    board.answer(-981, 3, out)
    heard = wire.hear(bytes(out))
    assert (heard.acceleration_m_s2, heard.messages, heard.garbage) == (pytest.approx(-9.81), 1, 0)
    board.answer(-0x8000, 0, out)
    assert wire.hear(bytes(out)).acceleration_m_s2 is None


def test_a_damaged_frame_is_none_and_counted(board: ctypes.CDLL) -> None:
    board.begin()
    frame = bytearray(Framed().tell(Told(True, 1), 0.01))
    frame[8] ^= 1
    assert take(board, bytes(frame), 0) == 0
    assert told(board)[7] == 1
    assert not coming(board, 0)
