"""One sweep a call, as on the device: `python benches/run.py live`.

The default detector of each kind of program, and written by hand in NumPy, back to back and at 300 sweeps/s; and the
whole program on the device, from its start to its first decision, in a process of its own.
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

import numpy as np
from data import UnavailableError
from measure import figure, say
from peers.numpy_step import NumpyDefault
from report import Row, Section
from settings import Settings

from jaxradar import load_scene, simulate, thin
from jaxradar._errors import ConfigError
from jaxradar.drive import SensorSeries
from jaxradar.export import JaxStep, export_detector, write_archive
from jaxradar.export.check import reference
from jaxradar.export.iree import compile_program
from jaxradar.live.detect import Step
from jaxradar.live.program import Program
from jaxradar.systems.step import DetectorFile, RangeAxis, load_detector, time_steps
from jaxradar.systems.step.packed import DECISION_FIELDS, PackedStep

__all__ = ["measure"]

RATE_HZ = 300.0
BINS = (128, 1444)  # as the lab keeps them, and as the sensor gives them
STARTS = 9
MOST_OFF = 1e-3  # of the largest statistic
NUMPY = "NumPy, by hand"
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
    return np.column_stack([series.sweeps, series.flags, time_steps(series.times_ns)]).astype(step.dtype)


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


def _programs(file: DetectorFile, step: PackedStep, section: Section, quick: bool) -> dict[str, tuple[Step, int]]:
    """Each with the size of its file in bytes, 0 of what has none."""
    text = step.lowered().as_text()

    def by_iree(single: bool) -> tuple[Step, int]:
        made = compile_program(text, "host", single=single)
        return Program(made, step.initial(), step.inputs, len(DECISION_FIELDS)), len(made)

    found: dict[str, tuple[Step, int]] = {"IREE, one dispatch": by_iree(True)}
    if not quick and step.axis.bins == BINS[0]:
        say("compiling as IREE cuts it, which takes minutes")
        found["IREE, as it cuts it"] = by_iree(False)
    found["jax.jit, vectors"] = JaxStep.of_step(step), 0
    try:
        artefact = export_detector(file, np.asarray(step.axis.range_m), kind="jax")
        found["jax.export, read back"] = JaxStep.of_artefact(artefact), len(artefact.program)
    except ConfigError as why:
        section.notes.append(f"Skipped: jax.export: {why}")
    found[NUMPY] = NumpyDefault(file.detector, step.axis), 0
    return found


def _wrong(step: PackedStep, program: Step, rows: np.ndarray) -> str:
    """Empty if a program decides as JAX does, else what differs."""
    wanted = reference(step, rows)
    found = np.empty_like(wanted)
    for row, decision in zip(rows, found, strict=True):
        program.inputs[:] = row
        decision[:] = program.run()
    event, statistic = DECISION_FIELDS.index("event"), DECISION_FIELDS.index("statistic")
    if not wanted[:, event].any():
        return "nothing is detected that could be compared"
    differing = np.flatnonzero(found[:, event] != wanted[:, event])
    if len(differing):
        return f"the event of sweep {differing[0]} and {len(differing) - 1} others is not JAX's"
    off = np.abs(found[:, statistic] - wanted[:, statistic]) / wanted[:, statistic].max()
    if not off.max() <= MOST_OFF:
        return f"the statistic of sweep {off.argmax()} is off by {off.max():.2g} of the largest"
    return ""


def _run(folder: Path, arguments: list[str]) -> tuple[float, float, float, str]:
    """Of a process: seconds from its start to what it says as `AT`, and to its end; its memory in MB; its output."""
    begin = time.monotonic()  # of the machine, not of a process
    ran = subprocess.run(
        [sys.executable, *arguments],
        capture_output=True,
        text=True,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": ""},
        check=False,
    )
    seconds = time.monotonic() - begin
    if ran.returncode or "AT" not in ran.stderr:
        raise UnavailableError(f"the program failed: {ran.stderr.strip().splitlines()[-1:]}")
    at, held = ran.stderr.rsplit("AT", 1)[1].split()[:2]
    return float(at) - begin, seconds, int(held) / 1e3, ran.stdout


# The time at which that is said, and the most memory so far.
SAID = (
    "    at = time.monotonic()\n"
    "    held = [line for line in open('/proc/self/status') if line.startswith('VmHWM')]\n"
    "    print('AT', at, held[0].split()[1], file=sys.stderr)\n"
)
PROGRAM = (
    "import runpy, sys, time\n"
    "sys.argv = sys.argv[1:]\n"
    "try:\n"
    "    runpy.run_path(sys.argv[0], run_name='__main__')\n"
    "finally:\n" + SAID
)
FLOOR = "import numpy, iree.runtime\nimport sys, time\nif True:\n" + SAID


def _started(folder: Path, archive: Path, log: Path) -> tuple[float, ...]:
    """Of the program for one sweep, then of its imports alone: seconds from the start of the process until the work is
    done, and to its end, and its resident memory in MB."""
    replay = [str(archive), "--source", "replay", str(log), "--sweeps", "1", "--json"]
    *whole, said = _run(folder, ["-c", PROGRAM, *replay])
    if "summary" not in said:
        raise UnavailableError("the program ended without a summary")
    return (*whole, *_run(folder, ["-c", FLOOR])[:3])


def measure(settings: Settings) -> Section:
    count = 2000 if settings.quick else 20_000
    section = Section("live", f"the default detector, one sweep a call; {count} calls", COLUMNS)
    file = load_detector("default")
    for bins in BINS:
        series = _series(bins)
        step = PackedStep(file.detector, RangeAxis.of(series.range_m))
        rows = _rows(step, series)
        for name, (program, size) in _programs(file, step, section, settings.quick).items():
            say(f"{name}, {bins} bins")
            wrong = _wrong(step, program.another(), rows) if name == NUMPY else ""
            if wrong:
                section.failed = True
                section.notes.append(f"WRONG, not timed: {name}, {bins} bins: {wrong}.")
                continue
            gc.collect()
            fast = np.percentile(_times(program, rows, count, None), [50, 99])
            slow = np.percentile(_times(program, rows, count // 10, RATE_HZ), [50, 99])
            numbers = {"p50": fast[0], "p99": fast[1], "paced_p50": slow[0], "paced_p99": slow[1]}
            if size:
                numbers["kb"] = size / 1e3
            cells = [name, str(bins), f"{size / 1e3:.0f}" if size else "", *map(figure, (*fast, *slow))]
            section.rows.append(Row(f"{name}, {bins}", cells, numbers))
    section.notes.append(
        f"`{NUMPY}` decides as JAX does on all {len(rows)} sweeps: the same detections, the statistic within "
        f"{MOST_OFF:g} of the largest."
        if not section.failed
        else "What is wrong is not timed."
    )
    _whole(section, file)
    return section


def _whole(section: Section, file: DetectorFile) -> None:
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
    names = ("first", "seconds", "mb", "floor_first", "floor_seconds", "floor_mb")
    found = dict(zip(names, np.median(np.array(runs), axis=0).tolist(), strict=True))
    section.rows.append(Row("start", [], found))
    section.notes.append(
        f"The whole program, {size / 1e3:.0f} kB, from its start to its first decision: {found['first']:.3f} s, to its "
        f"end after that one sweep: {found['seconds']:.3f} s, {found['mb']:.0f} MB resident. In turns with it "
        f"`import numpy, iree.runtime` alone: {found['floor_first']:.3f} s to the end of the imports, "
        f"{found['floor_seconds']:.3f} s to that of the process, {found['floor_mb']:.0f} MB. Medians of {STARTS}. "
        f"In the program a sweep of {len(series.range_m)} bins takes "
        f"{record['took_us']['median']:.0f} us (99 %: {record['took_us']['p99']:.0f}), Python's share included."
    )
    section.notes.append("Asked: 30 and 60 us at 128 bins, 60 us at 1444, 0.15 s, 60 MB, 100 and 300 kB.")
