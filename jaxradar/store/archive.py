"""The compressed form of a store: one ZIP file, whose drives are read one by one."""

from __future__ import annotations

import os
import struct
import tempfile
import threading
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa  # type: ignore[import-untyped]

from jaxradar._errors import LogError
from jaxradar.drive import Drive
from jaxradar.drivefile import HEADER, staged
from jaxradar.drivefile.layout import parse_header
from jaxradar.drivefile.reader import assemble_drive
from jaxradar.store.catalogue import Catalogue, Entry
from jaxradar.store.marker import CATALOGUE, DRIVES, MARKER, alone, check_marker

__all__ = ["Archive", "archived_members", "is_archive", "pack", "read_archived"]

LEVEL = 3  # of Zstandard: higher ones take five times as long and save a tenth
# What the libraries raise of a file that is damaged or made up; nothing else is taken for damage.
_DAMAGES = (
    OSError,
    EOFError,  # a member that ends too soon
    KeyError,  # a member that is not there
    RuntimeError,  # an encrypted one, or one in a compression that is not known
    ValueError,
    struct.error,
    zipfile.BadZipFile,
    zlib.error,
    pa.ArrowException,
)


def is_archive(path: Path) -> bool:
    """Whether a path is a file that claims to be an archive of a store: a ZIP file that begins with the marker."""
    try:
        if not path.is_file():  # a pipe would wait for its other end
            return False
        with path.open("rb") as file:
            start = file.read(30 + len(MARKER))
    except (OSError, ValueError):
        return False
    return start[:4] == b"PK\3\4" and start[30:] == MARKER.encode()


def pack(
    store: Path, archive: Path, *, overwrite: bool = False, advance: Callable[[int], None] = lambda sweeps: None
) -> None:
    """Write the archive of a store's folder. `advance` hears how many sweeps each drive had once it is in.

    Raises `LogError` if `archive` exists (with `overwrite`: if it is something else than an archive), if it cannot be
    written, or if the store is damaged; what was there before is then left as it was.
    """
    with (
        alone(store),
        Catalogue(store / CATALOGUE) as catalogue,
        staged(archive, overwrite=overwrite, replaceable=is_archive) as fresh,
        # A recorder without a clock dates its files to 1970, which ZIP does not know.
        zipfile.ZipFile(fresh, "w", allowZip64=True, strict_timestamps=False) as target,
    ):
        target.write(store / MARKER, MARKER)
        with tempfile.TemporaryDirectory() as folder:
            catalogue.copy(Path(folder) / CATALOGUE)
            target.write(Path(folder) / CATALOGUE, CATALOGUE, zipfile.ZIP_DEFLATED)
        codec = pa.Codec("zstd", LEVEL)
        for entry in list(catalogue.entries()):
            if entry.name is None:
                continue
            name = f"{DRIVES}/{entry.name}.drive"
            for file in sorted((store / name).iterdir()):
                if file.name == HEADER:
                    target.write(file, f"{name}/{HEADER}", zipfile.ZIP_DEFLATED)
                else:
                    target.writestr(f"{name}/{file.name}.zst", _compressed(codec, file))
            advance(entry.sweeps)


def _compressed(codec: Any, file: Path) -> bytes:
    content = np.frombuffer(file.read_bytes(), np.uint8)
    width = _width(file.name, len(content))
    apart = np.ascontiguousarray(content.reshape(-1, width).T)
    return struct.pack("<QB", len(content), width) + codec.compress(apart.tobytes(), asbytes=True)


def _width(name: str, size: int) -> int:
    """Bytes of an item that are taken apart: those of sweeps, where neighbours differ in the lower one alone."""
    return 2 if name.endswith(".sweeps") and size % 2 == 0 else 1


