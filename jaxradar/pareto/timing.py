"""Time candidates in turns in one process, so that the machine's drift hits all of them alike."""

from __future__ import annotations

import gc
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

__all__ = ["Spread", "first_call", "rounds", "spread", "three_digits", "time_text"]

# Threads of OpenMP, numba and XLA spin for a while after their work is done, and would spin on the next one's cores.
PAUSE_S = 0.01


@dataclass(frozen=True)
class Spread:
    """Median, 10th and 90th percentile."""

    median: float
    low: float
    high: float

    def scaled(self, factor: float) -> Spread:
        """In another unit; `factor` above 0."""
        return Spread(self.median * factor, self.low * factor, self.high * factor)


def spread(values: np.ndarray) -> Spread:
    """Of one candidate's rounds."""
    low, median, high = np.percentile(values, (10, 50, 90))
    return Spread(float(median), float(low), float(high))


def first_call(candidate: Callable[[], object]) -> float:
    """Seconds of a call, compilation and all."""
    begin = time.perf_counter()
    candidate()
    return time.perf_counter() - begin


def rounds(
    candidates: Mapping[str, Callable[[], object]],
    count: int,
    advance: Callable[[], object] | None = None,
    pause_s: float = PAUSE_S,
) -> dict[str, np.ndarray]:
    """Seconds of each candidate in each of `count` rounds, after one that does not count.

    A candidate returns when its result is there. Each round begins with another candidate: none is always measured
    behind the same one, with that one's data in the cache. `advance` is called after every round, the first too.
    """
    names = list(candidates)
    times = {name: np.empty(count) for name in names}
    collecting = gc.isenabled()
    gc.disable()
    try:
        for turn in range(-1, count):
            for offset in range(len(names)):
                name = names[(turn + offset) % len(names)]
                time.sleep(pause_s)
                begin = time.perf_counter()
                result = candidates[name]()
                elapsed = time.perf_counter() - begin
                del result  # what it takes to give memory back is nobody's time
                if turn >= 0:
                    times[name][turn] = elapsed
            if advance is not None:
                advance()
    finally:
        if collecting:
            gc.enable()
    return times


def three_digits(value: float) -> str:
    """Without an exponent, for numbers that people compare."""
    if not math.isfinite(value):
        return "∞" if value > 0 else "-∞" if value < 0 else "?"
    digits = 2 - math.floor(math.log10(abs(value))) if value else 0
    return f"{value:.{min(max(digits, 0), 6)}f}"


def time_text(seconds: float) -> str:
    """With the unit that fits."""
    for unit, factor in (("s", 1.0), ("ms", 1e3), ("µs", 1e6)):
        if seconds * factor >= 1.0:
            return f"{three_digits(seconds * factor)} {unit}"
    return f"{three_digits(seconds * 1e9)} ns"
