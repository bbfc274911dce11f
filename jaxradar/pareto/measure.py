"""Measure a task: errors once, times in turns."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import jax
import numpy as np

from jaxradar._errors import ConfigError
from jaxradar.pareto.front import CaseResult, Frontier, Point, choose_point, on_front
from jaxradar.pareto.machine import machine
from jaxradar.pareto.task import Candidate, Case, Program, Score, Task
from jaxradar.pareto.timing import first_call, rounds, spread

__all__ = ["choose", "measure"]

ROUNDS, QUICK_ROUNDS, FEWEST_ROUNDS = 11, 5, 3
ALONE = 10  # calls of a single item that are timed together: one is too short for the clock


def measure(
    task: Task,
    candidates: Sequence[Candidate] | None = None,
    *,
    cases: Collection[str] | None = None,
    quick: bool = False,
    count: int | None = None,
    progress: Callable[[str, float], None] = lambda what, share: None,
) -> Frontier:
    """Error and time of every candidate in every case.

    `candidates`: all that the task knows if None; `cases`: the names of those to measure. `count`: rounds of timing,
    11, or 5 if `quick`. `progress` is told what is being done and which share of all is done. A candidate that raises,
    or whose answer is no answer, is reported as failed and not timed. Raises `ValueError` for two candidates of one
    name and fewer than 3 rounds, `ConfigError` for a case that there is not.
    """
    held = task.candidates(quick) if candidates is None else candidates
    names = [one.name for one in held]
    if len(set(names)) != len(names):
        raise ValueError("candidates must have different names.")
    count = (QUICK_ROUNDS if quick else ROUNDS) if count is None else count
    if count < FEWEST_ROUNDS:  # percentiles are taken
        raise ValueError(f"`measure(count=...)` must be >= {FEWEST_ROUNDS}; got {count}.")
    known = task.cases(quick)
    unknown = set(cases or ()) - {one.name for one in known}
    if unknown:
        raise ConfigError(
            f"no case {', '.join(map(repr, sorted(unknown)))}; expected one of {'; '.join(one.name for one in known)}."
        )
    chosen = [one for one in known if cases is None or one.name in cases]
    about = (task.name, task.title, task.item, task.error_name, task.unit, task.cost_name, task.cost_unit)
    steps = len(held) + count + 1
    results = []
    for place, case in enumerate(chosen):

        def told(what: str, step: int, case: Case = case, place: int = place) -> None:
            progress(f"{case.name}: {what}", (place + min(step, steps) / steps) / len(chosen))

        results.append(_measure_case(task, case, held, count, told))
    return Frontier(*about, quick, count, machine(), tuple(results))


class _Ready(NamedTuple):
    candidate: Candidate
    program: Program
    score: Score
    first_s: float


def _measure_case(
    task: Task, case: Case, candidates: Sequence[Candidate], count: int, told: Callable[[str, int], None]
) -> CaseResult:
    told("drawing", 0)
    data = case.draw()
    ready: dict[str, _Ready] = {}
    failed: dict[str, str] = {}
    for step, candidate in enumerate(candidates):
        told(candidate.name, step)
        try:
            program = candidate.prepare(data)
            if program is None:
                continue
            answers: list[Any] = []
            first_s = first_call(lambda program=program, answers=answers: answers.append(_waited(program.batch)))  # type: ignore[misc]
            if program.single:
                _waited(program.single)
            score = task.score(data, answers[0], program.items)
        except Exception as error:  # whatever a script's own candidate may raise: the others are still worth measuring
            failed[candidate.name] = f"{type(error).__name__}: {error}"
            continue
        ready[candidate.name] = _Ready(candidate, program, score, first_s)
    done = iter(range(len(candidates), len(candidates) + count + 1))
    told("timing", len(candidates))
    batches = rounds(
        {name: (lambda run=one.program.batch: _waited(run)) for name, one in ready.items()},  # type: ignore[misc]
        count,
        lambda: told("timing", next(done)),
    )
    singles = rounds(
        {name: _repeated(one.program.single) for name, one in ready.items() if one.program.single}, FEWEST_ROUNDS
    )
    points = [_point(one, batches[name], singles.get(name)) for name, one in ready.items()]
    points.sort(key=lambda point: point.cost.value)
    marked = tuple(replace(point, front=front) for point, front in zip(points, on_front(points), strict=True))
    return CaseResult(case, data.bound, marked, failed)


def _waited(run: Callable[[], Any]) -> Any:
    return jax.block_until_ready(run())


def _repeated(single: Callable[[], Any]) -> Callable[[], None]:
    def run() -> None:
        for _ in range(ALONE):
            _waited(single)

    return run


def _point(one: _Ready, batch: np.ndarray, single: np.ndarray | None) -> Point:
    return Point(
        candidate=one.candidate.name,
        settings=dict(one.candidate.settings),
        default=one.candidate.default,
        peer=one.candidate.peer,
        items=one.program.items,
        score=one.score,
        batch=spread(batch / (one.program.answers or one.program.items)),
        single=None if single is None else spread(single / ALONE),
        first_s=max(one.first_s - float(np.median(batch)), 0.0),
    )


def choose(
    task: Task | Frontier, *, error: float | None = None, cost: float | None = None, case: str | None = None
) -> Point:
    """The cheapest candidate whose error is at most `error` (in the task's unit), or the most accurate that costs at
    most `cost` (seconds an item, where the cost is time), with its measured figures; of the named case, or the first.

    A task is measured first; give a `Frontier` to ask more than once. Raises `ConfigError` for a case that there is
    not and for a budget that nobody meets, naming who comes closest.
    """
    if isinstance(task, Task):
        task = measure(task, cases=[case or task.cases()[0].name])
    return choose_point(task, task.result(case), error, cost)
