"""One sweep a call, as on the device: `python benches/run.py live`.

The default detector of each kind of program, back to back and at 300 sweeps/s; and the whole program on the device,
from its start to its first decision, in a process of its own.
"""

from __future__ import annotations

import gc
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from data import UnavailableError
from measure import figure, say
from report import Row, Section
from settings import Settings

from jaxradar import load_scene, simulate, thin
from jaxradar.drive import SensorSeries
from jaxradar.export import JaxStep, export_detector, write_archive
from jaxradar.export.iree import compile_program
from jaxradar.live.detect import Step
from jaxradar.live.program import Program
from jaxradar.systems.step import RangeAxis, load_detector
from jaxradar.systems.step.packed import DECISION_FIELDS, PackedStep

__all__ = ["measure"]

RATE_HZ = 300.0
BINS = (128, 1444)  # as the lab keeps them, and as the sensor gives them
STARTS = 9
COLUMNS = ("program", "bins", "kB", "p50 us", "p99 us", "at 300 Hz p50", "p99")


def _series(bins: int) -> SensorSeries:
    """Two seconds over a wet road with a step."""
    series = simulate(load_scene("wet-road"), seed=1).sensors[0]
    if bins == len(series.range_m):
        return series
    if bins < len(series.range_m):
        return thin(series, bins)
    at = np.linspace(0, len(series.range_m) - 1, bins)
    low = at.astype(int)
    share, high = at - low, np.minimum(low + 1, len(series.range_m) - 1)
    sweeps = series.sweeps[:, low] * (1 - share) + series.sweeps[:, high] * share
    range_m = np.interp(at, np.arange(len(series.range_m)), series.range_m)
    return SensorSeries(series.sensor, series.times_ns, sweeps.round().astype(np.uint16), range_m, series.flags)


def _rows(step: PackedStep, series: SensorSeries) -> np.ndarray:
    rows = np.zeros((len(series), step.inputs), step.dtype)
    rows[:, : len(series.range_m)] = series.sweeps
    rows[:, len(series.range_m)] = series.flags
    rows[1:, len(series.range_m) + 1] = np.diff(series.times_ns) / 1e9
    return rows


def _times(program: Step, rows: np.ndarray, count: int, rate_hz: float | None) -> np.ndarray:
    """Microseconds of each of the last `count` calls."""
    found = np.zeros(count)
    due = time.perf_counter()
    for place in range(-200, count):
        if rate_hz is not None:
            due += 1.0 / rate_hz
            time.sleep(max(0.0, due - time.perf_counter()))
        row = rows[place % len(rows)]
        begin = time.perf_counter_ns()
        program.inputs[:] = row
        program.run()
        if place >= 0:
            found[place] = (time.perf_counter_ns() - begin) / 1e3
    return found


def _programs(step: PackedStep, quick: bool) -> dict[str, tuple[Step, int]]:
    text = step.lowered().as_text()

    def by_iree(single: bool) -> tuple[Step, int]:
        made = compile_program(text, "host", single=single)
        return Program(made, step.initial(), step.inputs, len(DECISION_FIELDS)), len(made)

    found: dict[str, tuple[Step, int]] = {"IREE, one dispatch": by_iree(True)}
    if not quick and step.axis.bins == BINS[0]:
        say("compiling as IREE cuts it, which takes minutes")
        found["IREE, as it cuts it"] = by_iree(False)
    found["jax.jit, vectors"] = JaxStep.of_step(step), 0
    return found


def _started(folder: Path, archive: Path, log: Path) -> tuple[float, float]:
    """Seconds from the start of the program to its first decision, and its resident memory in MB."""
    code = (
        "import runpy, sys\n"
        "sys.argv = sys.argv[1:]\n"
        "try:\n"
        "    runpy.run_path(sys.argv[0], run_name='__main__')\n"
        "finally:\n"
        "    held = [line for line in open('/proc/self/status') if line.startswith('VmHWM')]\n"
        "    print('RSS', held[0].split()[1], file=sys.stderr)\n"
    )
    begin = time.perf_counter()
    command = [sys.executable, "-c", code, str(archive), "--source", "replay", str(log), "--sweeps", "1", "--json"]
    ran = subprocess.run(
        command, capture_output=True, text=True, cwd=folder, env={**os.environ, "PYTHONPATH": ""}, check=False
    )
    seconds = time.perf_counter() - begin
    if ran.returncode or "summary" not in ran.stdout:
        raise UnavailableError(f"the program failed: {ran.stderr.strip().splitlines()[-1:]}")
    return seconds, int(ran.stderr.rsplit("RSS", 1)[1]) / 1e3


def measure(settings: Settings) -> Section:
    count = 2000 if settings.quick else 20_000
    section = Section("live", f"the default detector, one sweep a call; {count} calls", COLUMNS)
    file = load_detector("default")
    for bins in BINS:
        series = _series(bins)
        step = PackedStep(file.detector, RangeAxis.of(series.range_m))
        rows = _rows(step, series)
        for name, (program, size) in _programs(step, settings.quick).items():
            say(f"{name}, {bins} bins")
            gc.collect()
            fast = np.percentile(_times(program, rows, count, None), [50, 99])
            slow = np.percentile(_times(program, rows, count // 10, RATE_HZ), [50, 99])
            numbers = {"p50": fast[0], "p99": fast[1], "paced_p50": slow[0], "paced_p99": slow[1]}
            cells = [name, str(bins), f"{size / 1e3:.0f}" if size else "", *map(figure, (*fast, *slow))]
            section.rows.append(Row(f"{name}, {bins}", cells, numbers))
    _whole(section, file)
    return section


def _whole(section: Section, file: Any) -> None:
    from jaxradar.drivefile import write_drive

    drive = simulate(load_scene("wet-road"), seed=1)
    series = drive.sensors[0]
    with tempfile.TemporaryDirectory(prefix="jaxradar-bench-") as name:
        folder = Path(name)
        write_drive(drive, folder / "log.drive")
        size = write_archive(folder / "step.pyz", export_detector(file, series.range_m, sample=series.sweeps))
        say("starting the program")
        try:
            runs = [_started(folder, folder / "step.pyz", folder / "log.drive") for _ in range(STARTS)]
        except UnavailableError as why:
            section.failed = True
            section.notes.append(str(why))
            return
        record = json.loads(
            subprocess.run(
                [sys.executable, "step.pyz", "--source", "replay", "log.drive", "--fast", "--json"],
                capture_output=True,
                text=True,
                cwd=folder,
                env={**os.environ, "PYTHONPATH": ""},
                check=True,
            ).stdout.splitlines()[-1]
        )["summary"]
    seconds, memory = np.median(np.array(runs), axis=0)
    section.rows.append(Row("start", [], {"seconds": float(seconds), "mb": float(memory)}))
    section.notes.append(
        f"The whole program, {size / 1e3:.0f} kB, from its start to its end after one sweep: {seconds:.3f} s (median "
        f"of {STARTS}), {memory:.0f} MB resident; in it a sweep of {len(series.range_m)} bins takes "
        f"{record['took_us']['median']:.0f} us (99 %: {record['took_us']['p99']:.0f}), Python's share included."
    )
    section.notes.append("Asked: 30 and 60 us at 128 bins, 60 us at 1444, 0.15 s, 60 MB, 100 and 300 kB.")
