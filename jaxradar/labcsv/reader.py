"""The lab's CSV, as the C program in appendix C.1 of the thesis writes it and C.3 reads it.

A radar file is `,%f` for each range bin (an empty cell, then metres), then for each sweep `\\n%f` and `,%lf` for each
bin (seconds, amplitudes), with no line end behind the last. A log is one such file of any name, or a folder of files
`<sensor>.csv` with `gyro.csv` (the program) or `acc.csv` (the loader) beside them: time and acceleration, and with a
header row further columns `yaw_rate_rad_s` and `speed_m_s`. Spreadsheets' habits are read too: a byte order mark,
CRLF, a line end behind the last row, `0.012`, `128`, `1.2e3`. Truth stands in `truth.json` (`jaxradar.labcsv.truth`).

What the program does to its times and rows is mended or said in `Drive.problems`: see `read_lab_csv`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from jaxradar._errors import LogError
from jaxradar.drive import FULL_SCALE, Channel, Drive, Motion, SensorSeries, SweepFlag
from jaxradar.labcsv.clock import odd_times, unwrap_counter
from jaxradar.labcsv.table import NUMBER, Table, is_cut, read_bytes, read_table, shown
from jaxradar.labcsv.truth import read_truth, truth_path
from jaxradar.motion import KNOWN
from jaxradar.units import NANOSECONDS

__all__ = [
    "MOTION_COLUMNS",
    "MOTION_FILES",
    "SERIAL_TIME_OUT",
    "has_cpu_time",
    "looks_like_radar",
    "read_lab_csv",
    "sensor_files",
    "sensor_number",
]

MOTION_COLUMNS = tuple(KNOWN)  # named as the channels are
MOTION_FILES = ("acc.csv", "gyro.csv")  # the loader's name, the program's name
_SENSOR_NAME = re.compile(r"[0-9]{1,9}")
SERIAL_TIME_OUT = -129.0  # `serialGetchar() - 128` where nothing came: -1 - 128


def sensor_files(folder: Path) -> list[Path]:
    """The radar files of a log folder, in order of sensor number; none if it is no log folder."""
    found = [path for path in folder.iterdir() if path.suffix == ".csv" and _SENSOR_NAME.fullmatch(path.stem)]
    return sorted(found, key=lambda path: (int(path.stem), path.name))


def sensor_number(path: Path) -> int:
    """The number that a radar file bears as its name; 1 if it has another name."""
    return int(path.stem) if _SENSOR_NAME.fullmatch(path.stem) else 1


def looks_like_radar(path: Path) -> bool:
    """Whether a file begins as a radar file does: an empty cell, then a distance."""
    try:
        with path.open("rb") as file:
            start = file.read(64).removeprefix(b"\xef\xbb\xbf")
    except OSError:
        return False
    cells = re.split(rb"[,\r\n]", start, maxsplit=2)
    return len(cells) > 1 and not cells[0].strip() and NUMBER.match(cells[1]) is not None


def read_lab_csv(path: Path) -> Drive:
    """Read a log folder, or one radar file.

    - Amplitudes are uint16 if all are whole numbers in 0..65535, else float32 if that holds them exactly, else float64.
    - A row with a time alone (a failed read) is a sweep of zeros with the flag `NO_AMPLITUDES`; a sweep that reaches
      65535 has `SATURATED`.
    - A last row that is cut off is dropped.
    - The wrap of the program's 16-bit counter is undone. Other times that go back or stand still are kept.
    - The program's motion file has the CPU's clock: where it has as many rows as the first sensor (give or take one)
      but its times lie more than a sweep period off, it is joined row by row. Accelerations of -129 in it (nothing
      came over the serial line) are dropped. A file with a row of names is not the program's and is taken as it is.

    Everything but the first two goes into `problems`, and so do failed reads. Raises `LogError` naming file, line and
    column for what is no plain number, for negative amplitudes, for a range axis that does not increase and for
    rows of another length.
    """
    files = sensor_files(path) if path.is_dir() else [path]
    if not files:
        raise LogError(path, "holds no radar file; expected <sensor number>.csv, such as 3.csv.")
    sensors, problems = [], []
    for file in files:
        series, found = _read_radar(file)
        sensors.append(series)
        problems += found
    numbers = [series.sensor for series in sensors]
    for place, file in enumerate(files):
        if numbers.index(numbers[place]) != place:
            raise LogError(file, f"is a second file of sensor {numbers[place]}.")
    motion = Motion()
    if path.is_dir():
        motion, found = _read_motion(path, sensors[0])
        problems += found
    start = min((int(series.times_ns[0]) for series in sensors if len(series)), default=0)
    truth, mounting = read_truth(truth_path(path))
    return Drive(
        sensors=tuple(replace(series, times_ns=series.times_ns - start) for series in sensors),
        motion=Motion(
            **{
                name: Channel(channel.times_ns - start, channel.values)
                for name, channel in vars(motion).items()
                if channel is not None
            }
        ),
        mounting=mounting,
        truth=truth,
        clock_start_ns=start,
        problems=tuple(problems),
    )


def _read_radar(path: Path) -> tuple[SensorSeries, list[str]]:
    """One sensor, its times on the clock of the file."""
    data = read_bytes(path)
    range_m, start = _range_axis(path, data)
    table = read_table(path, data, start, len(range_m), first_line=2, alone=True)
    times_ns, wraps, span = unwrap_counter(table.times_ns)
    problems = list(table.problems)
    if wraps:
        problems.append(
            f"{path.name}: the program's 16-bit counter fell back to zero {_times(len(wraps))}, first in line "
            f"{wraps[0] + 2}; {span:.2f} s were added each time."
        )
    problems += odd_times(times_ns, path.name, 2)
    if table.alone.any():
        first = int(np.argmax(table.alone)) + 2
        problems.append(
            f"{path.name}: {int(table.alone.sum())} of {len(times_ns)} sweeps have a time but no amplitudes, first in "
            f"line {first}; they are marked invalid."
        )
    if not len(times_ns):
        ended = data[:start].endswith(b"\n")
        problems.append(f"{path.name}: holds no sweep{'.' if ended else '; its first line has no end.'}")
    sweeps = _amplitudes(path, data, start, table)
    flags = np.where(table.alone, np.uint16(SweepFlag.NO_AMPLITUDES), np.uint16(0))
    if sweeps.size and sweeps.max() >= FULL_SCALE:
        flags[(sweeps == FULL_SCALE).any(axis=1)] |= np.uint16(SweepFlag.SATURATED)
    return SensorSeries(sensor_number(path), times_ns, sweeps, range_m, flags), problems


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


def _range_axis(path: Path, data: bytes) -> tuple[np.ndarray, int]:
    """(bins,) float64 metres from the first line, and where the second line begins."""
    if not data:
        raise LogError(path, "is empty; expected a line of distances and a line for each sweep.")
    end = data.find(b"\n")
    line, start = (data, len(data)) if end < 0 else (data[:end], end + 1)
    cells = line.removesuffix(b"\r").split(b",")
    if cells[0].strip():
        raise LogError(
            path, f"found {shown(cells[0])}; expected an empty cell, then distances in metres.", line=1, column=1
        )
    if end < 0 and len(cells) > 2 and is_cut(cells, None):
        raise LogError(path, f"the file ends inside its first line, at {shown(cells[-1])}.", line=1, column=len(cells))
    if len(cells) < 3:
        raise LogError(path, f"found {len(cells) - 1} distances; expected at least 2.", line=1)
    for column, cell in enumerate(cells[1:], 2):
        if not NUMBER.fullmatch(cell):
            raise LogError(path, f"found {shown(cell)}; expected a distance in metres.", line=1, column=column)
    range_m = np.array([float(cell) for cell in cells[1:]])
    wrong = ~np.isfinite(range_m)
    wrong[1:] |= ~(range_m[1:] > range_m[:-1])
    if wrong.any():
        place = int(np.argmax(wrong))
        raise LogError(
            path,
            f"found {shown(cells[place + 1])}; expected a finite distance, greater than the one before.",
            line=1,
            column=place + 2,
        )
    return range_m, start


def _amplitudes(path: Path, data: bytes, start: int, table: Table) -> np.ndarray:
    """The sweeps in the smallest dtype that holds them exactly."""
    values = table.values
    if values.dtype == np.uint16:
        return values
    negative = np.argwhere(values < 0)
    if negative.size:
        row, column = negative[0].tolist()
        cell = data[start:].split(b"\n")[row].split(b",")[column + 1].strip()
        raise LogError(
            path, f"found {shown(cell)}; expected an amplitude, which is not negative.", line=row + 2, column=column + 2
        )
    with np.errstate(over="ignore"):
        single = values.astype(np.float32)
    return single if np.array_equal(single, values) else values


def _read_motion(folder: Path, first: SensorSeries) -> tuple[Motion, list[str]]:
    """The car's motion, its times on the clock of the radar files."""
    files = [folder / name for name in MOTION_FILES if (folder / name).exists()]
    if not files:
        return Motion(), []
    path = files[0]
    problems = [f"{other.name}: was not read, because {path.name} is there too." for other in files[1:]]
    data = read_bytes(path)
    if not data:
        return Motion(), [*problems, f"{path.name}: is empty."]
    names, start = _motion_names(path, data)
    further = len(names) > 1
    table = read_table(path, data, start, len(names), first_line=2 if start else 1, holes=further)
    problems += table.problems
    times_ns, values = table.times_ns, table.values.astype(np.float64)
    of_the_program = not start  # which writes no row of names
    if of_the_program and has_cpu_time(times_ns, first):
        rows = min(len(times_ns), len(first))
        off_s = np.abs(times_ns[:rows] - first.times_ns[:rows]).max() / NANOSECONDS
        problems.append(
            f"{path.name}: its clock is up to {off_s:.3f} s off sensor {first.sensor}'s (the program writes CPU "
            f"time there), so it was joined row by row{_surplus(len(times_ns) - rows)}."
        )
        times_ns, values = first.times_ns[:rows], values[:rows]
    channels = {}
    for column, name in enumerate(names):
        kept = ~np.isnan(values[:, column])
        if of_the_program:
            silent = values[:, column] == SERIAL_TIME_OUT
            if silent.any():
                problems.append(
                    f"{path.name}: {int(silent.sum())} of {len(silent)} samples are -129, which the program writes "
                    "when the serial line times out; they were dropped."
                )
            kept &= ~silent
        if kept.any():
            channels[name] = Channel(times_ns[kept], np.ascontiguousarray(values[kept, column]))
            problems += odd_times(channels[name].times_ns, f"{path.name}, {name}")
    return Motion(**channels), problems


