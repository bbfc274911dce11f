"""A store as it lies on disk, folder or archive, and how its drives are opened."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from jaxradar._errors import LogError
from jaxradar.drive import Drive
from jaxradar.drivefile import read_drive
from jaxradar.store.archive import CATALOGUE, DRIVES, FORMAT, MARKER, VERSION, Archive, is_archive
from jaxradar.store.catalogue import Catalogue, Entry

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

    def place(self, entry: Entry) -> Path:
        """Where the drive of an entry lies, as `read_log` takes it."""
        return self.path / DRIVES / f"{entry.name}.drive"

    def read(self, entry: Entry, *, verify: bool = False) -> Drive:
        """The drive of an entry. Raises `LogError`, as `read_drive` does."""
        if self.path.is_file():
            return Archive.of(self.path).read(f"{DRIVES}/{entry.name}.drive")
        return read_drive(self.place(entry), verify=verify)

    def shards(self, sweeps: int) -> Iterator[Sequence[Entry]]:
        """The drives in parts of about so many sweeps, those of one range axis and of like length together: what one
        machine goes through at a time. The same for every run over the same store."""
        part: list[Entry] = []
        held = 0
        for entry in sorted(self.drives, key=_likeness):
            part.append(entry)
            held += entry.sweeps
            if held >= sweeps:
                yield part
                part, held = [], 0
        if part:
            yield part


def _likeness(entry: Entry) -> tuple[str, int, str]:
    return (entry.sensors[0].axis if entry.sensors else "", -entry.sweeps, entry.name or "")


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
            fresh.write_text(json.dumps({"format": FORMAT, "version": VERSION}) + "\n", encoding="ascii")
            fresh.replace(path / MARKER)
        (path / DRIVES).mkdir(exist_ok=True)
    except OSError as error:
        raise LogError(path, f"cannot be written: {error.strerror or error}.") from error
    check_marker(path)


def check_marker(path: Path) -> None:
    """Raises `LogError` for a store of another version."""
    marker = path / MARKER
    try:
        held = json.loads(marker.read_bytes())
    except OSError as error:
        raise LogError(path, f"is no store: {MARKER} cannot be read ({error.strerror}).") from error
    except (ValueError, RecursionError) as error:
        raise LogError(marker, f"is not JSON ({error}); it is damaged.") from error
    if not isinstance(held, dict) or held.get("format") != FORMAT or held.get("version") != VERSION:
        raise LogError(marker, f"holds {held!r:.80}; expected format {FORMAT!r} of version {VERSION}.")


def open_store(path: str | PathLike[str]) -> Store:
    """A store, by the name of its folder or archive. Raises `LogError` if it is none, or damaged."""
    place = Path(path)
    if place.is_file():
        return Store(place, Archive.of(place).entries())
    check_marker(place)
    with Catalogue(place / CATALOGUE) as catalogue:
        return Store(place, tuple(catalogue.entries()))
