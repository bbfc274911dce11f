"""Columns and header of a drive on disk, as the docstring of `jaxradar.drivefile` lays them out."""

from __future__ import annotations

import json
import math
import mmap
import os
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from jaxradar._errors import LogError
from jaxradar.drive import Motion, SensorSeries

__all__ = [
    "FORMAT",
    "HEADER",
    "MOTION_NAMES",
    "VERSION",
    "Column",
    "SensorLayout",
    "checksums",
    "columns_of",
    "is_mapped",
    "open_items",
    "parse_header",
    "read_header",
    "whole",
    "write_header",
]

FORMAT = "jaxradar.drive"
VERSION = 1
HEADER = "header.json"
MOTION_NAMES = tuple(part.name for part in fields(Motion))

_INDEX = np.dtype([("time_ns", "<i8"), ("flags", "<u2"), ("reserved", "<u2"), ("crc32", "<u4")])
_SAMPLE = np.dtype([("time_ns", "<i8"), ("value", "<f8"), ("reserved", "<u4"), ("crc32", "<u4")])


@dataclass(frozen=True, eq=False)
class SensorLayout:
    """One sensor of a drive that is about to be written.

    - `sensor`: its number.
    - `range_m`: (bins,) float64, strictly increasing slant range in metres.
    - `dtype`: of the amplitudes: uint16, float32 or float64.
    - `spec`: how the sensor was set; JSON values only.
    """

    sensor: int
    range_m: np.ndarray
    dtype: DTypeLike = np.uint16
    spec: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        empty = np.empty(0, np.int64), np.empty((0, len(self.range_m)), self.dtype), np.empty(0, np.uint16)
        SensorSeries(self.sensor, empty[0], empty[1], self.range_m, empty[2])  # its checks are the ones wanted


@dataclass(frozen=True)
class Column:
    """One sensor or one channel on disk: a file of records and, for a sensor, a file of one row for each record."""

    label: str
    records: str
    record: np.dtype
    rows: str | None = None
    row: np.dtype | None = None

    @property
    def parts(self) -> list[tuple[str, np.dtype]]:
        """File names with the dtype of one item, in the order in which they are written: the record commits."""
        rows = [(self.rows, self.row)] if self.rows is not None and self.row is not None else []
        return [*rows, (self.records, self.record)]


def _sensor_column(sensor: int, dtype: DTypeLike, bins: int) -> Column:
    row = np.dtype((np.dtype(dtype).newbyteorder("<"), (bins,)))
    return Column(f"sensor {sensor}", f"{sensor}.index", _INDEX, f"{sensor}.sweeps", row)


def _motion_column(name: str) -> Column:
    return Column(name, f"{name}.motion", _SAMPLE)


def columns_of(header: Mapping[str, Any]) -> dict[int | str, Column]:
    """The columns of a drive, under the sensor's number or the channel's name."""
    numbers = [item["sensor"] for item in header["sensors"]]
    # They become file names.
    if not all(type(number) is int for number in numbers) or not set(header["motion"]) <= set(MOTION_NAMES):
        raise ValueError(f"sensors {numbers}, motion {header['motion']}")
    if not all(type(item["bins"]) is int and item["bins"] > 0 for item in header["sensors"]):
        raise ValueError(f"bins {[item['bins'] for item in header['sensors']]}")
    sensors = {
        item["sensor"]: _sensor_column(item["sensor"], item["dtype"], item["bins"]) for item in header["sensors"]
    }
    return sensors | {name: _motion_column(name) for name in header["motion"]}


def write_header(folder: Path, header: Mapping[str, Any], *, durable: bool = True) -> None:
    lines = (f' "{key}": {json.dumps(value, allow_nan=False)},\n' for key, value in header.items())
    text = f"{{\n{''.join(lines)}".encode("ascii")
    fresh = folder / f"{HEADER}.new"
    with fresh.open("wb") as file:
        file.write(text + _ending(zlib.crc32(text)))
        if durable:
            file.flush()
            os.fsync(file.fileno())
    fresh.replace(folder / HEADER)


