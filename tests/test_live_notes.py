"""What a run leaves for machines and shows to people: the event log, the display's line, the unit's quoting."""

from __future__ import annotations

import json
import resource
import shutil
import signal
import subprocess
from pathlib import Path

import numpy as np
import pytest
from live_samples import ready_drive

from jaxradar.live.artefact import DECISION, Header
from jaxradar.live.board import Fault
from jaxradar.live.detect import LiveDecision
from jaxradar.live.display import Display
from jaxradar.live.printed import CLEAR
from jaxradar.live.replay import Replay
from jaxradar.live.run import Moment
from jaxradar.live.serving import EventLog, Lines
from jaxradar.live.sweeps import LiveSweep
from jaxradar.live.systemd import unit
from jaxradar.live.tally import Tally

HEADER = Header(
    *("none", "", 0.5, "speed", "m/s", (0.1, 0.2), "uint16", "float64", (0.0,), (), DECISION),
    *("host", "jax", (), {}),
)
DECIDED = LiveDecision(1, 0, 0, 0.5, 0.0, 1.0, 0.1, 0.0, True, False, False)


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
        lines.write("two\n")
        lines.write("three\n")
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


@pytest.mark.parametrize("columns", [0, 200, 120, 80, 40, 10])
def test_the_line_fits_the_terminal(columns: int) -> None:
    """Or it would run over, and only its last row would be written over."""
    shown = Display([lambda: "board there", lambda: "123456 recorded"])
    shown._header, shown._last, shown._faults = HEADER, DECIDED, Fault.SENSOR_LOST
    line = shown.line(12.3, 300.0, columns)
    assert CLEAR not in line
    if columns:
        assert len(line) < columns
    if columns != 10:
        assert line.startswith("    12.3 s")
        assert line.endswith("sensor lost")
    if columns in (0, 200):
        assert "board there" in line
        assert "speed 0.1 of 0.5" in line


def test_the_unit_is_quoted_as_systemd_reads_it(tmp_path: Path) -> None:
    words = ["/usr/bin/true", "it's", 'a "b"', "back\\nslash", "100 %i", "$HOME", "", "plain/é", "two\nlines"]
    text = unit(words, "step%i.pyz")
    (line,) = [line for line in text.splitlines() if line.startswith("ExecStart=")]
    assert line == (
        r'ExecStart=/usr/bin/true "it' + "'" + r's" "a \"b\"" "back\\nslash" "100 %%i" $$HOME "" "plain/é" "two\nlines"'
    )
    assert "Description=Road steps ahead, by radar (step%%i.pyz)" in text
    assert "StartLimitIntervalSec=0" in text  # it is started again however often the sensor is not there yet
    if shutil.which("systemd-analyze") is not None:
        (tmp_path / "radar.service").write_text(text)
        command = ["systemd-analyze", "verify", str(tmp_path / "radar.service")]
        found = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
        assert "radar.service" not in found.stderr
