"""Writing a drive, all at once or sweep by sweep."""

from __future__ import annotations

import os
import zlib
from collections.abc import Sequence
from dataclasses import asdict
from io import FileIO
from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from jaxradar._errors import LogError
from jaxradar.drive import Drive, Mounting, Truth
from jaxradar.drivefile.layout import (
    FORMAT,
    HEADER,
    MOTION_NAMES,
    VERSION,
    Column,
    SensorLayout,
    checksums,
    columns_of,
    read_header,
    write_header,
)
from jaxradar.drivefile.reader import Folder, open_column
from jaxradar.drivefile.staged import staged

__all__ = ["DriveWriter", "is_drive_folder", "write_drive"]

Numbers = int | float | np.generic | np.ndarray | Sequence[Any]


class DriveWriter:
    """A drive that is being recorded. What `append` took is on disk in such an order that a crash at any byte leaves
    every earlier sweep readable; `close` (or the end of a `with` block) seals it.

    - `sensors`: one layout for each sensor.
    - `motion`: the names of the channels to come, as in `Motion`.
    - `clock_start_ns`: None if times are given on the recorder's own clock, which the reader then lets count from the
      first sweep; a number if they already count from it.
    - `mounting`, `truth`, `started_at_ns`, `problems`: as in `Drive`; `set` changes them later.
    - `durable`: whether `close` and `set` return only when all is on the disk itself, and outlives a loss of power.

    Raises `LogError` if `path` exists or cannot be written, `ValueError` for what a drive cannot hold.
    """

    def __init__(
        self,
        path: str | PathLike[str],
        sensors: Sequence[SensorLayout],
        *,
        motion: Sequence[str] = (),
        mounting: Mounting | None = None,
        truth: Truth | None = None,
        started_at_ns: int | None = None,
        clock_start_ns: int | None = None,
        problems: Sequence[str] = (),
        durable: bool = True,
    ) -> None:
        unknown = [name for name in motion if name not in MOTION_NAMES]
        if unknown:
            raise ValueError(f"`DriveWriter(motion=...)` knows {', '.join(MOTION_NAMES)}; got {unknown}.")
        numbers = [layout.sensor for layout in sensors]
        if len(set(numbers)) != len(numbers):
            raise ValueError(f"`DriveWriter(sensors=...)` must have different sensor numbers; got {numbers}.")
        header: dict[str, Any] = {
            "format": FORMAT,
            "version": VERSION,
            "sensors": [
                {
                    "sensor": int(layout.sensor),
                    "bins": len(layout.range_m),
                    "dtype": np.dtype(layout.dtype).name,
                    "range_m": layout.range_m.tolist(),
                    "spec": dict(layout.spec),
                }
                for layout in sensors
            ],
            "motion": list(motion),
            "mounting": None,
            "truth": None,
            "started_at_ns": None,
            "clock_start_ns": clock_start_ns,
            "problems": [],
            "sealed": None,
        }
        _update(header, mounting=mounting, truth=truth, started_at_ns=started_at_ns, problems=problems)
        folder = Path(path)
        with staged(folder, overwrite=False) as stage:
            stage.mkdir()
            for column in columns_of(header).values():
                for name, _ in column.parts:
                    (stage / name).touch()
            write_header(stage, header, durable=durable)
        self._open(folder, header, durable)

    @classmethod
    def reopen(cls, path: str | PathLike[str]) -> DriveWriter:
        """Go on with a drive: what a crash left behind its last whole sweep is cut off, which `problems` then says.

        Raises `LogError` if there is no drive to be read.
        """
        folder = Path(path)
        header = read_header(folder)
        writer = cls.__new__(cls)
        try:
            found = {
                column: open_column(Folder(folder), column, header["sealed"]) for column in columns_of(header).values()
            }
            header["problems"] += [sentence for _, _, cut in found.values() for sentence in cut]
            header["sealed"] = None
            write_header(folder, header)
            for column, (records, _, _) in found.items():
                for name, dtype in column.parts:
                    os.truncate(folder / name, len(records) * dtype.itemsize)
            writer._open(folder, header, durable=True)
        except OSError as error:
            raise LogError(folder, f"cannot be written: {error.strerror}.") from error
        except (KeyError, TypeError, ValueError) as error:
            raise LogError(folder / HEADER, f"does not describe a drive: {error!r:.200}.") from error
        return writer

    def _open(self, folder: Path, header: dict[str, Any], durable: bool) -> None:
        self._durable = durable
        self._ends: LogError | None = None
        self._folder = folder
        self._header = header
        self._columns = columns_of(header)
        names = [name for column in self._columns.values() for name, _ in column.parts]
        # Unbuffered: what append was given is the system's when it returns, sweeps before the records that commit them.
        self._files = {name: (folder / name).open("ab", buffering=0) for name in names}
        self._written = dict.fromkeys(names, (0, 0))
        for name in names:
            content = (folder / name).read_bytes()
            self._written[name] = len(content), zlib.crc32(content)

    def append(self, sensor: int, times_ns: Numbers, sweeps: Numbers, flags: Numbers = 0) -> None:
        """Add one sweep, or many: times () or (n,) in integer nanoseconds, sweeps (bins,) or (n, bins) of the sensor's
        dtype, flags () or (n,) of `SweepFlag`.

        Raises `ValueError` for other shapes or dtypes and for an unknown or closed sensor, `LogError` if the disk
        does not take them; the drive on it then ends before this call.
        """
        column = self._column(sensor)
        assert column.row is not None
        rows = np.asarray(sweeps)
        rows = rows[None] if rows.ndim == 1 else rows
        if rows.dtype != column.row.base or rows.shape[1:] != column.row.shape:
            raise ValueError(
                f"`DriveWriter.append(sweeps=...)` must hold {column.row.base} in rows of {column.row.shape[0]} bins; "
                f"got {rows.dtype} of shape {rows.shape}."
            )
        records = _records(column, times_ns, len(rows))
        records["flags"] = flags
        self._commit(column, records, np.ascontiguousarray(rows, column.row.base))

    def append_motion(self, name: str, times_ns: Numbers, values: Numbers) -> None:
        """Add one sample of a channel, or many: times and values () or (n,), in nanoseconds and the channel's unit.

        Raises as `append` does.
        """
        column = self._column(name)
        samples = np.atleast_1d(np.asarray(values, np.float64))
        records = _records(column, times_ns, len(samples))
        records["value"] = samples
        self._commit(column, records, None)

    def set(self, **changes: Any) -> None:
        """Change `mounting`, `truth`, `started_at_ns` or `problems`. Raises `ValueError` for another name."""
        _update(self._header, **changes)
        self._save()

    def flush(self) -> None:
        """Return when everything appended so far is on the disk itself and outlives a loss of power."""
        try:
            for file in self._files.values():
                os.fsync(file.fileno())
        except OSError as error:
            raise LogError(self._folder, f"cannot be written: {error.strerror}.") from error

    def close(self) -> None:
        """Seal the drive: lengths and checksums of its columns go into the header. Closing twice does nothing."""
        if not self._files:
            return
        try:
            if self._durable:
                self.flush()
            sealed = {name: {"bytes": size, "crc32": crc} for name, (size, crc) in self._written.items()}
            self._header["sealed"] = sealed
            self._save()
        finally:  # on a full disk it stays as a crash would leave it
            for file in self._files.values():
                file.close()
            self._files = {}

    def __enter__(self) -> DriveWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _column(self, key: int | str) -> Column:
        if not self._files:
            raise ValueError(f"`DriveWriter` of {self._folder} is closed.")
        if key not in self._columns:
            raise ValueError(f"`DriveWriter` of {self._folder} has {list(self._columns)}; got {key!r}.")
        return self._columns[key]

    def _commit(self, column: Column, records: np.ndarray, rows: np.ndarray | None) -> None:
        records["crc32"] = np.fromiter(checksums(records, rows), np.uint32, len(records))
        items = [records] if rows is None else [rows, records]
        contents = [
            (name, part.reshape(-1).view(np.uint8).data) for (name, _), part in zip(column.parts, items, strict=True)
        ]
        if self._ends is not None:
            raise self._ends
        try:
            for name, content in contents:
                _write_all(self._files[name], content)
        except OSError as error:
            failed = LogError(self._folder, f"cannot be written: {error.strerror}.")
            try:
                for name, _ in contents:
                    os.truncate(self._folder / name, self._written[name][0])
            except OSError:
                self._ends = failed  # what came behind the rest of this call would not be found
            raise failed from error
        for name, content in contents:
            size, crc = self._written[name]
            self._written[name] = size + len(content), zlib.crc32(content, crc)

    def _save(self) -> None:
        try:
            write_header(self._folder, self._header, durable=self._durable)
        except OSError as error:
            raise LogError(self._folder / HEADER, f"cannot be written: {error.strerror}.") from error