def _ending(checksum: int) -> bytes:
    """The last lines of a header, whose other lines have this checksum."""
    return b' "checksum": %d\n}\n' % checksum


def read_header(folder: str | PathLike[str]) -> dict[str, Any]:
    path = os.path.join(folder, HEADER)  # noqa: PTH118 (a `Path` takes as long as reading)
    try:
        with open(path, "rb", buffering=0) as file:  # noqa: PTH123
            text = file.read()
    except OSError as error:
        raise LogError(path, f"cannot be read: {error.strerror}; a drive has a {HEADER}.") from error
    return parse_header(path, text)


def parse_header(path: str | Path, text: bytes) -> dict[str, Any]:
    """A header out of its text. Raises `LogError`, which names `path`."""
    try:
        header = json.loads(text, parse_constant=_refuse)
    except (ValueError, RecursionError) as error:
        raise LogError(path, f"is not JSON ({error}); it is damaged.") from error
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        found = header.get("format") if isinstance(header, dict) else type(header).__name__
        raise LogError(path, f"holds format {found!r:.60}; expected {FORMAT!r}.")
    if header.get("version") != VERSION:
        raise LogError(path, f"has version {header.get('version')!r:.60}; this program reads version {VERSION}.")
    stated = header.pop("checksum", None)
    start = text.rfind(b"\n", 0, max(0, len(text) - 3)) + 1
    found = zlib.crc32(text[:start])
    if text[start:] != _ending(found):
        raise LogError(path, f"has checksum {found}, but says that it should be {stated!r:.60}; it is damaged.")
    return header


def _refuse(constant: str) -> float:
    raise ValueError(f"it holds {constant}, which is not finite")


def open_items(path: str | Path, dtype: np.dtype) -> tuple[np.ndarray, int]:
    """The whole items of a file, read-only, and its size. Rows are mapped into memory, records, which are gone through
    at once, are read."""
    with open(path, "rb", buffering=0) as file:  # noqa: PTH123 (a `Path` takes as long as opening the file)
        size = os.fstat(file.fileno()).st_size
        count = size // dtype.itemsize
        held: bytes | mmap.mmap
        if count and dtype.shape:
            # Not `np.memmap`, every slice of which is a Python object that takes longer than what is made of it.
            held = mmap.mmap(file.fileno(), count * dtype.itemsize, access=mmap.ACCESS_READ)
        else:
            held = file.readall() if count else b""
            count = len(held) // dtype.itemsize
    return np.frombuffer(held, dtype.base, count * math.prod(dtype.shape)).reshape(count, *dtype.shape), size


def is_mapped(values: np.ndarray) -> bool:
    """Whether an array is, or is a part of, a file that is mapped into memory."""
    base: Any = values
    while isinstance(base, np.ndarray):
        base = base.base
    return isinstance(base.obj if isinstance(base, memoryview) else base, mmap.mmap)


def checksums(records: np.ndarray, rows: np.ndarray | None) -> Iterator[int]:
    """The right checksum of each record."""
    size = records.dtype.itemsize
    heads = np.ascontiguousarray(records.view(np.uint8).reshape(len(records), size)[:, :-4])
    # As `bytes`, which are made and read faster than rows of an array.
    starts = map(zlib.crc32, heads.view(f"V{size - 4}").ravel().tolist())
    return starts if rows is None else map(zlib.crc32, rows, starts)


def whole(records: np.ndarray, rows: np.ndarray | None) -> int:
    """How many records from the first on carry their right checksum."""
    count = len(records) if rows is None else min(len(records), len(rows))
    stated = records["crc32"][:count].tolist()
    crcs = checksums(np.ascontiguousarray(records[:count]), None if rows is None else rows[:count])
    return next((place for place, crc in enumerate(crcs) if crc != stated[place]), count)
