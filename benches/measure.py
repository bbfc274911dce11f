"""How times are taken and written; used by `run.py`. The clock itself is that of `jaxradar.pareto`."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from rich.console import Console
from rich.progress import Progress

from jaxradar import pareto
from jaxradar.pareto import Spread, spread
from jaxradar.pareto.timing import three_digits as figure

__all__ = ["Spread", "around", "figure", "ratio", "rounds", "say", "spread"]

_console = Console(stderr=True, highlight=False)


def say(text: str) -> None:
    """A line about progress, on standard error."""
    _console.print(text, markup=False, soft_wrap=True)


def around(held: Spread) -> str:
    return f"{figure(held.low)}..{figure(held.high)}"


def ratio(times: np.ndarray, others: np.ndarray) -> Spread:
    """Of two candidates' times, round by round."""
    return spread(times / others)


def rounds(candidates: Mapping[str, Callable[[], object]], count: int, what: str) -> dict[str, np.ndarray]:
    """`jaxradar.pareto.rounds` with a progress bar."""
    with Progress(console=_console, transient=True) as progress:
        task = progress.add_task(what, total=count + 1)
        return pareto.rounds(candidates, count, lambda: progress.advance(task))
