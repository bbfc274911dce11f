"""Who is on the front, and whom to choose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from jaxradar._errors import ConfigError
from jaxradar.estimate.intervals import Estimate
from jaxradar.pareto.task import Case, Score
from jaxradar.pareto.timing import Spread, time_text

__all__ = ["CaseResult", "Frontier", "Point", "choose_point", "on_front"]


@dataclass(frozen=True)
class Point:
    """One candidate in one case. Times in seconds: `batch` of one item among many, `single` of one item alone,
    `first_s` of the first call over what later ones take: compiling."""

    candidate: str
    settings: dict[str, Any]
    default: bool
    peer: bool
    items: int
    score: Score
    batch: Spread
    single: Spread | None
    first_s: float
    front: bool = False

    @property
    def error(self) -> Estimate:
        return self.score.error

    @property
    def cost(self) -> Estimate:
        """What the score says, or the time of one item: the median, and where 10 to 90 % of the rounds lie."""
        return self.score.cost or Estimate(self.batch.median, self.batch.low, self.batch.high)


@dataclass(frozen=True)
class CaseResult:
    """All candidates in one case, the cheapest first. `failed`: who had no answer, and why."""

    case: Case
    bound: float | None
    points: tuple[Point, ...]
    failed: dict[str, str]

    @property
    def front(self) -> tuple[Point, ...]:
        return tuple(point for point in self.points if point.front)


@dataclass(frozen=True)
class Frontier:
    """What was measured of a task, with how many rounds, and where."""

    task: str
    title: str
    item: str
    error_name: str
    unit: str
    cost_name: str
    cost_unit: str
    quick: bool
    rounds: int
    machine: dict[str, str]
    results: tuple[CaseResult, ...]

    def result(self, case: str | None = None) -> CaseResult:
        """Of a case by its name, or of the first. Raises `ConfigError` for one that there is not."""
        for one in self.results:
            if case is None or one.case.name == case:
                return one
        raise ConfigError(f"no case {case!r}; expected one of {'; '.join(one.case.name for one in self.results)}.")

    def cost_text(self, cost: float) -> str:
        """With its unit."""
        return time_text(cost) if self.cost_unit == "s" else f"{cost:.3g} {self.cost_unit}"


def beats(one: Point, other: Point) -> bool:
    """Whether `one` is better or cheaper beyond the error bars, and neither worse nor dearer beyond them."""
    worse, dearer = other.error.below(one.error), other.cost.below(one.cost)
    better, cheaper = one.error.below(other.error), one.cost.below(other.cost)
    return (better or cheaper) and not (worse or dearer)


def on_front(points: Sequence[Point]) -> list[bool]:
    """Of each point whether none beats it."""
    return [not any(beats(other, point) for other in points if other is not point) for point in points]


def choose_point(found: Frontier, result: CaseResult, error: float | None = None, cost: float | None = None) -> Point:
    """The cheapest with an error of at most `error` in the frontier's unit, or the most accurate of those that cost at
    most `cost` (seconds an item, where the cost is time); with both, the cheapest that meets both. Counted by what was
    measured, not by the ends of the error bars.

    Raises `ConfigError` if neither is given, and where nobody meets the budget, naming who comes closest.
    """
    if error is None and cost is None:
        raise ConfigError("expected a budget: an error, a cost, or both.")
    if not result.points:
        raise ConfigError(
            f"nobody had an answer in {result.case.name}: {'; '.join(map(': '.join, result.failed.items()))}"
        )
    fits = [
        point
        for point in result.points
        if (error is None or point.error.value <= error) and (cost is None or point.cost.value <= cost)
    ]
    if not fits:
        best = min(result.points, key=lambda point: point.error.value)
        cheap = min(result.points, key=lambda point: point.cost.value)
        first, second = (
            f"{one.candidate} with {one.error.value:.3g} {found.unit} in {found.cost_text(one.cost.value)}"
            for one in (best, cheap)
        )
        raise ConfigError(
            f"nobody meets the budget in {result.case.name}: the most accurate is {first}, the cheapest {second}."
        )
    if error is None:
        return min(fits, key=lambda point: (point.error.value, point.cost.value))
    return min(fits, key=lambda point: (point.cost.value, point.error.value))
