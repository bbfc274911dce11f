"""The whole of what README says of real roads, printed and checked by the script that README names."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parents[1] / "scripts" / "road_recordings.py"


@pytest.mark.long
def test_the_script_finds_all_as_asked_for(road_recordings) -> None:
    folder = next(iter(road_recordings.values())).parent
    done = subprocess.run([sys.executable, SCRIPT, folder], capture_output=True, text=True, timeout=1200, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.endswith("\nAll as asked for.\n")
    assert "Standing, together 27 alarms of the thesis's rule, 27 of the plain script." in done.stdout


def test_a_folder_without_recordings_is_refused(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, SCRIPT, tmp_path], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 2
    assert "expected a folder that holds *.h5 recordings" in done.stderr
    assert "Traceback" not in done.stderr
