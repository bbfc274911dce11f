"""Logs into a store: in parallel, only what is new or changed, and to be gone on with after a kill at any point.

A drive is written under another name and then renamed, and its row is put into the catalogue after that. A kill
between the two leaves a drive without a row, which the next import writes anew. A source whose files have the size and
the time of change that the catalogue knows is not read again; one whose content is the same all the same is not
parsed again.
"""

from __future__ import annotations

import contextlib
import glob
import json
import os
import shutil
import signal
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from hashlib import sha256
from multiprocessing import get_all_start_methods, get_context
from os import PathLike
from pathlib import Path
from time import monotonic

from jaxradar._errors import LogError
from jaxradar._machine import cores
from jaxradar.drivefile import is_drive_folder, write_drive
from jaxradar.logs import find_logs, read_log, source_files
from jaxradar.store import CATALOGUE, DRIVES, Catalogue, Entry, alone, archived_members, entry_of, make_store

__all__ = ["Imported", "import_each", "import_logs"]

COMMIT_SECONDS = 1.0  # how much work a kill can cost
_HASH_BLOCK = 1 << 18
_NO_FILES = "[]"  # the stamp of what is not there


@dataclass(frozen=True)
class Imported:
    """What became of one source.

    `done`: "imported", "unchanged" (nothing to do), "same" (another time of change, the same content), "failed",
    "failed before" (and unchanged since then) or "moved" (it is not there any more, but the same content is elsewhere:
    its drive was taken out of the store, which holds the other's). `entry`: its row.
    """

    done: str
    entry: Entry


@dataclass(frozen=True)
class _Task:
    log: str  # as it was found; a link's own name, and what lies beside it, are a log's
    source: str
    name: str
    stamp: str
    known: Entry | None


def import_logs(
    logs: str | PathLike[str] | Iterable[str | PathLike[str]],
    store: str | PathLike[str],
    *,
    workers: int | None = None,
    progress: Callable[[int], None] = lambda done: None,
) -> tuple[Imported, ...]:
    """Bring logs into the store at a path, which is made if it is not there. Returns what became of each.

    `logs`: a path or many: logs, folders of logs and patterns, as `find_logs` takes them. `workers`: processes, one
    for each core if None. `progress`: hears how many are done. A log that cannot be read is an entry with an `error`,
    and never stops the others; nor does one that brings its process down.

    Raises `LogError` if `store` is something else, cannot be written, or is being written by another program.
    """
    done = []
    for one in import_each(logs, store, workers=workers):
        done.append(one)
        progress(len(done))
    return tuple(done)


def import_each(
    logs: str | PathLike[str] | Iterable[str | PathLike[str]],
    store: str | PathLike[str],
    *,
    workers: int | None = None,
) -> Iterator[Imported]:
    """As `import_logs`, each as soon as it is done. What the caller does not go on to fetch is not imported, and
    nothing of it is lost; nobody else can import until this is closed or at its end."""
    place = Path(store)
    make_store(place)
    with alone(place), Catalogue(place / CATALOGUE, write=True) as catalogue:
        known = {entry.source: entry for entry in catalogue.entries()}
        fresh: list[Entry] = []
        saved = monotonic()
        try:
            given = [logs] if isinstance(logs, str | PathLike) else logs
            for one in _work(place, _tasks(place, given, known), workers or cores()):
                if one.done not in ("unchanged", "failed before") and one.entry.stamp != _NO_FILES:
                    fresh.append(one.entry)
                if fresh and monotonic() - saved > COMMIT_SECONDS:
                    catalogue.put(fresh)
                    fresh, saved = [], monotonic()
                yield one
        finally:
            catalogue.put(fresh)
        yield from _moved(place, catalogue)


def _moved(store: Path, catalogue: Catalogue) -> Iterator[Imported]:
    """A drive that is in a store twice would count twice."""
    entries = [entry for entry in catalogue.entries() if entry.name is not None]
    there = {entry.source for entry in entries if os.path.lexists(entry.source)}
    held = {entry.hash for entry in entries if entry.source in there and entry.error is None}
    for entry in entries:
        source = Path(entry.source)
        if entry.source in there or entry.hash not in held or archived_members(source) is not None:
            continue
        catalogue.drop(entry.source)
        shutil.rmtree(store / DRIVES / f"{entry.name}.drive", ignore_errors=True)
        yield Imported("moved", entry)


def _tasks(store: Path, logs: Iterable[str | PathLike[str]], known: dict[str, Entry]) -> Iterator[_Task | Imported]:
    """What is to be read, and what need not be."""
    taken = {entry.name for entry in known.values() if entry.name}
    met: set[str] = set()
    inside = os.path.realpath(store) + os.sep
    for given in logs:
        root = _root(os.fspath(given))
        for log in find_logs([given]):
            source = os.path.realpath(log)
            if source.startswith(inside) or source in met:
                continue
            met.add(source)
            try:
                source.encode()
            except UnicodeEncodeError:  # which the catalogue cannot hold
                error = f"{source!r}: the name is no UTF-8; rename it to import it."
                yield Imported("failed", Entry(source, None, _NO_FILES, "", 0, error=error))
                continue
            held = known.get(source)
            stamp = _stamp(log)
            if held is not None and held.stamp == stamp:
                if held.error is not None:
                    yield Imported("failed before", held)
                    continue
                if is_drive_folder(store / DRIVES / f"{held.name}.drive"):
                    yield Imported("unchanged", held)
                    continue
            name = (held.name if held else None) or _free_name(_name(log, root), taken)
            taken.add(name)
            yield _Task(os.path.abspath(log), source, name, stamp, held)  # noqa: PTH100


