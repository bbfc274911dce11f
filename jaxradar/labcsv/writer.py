"""A drive as the lab's CSV, byte for byte as the program of the thesis (appendix C.1) writes it.

More decimals than its `%f` are written only where `%f` would lose something. What is read back from `write_lab_csv`
has the same times, amplitudes, range axes, motion, truth and mounting.
"""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import numpy as np

from jaxradar._errors import LogError
from jaxradar.drive import FULL_SCALE, Drive, SensorSeries, SweepFlag
from jaxradar.drivefile import staged
from jaxradar.labcsv.reader import (
    MOTION_COLUMNS,
    MOTION_FILES,
    SERIAL_TIME_OUT,
    has_cpu_time,
    sensor_files,
    sensor_number,
)
from jaxradar.labcsv.truth import truth_path, truth_text
from jaxradar.units import NANOSECONDS

__all__ = ["write_lab_csv"]

_DECIMALS = (6, 9, 12, 17)


def write_lab_csv(drive: Drive, path: Path, *, overwrite: bool = False) -> list[str]:
    """Write a folder of `<sensor>.csv`, `gyro.csv` and `truth.json`, or one radar file if `path` ends in `.csv`.

    Returns a sentence for each thing of the drive that the format cannot hold and that was left out. All is written
    under other names and then renamed. Raises `LogError` if `path` exists and `overwrite` is false, if it cannot be
    written, and for a drive that the format cannot hold: no sensor, amplitudes that are not finite or are negative,
    in one file more than one sensor or motion.
    """
    path = Path(path)
    files, left_out = _radar_files(drive, path)
    motion, lost = _motion_text(drive)
    left_out += lost
    truth = truth_text(drive)
    if path.suffix.lower() != ".csv":
        files |= {"gyro.csv": motion} if motion is not None else {}
        files |= {"truth.json": truth} if truth is not None else {}
        with staged(path, overwrite=overwrite, replaceable=_is_log_folder) as stage:
            stage.mkdir()
            for name, text in files.items():
                (stage / name).write_text(text, encoding="ascii")
        return left_out
    if len(files) > 1 or motion is not None:
        raise LogError(path, "one file holds one sensor and no motion; expected the name of a folder.")
    sensor, named = drive.sensors[0].sensor, sensor_number(path)
    if sensor != named:
        left_out.append(f"The sensor's number {sensor} was left out; this file's name says {named}.")
    beside = truth_path(path)
    if truth is None and beside.exists() and not overwrite:
        raise LogError(beside, "exists already and would be taken for the truth of the new log.")
    with ExitStack() as stack:
        if truth is not None:
            stack.enter_context(staged(beside, overwrite=overwrite)).write_text(truth)
        stack.enter_context(staged(path, overwrite=overwrite)).write_text("".join(files.values()), encoding="ascii")
    if truth is None:
        beside.unlink(missing_ok=True)
    return left_out


def _is_log_folder(path: Path) -> bool:
    """Whether all that a folder holds is a log, so that nothing else is lost with it."""
    if not path.is_dir() or path.is_symlink():
        return False
    known = {*sensor_files(path), *(path / name for name in (*MOTION_FILES, "truth.json"))}
    return bool(sensor_files(path)) and known >= set(path.iterdir())


def _radar_files(drive: Drive, path: Path) -> tuple[dict[str, str], list[str]]:
    if not drive.sensors:
        raise LogError(path, "a log has at least one sensor; this drive has none.")
    files, left_out = {}, []
    for series in drive.sensors:
        if not np.isfinite(series.sweeps).all() or (series.sweeps < 0).any():
            raise LogError(path, f"sensor {series.sensor} has amplitudes that are negative or not finite.")
        files[f"{series.sensor}.csv"] = _radar_text(series, drive.clock_start_ns)
        left_out += _lost_in_radar(series)
    if drive.started_at_ns is not None:
        left_out.append(f"The date of the recording ({drive.started_at}) was left out.")
    if drive.problems:
        left_out.append(f"What was said of the log ({len(drive.problems)} sentences) was left out.")
    return files, left_out


def _lost_in_radar(series: SensorSeries) -> list[str]:
    lost = []
    silent = (series.flags & SweepFlag.NO_AMPLITUDES) != 0
    saturated = np.zeros(len(series), bool) if not series.sweeps.size else (series.sweeps == FULL_SCALE).any(axis=1)
    wanted = np.where(silent, SweepFlag.NO_AMPLITUDES, 0) | np.where(saturated & ~silent, SweepFlag.SATURATED, 0)
    if (differs := series.flags != wanted).any():
        lost.append(f"Sensor {series.sensor}: flags of {int(differs.sum())} sweeps were left out.")
    if silent.any() and series.sweeps[silent].any():
        lost.append(f"Sensor {series.sensor}: amplitudes of sweeps that are marked as without any were left out.")
    if series.spec:
        lost.append(f"Sensor {series.sensor}: how it was set ({', '.join(map(str, series.spec))}) was left out.")
    return lost


