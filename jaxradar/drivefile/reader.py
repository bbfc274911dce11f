"""Opening a drive."""

from __future__ import annotations

import os
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from jaxradar._errors import LogError
from jaxradar.drive import Channel, Drive, Motion, Mounting, RoadStep, SensorSeries, Truth
from jaxradar.drivefile.layout import HEADER, Column, columns_of, open_items, read_header, whole

__all__ = ["DriveFiles", "Folder", "assemble_drive", "open_column", "read_drive"]


@runtime_checkable
class DriveFiles(Protocol):
    """Where the files of a drive lie: a folder, or an archive. `place` names a file for messages."""

    def items(self, name: str, dtype: np.dtype) -> tuple[np.ndarray, int]:
        """The whole items of a file, read-only, and its size in bytes."""

    def content(self, name: str) -> bytes:
        """All of a file."""

    def place(self, name: str) -> str | Path:
        """Its name in a message."""


@dataclass(frozen=True)
class Folder:
    """A drive's own folder, whose files are mapped into memory."""

    path: str | PathLike[str]

    def items(self, name: str, dtype: np.dtype) -> tuple[np.ndarray, int]:
        return open_items(self.place(name), dtype)

    def content(self, name: str) -> bytes:
        return Path(self.place(name)).read_bytes()

    def place(self, name: str) -> str:
        return os.path.join(self.path, name)  # noqa: PTH118 (a `Path` takes as long as opening the file)


def open_column(
    files: DriveFiles, column: Column, sealed: Mapping[str, Any] | None, verify: bool = False
) -> tuple[np.ndarray, np.ndarray | None, list[str]]:
    """Records, rows and what had to be cut off, of one column."""
    try:
        opened = [files.items(name, dtype) for name, dtype in column.parts]
    except OSError as error:
        raise LogError(error.filename or files.place(""), f"cannot be read: {error.strerror}.") from error
    records, rows = opened[-1][0], opened[0][0] if column.row is not None else None
    sizes = {name: size for (name, _), (_, size) in zip(column.parts, opened, strict=True)}
    if sealed is not None and all(sealed[name]["bytes"] == size for name, size in sizes.items()):
        for name in sizes if verify else ():
            found = zlib.crc32(files.content(name))
            if found != sealed[name]["crc32"]:
                raise LogError(
                    files.place(name), f"has checksum {found} where {sealed[name]['crc32']} is stated; it is damaged."
                )
        return records, rows, []
    count = whole(records, rows)
    problems = [
        f"{name}: {sizes[name] - count * dtype.itemsize} of {sizes[name]} bytes after {count} whole records do not "
        "hang together (the recording was cut off, or the file is damaged) and were dropped."
        for name, dtype in column.parts
        if sizes[name] != count * dtype.itemsize
    ]
    if sealed is not None:
        problems += [
            f"{name}: holds {size} bytes where the closed drive had {sealed[name]['bytes']}."
            for name, size in sizes.items()
            if sealed[name]["bytes"] != size
        ]
    return records[:count], None if rows is None else rows[:count], problems


def read_drive(path: str | PathLike[str], *, verify: bool = False) -> Drive:
    """Open a `NAME.drive` folder (the layout is this module's docstring).

    Sweeps are read-only memory maps. A drive that was closed is trusted if its files have the lengths that its header
    states; `verify=True` compares their checksums too. One that was not closed is checked sweep by sweep, read up to
    its last whole sweep, and `problems` says what was cut off.

    Raises `LogError` for a folder that is no drive, and for one whose header is damaged or of an unknown version.
    """
    return assemble_drive(Folder(path), read_header(path), verify)


def assemble_drive(files: DriveFiles, header: Mapping[str, Any], verify: bool = False) -> Drive:
    """A drive out of its files and its header, as `read_drive` does. Raises `LogError`."""
    try:
        return _assemble(files, header, verify)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise LogError(files.place(HEADER), f"does not describe a drive: {error!r:.200}.") from error


def _assemble(files: DriveFiles, header: Mapping[str, Any], verify: bool) -> Drive:
    problems = list(header["problems"])
    if header["sealed"] is None:
        problems.append("The drive was not closed: each sweep was checked.")
    columns = {}
    for key, column in columns_of(header).items():
        records, rows, cut = open_column(files, column, header["sealed"], verify)
        columns[key] = records, rows
        problems += cut
    clock, base = header["clock_start_ns"], 0
    if clock is None:
        starts = [columns[item["sensor"]][0]["time_ns"][:1] for item in header["sensors"]]
        clock = base = min((int(times[0]) for times in starts if len(times)), default=0)

    def times_ns(records: np.ndarray) -> np.ndarray:
        return np.subtract(records["time_ns"], base, dtype=np.int64)

    sensors = []
    for item in header["sensors"]:
        records, rows = columns[item["sensor"]]
        assert rows is not None
        range_m, flags = np.array(item["range_m"], np.float64), records["flags"].astype(np.uint16)
        sensors.append(SensorSeries(item["sensor"], times_ns(records), rows, range_m, flags, item["spec"]))
    motion = {}
    for name in header["motion"]:
        records, _ = columns[name]
        motion[name] = Channel(times_ns(records), records["value"].astype(np.float64))
    truth, mounting = header["truth"], header["mounting"]
    return Drive(
        sensors=tuple(sensors),
        motion=Motion(**motion),
        mounting=None if mounting is None else Mounting(**mounting),
        truth=None if truth is None else Truth(tuple(_step(step) for step in truth)),
        started_at_ns=header["started_at_ns"],
        clock_start_ns=clock,
        problems=tuple(problems),
    )


def _step(held: dict[str, Any]) -> RoadStep:
    """A step out of JSON, which knows no tuples."""
    wheels = held.get("wheels_s")
    return RoadStep(**{**held, "wheels_s": None if wheels is None else tuple(wheels)})
