"""Tables of plain numbers as text: fast where they are sound, to the line and column where they are not.

pyarrow, where it is installed, reads whole tables of nothing but numbers. What it refuses is looked at line by line:
rows that hold a time alone are legitimate, the last row may be cut off, all else is an error with its place.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import NoReturn

import numpy as np

from jaxradar._errors import LogError
from jaxradar.labcsv.parse import by_pyarrow, by_python
from jaxradar.units import NANOSECONDS

__all__ = ["NUMBER", "Table", "is_cut", "read_bytes", "read_table", "shown"]

NUMBER = re.compile(rb"[ \t]*[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?[ \t]*")
_BEGUN = re.compile(rb"[+-]?\d*\.?\d*([eE][+-]?\d*)?")  # what is left of a number that was cut off
_FLOAT64_SECONDS = 4_000_000  # beyond, float64 seconds are more than 0.5 ns apart
_MOST_SECONDS = 4_000_000_000  # int64 nanoseconds end at 9.2e9 s, and differences must fit too


@dataclass(frozen=True)
class Table:
    """What stands in a table of a time and `columns` numbers a row.

    - `times_ns`: (rows,) int64, the first cell in nanoseconds.
    - `values`: (rows, columns), uint16 if every value is a whole number in 0..65535, else float64. Of a table that may
      have empty cells always float64, NaN where a cell is empty.
    - `alone`: (rows,) bool, rows that hold a time and nothing else; their values are 0.
    - `problems`: what was dropped.
    """

    times_ns: np.ndarray
    values: np.ndarray
    alone: np.ndarray
    problems: tuple[str, ...] = ()


def read_bytes(path: Path) -> bytes:
    """A file's content without a byte order mark. Raises `LogError`."""
    try:
        return path.read_bytes().removeprefix(b"\xef\xbb\xbf")
    except OSError as error:
        raise LogError(path, f"cannot be read: {error.strerror}.") from error


def shown(cell: bytes) -> str:
    """A cell's text as a message shows it."""
    text = cell.decode("utf-8", "backslashreplace")
    return repr(text if len(text) <= 30 else text[:27] + "...")


def is_cut(cells: list[bytes], before: bytes | None) -> bool | None:
    """Whether the last cell of a row without a line end lost its end; None if that cannot be told.

    A program writes all numbers of a row with as many decimals, so fewer say that some are missing. `before` is the
    last cell of the row before, asked where the decimals of this row differ among themselves.
    """
    last = cells[-1].strip()
    if not NUMBER.fullmatch(last) or last.endswith(b"."):
        return _BEGUN.fullmatch(last) is not None
    decimals = {_decimals(cell) for cell in cells[1:-1]}
    if len(decimals) != 1 and before is not None:
        decimals = {_decimals(before)}
    if len(decimals) != 1 or None in decimals or decimals == {0} or b"e" in last.lower():
        return None
    return _decimals(last) not in decimals


def _decimals(cell: bytes) -> int | None:
    return None if b"e" in cell.lower() else len(cell.strip().partition(b".")[2])


def read_table(
    path: Path, data: bytes, start: int, columns: int, *, first_line: int, alone: bool = False, holes: bool = False
) -> Table:
    """Read rows of a time and `columns` numbers from byte `start` of a file's content on.

    `first_line` is that byte's line, from 1. `alone` allows rows that hold a time only, `holes` empty cells.
    Raises `LogError` for a cell that is no finite number and for a row of another length, unless it is the last one
    and cut off: that one is dropped and reported.
    """
    width = columns + 1
    end, problems = _sound_end(path, data, start, width, first_line, alone)
    if end <= start:
        empty = np.empty((0, columns), np.float64 if holes else np.uint16)
        return Table(np.empty(0, np.int64), empty, np.empty(0, bool), tuple(problems))
    missing = None
    blocks = by_pyarrow(data, start, end, width, holes=holes)
    if blocks is None:
        lines, missing = _lines(path, data[start:end], width, first_line, alone)
        if missing.any():
            text = b"\n".join(lines)
            blocks = by_pyarrow(text, 0, len(text), width, holes=holes)
        if blocks is None:
            blocks = by_python(lines, width, holes=holes)
        if blocks is None:
            _diagnose(path, lines, first_line, holes)
    seconds, values = _matrix(blocks, holes)
    cells = _Cells(path, data, start, end, first_line)
    if values.dtype != np.uint16:
        wrong = np.isinf(values) if holes else ~np.isfinite(values)
        if wrong.any():
            row, column = map(int, np.argwhere(wrong)[0])
            cells.refuse(row, column + 1, "a finite number")
    times_ns = _nanoseconds(seconds, cells)
    return Table(times_ns, values, np.zeros(len(times_ns), bool) if missing is None else missing, tuple(problems))


@dataclass(frozen=True)
class _Cells:
    """Where the text of a parsed cell stands."""

    path: Path
    data: bytes
    start: int
    end: int
    first_line: int

    def lines(self) -> list[bytes]:
        return self.data[self.start : self.end].split(b"\n")

    def refuse(self, row: int, column: int, expected: str) -> NoReturn:
        cell = self.lines()[row].split(b",")[column].strip()
        raise LogError(
            self.path, f"found {shown(cell)}; expected {expected}.", line=self.first_line + row, column=column + 1
        )


