"""In the car: `python benches/run.py car`.

The compiled default detector over ten minutes of sweeps at 300 Hz as they would come, a board at the end of a
pseudo-terminal in a process of its own and the recorder on; then three million sweeps as fast as it goes.
"""

from __future__ import annotations

import dataclasses
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from data import UnavailableError
from measure import figure, say
from report import Row, Section
from settings import Settings

from jaxradar import load_scene, simulate
from jaxradar.drive import Drive
from jaxradar.drivefile import read_drive, write_drive
from jaxradar.export import export_detector, write_archive
from jaxradar.systems.step import load_detector

__all__ = ["measure"]

RATE_HZ = 300.0
SECONDS, QUICK_SECONDS = 600, 10
SOAK, QUICK_SOAK = 3_000_000, 60_000
BOARD = Path(__file__).parents[2] / "tests" / "board.py"
MOST_AFTER_US, MOST_GROWN_MB = 1000, 1.0  # of 99.9 % of the sweeps; from a tenth of the soak on
COLUMNS = ("sweep in to byte out", "p50 us", "p99 us", "p99.9 us", "most us")


def _long(seconds: int) -> Drive:
    """A wet road with a step, again and again, at an even rate."""
    drive = simulate(load_scene("wet-road"), seed=1)
    one = drive.sensors[0]
    count = round(seconds * RATE_HZ)
    rows = np.arange(count) % len(one)
    times = np.round(np.arange(count) * 1e9 / RATE_HZ).astype(np.int64)
    made = dataclasses.replace(one, times_ns=times, sweeps=one.sweeps[rows], flags=one.flags[rows])
    return Drive((made,))


def measure(settings: Settings) -> Section:
    section = Section("car", "a board told and all recorded, at 300 sweeps/s", COLUMNS)
    with tempfile.TemporaryDirectory(prefix="jaxradar-bench-") as name:
        folder = Path(name)
        drive = _long(QUICK_SECONDS if settings.quick else SECONDS)
        series = drive.sensors[0]
        write_drive(drive, folder / "long.drive")
        write_drive(_long(2), folder / "short.drive")
        write_archive(
            folder / "step.pyz", export_detector(load_detector("default"), series.range_m, sample=series.sweeps[:600])
        )
        try:
            _paced(section, folder, len(series))
            _soak(section, folder, QUICK_SOAK if settings.quick else SOAK)
        except UnavailableError as why:
            section.failed = True
            section.notes.append(str(why))
    section.notes.append(
        f"Asked: 99.9 % within {MOST_AFTER_US} us, no sweep lost, memory growing by at most {MOST_GROWN_MB:g} MB."
    )
    return section


def _beside_a_board(folder: Path, command: list[str]) -> dict[str, Any]:
    """The last line of what a program prints, while a board is there."""
    board = subprocess.Popen(
        [sys.executable, str(BOARD), str(folder / "board"), "nucleo", str(folder / "bytes")],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert board.stdout is not None
    board.stdout.readline()
    try:
        ran = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    finally:
        board.kill()
        board.wait()
    if ran.returncode:
        raise UnavailableError(f"the program failed: {ran.stderr.strip().splitlines()[-1:]}")
    found: dict[str, Any] = json.loads(ran.stdout.splitlines()[-1])
    return found


def _paced(section: Section, folder: Path, sweeps: int) -> None:
    say(f"{sweeps / RATE_HZ:.0f} s of sweeps as they come")
    command = [sys.executable, "step.pyz", "--source", "replay", "long.drive", "--json", "--link", "nucleo"]
    found = _beside_a_board(folder, [*command, "--port", str(folder / "board"), "--record", "records"])["summary"]
    told, recorded = found["board"], found["recorded"]
    after = told["told_after_us"]
    cells = ["paced", *(figure(after[key]) for key in ("median", "p99", "p99.9", "most"))]
    kept = sum(len(read_drive(one).sensors[0]) for one in (folder / "records").glob("*.drive"))
    section.rows.append(Row("paced", cells, {key: after[key] for key in ("median", "p99", "p99.9")}))
    section.notes.append(
        f"{found['sweeps']} of {sweeps} sweeps decided on, {kept} read back from the disk; {found['late']} late, "
        f"{found['silent']} rounds without one, {found['dropped']} dropped, {recorded['dropped']} not recorded; "
        f"{told['told']} bytes out, {told['dropped']} not, {told['heard']} in. The program takes "
        f"{100 * found['processor_share']:.0f} % of a processor, the detector {found['took_us']['median']:.0f} us a "
        "sweep. The figures are of the last 65,536 sweeps."
    )
    section.failed |= found["sweeps"] != sweeps or kept != sweeps or after["p99.9"] > MOST_AFTER_US


def _soak(section: Section, folder: Path, sweeps: int) -> None:
    say(f"{sweeps:,} sweeps as fast as it goes")
    command = [sys.executable, str(Path(__file__).parents[1] / "soak.py"), "short.drive", "step.pyz"]
    found = _beside_a_board(folder, [*command, str(folder / "board"), "soak", str(sweeps)])
    grown = (found["late_kb"] - found["early_kb"]) / 1e3
    section.rows.append(Row("soak", [], {"grown_mb": grown}))
    section.notes.append(
        f"Over {found['tally']['sweeps']:,} sweeps as fast as it goes, from a tenth of them on, resident memory grows "
        f"by {grown:.2f} MB, to {found['late_kb'] / 1e3:.0f}; {found['tally']['recorded']['dropped']} not recorded."
    )
    section.failed |= grown > MOST_GROWN_MB or bool(found["tally"]["recorded"]["dropped"])
