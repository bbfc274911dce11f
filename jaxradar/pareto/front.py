"""Who is on the front, and whom to choose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from jaxradar._errors import ConfigError
from jaxradar.pareto.figures import Figure
from jaxradar.pareto.task import Score
from jaxradar.pareto.timing import Spread

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
    def error(self) -> Figure:
        return self.score.error


@dataclass(frozen=True)
class CaseResult:
    """All candidates in one case, the cheapest first. `failed`: who had no answer, and why."""

    case: str
    about: str
    setting: dict[str, float]
    bound: float | None
    bound_name: str
    points: tuple[Point, ...]
    failed: dict[str, str]

    @property
    def front(self) -> tuple[Point, ...]:
        return tuple(point for point in self.points if point.front)


@dataclass(frozen=True)
class Frontier:
    """What was measured of a task."""

    task: str
    title: str
    item: str
    error_name: str
    unit: str
    quick: bool
    results: tuple[CaseResult, ...]

    def result(self, case: str | None = None) -> CaseResult:
        """Of a case by its name, or of the first. Raises `ConfigError` for one that there is not."""
        for one in self.results:
            if case is None or one.case == case:
                return one
        raise ConfigError(f"no case {case!r}; expected one of {', '.join(one.case for one in self.results)}.")


def beats(one: Point, other: Point) -> bool:
    """Whether `one` is better or faster beyond the error bars, and neither worse nor slower beyond them."""
    worse, slower = other.error.below(one.error), other.batch.high < one.batch.low
    better, faster = one.error.below(other.error), one.batch.high < other.batch.low
    return (better or faster) and not (worse or slower)


def on_front(points: Sequence[Point]) -> list[bool]:
    """Of each point whether none beats it."""
    return [not any(beats(other, point) for other in points if other is not point) for point in points]


def choose_point(result: CaseResult, unit: str, error: float | None = None, time_s: float | None = None) -> Point:
    """The cheapest with an error of at most `error` in the frontier's unit, or the most accurate of those that take
    at most `time_s` an item; with both, the cheapest that meets both. Counted by what was measured, not by the ends of
    the error bars.

    Raises `ConfigError` if neither is given, and where nobody meets the budget, naming who comes closest.
    """
    if error is None and time_s is None:
        raise ConfigError("expected a budget: an error, a time, or both.")
    fits = [
        point
        for point in result.points
        if (error is None or point.error.value <= error) and (time_s is None or point.batch.median <= time_s)
    ]
    if not fits:
        best = min(result.points, key=lambda point: point.error.value)
        fast = min(result.points, key=lambda point: point.batch.median)
        raise ConfigError(
            f"nobody meets the budget in {result.case}: the most accurate is {best.candidate} with "
            f"{best.error.value:.3g} {unit} in {1e9 * best.batch.median:.3g} ns, the fastest {fast.candidate} with "
            f"{fast.error.value:.3g} {unit} in {1e9 * fast.batch.median:.3g} ns."
        )
    if error is None:
        return min(fits, key=lambda point: (point.error.value, point.batch.median))
    return min(fits, key=lambda point: (point.batch.median, point.error.value))