def _radar_text(series: SensorSeries, clock_start_ns: int) -> str:
    axis = _format_of(series.range_m)
    silent = (series.flags & SweepFlag.NO_AMPLITUDES) != 0
    times = _time_texts(series.times_ns.tolist(), clock_start_ns, 6)
    amplitude = "%.6f" if series.sweeps.dtype == np.uint16 else _format_of(series.sweeps[~silent])
    row = ("," + amplitude) * len(series.range_m)
    parts = ["".join(f",{axis}" % metres for metres in series.range_m.tolist())]
    for time, sweep, failed in zip(times, series.sweeps, silent.tolist(), strict=True):
        parts.append("\n" + time + ("" if failed else row % tuple(sweep.tolist())))
    # Without a line end these would be taken for a row that was cut off: one without amplitudes, and one whose last
    # number has fewer decimals than others.
    if silent[-1:].any() or amplitude == "%r":
        parts.append("\n")
    return "".join(parts)


def _format_of(values: np.ndarray) -> str:
    """The fewest decimals that give every value back exactly; `repr` where none of the usual numbers of them does."""
    numbers = np.unique(values.astype(np.float64)).tolist()
    for decimals in _DECIMALS:
        form = f"%.{decimals}f"
        if all(float(form % number) == number for number in numbers):
            return form
    return "%r"


def _time_texts(times_ns: list[int], clock_start_ns: int, fewest: int) -> list[str]:
    """Seconds with `fewest` decimals or, if those lose something, 6 or 9; exact, for they are made of integers."""
    times = [time + clock_start_ns for time in times_ns]
    decimals = next(d for d in (3, 6, 9) if d >= fewest and not any(time % 10 ** (9 - d) for time in times))
    unit = 10 ** (9 - decimals)

    def text(time: int) -> str:
        seconds, rest = divmod(abs(time), NANOSECONDS)
        return f"{'-' if time < 0 else ''}{seconds}.{rest // unit:0{decimals}d}"

    return [text(time) for time in times]


def _motion_text(drive: Drive) -> tuple[str | None, list[str]]:
    """`%.3f,%d` and a line end for each sample, as the program writes it. A row of names stands above where there are
    further channels, whose cells are empty where they have no sample, or where the reader would mend what is right."""
    channels = {name: channel for name in MOTION_COLUMNS if (channel := getattr(drive.motion, name)) is not None}
    lost, texts, times = [], {}, {}
    for name, channel in channels.items():
        finite = np.isfinite(channel.values)
        if not finite.all():
            lost.append(f"{name}: {int((~finite).sum())} samples that are no finite numbers were left out.")
        values = channel.values[finite]
        if len(values):
            form = "%d" if (values % 1 == 0).all() else _format_of(values)
            texts[name] = [form % value for value in values.tolist()]
            times[name] = channel.times_ns[finite].tolist()
    if not texts:
        return None, lost
    names = [MOTION_COLUMNS[0], *(name for name in texts if name != MOTION_COLUMNS[0])]
    first = times[next(iter(times))]
    if len(texts) == len(names) and all(own == first for own in times.values()):
        rows = list(zip(first, map(",".join, zip(*texts.values(), strict=True)), strict=True))
    else:
        rows = []
        for name in texts:
            before, behind = "," * names.index(name), "," * (len(names) - 1 - names.index(name))
            rows += [(time, before + text + behind) for time, text in zip(times[name], texts[name], strict=True)]
        if all(own == sorted(own) for own in times.values()):  # sorting would change a channel whose times go back
            rows.sort(key=lambda row: row[0])
    stamps = _time_texts([time for time, _ in rows], drive.clock_start_ns, 3)
    series = min(drive.sensors, key=lambda item: item.sensor)
    mended = has_cpu_time(np.array(first, np.int64), series) or any(
        float(text) == SERIAL_TIME_OUT for text in texts.get(names[0], ())
    )
    header = ",".join(["time_s", *names]) + "\n" if len(names) > 1 or mended else ""
    return header + "".join(f"{stamp},{text}\n" for stamp, (_, text) in zip(stamps, rows, strict=True)), lost