@dataclass(frozen=True, eq=False)
class Archive:
    """An open archive: one for each path in a process, read by any number of threads."""

    path: Path
    file: zipfile.ZipFile
    members: dict[str, list[tuple[str, int, int]]]  # by folder: name, size and CRC-32 as the archive states them
    lock: threading.Lock = field(default_factory=threading.Lock)

    @classmethod
    def of(cls, path: Path) -> Archive:
        """The archive at a path as it is now. Raises `LogError`."""
        with _said(path):
            state = path.stat()
            return _open(path, os.path.realpath(path), state.st_size, state.st_mtime_ns)

    def content(self, name: str) -> bytes:
        """A member as it stands, its checksum compared. Raises `LogError`."""
        with _said(self.path, name), self.lock:
            return self.file.read(name)

    def entries(self) -> tuple[Entry, ...]:
        """What the catalogue says. Raises `LogError`."""
        # SQLite reads files alone.
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder) / CATALOGUE
            place.write_bytes(self.content(CATALOGUE))
            try:
                with Catalogue(place) as catalogue:
                    return tuple(catalogue.entries())
            except LogError as error:
                raise LogError(self.path, f"{CATALOGUE} in it {error.problem}") from error

    def read(self, name: str) -> Drive:
        """A drive by the name of its folder in the archive. Raises `LogError`."""
        place = self.path / name / HEADER
        header = parse_header(place, self.content(f"{name}/{HEADER}"))
        if not header.get("sealed"):
            raise LogError(place, "was not closed before it was packed; an archive holds closed drives alone.")
        return assemble_drive(_Files(self, name, header["sealed"]), header)


@lru_cache(maxsize=8)
def _open(path: Path, real: str, size: int, changed_ns: int) -> Archive:
    file = zipfile.ZipFile(path)
    members: dict[str, list[tuple[str, int, int]]] = {}
    for one in file.infolist():
        folder, _, name = one.filename.rpartition("/")
        members.setdefault(folder, []).append((name, one.file_size, one.CRC))
    archive = Archive(path, file, members)
    check_marker(path / MARKER, archive.content(MARKER))
    return archive


@dataclass(frozen=True)
class _Files:
    """The files of one drive, taken out of the archive as they are asked for."""

    archive: Archive
    folder: str
    sealed: dict[str, Any]  # length and checksum of each, as the header states them
    held: dict[str, np.ndarray] = field(default_factory=dict)

    def _bytes(self, name: str) -> np.ndarray:
        if name not in self.held:
            member = f"{self.folder}/{name}.zst"
            packed = self.archive.content(member)
            with _said(self.archive.path, member):
                size, width = struct.unpack_from("<QB", packed)
                if size != self.sealed[name]["bytes"] or width not in (1, 2) or size % width:
                    raise ValueError(f"states {size} bytes of width {width}")
                apart = pa.Codec("zstd").decompress(memoryview(packed)[9:], decompressed_size=size)
                # In memory where a program reads it without a copy: pyarrow's buffers and NumPy's large arrays are.
                whole = np.frombuffer(apart, np.uint8).reshape(width, -1).T
                self.held[name] = np.ascontiguousarray(whole).reshape(-1)
        return self.held[name]

    def items(self, name: str, dtype: np.dtype) -> tuple[np.ndarray, int]:
        held = self._bytes(name)
        count = len(held) // dtype.itemsize
        found = held[: count * dtype.itemsize].view(dtype.base).reshape(count, *dtype.shape)
        found.flags.writeable = False
        return found, len(held)

    def content(self, name: str) -> bytes:
        return self._bytes(name).tobytes()

    def place(self, name: str) -> Path:
        return self.archive.path / self.folder / name


def read_archived(path: Path) -> Drive | None:
    """The drive at `ARCHIVE/drives/NAME.drive`; None if no part of the path is an archive. Raises `LogError`."""
    found = _inside(path)
    return None if found is None else found[0].read(found[1])


def archived_members(path: Path) -> list[tuple[str, int, int]] | None:
    """Name, size and CRC-32 of each file of such a drive, as the archive states them; None likewise."""
    found = _inside(path)
    if found is None:
        return None
    archive, name = found
    return archive.members.get(name, [])


def _inside(path: Path) -> tuple[Archive, str] | None:
    for archive in path.parents:
        if is_archive(archive):
            return Archive.of(archive), path.relative_to(archive).as_posix()
    return None


@contextmanager
def _said(path: Path, member: str = "") -> Iterator[None]:
    try:
        yield
    except LogError:
        raise
    except _DAMAGES as error:
        said = getattr(error, "strerror", None) or error
        about = f"{member} in it cannot be read" if member else "cannot be read"
        raise LogError(path, f"{about} ({said}); the archive is damaged or no archive.") from error
