"""Measure a task: errors once, times in turns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from jaxradar._errors import ConfigError
from jaxradar.pareto.front import CaseResult, Frontier, Point, choose_point, on_front
from jaxradar.pareto.task import Candidate, Case, Program, Score, Task
from jaxradar.pareto.timing import first_call, rounds, spread

__all__ = ["choose", "measure"]

ALONE = 10  # calls of a single item that are timed together: one is too short for the clock


def measure(
    task: Task,
    candidates: Sequence[Candidate] | None = None,
    *,
    quick: bool = False,
    count: int | None = None,
    progress: Callable[[str, float], None] = lambda what, share: None,
) -> Frontier:
    """Error and time of every candidate in every case.

    `candidates`: all that the task knows if None. `count`: rounds of timing, 15, or 5 if `quick`. `progress` is told
    what is being done and which share of all is done. A candidate that raises, or whose answer is no answer, is
    reported as failed and not timed.
    """
    held = task.candidates(quick) if candidates is None else candidates
    names = [one.name for one in held]
    if len(set(names)) != len(names):
        raise ValueError("candidates must have different names.")
    count = (5 if quick else 15) if count is None else count
    if count < 3:
        raise ValueError(f"`measure(count=...)` must be >= 3, as percentiles are taken; got {count}.")
    cases = task.cases(quick)
    steps = len(held) + count + 1
    results = []
    for place, case in enumerate(cases):

        def told(what: str, step: int, case: Case = case, place: int = place) -> None:
            progress(f"{case.name}: {what}", (place + min(step, steps) / steps) / len(cases))

        results.append(_measure_case(task, case, held, count, told))
    return Frontier(task.name, task.title, task.item, task.error_name, task.unit, quick, tuple(results))


def _measure_case(
    task: Task, case: Case, candidates: Sequence[Candidate], count: int, told: Callable[[str, int], None]
) -> CaseResult:
    ready: dict[str, tuple[Candidate, Program, Score, float]] = {}
    failed: dict[str, str] = {}
    for step, candidate in enumerate(candidates):
        told(candidate.name, step)
        try:
            program = candidate.prepare(case)
            if program is None:
                continue
            answers: list[Any] = []
            first_s = first_call(lambda program=program, answers=answers: answers.append(program.batch()))  # type: ignore[misc]
            score = task.score(case, answers[0], program.items)
        except Exception as error:  # whatever a script's own candidate may raise: the others are still worth measuring
            failed[candidate.name] = f"{type(error).__name__}: {error}"
            continue
        ready[candidate.name] = candidate, program, score, first_s
    done = iter(range(len(candidates), len(candidates) + 2 * count + 2))
    told("timing", len(candidates))
    batches = rounds(
        {name: program.batch for name, (_, program, _, _) in ready.items()}, count, lambda: told("timing", next(done))
    )
    singles = rounds(
        {name: _repeated(program.single) for name, (_, program, _, _) in ready.items() if program.single}, count
    )
    points = [
        _point(candidate, program, score, first_s, batches[name], singles.get(name))
        for name, (candidate, program, score, first_s) in ready.items()
    ]
    points.sort(key=lambda point: point.batch.median)
    marked = tuple(replace(point, front=front) for point, front in zip(points, on_front(points), strict=True))
    return CaseResult(case.name, case.about, dict(case.setting), case.bound, case.bound_name, marked, failed)


def _repeated(single: Callable[[], Any]) -> Callable[[], None]:
    def run() -> None:
        for _ in range(ALONE):
            single()

    return run


def _point(
    candidate: Candidate, program: Program, score: Score, first_s: float, batch: np.ndarray, single: np.ndarray | None
) -> Point:
    return Point(
        candidate=candidate.name,
        settings=dict(candidate.settings),
        default=candidate.default,
        peer=candidate.peer,
        items=program.items,
        score=score,
        batch=spread(batch / program.items),
        single=None if single is None else spread(single / ALONE),
        first_s=max(first_s - float(np.median(batch)), 0.0),
    )


def choose(
    task: Task | Frontier, *, error: float | None = None, time_s: float | None = None, case: str | None = None
) -> Point:
    """The cheapest candidate whose error is at most `error` (in the task's unit), or the most accurate that takes at
    most `time_s` an item, with its measured figures; of the named case, or the first.

    A task is measured first; give a `Frontier` to ask more than once. Raises `ConfigError` for a budget that nobody
    meets, naming who comes closest.
    """
    if isinstance(task, Task):
        cases = [one for one in task.cases() if case is None or one.name == case][:1]
        if not cases:
            raise ConfigError(f"no case {case!r}; expected one of {', '.join(one.name for one in task.cases())}.")
        result = _measure_case(task, cases[0], task.candidates(), 15, lambda what, step: None)
    else:
        result = task.result(case)
    return choose_point(result, task.unit, error, time_s)
