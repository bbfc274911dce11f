"""What is compared: a task makes inputs with known truth, a candidate is a way of answering."""

from __future__ import annotations

import abc
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from jaxradar.estimate.intervals import Estimate, mean, percentile, proportion, rms

__all__ = ["Candidate", "Case", "Data", "Program", "Score", "Task", "estimation_score"]


@dataclass(frozen=True, eq=False)
class Data:
    """One set of inputs of which the truth is known.

    - `inputs`: whatever the task's candidates take; `truth`: what they should find.
    - `items`: how many things are in it that time is counted for (sweeps).
    - `bound`: the least error that can be had, in the task's unit, where theory knows one.
    """

    inputs: Any
    truth: Any
    items: int
    bound: float | None = None


@dataclass(frozen=True, eq=False)
class Case:
    """One kind of input: `draw()` makes it, the same each time, when it is its turn.

    - `about`: what it is, in a few words; `conditions`: the same as numbers.
    - `bound_name`: whose bound it is. `attainable(level)`: the least error at another level of its series, in the
      task's unit, where theory knows more than the bound; `threshold`: the level below which nobody meets the bound.
    - `series`, `level`: cases that differ in one number alone (SNR) bear one series' name and that number;
      `level_name`: what it is, with its unit.
    """

    name: str
    draw: Callable[[], Data]
    about: str
    conditions: Mapping[str, float] = field(default_factory=dict)
    bound_name: str = ""
    series: str = ""
    level: float | None = None
    level_name: str = ""
    attainable: Callable[[float], float] | None = None
    threshold: float | None = None


@dataclass(frozen=True)
class Program:
    """A candidate made ready for one case: what answers the first `items` of it at once, and what answers one (None
    where that makes no sense). Whoever calls it waits for the answer, should it be JAX's. `answers`: how many the time
    is shared by, where that is not `items`."""

    batch: Callable[[], Any]
    items: int
    single: Callable[[], Any] | None = None
    answers: int | None = None


@dataclass(frozen=True, eq=False)
class Candidate:
    """One way of doing a task: `prepare(data)` gives a `Program`, or None where it cannot do that case.

    `settings` are what it is made of, for whoever wants to use it. `default`: the one that the package's default
    detector holds. `peer`: not of this package.
    """

    name: str
    prepare: Callable[[Data], Program | None]
    settings: Mapping[str, float | str] = field(default_factory=dict)
    default: bool = False
    peer: bool = False


@dataclass(frozen=True)
class Score:
    """How far an answer is from the truth: the error that candidates are compared by, and more `details`, whose names
    bear their unit where it is not the task's. `cost`: what it costs, where that is not time."""

    error: Estimate
    details: Mapping[str, Estimate] = field(default_factory=dict)
    cost: Estimate | None = None


class Task(abc.ABC):
    """`title`: one line; `item`: what time is counted for; `error_name`, `unit`: what is compared, and in what.

    `cost_name`, `cost_unit`: what it is compared with; the time of one item in seconds unless scores say otherwise.
    """

    name: str
    title: str
    item: str
    error_name: str
    unit: str
    cost_name: str = "time"
    cost_unit: str = "s"

    @abc.abstractmethod
    def cases(self, quick: bool = False) -> Sequence[Case]:
        """The kinds of input, drawn from fixed seeds; fewer if `quick`."""

    @abc.abstractmethod
    def candidates(self, quick: bool = False) -> Sequence[Candidate]:
        """Those that the package knows of; fewer if `quick`. A script may add its own."""

    @abc.abstractmethod
    def score(self, data: Data, answer: Any, items: int) -> Score:
        """Compare the answer for the first `items` of a case with the truth. Raises `ValueError` for an answer that
        is no answer (of another shape, or not a number)."""


def estimation_score(answer: Any, truth: np.ndarray, scale: float, gross: float | None = None) -> Score:
    """Of estimates of one number each: RMS error, bias, 95th percentile of |error| and, with `gross`, the share of
    larger errors and the RMS of the others. `scale`: of the unit that errors are given in. Raises `ValueError` for
    another number of estimates, and for estimates that are no numbers."""
    if np.shape(answer) != np.shape(truth):
        raise ValueError(f"expected {np.shape(truth)[0]} estimates; got an array of shape {np.shape(answer)}.")
    errors = np.asarray(answer, np.float64) - np.asarray(truth, np.float64)
    if not np.isfinite(errors).all():
        raise ValueError(f"{int((~np.isfinite(errors)).sum())} of {errors.size} estimates are not numbers.")
    far = np.abs(errors) > (np.inf if gross is None else gross)
    details = {"bias": mean(errors).scaled(scale), "95 % of |error|": percentile(np.abs(errors), 95.0).scaled(scale)}
    if gross is not None:
        details["gross %"] = proportion(int(far.sum()), errors.size).scaled(100.0)
        if not far.all():
            details["without gross"] = rms(errors[~far]).scaled(scale)
    return Score(rms(errors).scaled(scale), details)
