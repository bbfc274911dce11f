"""Recorded logs in, drives out, and back: the one place that knows foreign files."""

from __future__ import annotations

import glob
import os
from collections.abc import Iterable, Sequence
from os import PathLike
from pathlib import Path

from jaxradar._errors import LogError
from jaxradar.drive import Drive
from jaxradar.drivefile import is_drive_folder, read_drive, write_drive
from jaxradar.labcsv import MOTION_FILES, looks_like_radar, read_lab_csv, sensor_files, truth_path
from jaxradar.labcsv.writer import write_lab_csv
from jaxradar.logs.acconeer_h5 import read_acconeer_h5
from jaxradar.store import is_archive, is_store, open_store, read_archived

__all__ = ["below_common_folder", "find_logs", "read_log", "source_files", "write_log"]

_HDF5_NAMES = (".h5", ".hdf5")
_HDF5_START = b"\x89HDF\r\n\x1a\n"
_READABLE = "a folder of the lab's CSV, one CSV file, an Acconeer HDF5 file, a .drive folder or a drive of a store"


def read_log(path: str | PathLike[str]) -> Drive:
    """Read a log of any kind: what it is follows from its name, or else from its content.

    A `.drive` folder (`jaxradar.drivefile`), a drive in a store's archive (`ARCHIVE.zip/drives/NAME.drive`), a folder
    of `<sensor>.csv` or one CSV file (`jaxradar.labcsv`), an Acconeer file `.h5` or `.hdf5`
    (`jaxradar.logs.acconeer_h5`). Raises `LogError`, which says what is wrong where.
    """
    log = Path(path)
    if not os.fspath(path):  # which `Path` takes for the current folder
        raise LogError(path, f"the name is empty; expected {_READABLE}.")
    try:
        if log.is_dir():
            return _read_folder(log)
        if log.suffix == ".drive" and (archived := read_archived(log)) is not None:
            return archived
        if is_archive(log):
            raise LogError(log, "is the archive of a store; expected one of its drives, or a command that takes many.")
        if log.exists() and not log.is_file():
            raise LogError(log, "is a pipe or a device, which cannot be read twice; expected a file or a folder.")
        with log.open("rb") as file:
            start = file.read(len(_HDF5_START))
    except OSError as error:
        raise LogError(log, f"cannot be read: {error.strerror or error}.") from error
    except ValueError as error:  # a name with a zero byte
        raise LogError(log, f"cannot be read: {error}.") from error
    if log.suffix.lower() in _HDF5_NAMES or start == _HDF5_START:
        return read_acconeer_h5(log)
    if log.suffix.lower() == ".csv" or looks_like_radar(log):
        return read_lab_csv(log)
    raise LogError(log, f"begins with {start!r}, which is no log; expected {_READABLE}.")


def _read_folder(folder: Path) -> Drive:
    if folder.suffix == ".drive" or is_drive_folder(folder):
        return read_drive(folder)
    if is_store(folder):
        raise LogError(folder, "is a store; expected one of its drives, or a command that takes many.")
    if sensor_files(folder):
        return read_lab_csv(folder)
    held = sorted(part.name for part in folder.iterdir())[:5]
    raise LogError(folder, f"is a folder that holds {', '.join(held) or 'nothing'}; expected {_READABLE}.")


def source_files(log: Path) -> list[Path]:
    """The files that a log is made of, its truth among them, in order of their names."""
    if not log.is_dir():
        found = [log]
    elif is_drive_folder(log):
        return sorted(log.iterdir())
    else:
        found = [*sensor_files(log), *(log / name for name in MOTION_FILES)]
    return sorted(file for file in (*found, truth_path(log)) if file.is_file())


def find_logs(paths: str | PathLike[str] | Iterable[str | PathLike[str]]) -> list[Path]:
    """All logs that a path or many name, files, folders and patterns with `*`, `?` or `[`: sorted, each once.

    A folder that is a log itself is one log, a store (its folder or its archive) is all drives of its catalogue; any
    other folder is searched through. What does not exist, and a pattern that matches nothing, is returned as it was
    given, so that reading it says so; an empty name names nothing.
    """
    found: dict[str, Path] = {}
    for given in [paths] if isinstance(paths, str | PathLike) else paths:
        text = os.fspath(given)
        exists = os.path.lexists(text)
        # `Path.glob` takes no absolute pattern.
        matches = [] if exists or not glob.has_magic(text) else glob.glob(text, recursive=True)  # noqa: PTH207
        for path in map(Path, matches or [text]) if text else ():
            if is_store(path):
                logs = _drives_in(path)
            elif path.is_dir():
                logs = _logs_in(path)
            else:
                logs = {os.path.realpath(path): path} if not matches or _is_log_file(path) else {}
            for real, log in logs.items():
                found.setdefault(real, log)
    return sorted(found.values(), key=lambda log: log.parts)


def _drives_in(path: Path) -> dict[str, Path]:
    """By their real paths, which are made of the store's own: a million drives are not looked up one by one."""
    store, real = open_store(path), os.path.realpath(path)
    return {os.path.join(real, *store.parts(entry)): store.place(entry) for entry in store.drives}  # noqa: PTH118


def _logs_in(folder: Path) -> dict[str, Path]:
    """Likewise."""
    if folder.suffix == ".drive" or is_drive_folder(folder) or _sensor_files(folder):
        return {os.path.realpath(folder): folder}
    found: dict[str, Path] = {}
    for base, folders, files in os.walk(folder):
        here = Path(base)
        if is_store(here):
            found |= _drives_in(here)
            folders.clear()
            continue
        logs = [here / name for name in folders if not name.startswith(".")]
        logs = [path for path in logs if path.suffix == ".drive" or is_drive_folder(path) or _sensor_files(path)]
        folders[:] = [name for name in folders if not name.startswith(".") and here / name not in logs]
        logs += [here / name for name in files if _is_log_file(here / name)]
        found |= {os.path.realpath(log): log for log in logs}
    return found


def _sensor_files(folder: Path) -> list[Path]:
    try:
        return sensor_files(folder)
    except OSError:
        return []


def _is_log_file(path: Path) -> bool:
    if not path.is_file():  # a pipe would wait for its other end
        return False
    if path.suffix.lower() in _HDF5_NAMES:
        return True
    return path.suffix.lower() == ".csv" and path.name not in MOTION_FILES and looks_like_radar(path)


def below_common_folder(paths: Sequence[str]) -> tuple[str, list[str]]:
    """The folder that all logs lie in, and their names from there; "" and the names as they are if there is none."""
    try:
        common = os.path.commonpath([os.path.dirname(os.path.abspath(path)) for path in paths])  # noqa: PTH100, PTH120
    except ValueError:  # no paths, or on different drives
        return "", list(paths)
    if common == os.path.sep:
        return "", list(paths)
    return common, [os.path.relpath(path, common) for path in paths]


def write_log(drive: Drive, path: str | PathLike[str], *, overwrite: bool = False) -> list[str]:
    """Write a drive in the form that the name asks for: `NAME.drive`, `NAME.csv` (one sensor, no motion), and under
    any other name a folder of CSV; HDF5 is only read.

    Returns a sentence for each thing that this form cannot hold. Raises `LogError` if `path` exists and `overwrite` is
    false, and as the writer of that form does.
    """
    target = Path(path)
    if target.suffix == ".drive":
        write_drive(drive, target, overwrite=overwrite)
        return []
    if target.suffix.lower() in _HDF5_NAMES:
        raise LogError(target, "HDF5 is read only; expected NAME.drive, NAME.csv or the name of a folder.")
    return write_lab_csv(drive, target, overwrite=overwrite)
