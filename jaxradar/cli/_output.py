"""What all commands print alike: file names, tables, JSON lines, figures."""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO, Any, Protocol, cast, runtime_checkable

from jaxradar._errors import ConfigError

__all__ = ["Lines", "Stream", "console", "json_lines", "plain", "print_table", "ready_folder", "shown"]


@runtime_checkable
class Stream(Protocol):
    """Where text goes: a file, a terminal, or what stands in for one."""

    def write(self, text: str, /) -> int: ...

    def flush(self) -> None: ...

    def isatty(self) -> bool: ...


def shown(path: str | os.PathLike[str]) -> str:
    """A path as text that every stream takes: a name that is no UTF-8 is escaped."""
    return os.fspath(path).encode("utf-8", "backslashreplace").decode("utf-8")


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

    def __init__(self, file: Stream | None) -> None:
        self._file = file

    def write(self, record: Mapping[str, Any]) -> None:
        """Add one object."""
        if self._file is not None:
            self._file.write(json.dumps(plain(record), allow_nan=False) + "\n")
            self._file.flush()


@contextmanager
def json_lines(target: str | None, logs: Sequence[Path]) -> Iterator[Lines]:
    """Lines into a file, on standard output for `-`, nowhere for None.

    Raises `ConfigError` if the file cannot be written or belongs to one of the logs.
    """
    if target is None or target == "-":
        yield Lines(sys.stdout if target else None)
        return
    real = Path(os.path.realpath(target))
    for log in logs:
        held = Path(os.path.realpath(log))
        if held == real or held in real.parents:
            raise ConfigError(f"--json {shown(target)} would overwrite the log {shown(log)} or a part of it.")
    with ExitStack() as stack:
        try:
            file = stack.enter_context(Path(target).open("w", encoding="utf-8"))
        except (OSError, ValueError) as error:
            reason = error.strerror if isinstance(error, OSError) else str(error)
            raise ConfigError(f"--json {shown(target)} cannot be written: {reason}.") from None
        yield Lines(file)


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
