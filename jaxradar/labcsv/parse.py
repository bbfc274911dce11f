"""Rows of plain numbers from text: by pyarrow where it is installed, by Python alone where it is not, to the same bit.

Both round to the nearest float64. `by_python` says what a number is: `by_pyarrow` may refuse what that takes, and takes
nothing that that refuses, so a table reads the same with it and without.
"""

from __future__ import annotations

import numpy as np

__all__ = ["by_pyarrow", "by_python", "use_one_thread"]

_BLOCK = 1 << 20  # bytes of text that one thread of pyarrow parses at a time
_CELLS = 1 << 16  # that are Python's own objects at a time, some 6 MB
_IN_NUMBERS = b"0123456789+-.eE \t,naifty" + b"NAIFTY"  # of `nan` and `infinity` too, which the caller refuses


def use_one_thread() -> None:
    """From now on this process parses with one thread: for where there is a process for each core."""
    try:
        import pyarrow as pa  # type: ignore[import-untyped]
    except ImportError:
        return
    pa.set_cpu_count(1)


def by_pyarrow(data: bytes, start: int, end: int, width: int, *, holes: bool) -> list[np.ndarray] | None:
    """The rows in a file's bytes from `start` to `end`, as blocks of (rows, width) float64; with `holes`, empty cells
    are NaN. None where pyarrow is not installed, or where not every row is `width` numbers."""
    try:
        import pyarrow as pa
        from pyarrow import csv
    except ImportError:
        return None
    # pyarrow takes a lone CR for a line end and `nan(1)` for a number; nothing else here does.
    if data.find(b"(", start, end) >= 0:
        return None
    if data.find(b"\r", start, end) >= 0 and data.count(b"\r", start, end) != data.count(b"\r\n", start, end):
        return None
    names = [str(column) for column in range(width)]
    try:
        table = csv.read_csv(
            pa.BufferReader(pa.py_buffer(memoryview(data)[start:end])),
            csv.ReadOptions(column_names=names, block_size=max(_BLOCK, 64 * width)),
            csv.ParseOptions(quote_char=False, double_quote=False, escape_char=False, ignore_empty_lines=False),
            csv.ConvertOptions(
                check_utf8=False,
                null_values=[""] if holes else [],
                column_types=dict.fromkeys(names, pa.float64()),
            ),
        )
    except pa.ArrowInvalid:
        return None
    if table.column(0).null_count:  # of an empty line too, which pyarrow takes for a row of empty cells
        return None
    return [batch.to_tensor(null_to_nan=holes, row_major=True).to_numpy() for batch in table.to_batches()]


def by_python(lines: list[bytes], width: int, *, holes: bool) -> list[np.ndarray] | None:
    """Likewise, from lines that all have `width` cells; None where one of these is no number."""
    blocks = []
    rows = max(1, _CELLS // width)
    for first in range(0, len(lines), rows):
        text = b",".join(lines[first : first + rows])
        if text.translate(None, _IN_NUMBERS):  # `float` takes `1_0` and the line ends of other systems
            return None
        cells = text.split(b",")
        if holes:
            cells = [cell or b"nan" for cell in cells]
        try:
            numbers = np.fromiter(map(float, cells), np.float64, len(cells))
        except ValueError:
            return None
        blocks.append(numbers.reshape(-1, width))
    return blocks