def has_cpu_time(times_ns: np.ndarray, first: SensorSeries) -> bool:
    """Whether motion was recorded loop by loop with the first sensor, but on another clock."""
    rows = min(len(times_ns), len(first))
    period_s = 1 / rate if (rate := first.sweep_rate_hz) else np.inf
    off_ns = np.abs(times_ns[:rows] - first.times_ns[:rows]).max(initial=0)
    return abs(len(times_ns) - len(first)) <= 1 and bool(off_ns > period_s * NANOSECONDS)


def _surplus(rows: int) -> str:
    return f", and {rows} row without a sweep was dropped" if rows else ""


def _motion_names(path: Path, data: bytes) -> tuple[list[str], int]:
    """The channels of a motion file, and where its rows begin."""
    end = data.find(b"\n")
    cells = [cell.strip() for cell in (data if end < 0 else data[:end]).split(b",")]
    if NUMBER.fullmatch(cells[0]):
        if len(cells) != 2:
            raise LogError(
                path, f"has {len(cells)} cells; expected time and acceleration, or a row of names above.", line=1
            )
        return [MOTION_COLUMNS[0]], 0
    texts = [cell.decode("utf-8", "backslashreplace") for cell in cells]
    expected: Iterable[tuple[str, ...]] = [("time_s", "time"), ("acceleration_m_s2", "acceleration")]
    for column, (text, known) in enumerate(zip(texts, expected, strict=False)):
        if text not in known:
            raise LogError(path, f"found {text!r:.40}; expected `{known[0]}`.", line=1, column=column + 1)
    names = [MOTION_COLUMNS[0], *texts[2:]]
    for column, name in enumerate(names[1:], 3):
        if name not in MOTION_COLUMNS or name in names[: column - 2]:
            raise LogError(
                path, f"found {name!r:.40}; expected one of {', '.join(MOTION_COLUMNS[1:])}.", line=1, column=column
            )
    if len(texts) < 2:
        raise LogError(path, "has one column; expected time and acceleration.", line=1)
    return names, len(data) if end < 0 else end + 1
