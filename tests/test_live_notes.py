"""What a run shows to people and gives to systemd: the display's line, the unit's quoting."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from jaxradar.live.artefact import DECISION, Header
from jaxradar.live.board import Fault
from jaxradar.live.detect import LiveDecision
from jaxradar.live.display import Display
from jaxradar.live.printed import CLEAR
from jaxradar.live.systemd import unit

HEADER = Header(
    *("none", "", 0.5, "speed", "m/s", (0.1, 0.2), "uint16", "float64", (0.0,), (), DECISION),
    *("host", "jax", (), {}),
)
DECIDED = LiveDecision(1, 0, 0, 0.5, 0.0, 1.0, 0.1, 0.0, True, False, False)


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
