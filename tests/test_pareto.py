"""Figures with intervals that cover, a front that is one, a choice that keeps the budget."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from jaxradar import ConfigError, pareto
from jaxradar.pareto import Candidate, Case, Figure, Frontier, Point, Program, Score, Spread, Task
from jaxradar.pareto.front import CaseResult


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
            found, truth = pareto.share(int((values > 1.0).sum()), 200), 0.15866
        else:
            found, truth = pareto.percentile(values, 90.0), 1.28155
        assert found.low <= found.value <= found.high
        inside += found.low <= truth <= found.high
    assert 925 <= inside <= (975 if what in ("mean", "rms") else 995)


def test_intervals_of_few_and_of_extremes() -> None:
    assert pareto.share(0, 10).low == 0.0
    assert pareto.share(10, 10).high == 1.0
    assert pareto.share(0, 10).high == pytest.approx(1 - 0.025**0.1)
    assert math.isinf(pareto.mean(np.array([2.0])).high)
    assert math.isinf(pareto.percentile(np.arange(5.0), 95.0).high)
    with pytest.raises(ValueError, match="3 of 2"):
        pareto.share(3, 2)


def point(name: str, error: tuple[float, float, float], ns: tuple[float, float, float]) -> Point:
    spread = Spread(*(1e-9 * one for one in (ns[1], ns[0], ns[2])))
    figure = Figure(error[1], error[0], error[2])
    return Point(name, {}, False, False, 100, Score(figure), spread, None, 0.0)


def test_the_front_is_what_nobody_beats() -> None:
    points = [
        point("fast and bad", (9, 10, 11), (9, 10, 11)),
        point("beaten", (9, 10, 11), (19, 20, 21)),
        point("good", (0.9, 1, 1.1), (29, 30, 31)),
        point("as good, as fast, within the error bars", (0.95, 1.05, 1.15), (30, 31, 32)),
        point("as good and slower", (0.95, 1.05, 1.15), (90, 100, 110)),
    ]
    assert pareto.on_front(points) == [True, False, True, True, False]


def test_choose_keeps_the_budget_or_says_who_comes_closest() -> None:
    points = (point("fast", (9, 10, 11), (9, 10, 11)), point("good", (0.9, 1, 1.1), (29, 30, 31)))
    result = CaseResult("case", "", {}, None, "", points, {})
    held = Frontier("t", "T", "sweep", "error", "mm", False, (result,))
    assert pareto.choose(held, error=5.0).candidate == "good"
    assert pareto.choose(held, error=50.0).candidate == "fast"
    assert pareto.choose(held, time_s=35e-9).candidate == "good"
    assert pareto.choose(held, time_s=15e-9, case="case").candidate == "fast"
    for budget, said in (
        ({"error": 0.5}, "good with 1 mm in 30 ns"),
        ({"time_s": 1e-9}, "fast with 10 mm in 10 ns"),
        ({"error": 5.0, "time_s": 15e-9}, "nobody meets"),
        ({}, "a budget"),
        ({"error": 1.0, "case": "other"}, "expected one of case"),
    ):
        with pytest.raises(ConfigError, match=said):
            pareto.choose(held, **budget)  # type: ignore[arg-type]


class Guess(Task):
    """Numbers; the answer is themselves, late or a little wrong."""

    name, title, item, error_name, unit = "guess", "Numbers", "number", "RMS error", "m"

    def cases(self, quick: bool = False) -> Sequence[Case]:
        values = np.random.default_rng(0).standard_normal(1000)
        return [Case(f"case {k}", values, values, 1000, "numbers", bound=0.01, gross=0.5) for k in range(2)]

    def candidates(self, quick: bool = False) -> Sequence[Candidate]:
        def slow(case: Case) -> Program:
            return Program(lambda: (time.sleep(0.01), case.inputs)[1], case.items)

        def wrong(case: Case) -> Program:
            noise = 0.1 * np.random.default_rng(1).standard_normal(case.items)
            return Program(lambda: case.inputs + noise, case.items, lambda: time.sleep(1e-4))

        def broken(case: Case) -> Program:
            return Program(lambda: case.inputs * np.nan, case.items)

        def short(case: Case) -> Program:
            return Program(lambda: case.inputs[:-1], case.items)

        return [
            Candidate("slow", slow, {"a": 1.0}),
            Candidate("wrong", wrong),
            Candidate("broken", broken),
            Candidate("short", short),
            Candidate("not for this case", lambda case: None),
        ]

    def score(self, case: Case, answer: Any, items: int) -> Score:
        return pareto.estimation_score(answer, case.truth[:items], 1.0, case.gross)


def test_measure_tells_errors_times_front_and_failures() -> None:
    told: list[tuple[str, float]] = []
    found = pareto.measure(Guess(), count=3, progress=lambda what, share: told.append((what, share)))
    assert [one.case for one in found.results] == ["case 0", "case 1"]
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
    }
    assert told[0][1] == 0.0
    assert all(a[1] <= b[1] <= 1.0 for a, b in zip(told, told[1:], strict=False))
    columns, rows = pareto.table(found, result)
    assert all(len(row) == len(columns) for row in rows)
    assert rows[0][0] == "*  wrong"
    assert "× bound" in columns
    text = json.dumps(pareto.to_json(found), allow_nan=False)
    assert json.loads(text)["results"][0]["points"][1]["settings"] == {"a": 1.0}
    assert pareto.choose(Guess(), error=0.5, case="case 1").candidate == "wrong"
    with pytest.raises(ConfigError, match="case 0, case 1"):
        pareto.choose(Guess(), error=0.5, case="case 7")


def test_measure_refuses_what_it_cannot_tell_apart() -> None:
    task = Guess()
    twice = [task.candidates()[0]] * 2
    with pytest.raises(ValueError, match="different names"):
        pareto.measure(task, twice)
    with pytest.raises(ValueError, match=">= 3"):
        pareto.measure(task, count=2)


def test_gross_errors_are_told_apart() -> None:
    truth = np.zeros(1000)
    estimates = np.where(np.arange(1000) < 20, 2.0, 0.1)
    score = pareto.estimation_score(estimates, truth, 1e3, 1.0)
    assert score.details["gross"].value == 0.02
    assert score.details["RMSE without gross"].value == pytest.approx(100.0)
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
