"""Figures with intervals that cover, a front that is one, a choice that keeps the budget."""

from __future__ import annotations

import dataclasses
import json
import math
import time
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from jaxradar import ConfigError, pareto
from jaxradar.pareto import (
    Candidate,
    Case,
    CaseResult,
    Data,
    Estimate,
    Frontier,
    Point,
    Program,
    Score,
    Spread,
    Task,
)
from jaxradar.pareto.front import on_front
from jaxradar.plots.frontier import plot_case, plot_levels


@pytest.mark.parametrize("what", ["mean", "rms", "share", "percentile"])
def test_intervals_cover_as_often_as_they_say(what: str) -> None:
    """1,000 draws: 95 % are inside, ± 2 % (four standard errors 2.8 %); the discrete ones may be wider."""
    random = np.random.default_rng(3)
    inside = 0
    for _ in range(1000):
        values = random.standard_normal(200)
        if what == "mean":
            found, truth = pareto.mean(values), 0.0
        elif what == "rms":
            found, truth = pareto.rms(values), 1.0
        elif what == "share":
            found, truth = pareto.proportion(int((values > 1.0).sum()), 200), 0.15866
        else:
            found, truth = pareto.percentile(values, 90.0), 1.28155
        assert found.low <= found.value <= found.high
        inside += found.low <= truth <= found.high
    assert 925 <= inside <= (975 if what in ("mean", "rms") else 995)


def test_intervals_of_few_and_of_extremes() -> None:
    assert pareto.proportion(0, 10).low == 0.0
    assert pareto.proportion(10, 10).high == 1.0
    assert pareto.proportion(0, 10).high == pytest.approx(1 - 0.025**0.1)
    assert math.isinf(pareto.mean(np.array([2.0])).high)
    assert math.isinf(pareto.percentile(np.arange(5.0), 95.0).high)
    with pytest.raises(ValueError, match="3 of 2"):
        pareto.proportion(3, 2)


def held(*points: Point) -> Frontier:
    case = Case("case", lambda: Data(None, None, 1), "")
    result = CaseResult(case, None, points, {})
    return Frontier("t", "T", "sweep", "error", "mm", "time", "s", False, 3, {}, (result,))


def point(name: str, error: tuple[float, float, float], ns: tuple[float, float, float]) -> Point:
    spread = Spread(*(1e-9 * one for one in (ns[1], ns[0], ns[2])))
    figure = Estimate(error[1], error[0], error[2])
    return Point(name, {}, False, False, 100, Score(figure), spread, None, 0.0)


def test_the_front_is_what_nobody_beats() -> None:
    points = [
        point("fast and bad", (9, 10, 11), (9, 10, 11)),
        point("beaten", (9, 10, 11), (19, 20, 21)),
        point("good", (0.9, 1, 1.1), (29, 30, 31)),
        point("as good, as fast, within the error bars", (0.95, 1.05, 1.15), (30, 31, 32)),
        point("as good and slower", (0.95, 1.05, 1.15), (90, 100, 110)),
    ]
    assert on_front(points) == [True, False, True, True, False]


def test_choose_keeps_the_budget_or_says_who_comes_closest() -> None:
    both = held(point("fast", (9, 10, 11), (9, 10, 11)), point("good", (0.9, 1, 1.1), (29, 30, 31)))
    assert pareto.choose(both, error=5.0).candidate == "good"
    assert pareto.choose(both, error=50.0).candidate == "fast"
    assert pareto.choose(both, cost=35e-9).candidate == "good"
    assert pareto.choose(both, cost=15e-9, case="case").candidate == "fast"
    for budget, said in (
        ({"error": 0.5}, "good with 1 mm in 30.0 ns"),
        ({"cost": 1e-9}, "fast with 10 mm in 10.0 ns"),
        ({"error": 5.0, "cost": 15e-9}, "nobody meets"),
        ({}, "a budget"),
        ({"error": 1.0, "case": "other"}, "expected one of case"),
    ):
        with pytest.raises(ConfigError, match=said):
            pareto.choose(both, **budget)  # type: ignore[arg-type]


