"""What is in a store, as a SQLite file: one row for each source."""

from __future__ import annotations

import contextlib
import json
import sqlite3
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from types import TracebackType
from typing import Any
from urllib.parse import quote

from jaxradar._errors import LogError
from jaxradar.drive import Drive

__all__ = ["Catalogue", "Entry", "SensorEntry", "entry_of"]

VERSION = 1  # of the table, in SQLite's own `user_version`
_COLUMNS = ("source", "name", "stamp", "hash", "bytes", "sensors", "problems", "steps", "error")
_TABLE = """
CREATE TABLE IF NOT EXISTS drives (
    source TEXT PRIMARY KEY,
    name TEXT UNIQUE,
    stamp TEXT NOT NULL,
    hash TEXT NOT NULL,
    bytes INTEGER NOT NULL,
    sensors TEXT NOT NULL,
    problems TEXT NOT NULL,
    steps INTEGER,
    error TEXT
) STRICT
"""


@dataclass(frozen=True)
class SensorEntry:
    """One sensor of a drive: its number, how many sweeps of how many bins, their dtype, the first 16 digits of the
    SHA-256 of its range axis (float64, little-endian), sweeps a second and seconds."""

    sensor: int
    sweeps: int
    bins: int
    dtype: str
    axis: str
    rate_hz: float | None
    duration_s: float


@dataclass(frozen=True)
class Entry:
    """One source, and the drive that was made of it.

    - `source`: its absolute path. `name`: of the drive in the store; None if it could never be read.
    - `stamp`: size and time of change of each of its files, as JSON. `hash`: SHA-256 over their names and contents.
      `bytes`: their size.
    - `sensors`, `problems`: what the reader found. `steps`: how many of them the truth knows; None without truth.
    - `error`: why it could not be read as it is now; a drive made of an earlier state of it stays.
    """

    source: str
    name: str | None
    stamp: str
    hash: str
    bytes: int
    sensors: tuple[SensorEntry, ...] = ()
    problems: tuple[str, ...] = ()
    steps: int | None = None
    error: str | None = None

    @property
    def sweeps(self) -> int:
        """Of all sensors."""
        return sum(one.sweeps for one in self.sensors)


def entry_of(drive: Drive, *, source: str, name: str, stamp: str, hash: str, bytes: int) -> Entry:  # noqa: A002
    """The entry of a drive."""
    sensors = tuple(
        SensorEntry(
            one.sensor,
            len(one),
            len(one.range_m),
            one.sweeps.dtype.name,
            sha256(one.range_m.astype("<f8").tobytes()).hexdigest()[:16],
            one.sweep_rate_hz,
            one.duration_s,
        )
        for one in drive.sensors
    )
    steps = None if drive.truth is None else len(drive.truth.steps)
    return Entry(source, name, stamp, hash, bytes, sensors, tuple(drive.problems), steps)


class Catalogue:
    """The catalogue in a file; what a block of `with` puts into it is there when the block ends, or not at all.

    `write=False` opens it for reading alone, where it must be there. Raises `LogError` for a file that is no
    catalogue, is damaged, is locked by another program, or is of another version.
    """

    def __init__(self, path: Path, *, write: bool = False) -> None:
        self.path = path
        with self._said():
            if not write and not path.is_file():
                raise LogError(path, "is missing; `jaxradar import` makes it.")
            try:
                self._open("rwc" if write else "ro")
            except sqlite3.OperationalError as error:
                # A kill in the middle of a write leaves a journal, which must be rolled back before anything is read.
                if write or not error.sqlite_errorname.startswith("SQLITE_READONLY"):
                    raise
                self._open("rw")

    def _open(self, mode: str) -> None:
        uri = f"file:{quote(str(self.path))}?mode={mode}"
        self._base = sqlite3.connect(uri, uri=True, timeout=10.0, isolation_level=None)
        try:
            self._check(mode == "rwc")
        except BaseException:
            self._base.close()
            raise

    def _check(self, write: bool) -> None:
        version = self._base.execute("PRAGMA user_version").fetchone()[0]
        if version not in ((0, VERSION) if write else (VERSION,)):
            raise LogError(self.path, f"has version {version}; this program reads version {VERSION}.")
        if write:
            # A kill loses nothing that was committed; a loss of power may damage the file, which the next import says.
            self._base.execute("PRAGMA synchronous = NORMAL")
            self._base.execute(_TABLE)
            self._base.execute(f"PRAGMA user_version = {VERSION}")

    def put(self, entries: Iterable[Entry]) -> None:
        """Add entries, or replace those of the same source, all at once."""
        rows = [_row(entry) for entry in entries]
        marks = ", ".join("?" * len(_COLUMNS))
        with self._said():
            self._base.execute("BEGIN IMMEDIATE")
            try:
                self._base.executemany(f"INSERT OR REPLACE INTO drives ({', '.join(_COLUMNS)}) VALUES ({marks})", rows)
            except BaseException:
                self._base.execute("ROLLBACK")
                raise
            self._base.execute("COMMIT")

    def drop(self, source: str) -> None:
        """Forget a source."""
        with self._said():
            self._base.execute("DELETE FROM drives WHERE source = ?", (source,))

    def entries(self) -> Iterator[Entry]:
        """All of them, in order of their names, those that could not be read last."""
        with self._said():
            query = f"SELECT {', '.join(_COLUMNS)} FROM drives ORDER BY name IS NULL, name, source"
            for row in self._base.execute(query):
                yield self._entry(dict(zip(_COLUMNS, row, strict=True)))

    def copy(self, path: Path) -> None:
        """The same in another file."""
        with self._said(), contextlib.closing(sqlite3.connect(path)) as target:
            self._base.backup(target)

    def close(self) -> None:
        self._base.close()

    def __enter__(self) -> Catalogue:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _entry(self, row: Mapping[str, Any]) -> Entry:
        try:
            sensors = tuple(SensorEntry(**one) for one in json.loads(row["sensors"]))
            problems = tuple(json.loads(row["problems"]))
            if not (all(map(_is_sound, sensors)) and all(isinstance(one, str) for one in problems)):
                raise ValueError("a field of another type")
            return Entry(**{**row, "sensors": sensors, "problems": problems})
        except (TypeError, ValueError, RecursionError) as error:
            raise LogError(self.path, f"holds a row that is no entry ({error!r:.100}); it is damaged.") from error

    @contextlib.contextmanager
    def _said(self) -> Iterator[None]:
        try:
            yield
        except (sqlite3.Error, UnicodeDecodeError) as error:
            # What SQLite says of a damaged file may quote its bytes, which are no text then.
            damaged = getattr(error, "sqlite_errorname", "SQLITE_CORRUPT") in ("SQLITE_CORRUPT", "SQLITE_NOTADB")
            advice = " Delete it and import again: the drives are made anew." if damaged else ""
            raise LogError(self.path, f"cannot be used: {error}.{advice}") from error


def _is_sound(one: SensorEntry) -> bool:
    numbers = (one.sensor, one.sweeps, one.bins)
    texts = (one.dtype, one.axis)
    return (
        all(type(number) is int for number in numbers)
        and all(isinstance(text, str) for text in texts)
        and isinstance(one.duration_s, float | int)
        and isinstance(one.rate_hz, float | int | None)
    )


def _row(entry: Entry) -> tuple[Any, ...]:
    held = {**vars(entry), "sensors": json.dumps([asdict(one) for one in entry.sensors])}
    held["problems"] = json.dumps(list(entry.problems))
    return tuple(held[column] for column in _COLUMNS)
