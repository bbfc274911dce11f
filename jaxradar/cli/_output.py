"""What all commands print alike: tables, JSON lines, progress."""

from __future__ import annotations

import json
import math
import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, Protocol, cast, runtime_checkable

from jaxradar._errors import ConfigError, LogError
from jaxradar._program import shown

__all__ = [
    "Lines",
    "Stream",
    "console",
    "json_lines",
    "plain",
    "print_table",
    "progress",
    "ready_folder",
    "spare_logs",
    "told_shares",
    "write_json",
    "write_text",
]


@runtime_checkable
class Stream(Protocol):
    """Where text goes: a file, a terminal, or what stands in for one."""

    def write(self, text: str, /) -> int: ...

    def flush(self) -> None: ...

    def isatty(self) -> bool: ...


def plain(value: Any) -> Any:
    """The same as strict JSON knows it: a number that is not finite is null."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value if value is None or isinstance(value, bool | int | str) else str(value)


class Lines:
    """JSON lines, each on the disk as soon as it is written."""

    def __init__(self, file: Stream | None, path: Path | None = None) -> None:
        self._file = file
        self._path = path

    def write(self, record: Mapping[str, Any]) -> None:
        """Add one object. Raises `LogError` if the file at `path` does not take it, `OSError` if a stream does not."""
        if self._file is None:
            return
        try:
            self._file.write(json.dumps(plain(record), allow_nan=False) + "\n")
            self._file.flush()
        except OSError as error:
            if self._path is None:
                raise
            raise LogError(self._path, f"cannot be written: {error.strerror or error}.") from error


def spare_logs(option: str, target: str, logs: Sequence[str]) -> None:
    """Raises `ConfigError` if a file to be written is a log, a part of one, its truth, or a part of a store."""
    from jaxradar.store import MARKER

    real = Path(os.path.realpath(target))
    for log in logs:
        held = Path(os.path.realpath(log))
        if real in (held, held.with_name(f"{held.stem}.truth.json"), *held.parents) or held in real.parents:
            raise ConfigError(
                f"{option} {shown(target)} would overwrite the log {shown(log)}, a part of it or its truth."
            )
    for folder in real.parents:
        if (folder / MARKER).is_file():
            raise ConfigError(f"{option} {shown(target)} lies in the store {shown(folder)}; give another place.")


@contextmanager
def json_lines(target: str | None, logs: Sequence[str]) -> Iterator[Lines]:
    """Lines into a file, on standard output for `-`, nowhere for None.

    Raises `ConfigError` if the file cannot be written or belongs to one of the logs.
    """
    if target is None or target == "-":
        yield Lines(sys.stdout if target else None)
        return
    spare_logs("--json", target, logs)
    path = Path(target)
    try:
        file = path.open("w", encoding="utf-8")
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise ConfigError(f"--json {shown(target)} cannot be written: {reason}.") from None
    try:
        yield Lines(file, path)
    finally:
        with suppress(OSError):  # every line was flushed, and a failure said, before
            file.close()


def ready_folder(target: str | None, option: str) -> Path | None:
    """A folder that exists and takes files. Raises `ConfigError` if it cannot be made or written to."""
    if target is None:
        return None
    folder = Path(target)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise ConfigError(f"{option} {shown(target)} cannot be made: {reason}.") from None
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ConfigError(f"{option} {shown(target)} cannot be written to.")
    return folder


def console(file: Stream) -> Any:
    """A `rich.console.Console` that takes text as it stands. Off a terminal, tables are as wide as they need."""
    from rich.console import Console

    def of(width: int | None) -> Console:
        return Console(file=cast(IO[str], file), markup=False, highlight=False, emoji=False, width=width)

    made = of(None if file.isatty() or "COLUMNS" in os.environ else 200)
    # In a narrower window whole columns would vanish; lines that run over are the smaller evil.
    return made if made.width >= 80 else of(80)


def print_table(file: Stream, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """A table whose first column is text, which gives way in a narrow window, and whose others are numbers."""
    from rich.table import Table

    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold")
    for place, name in enumerate(columns):
        if place:
            table.add_column(name, justify="right", no_wrap=True)
        else:
            table.add_column(name, overflow="fold")
    for row in rows:
        table.add_row(*row)
    console(file).print(table)


@contextmanager
def progress(what: str, total: int, *, quiet: bool = False) -> Iterator[Callable[[int], None]]:
    """A bar on standard error if that is a terminal and there is more than one step; gives what advances it."""
    if quiet or total < 2 or not sys.stderr.isatty():
        yield lambda steps: None
        return
    from rich.progress import Progress

    with Progress(console=console(sys.stderr), transient=True) as bar:
        task = bar.add_task(what, total=total)
        yield lambda steps: bar.advance(task, steps)


@contextmanager
def told_shares(what: str, note: str) -> Iterator[Callable[[str, float], None]]:
    """A bar for long work that says itself what it is at and what share is done; off a terminal a line, `note`, and one
    for each tenth of what takes longer than a minute."""
    if not sys.stderr.isatty():
        print(f"jaxradar: {note} ...", file=sys.stderr)
        yield _tenths(what)
        return
    from rich.progress import Progress

    with Progress(console=console(sys.stderr), transient=True) as bar:
        task = bar.add_task(what, total=1.0)
        yield lambda name, share: bar.update(task, completed=share, description=name)


def _tenths(what: str, quiet_s: float = 60.0) -> Callable[[str, float], None]:
    began, said = time.monotonic(), 0

    def told(name: str, share: float) -> None:
        nonlocal said
        if int(10.0 * share) > said and time.monotonic() - began > quiet_s:
            said = int(10.0 * share)
            print(f"jaxradar: {what}: {10 * said} %, {shown(name)}", file=sys.stderr, flush=True)

    return told


def write_text(path: Path, text: str) -> None:
    """A file as a whole or not at all, in place of one that was there. Raises `LogError` if it cannot be written."""
    from jaxradar.drivefile import staged

    with staged(path, overwrite=True) as stage:
        stage.write_text(text, encoding="utf-8")


def write_json(path: Path, record: object) -> None:
    """As `write_text`, strict JSON to be read by people too."""
    write_text(path, json.dumps(record, allow_nan=False, indent=1) + "\n")