def _root(given: str) -> Path:
    """What is above all that an argument names: its folder, or of a pattern the part before the first wildcard."""
    path = Path(given).absolute()
    while glob.has_magic(str(path)) and not path.exists():
        path = path.parent
    return path.parent if path == Path(given).absolute() else path


def _name(log: Path, root: Path) -> str:
    """A source's path below what was asked for, without its ending."""
    try:
        parts = log.resolve().relative_to(root.resolve()).parts
    except ValueError:
        parts = (log.name,)
    last = parts[-1] if log.is_dir() and log.suffix != ".drive" else Path(parts[-1]).stem
    return "/".join([*parts[:-1], last])


def _free_name(name: str, taken: set[str]) -> str:
    number, free = 1, name
    while free in taken:
        number += 1
        free = f"{name}-{number}"
    return free


def _stamp(log: Path) -> str:
    members = archived_members(log)
    if members is not None:
        return json.dumps(members)
    found = []
    for file in source_files(log):
        with contextlib.suppress(OSError):  # gone since it was listed
            state = file.stat()
            found.append([file.name, state.st_size, state.st_mtime_ns])
    return json.dumps(found)


def _work(store: Path, tasks: Iterator[_Task | Imported], workers: int) -> Iterator[Imported]:
    """In processes, a few tasks ahead of what is fetched."""
    waiting: dict[Future[Imported], _Task] = {}
    alone: list[_Task] = []  # that were on their way when a process died: one of them is to blame
    pool, more = _pool(workers), True
    try:
        while more or waiting:
            broken: list[_Task] = []
            while more and not broken and len(waiting) < 4 * workers:
                one = next(tasks, None)
                if one is None:
                    more = False
                elif isinstance(one, Imported):
                    yield one
                else:
                    try:
                        waiting[pool.submit(_import_one, store, one)] = one
                    except BrokenProcessPool:
                        broken.append(one)
            for future in wait(waiting, return_when=FIRST_COMPLETED).done if waiting and not broken else ():
                task = waiting.pop(future)
                try:
                    yield future.result()
                except BrokenProcessPool:
                    broken.append(task)
            if broken:
                alone += [*broken, *waiting.values()]
                waiting.clear()
                pool.shutdown(cancel_futures=True)
                pool = _pool(workers)
    finally:
        pool.shutdown(cancel_futures=True)
    for task in alone:
        with _pool(1) as single:
            try:
                yield single.submit(_import_one, store, task).result()
            except BrokenProcessPool:
                died = f"{task.log}: its reader died, of too little memory or of damage in the file."
                yield _failed(replace(task, stamp=_NO_FILES), "", 0, died)


def _pool(workers: int) -> ProcessPoolExecutor:
    # Forked from a process that has threads (of JAX, of Arrow), a child may hang; forked from a server, it need not
    # import the readers again.
    server = "forkserver" in get_all_start_methods()
    context = get_context("forkserver" if server else "spawn")
    if server:
        context.set_forkserver_preload(["jaxradar.ingest", "pyarrow.csv"])
    return ProcessPoolExecutor(workers, context, initializer=_ready)


def _ready() -> None:
    """What a process of the pool does first."""
    from jaxradar.labcsv import use_one_thread

    use_one_thread()  # of the parser's own there would be too many
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for who asked for the work, and ends the pool


def _import_one(store: Path, task: _Task) -> Imported:
    """In a process of its own."""
    log = Path(task.log)
    digest, size = "", 0
    target = store / DRIVES / f"{task.name}.drive"
    try:
        digest, size = _hash(log)
        known = task.known
        if known is not None and known.hash == digest and known.error is None and is_drive_folder(target):
            return Imported("same", replace(known, stamp=task.stamp))
        drive = read_log(log)
        write_drive(drive, target, overwrite=True, durable=False)
        entry = entry_of(drive, source=task.source, name=task.name, stamp=task.stamp, hash=digest, bytes=size)
        return Imported("imported", entry)
    except LogError as error:
        # A disk that is full today, or a file that is locked, is no fault of the log's.
        passing = isinstance(error.__cause__, OSError) or error.path.startswith(str(store))
        return _failed(replace(task, stamp=_NO_FILES) if passing else task, digest, size, str(error))
    except MemoryError:
        return _failed(replace(task, stamp=_NO_FILES), digest, size, f"{log}: is too large for the memory at hand.")
    except Exception as error:
        return _failed(replace(task, stamp=_NO_FILES), digest, size, f"{log}: cannot be imported ({error!r:.200}).")


def _failed(task: _Task, digest: str, size: int, error: str) -> Imported:
    """What was made of an earlier state of the source stays; a task without a stamp is tried again the next time."""
    if task.known is not None and task.known.name is not None:
        return Imported("failed", replace(task.known, stamp=task.stamp, error=error))
    return Imported("failed", Entry(task.source, None, task.stamp, digest, size, error=error))


def _hash(log: Path) -> tuple[str, int]:
    """SHA-256 over the names, sizes and contents of a log's files, and their size in bytes; of a drive in an archive
    over the checksums that this states."""
    members = archived_members(log)
    if members is not None:
        return sha256(json.dumps(members).encode()).hexdigest(), sum(size for _, size, _ in members)
    found, total = sha256(), 0
    for path in source_files(log):
        with path.open("rb", buffering=0) as file:
            size = os.fstat(file.fileno()).st_size
            found.update(json.dumps([path.name, size]).encode())
            while block := file.read(_HASH_BLOCK):
                found.update(block)
                total += len(block)
    return found.hexdigest(), total