def _write_all(file: FileIO, content: memoryview) -> None:
    rest = content
    while rest:  # an unbuffered file may take less than it was given
        rest = rest[file.write(rest) :]


def _records(column: Column, times_ns: Numbers, count: int) -> np.ndarray:
    times = np.atleast_1d(np.asarray(times_ns))
    if times.shape != (count,) or (count and times.dtype.kind not in "iu"):
        raise ValueError(
            f"`DriveWriter` of {column.label}: `times_ns` must be {count} whole numbers; "
            f"got {times.dtype} of shape {times.shape}."
        )
    records = np.zeros(count, column.record)
    records["time_ns"] = times
    return records


def _update(header: dict[str, Any], **changes: Any) -> None:
    for name, value in changes.items():
        if name == "mounting":
            header[name] = None if value is None else asdict(value)
        elif name == "truth":
            header[name] = None if value is None else [asdict(step) for step in value.steps]
        elif name == "started_at_ns":
            header[name] = None if value is None else int(value)
        elif name == "problems":
            header[name] = list(value)
        else:
            raise ValueError(f"`DriveWriter.set` knows mounting, truth, started_at_ns and problems; got {name!r}.")


def is_drive_folder(path: Path) -> bool:
    """Whether `path` is a folder that claims to be a drive."""
    return (path / HEADER).is_file()


