"""What was measured, as a table to read and as JSON to keep."""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from typing import Any

from jaxradar.estimate.intervals import Estimate
from jaxradar.pareto.front import CaseResult, Frontier, Point
from jaxradar.pareto.timing import Spread, three_digits, time_text

__all__ = ["table", "to_json"]


def table(frontier: Frontier, result: CaseResult) -> tuple[list[str], list[list[str]]]:
    """Column names and rows of a case, the cheapest first; `*` before a name: on the front, `D`: the default's.

    The column of each detail is there if any candidate has it.
    """
    details = list(dict.fromkeys(name for point in result.points for name in point.score.details))
    columns = ["candidate", f"{frontier.error_name} {frontier.unit}".strip(), "95 %"]
    if result.bound:
        columns.append("× bound")
    columns += [*details, f"a {frontier.item}", "10..90 %", "alone", "compiling"]
    return columns, [_row(point, result, details) for point in result.points]


def _row(point: Point, result: CaseResult, details: list[str]) -> list[str]:
    mark = ("*" if point.front else " ") + ("D" if point.default else " ")
    cells = [f"{mark} {point.candidate}", three_digits(point.error.value), _interval(point.error)]
    if result.bound:
        cells.append(f"{point.error.value / result.bound:.2f}")
    for name in details:
        held = point.score.details.get(name)
        cells.append("" if held is None else three_digits(held.value))
    alone = "" if point.single is None else time_text(point.single.median)
    return [*cells, time_text(point.batch.median), _between(point.batch), alone, time_text(point.first_s)]


def _interval(figure: Estimate) -> str:
    return f"{three_digits(figure.low)}..{three_digits(figure.high)}"


def _between(spread: Spread) -> str:
    return f"{time_text(spread.low)}..{time_text(spread.high)}"


def to_json(frontier: Frontier) -> dict[str, Any]:
    """All of it in plain lists, numbers and text; times in seconds, errors in `unit`; ends of intervals that lie at
    infinity come out as None. Each result bears its case's name, text and conditions beside its points."""
    record = asdict(replace(frontier, results=()))
    record["results"] = [
        {
            "case": result.case.name,
            "about": result.case.about,
            "conditions": dict(result.case.conditions),
            "bound": result.bound,
            "bound_name": result.case.bound_name,
            "points": [asdict(point) for point in result.points],
            "failed": result.failed,
        }
        for result in frontier.results
    ]
    plain: dict[str, Any] = _finite(record)
    return plain


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
