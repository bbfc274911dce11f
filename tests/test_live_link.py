"""A board at the end of a real pseudo-terminal, in a process of its own: there, gone, silent, stalling, babbling."""

from __future__ import annotations

import termios
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from board import ACCELERATION, FRAME_BYTES, Board, frames, until

from jaxradar.live.board import Fault, Told
from jaxradar.live.link import Link
from jaxradar.live.wires import Framed, Heard, Nucleo

PERIOD_S = 0.005
AT_ONCE_S = 0.5  # a process may be kept from its core for a while; one that waits for a board waits for ever
STEP = Told(True, 1, 0.05)


@pytest.fixture
def place(tmp_path: Path) -> Path:
    return tmp_path / "ttyACM0"


@pytest.fixture
def link(place: Path) -> Iterator[Link]:
    made = Link(str(place), Nucleo(), PERIOD_S)
    yield made
    made.close()


def exchanges(link: Link, count: int, told: Told = Told()) -> tuple[list[Heard], float]:  # noqa: B008
    """What was heard, and the longest that an exchange took, in seconds."""
    found, longest = [], 0.0
    for _ in range(count):
        begin = time.perf_counter()
        found.append(link.exchange(told))
        longest = max(longest, time.perf_counter() - begin)
        time.sleep(PERIOD_S)
    return found, longest


def test_one_byte_out_and_one_in_each_period(place: Path, link: Link, tmp_path: Path) -> None:
    with Board(place, "nucleo", tmp_path / "log") as board:
        link.open()
        exchanges(link, 20)
        exchanges(link, 10, STEP)
        found, _ = exchanges(link, 10)
        until(lambda: len(board.bytes()) == 40)
        sent = board.bytes()
    assert sent == bytes(20) + b"\x01" * 10 + bytes(10)
    assert {heard.acceleration_m_s2 for heard in found} <= {ACCELERATION - 128.0, None}
    assert link.counts._replace(heard=0) == (40, 0, 0, 0, 1)
    assert 20 <= link.counts.heard <= 40
    assert not link.is_silent


def test_the_scale_of_the_acceleration_can_be_set(place: Path) -> None:
    link = Link(str(place), Nucleo(0.5), PERIOD_S)
    with Board(place, "nucleo"):
        link.open()
        heard: set[float | None] = set()
        until(lambda: heard.update(one.acceleration_m_s2 for one in exchanges(link, 5)[0]) or heard - {None} != set())
    link.close()
    assert heard - {None} == {0.5 * (ACCELERATION - 128)}


def test_frames_both_ways(place: Path, tmp_path: Path) -> None:
    link = Link(str(place), Framed(), PERIOD_S)
    with Board(place, "framed", tmp_path / "log") as board:
        link.open()
        found, _ = exchanges(link, 10, STEP)
        until(lambda: len(board.bytes()) == 10 * FRAME_BYTES)
        link.close(Told(faults=Fault.STOPPING))
        until(lambda: len(board.bytes()) == 11 * FRAME_BYTES)
        sent = frames(board.bytes())
    assert [frame.sequence for frame in sent] == list(range(1, 12))
    assert [frame.faults for frame in sent] == [0] * 10 + [Fault.STOPPING]
    assert {one.acceleration_m_s2 for one in found} <= {None, 981 * 0.01}


def test_a_board_that_is_not_there_costs_nothing_and_is_found_when_it_comes(place: Path, link: Link) -> None:
    link.open(wait_s=0.2)
    assert not link.is_open
    assert "cannot be opened (No such file or directory)" in link.problem
    _, longest = exchanges(link, 20, STEP)
    assert longest < AT_ONCE_S
    assert link.counts.dropped == 20
    with Board(place, "nucleo"):
        until(lambda: link.is_open)
        assert link.problem == ""
        exchanges(link, 5)
    assert link.counts.told == 5


def test_unplugged_and_back(place: Path, link: Link, tmp_path: Path) -> None:
    with Board(place, "nucleo"):
        link.open()
        exchanges(link, 5)
    _, longest = exchanges(link, 20, STEP)
    assert longest < AT_ONCE_S
    assert not link.is_open
    assert str(place) in link.problem
    with Board(place, "nucleo", tmp_path / "log") as board:
        until(lambda: link.is_open)
        exchanges(link, 5)
        until(lambda: board.bytes() == bytes(5))  # and nothing of what was said meanwhile
    assert link.counts.opened == 2


def test_a_silent_board_is_told_and_named_silent(place: Path, link: Link, tmp_path: Path) -> None:
    with Board(place, "silent", tmp_path / "log") as board:
        link.open()
        exchanges(link, 10)
        assert not link.is_silent
        until(lambda: bool(exchanges(link, 20)) and link.is_silent)
        assert link.is_open
        until(lambda: len(board.bytes()) == link.counts.told)


def test_a_board_that_takes_nothing_never_stalls_and_hears_nothing_old(place: Path, link: Link) -> None:
    """The line takes some thousand bytes, then none."""
    with Board(place, "stalling"):
        link.open()
        longest, begin = 0.0, time.monotonic()
        while link.counts.dropped < 3:
            start = time.perf_counter()
            link.exchange(STEP)
            longest = max(longest, time.perf_counter() - start)
            assert time.monotonic() < begin + 20
        assert longest < AT_ONCE_S
        assert link.counts.told > 100


def test_garbage_without_end_is_read_no_faster_than_messages(place: Path) -> None:
    link = Link(str(place), Framed(), PERIOD_S)
    with Board(place, "babbling"):
        link.open()
        found, longest = exchanges(link, 100)
    link.close()
    assert longest < AT_ONCE_S
    assert {heard.acceleration_m_s2 for heard in found} == {None}
    assert link.counts.garbage > 10_000
    assert link.counts.told >= 90


def test_closing_does_not_wait(place: Path) -> None:
    for kind in ("stalling", "silent"):
        link = Link(str(place), Nucleo(), PERIOD_S)
        with Board(place, kind):
            link.open()
            begin = time.monotonic()
            link.close(Told(faults=Fault.STOPPING))
            assert time.monotonic() - begin < 1.0


def test_a_board_that_goes_while_its_line_is_set_up_is_found_again(
    place: Path, link: Link, monkeypatch: pytest.MonkeyPatch
) -> None:
    """pyserial passes `termios.error` on, which is no `OSError`."""
    inner, failures = termios.tcflush, [termios.error(5, "Input/output error")]

    def flush(descriptor: int, queue: int) -> None:
        if failures:
            raise failures.pop()
        inner(descriptor, queue)

    monkeypatch.setattr(termios, "tcflush", flush)
    with Board(place, "nucleo"):
        link.open(wait_s=0.2)
        until(lambda: link.is_open)
    assert not failures


def test_what_is_no_line_or_another_program_s_is_named(place: Path, link: Link, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for name, why in (("file", "it is no serial line"), ("", "Is a directory")):
        other = Link(str(tmp_path / name), Nucleo(), PERIOD_S)
        other.open()
        assert f"cannot be opened ({why})" in other.problem
        other.close()
    with Board(place, "nucleo"):
        link.open()
        second = Link(str(place), Nucleo(), PERIOD_S)
        second.open()
        assert "cannot be opened (another program has it)" in second.problem
        second.close()