def _is_drive_alone(path: Path) -> bool:
    """Whether all that a folder holds is a drive, so that nothing else is lost with it."""
    parts = (".sweeps", ".index", ".motion", ".new")
    found = path.iterdir() if is_drive_folder(path) and not path.is_symlink() else [path]
    return all(part.name == HEADER or part.suffix in parts for part in found)


def write_drive(drive: Drive, path: str | PathLike[str], *, overwrite: bool = False, durable: bool = True) -> None:
    """Write a whole drive as a folder, sealed; `read_drive` gives every field back equal.

    It is written under another name and then renamed, so `path` never holds half a drive. `durable`: return when it
    is on the disk itself, and outlives a loss of power.

    Raises `LogError` if `path` exists (with `overwrite`: if it is something else than a drive) or cannot be written,
    and `ValueError` for a `spec` that is not made of JSON values.
    """
    motion = {name: channel for name, channel in vars(drive.motion).items() if channel is not None}
    with staged(Path(path), overwrite=overwrite, replaceable=_is_drive_alone) as stage:
        layouts = [SensorLayout(item.sensor, item.range_m, item.sweeps.dtype, item.spec) for item in drive.sensors]
        with DriveWriter(
            stage,
            layouts,
            motion=list(motion),
            mounting=drive.mounting,
            truth=drive.truth,
            started_at_ns=drive.started_at_ns,
            clock_start_ns=drive.clock_start_ns,
            problems=drive.problems,
            durable=durable,
        ) as writer:
            for series in drive.sensors:
                writer.append(series.sensor, series.times_ns, series.sweeps, series.flags)
            for name, channel in motion.items():
                writer.append_motion(name, channel.times_ns, channel.values)
