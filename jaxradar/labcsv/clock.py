"""What goes wrong with the times of a log, mended where the cause is certain and said where it is not."""

from __future__ import annotations

import numpy as np

from jaxradar.units import NANOSECONDS

__all__ = ["odd_times", "unwrap_counter"]

_COUNTS = 1 << 16
_MOST_MISSING = 50  # loops of the lab's program, one second, that may be missing around a wrap


def unwrap_counter(times_ns: np.ndarray) -> tuple[np.ndarray, list[int], float]:
    """Mend the wraps of the 16-bit counter behind the times of the lab's program: time = counter · period.

    (rows,) int64 nanoseconds as the file has them go in. A fall is such a wrap only if it leads from just below
    65536 · period to just above 0 on the grid of the period, which is inferred from the rows themselves; any other
    fall is left alone. Returns the times, the first row after each wrap, and what one wrap spans in seconds.
    """
    steps = np.diff(times_ns)
    falls = np.flatnonzero(steps < 0)
    forward = steps[steps > 0]
    if not falls.size or not forward.size:
        return times_ns, [], 0.0
    # One step is rounded to the file's decimals; the sum of all, over the number of periods in it, is not.
    counts = np.rint(forward / np.median(forward)).sum()
    period = forward.sum() / counts
    mended, wraps, span = times_ns.copy(), [], 0.0
    for row in falls.tolist():
        last, first = times_ns[row] / period, times_ns[row + 1] / period
        count, again = round(last), round(first)
        on_grid = abs(last - count) <= 0.25 and abs(first - again) <= 0.25
        if on_grid and count < _COUNTS and again >= 0 and _COUNTS - count + again <= _MOST_MISSING:
            # The last time before the wrap is `count` periods since zero: the best ruler that the file holds.
            shift = round(_COUNTS * int(times_ns[row]) / count)
            mended[row + 1 :] += shift
            wraps.append(row + 1)
            span = shift / NANOSECONDS
    return mended, wraps, span


def odd_times(times_ns: np.ndarray, place: str, first_line: int | None = None) -> list[str]:
    """One sentence each on times that go back and times that are repeated; `first_line` is the first row's line."""
    steps = np.diff(times_ns)
    problems = []
    for odd, what in ((steps < 0, "go back"), (steps == 0, "repeat the one before")):
        rows = np.flatnonzero(odd) + 1
        if rows.size:
            first = int(rows[0])
            where = f"in row {first + 1}" if first_line is None else f"in line {first_line + first}"
            problems.append(f"{place}: {rows.size} of {len(times_ns)} times {what}, first {where}; left as recorded.")
    return problems