class Guess(Task):
    """Numbers; the answer is themselves, late or a little wrong."""

    name, title, item, error_name, unit = "guess", "Numbers", "number", "RMS error", "m"

    def cases(self, quick: bool = False) -> Sequence[Case]:
        values = np.random.default_rng(0).standard_normal(1000)
        return [Case(f"case {k}", lambda: Data(values, values, 1000, 0.01), "numbers") for k in range(2)]

    def candidates(self, quick: bool = False) -> Sequence[Candidate]:
        def slow(data: Data) -> Program:
            return Program(lambda: (time.sleep(0.01), data.inputs)[1], data.items)

        def wrong(data: Data) -> Program:
            noise = 0.1 * np.random.default_rng(1).standard_normal(data.items)
            return Program(lambda: data.inputs + noise, data.items, lambda: time.sleep(1e-4))

        def broken(data: Data) -> Program:
            return Program(lambda: data.inputs * np.nan, data.items)

        def short(data: Data) -> Program:
            return Program(lambda: data.inputs[:-1], data.items)

        def alone(data: Data) -> Program:
            return Program(lambda: data.inputs, data.items, lambda: 1 // 0)

        return [
            Candidate("slow", slow, {"a": 1.0}),
            Candidate("wrong", wrong),
            Candidate("broken", broken),
            Candidate("short", short),
            Candidate("alone", alone),
            Candidate("not for this case", lambda data: None),
        ]

    def score(self, data: Data, answer: Any, items: int) -> Score:
        return pareto.estimation_score(answer, data.truth[:items], 1.0, 0.5)


def test_measure_tells_errors_times_front_and_failures() -> None:
    told: list[tuple[str, float]] = []
    found = pareto.measure(Guess(), count=3, progress=lambda what, share: told.append((what, share)))
    assert [one.case.name for one in found.results] == ["case 0", "case 1"]
    result = found.result()
    wrong, slow = result.points
    assert (wrong.candidate, slow.candidate) == ("wrong", "slow")
    assert 0.09 < wrong.error.low < wrong.error.value < wrong.error.high < 0.11
    assert slow.error.value == 0.0
    assert 1e-5 <= slow.batch.low <= slow.batch.median <= slow.batch.high < 1e-2
    assert wrong.single is not None
    assert 1e-4 <= wrong.single.median < 1e-1
    assert slow.single is None
    assert wrong.front
    assert slow.front
    assert result.failed == {
        "broken": "ValueError: 1000 of 1000 estimates are not numbers.",
        "short": "ValueError: expected 1000 estimates; got an array of shape (999,).",
        "alone": "ZeroDivisionError: integer division or modulo by zero",
    }
    assert told[0][1] == 0.0
    assert all(a[1] <= b[1] <= 1.0 for a, b in pairwise(told))
    columns, rows = pareto.table(found, result)
    assert all(len(row) == len(columns) for row in rows)
    assert rows[0][0] == "*  wrong"
    assert "× bound" in columns
    text = json.dumps(pareto.to_json(found), allow_nan=False)
    assert json.loads(text)["results"][0]["points"][1]["settings"] == {"a": 1.0}
    assert pareto.choose(Guess(), error=0.5, case="case 1").candidate == "wrong"
    with pytest.raises(ConfigError, match="case 0; case 1"):
        pareto.choose(Guess(), error=0.5, case="case 7")


def test_measure_refuses_what_it_cannot_tell_apart() -> None:
    task = Guess()
    twice = [task.candidates()[0]] * 2
    with pytest.raises(ValueError, match="different names"):
        pareto.measure(task, twice)
    with pytest.raises(ValueError, match=">= 3"):
        pareto.measure(task, count=2)
    broken = [one for one in task.candidates() if one.name == "broken"]
    nobody = pareto.measure(task, broken, cases=["case 0"], count=3)
    with pytest.raises(ConfigError, match="nobody had an answer in case 0: broken"):
        pareto.choose(nobody, error=1.0)
    with pytest.raises(ValueError, match="nobody had an answer"):
        plot_case(nobody, nobody.result())


def test_cost_may_be_something_else_than_time() -> None:
    dear = dataclasses.replace(
        point("dear", (0.9, 1, 1.1), (1, 1, 1)), score=Score(Estimate(1, 0.9, 1.1), {}, Estimate(70, 69, 71))
    )
    cheap = dataclasses.replace(
        point("cheap", (8, 9, 10), (1, 1, 1)), score=Score(Estimate(9, 8, 10), {}, Estimate(40, 39, 41))
    )
    worse = dataclasses.replace(cheap, candidate="worse", score=Score(Estimate(9, 8, 10), {}, Estimate(60, 59, 61)))
    assert on_front([dear, cheap, worse]) == [True, True, False]
    loud = dataclasses.replace(held(dear, cheap, worse), cost_name="audible level", cost_unit="dB")
    assert pareto.choose(loud, error=5.0).candidate == "dear"
    assert pareto.choose(loud, cost=50.0).candidate == "cheap"
    with pytest.raises(ConfigError, match="cheap with 9 mm in 40 dB"):
        pareto.choose(loud, cost=10.0)


def test_levels_are_drawn_where_there_are_three_of_a_series() -> None:
    def result(level: float, error: float) -> CaseResult:
        case = Case(
            f"{level:g} dB",
            lambda: Data(None, None, 1),
            "numbers",
            bound_name="B",
            series="numbers",
            level=level,
            level_name="level (dB)",
            attainable=lambda x: 2.0,
            threshold=5.0,
        )
        points = (point("ours", (0.9 * error, error, 1.1 * error), (9, 10, 11)),)
        return CaseResult(case, 1.0, points, {})

    results = tuple(result(level, error) for level, error in ((20, 1.0), (0, 5.0), (40, 1.05)))
    found = dataclasses.replace(held(), results=results)
    figure = plot_levels(found)
    assert figure is not None
    (axes,) = figure.axes
    assert figure.get_suptitle() == "From 20 dB on, ours is within 10% of the bound"
    assert axes.get_xlabel() == "level (dB)"
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels == ["threshold of gross errors", "B bound", "attainable", "ours"]
    assert plot_levels(dataclasses.replace(found, results=results[:2])) is None
    gap = tuple(result(level, error) for level, error in ((0, 1.0), (20, 5.0), (40, 1.05)))
    between = plot_levels(dataclasses.replace(found, results=gap))
    assert between is not None
    assert between.get_suptitle() == "Nobody is near the bound at the two highest levels"


def test_a_case_is_drawn_with_its_bound_front_and_labels() -> None:
    points = (
        dataclasses.replace(point("ours", (0.9, 1.0, 1.05), (9, 10, 11)), front=True),
        dataclasses.replace(point("theirs", (0.9, 1.0, 1.05), (90, 100, 110)), peer=True),
        point("unnamed", (2, 3, 4), (9, 10, 11)),
    )
    case = Case("case", lambda: Data(None, None, 1), "numbers", bound_name="B")
    found = held()
    figure = plot_case(found, CaseResult(case, 1.0, points, {}))
    assert figure.get_suptitle() == "Within 10% of the bound in 10.0 ns; theirs takes 10 times that"
    (axes,) = figure.axes
    texts = {text.get_text() for text in axes.texts}
    assert texts == {"ours", "theirs"}
    assert axes.get_xscale() == axes.get_yscale() == "log"


def test_gross_errors_are_told_apart() -> None:
    truth = np.zeros(1000)
    estimates = np.where(np.arange(1000) < 20, 2.0, 0.1)
    score = pareto.estimation_score(estimates, truth, 1e3, 1.0)
    assert score.details["gross %"].value == pytest.approx(2.0)
    assert score.details["without gross"].value == pytest.approx(100.0)
    assert score.error.value == pytest.approx(1e3 * math.sqrt(0.02 * 4 + 0.98 * 0.01))
    assert score.details["bias"].value == pytest.approx(1e3 * (0.04 + 0.098))


def test_rounds_take_turns_and_count_all_but_the_first() -> None:
    calls: list[str] = []
    turns = []
    times = pareto.rounds(
        {name: lambda name=name: calls.append(name) for name in "ab"},  # type: ignore[misc]
        3,
        lambda: turns.append(1),
        pause_s=0.0,
    )
    assert {name: len(one) for name, one in times.items()} == {"a": 3, "b": 3}
    assert "".join(calls) == "baabbaab"
    assert len(turns) == 4
