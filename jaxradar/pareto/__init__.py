"""Accuracy against time: a task and candidates in, points with error bars out; who is on the front, whom to choose.

    from jaxradar.pareto import choose, measure, table
    from jaxradar.signal.peaks import Parabola
    from jaxradar.tasks import EchoRange

    task = EchoRange()
    mine = task.candidate("my parabola", lambda fwhm, bin_m: Parabola(round(0.4 * fwhm)))
    found = measure(task, [*task.candidates(quick=True), mine], cases=["white 20 dB"])
    print(table(found, found.result()))
    print(choose(found, error=1.2).candidate)

A task of one's own is a subclass of `Task` with `cases`, `candidates` and `score`; `estimation_score` does the last for
estimates of one number each.
"""

from jaxradar.estimate.intervals import Estimate, mean, percentile, proportion, rate, rms
from jaxradar.pareto.front import CaseResult, Frontier, Point
from jaxradar.pareto.machine import machine
from jaxradar.pareto.measure import choose, measure
from jaxradar.pareto.report import table, to_json
from jaxradar.pareto.task import Candidate, Case, Data, Program, Score, Task, estimation_score
from jaxradar.pareto.timing import Spread, rounds, spread, time_text

__all__ = [
    "Candidate",
    "Case",
    "CaseResult",
    "Data",
    "Estimate",
    "Frontier",
    "Point",
    "Program",
    "Score",
    "Spread",
    "Task",
    "choose",
    "estimation_score",
    "machine",
    "mean",
    "measure",
    "percentile",
    "proportion",
    "rate",
    "rms",
    "rounds",
    "spread",
    "table",
    "time_text",
    "to_json",
]
