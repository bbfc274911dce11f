"""The event log: what stands in it, and a disk that does not take it."""

from __future__ import annotations

import errno
import io
import json
import re
from pathlib import Path

import pytest
from board import Board, until
from test_live_service import log, ran

from jaxradar.live.writer import Writer

__all__ = ["log"]  # a fixture


def test_the_event_log_has_faults_losses_and_what_was_said(log: Path, tmp_path: Path) -> None:
    found = ran(
        log, "--events", str(tmp_path / "events"), "--link", "nucleo", "--port", str(tmp_path / "none"), "--json"
    )
    assert found.returncode == 0
    lines = [json.loads(line) for line in (tmp_path / "events").read_text().splitlines()]
    assert all(re.fullmatch(r"\d{4}-\d\d-\d\dT[\d:.]+\+00:00", line["utc"]) for line in lines)
    kinds = [next(key for key in line if key != "utc") for line in lines]
    assert kinds[0] == "begin" or kinds[1] == "begin"
    assert kinds[-1] == "end"
    named = [line["faults"]["faults"] for line in lines if "faults" in line]
    assert ["no_data"] in named  # sweeps without amplitudes are in the log
    assert [] in named  # and it is said when that is over
    assert any("No such file" in line["said"]["sentence"] for line in lines if "said" in line)


def test_an_event_log_that_cannot_be_written_ends_nothing(log: Path, tmp_path: Path) -> None:
    """On a disk that is full from the begin on: steps are found and told as ever, and it is said."""
    if not Path("/dev/full").exists():
        pytest.skip("there is no /dev/full here")
    with Board(tmp_path / "board", "nucleo", tmp_path / "bytes") as board:
        options = ["--json", "--link", "nucleo", "--port", str(tmp_path / "board"), "--hold", "1000"]
        found = ran(log, *options, "--events", "/dev/full")
        until(lambda: board.bytes()[-1:] == b"\x00")
        assert b"\x01" in board.bytes()
    assert found.returncode == 0, found.stderr
    assert "/dev/full: No space left on device. Trying again." in found.stderr
    again = ran(log, "--json", "--fast", "--events", "/dev/full")
    assert again.returncode == 0, again.stderr
    assert found.stdout.splitlines()[:-1] == again.stdout.splitlines()[:-1]


class Filling(io.StringIO):
    """A file on a disk that is full for a while."""

    full = False

    def write(self, text: str) -> int:
        if self.full:
            raise OSError(errno.ENOSPC, "No space left on device")
        return super().write(text)


@pytest.mark.parametrize("direct", [False, True])
def test_lines_are_written_again_when_there_is_room(direct: bool) -> None:
    stream = Filling()
    writer = Writer(stream, direct=direct, lossy=True)
    writer.say("before")
    until(lambda: stream.getvalue() == "before\n")
    stream.full = True
    writer.say("lost")
    until(lambda: writer.problem == "No space left on device")
    stream.full = False
    writer.say("after")
    writer.close()
    assert (stream.getvalue(), writer.problem) == ("before\nafter\n", "")
