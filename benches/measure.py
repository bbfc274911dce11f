"""Time candidates in turns in one process, so that the machine's drift hits all of them alike; used by `run.py`."""

from __future__ import annotations

import gc
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from rich.console import Console
from rich.progress import Progress

__all__ = ["Spread", "figure", "ratio", "rounds", "say", "spread"]

_console = Console(stderr=True, highlight=False)
# Threads of OpenMP, numba and XLA spin for a while after their work is done, and would spin on the next one's cores.
PAUSE_S = 0.01


def say(text: str) -> None:
    """A line about progress, on standard error."""
    _console.print(text, markup=False, soft_wrap=True)


@dataclass(frozen=True)
class Spread:
    """Median, 10th and 90th percentile."""

    median: float
    low: float
    high: float

    def scaled(self, factor: float) -> Spread:
        return Spread(self.median * factor, self.low * factor, self.high * factor)

    def around(self) -> str:
        return f"{figure(self.low)}..{figure(self.high)}"


def figure(value: float) -> str:
    """Three digits, without an exponent."""
    return f"{value:.{max(0, 2 - math.floor(math.log10(abs(value)))) if value else 0}f}"


def spread(values: np.ndarray) -> Spread:
    low, median, high = np.percentile(values, (10, 50, 90))
    return Spread(float(median), float(low), float(high))


def ratio(times: np.ndarray, others: np.ndarray) -> Spread:
    """Of two candidates' times, round by round."""
    return spread(times / others)


def rounds(candidates: Mapping[str, Callable[[], object]], count: int, what: str) -> dict[str, np.ndarray]:
    """Seconds of each candidate in each of `count` rounds, after one that does not count.

    A candidate returns when its result is there. Each round begins with another candidate: none is always measured
    behind the same one, with that one's data in the cache.
    """
    names = list(candidates)
    times = {name: np.empty(count) for name in names}
    collecting = gc.isenabled()
    gc.disable()
    try:
        with Progress(console=_console, transient=True) as progress:
            task = progress.add_task(what, total=count + 1)
            for turn in range(-1, count):
                for offset in range(len(names)):
                    name = names[(turn + offset) % len(names)]
                    time.sleep(PAUSE_S)
                    begin = time.perf_counter()
                    result = candidates[name]()
                    elapsed = time.perf_counter() - begin
                    del result  # what it takes to give memory back is nobody's time
                    if turn >= 0:
                        times[name][turn] = elapsed
                progress.advance(task)
    finally:
        if collecting:
            gc.enable()
    return times
