"""A store as it lies on disk, folder or archive, and how its drives are opened."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from jaxradar._errors import LogError
from jaxradar.drive import Drive
from jaxradar.drivefile import read_drive
from jaxradar.store.archive import Archive, is_archive
from jaxradar.store.catalogue import Catalogue, Entry
from jaxradar.store.marker import CATALOGUE, DRIVES, MARKER, check_marker, marker_content

__all__ = ["CATALOGUE", "DRIVES", "MARKER", "Store", "is_store", "make_store", "open_store"]


@dataclass(frozen=True, eq=False)
class Store:
    """A store, opened for reading: `entries` in order of their names.

    `path`: the folder, or the archive.
    """

    path: Path
    entries: tuple[Entry, ...]

    @property
    def drives(self) -> tuple[Entry, ...]:
        """The entries that were read, each with a drive."""
        return tuple(entry for entry in self.entries if entry.name is not None)

    @staticmethod
    def parts(entry: Entry) -> tuple[str, str]:
        """Where in the store the drive of an entry lies."""
        return DRIVES, f"{entry.name}.drive"

    def place(self, entry: Entry) -> Path:
        """Where the drive of an entry lies, as `read_log` takes it."""
        return self.path.joinpath(*self.parts(entry))

    def read(self, entry: Entry, *, verify: bool = False) -> Drive:
        """The drive of an entry. Raises `LogError`, as `read_drive` does."""
        if self.path.is_file():
            return Archive.of(self.path).read("/".join(self.parts(entry)))
        return read_drive(self.place(entry), verify=verify)


def is_store(path: Path) -> bool:
    """Whether a path is a store, as a folder or as an archive."""
    return (path / MARKER).is_file() or is_archive(path)


def make_store(path: Path) -> None:
    """A store with nothing in it, unless one is there.

    Raises `LogError` if something else is there, or if it cannot be written.
    """
    try:
        if not (path / MARKER).is_file():
            if path.exists() and (not path.is_dir() or any(path.iterdir())):
                raise LogError(path, f"exists and is no store (it has no {MARKER}); it was left alone.")
            path.mkdir(parents=True, exist_ok=True)
            fresh = path / f".{MARKER}.new"
            fresh.write_bytes(marker_content())
            fresh.replace(path / MARKER)
        (path / DRIVES).mkdir(exist_ok=True)
    except OSError as error:
        raise LogError(path, f"cannot be written: {error.strerror or error}.") from error
    _check(path)


def _check(path: Path) -> None:
    marker = path / MARKER
    try:
        held = marker.read_bytes()
    except OSError as error:
        raise LogError(path, f"is no store: {MARKER} cannot be read ({error.strerror}).") from error
    check_marker(marker, held)


def open_store(path: str | PathLike[str]) -> Store:
    """A store, by the name of its folder or archive. Raises `LogError` if it is none, or damaged."""
    place = Path(path)
    if place.is_file():
        return Store(place, Archive.of(place).entries())
    _check(place)
    with Catalogue(place / CATALOGUE) as catalogue:
        return Store(place, tuple(catalogue.entries()))