def _sound_end(path: Path, data: bytes, start: int, width: int, first_line: int, alone: bool) -> tuple[int, list[str]]:
    """Where the last whole row ends, and what was left behind it."""
    problems = []
    end = len(data.rstrip(b"\0"))
    if end < len(data):
        problems.append(f"{path.name}: {len(data) - end} zero bytes at the end were dropped: the file was cut off.")
    ended = data[end - 1 : end] in (b"\n", b"\r")
    if ended:
        end = max(start, len(data[:end].rstrip(b"\r\n")))
    if end <= start:
        return start, problems
    begin = max(start, data.rfind(b"\n", start, end) + 1)
    cells = data[begin:end].split(b",")
    cut: bool | None = False
    if len(cells) < width:
        failed_read = alone and ended and not b"".join(cells[1:]).strip()
        cut = not failed_read
    elif len(cells) == width and not ended and b"".join(cells[1:]).strip():
        before = data[data.rfind(b"\n", start, begin - 1) + 1 : begin - 1] if begin > start else None
        cut = is_cut(cells, None if before is None else before.rsplit(b",", 1)[-1])
    if cut is False:
        return end, problems
    line = first_line + data.count(b"\n", start, begin)
    last = shown(cells[-1])
    if cut is None:
        problems.append(
            f"{path.name}, line {line}: the file ends without a line end, and whether its last number {last} is "
            "complete cannot be told; it was kept."
        )
        return end, problems
    problems.append(
        f"{path.name}, line {line}: the last row is cut off (it ends at cell {len(cells)} of {width}, {last}) "
        "and was dropped."
    )
    return max(start, len(data[:begin].rstrip(b"\r\n"))), problems


def _matrix(blocks: list[np.ndarray], holes: bool) -> tuple[np.ndarray, np.ndarray]:
    """Times in seconds (rows,) and values (rows, columns) of a parsed table's blocks of rows."""
    seconds = np.concatenate([block[:, 0] for block in blocks])
    if not holes:
        counts = np.empty((len(seconds), blocks[0].shape[1] - 1), np.uint16)
        row = 0
        with np.errstate(invalid="ignore"):
            for block in blocks:
                part = counts[row : row + len(block)]
                np.copyto(part, block[:, 1:], casting="unsafe")
                if not np.array_equal(part, block[:, 1:]):
                    break
                row += len(block)
            else:
                return seconds, counts
    return seconds, np.concatenate([block[:, 1:] for block in blocks])


def _nanoseconds(seconds: np.ndarray, cells: _Cells) -> np.ndarray:
    largest = np.abs(seconds).max()
    if not largest < _MOST_SECONDS:
        row = int(np.argmax(~(np.abs(seconds) < _MOST_SECONDS)))
        cells.refuse(row, 0, f"a time in seconds, below {_MOST_SECONDS}")
    nearest: np.ndarray = np.rint(seconds * NANOSECONDS).astype(np.int64)
    if largest < _FLOAT64_SECONDS:
        return nearest
    texts = (line.partition(b",")[0].decode().strip() for line in cells.lines())
    try:
        return np.array([round(Decimal(text) * NANOSECONDS) for text in texts], np.int64)
    except ArithmeticError:  # an exponent that Decimal does not take
        return nearest


def _lines(path: Path, text: bytes, width: int, first_line: int, alone: bool) -> tuple[list[bytes], np.ndarray]:
    """The rows with zeros put where a time stands alone, and which rows those are."""
    lines = [line.rstrip(b"\r") for line in text.split(b"\n")]
    missing = np.zeros(len(lines), bool)
    zeros = b",0" * (width - 1)
    for row, line in enumerate(lines):
        found = line.count(b",") + 1
        time = line.rstrip(b",")
        if alone and found <= width and time and b"," not in time:
            missing[row] = True
            lines[row] = time + zeros
        elif found != width:
            problem = f"has {found} cell{'' if found == 1 else 's'}" if line else "is empty"
            raise LogError(path, f"the row {problem}; expected {width} cells.", line=first_line + row)
    return lines, missing


def _diagnose(path: Path, lines: list[bytes], first_line: int, holes: bool) -> NoReturn:
    """Name the first cell that is no number."""
    number = b"(" + NUMBER.pattern + (b")?" if holes else b")")
    row_of_numbers = re.compile(number + b"(," + number + b")*")
    for row, line in enumerate(lines):
        if row_of_numbers.fullmatch(line):
            continue
        for column, cell in enumerate(line.split(b",")):
            if not NUMBER.fullmatch(cell) and (cell or not holes or column == 0):
                found = f"found {shown(cell)}" if cell.strip() else "the cell is empty"
                raise LogError(path, f"{found}; expected a number.", line=first_line + row, column=column + 1)
    raise AssertionError(f"{path}: all cells are numbers, and were refused.")
