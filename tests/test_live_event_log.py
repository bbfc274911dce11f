"""The event log: what stands in it, and a disk that does not take it."""

from __future__ import annotations

import errno
import io
import json
import re
import resource
import signal
from pathlib import Path

import numpy as np
import pytest
from board import Board, until
from live_samples import ready_drive
from test_live_notes import DECIDED, HEADER
from test_live_service import log, ran

from jaxradar.live.board import Fault
from jaxradar.live.event_log import EventLog, Lines
from jaxradar.live.replay import Replay
from jaxradar.live.run import Moment
from jaxradar.live.sweeps import LiveSweep
from jaxradar.live.tally import Tally
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
    writer = Writer(stream, direct=direct)
    writer.say("before")
    until(lambda: stream.getvalue() == "before\n")
    stream.full = True
    writer.say("lost")
    until(lambda: writer.problem == "No space left on device")
    stream.full = False
    writer.say("after")
    with pytest.raises(OSError, match="No space left"):
        writer.close()
    assert (stream.getvalue(), writer.problem) == ("before\nafter\n", "")


def sweep(sensor: int, last: bool) -> LiveSweep:
    return LiveSweep(sensor, 0, np.zeros(2, np.uint16), 0, (), last)


def kinds(path: Path) -> list[str]:
    return [next(key for key in json.loads(line) if key != "utc") for line in path.read_text().splitlines()]


def test_a_disk_that_does_not_take_the_event_log_ends_nothing() -> None:
    log, tally = EventLog(Path("/dev/full")), Tally()
    log.begin(Replay(ready_drive(), None), HEADER, ())
    for _ in range(20):
        log.say("a sentence")
    log.end(tally)
    assert tally.more["events"] == {"lost": 22}


def test_half_a_line_stays_alone(tmp_path: Path) -> None:
    path = tmp_path / "events"
    path.write_text('{"utc": 1}\n{"ut')  # by a program that was killed
    lines = Lines(path)
    lines.write("one\n")
    before, handler = resource.getrlimit(resource.RLIMIT_FSIZE), signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (path.stat().st_size + 2, before[1]))  # stands for a full disk
        for text in ("two\n", "three\n"):
            with pytest.raises(OSError, match=r"large|space"):
                lines.write(text)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)
    lines.write("four\n")
    lines.close()
    assert path.read_text().splitlines() == ['{"utc": 1}', '{"ut', "one", "tw", "four"]
    assert lines.lost == 2
    Lines(path).close()
    assert path.read_text().endswith("four\n")


def test_a_sensor_that_fails_beside_one_that_does_not_is_noted_once(tmp_path: Path) -> None:
    log = EventLog(tmp_path / "events")
    log.begin(Replay(ready_drive(), None), HEADER, ())
    for place in range(60):
        bad = Fault.NO_DATA if 10 <= place < 50 else Fault(0)
        log.hear(sweep(1, False), DECIDED, Moment(0, place, bad))
        log.hear(sweep(3, True), DECIDED, Moment(0, place, Fault(0)))
    log.end(Tally())
    assert kinds(tmp_path / "events") == ["begin", "faults", "faults", "end"]
