"""Accuracy against time: a task and candidates in, points with error bars out; who is on the front, whom to choose.

from jaxradar.pareto import choose, measure
from jaxradar.tasks import TASKS

found = measure(TASKS["range"]())
print(choose(found, error=1.2, case="white 20 dB").candidate)
"""

from jaxradar.pareto.figures import Figure, mean, percentile, rms, share
from jaxradar.pareto.front import CaseResult, Frontier, Point, choose_point, on_front
from jaxradar.pareto.measure import choose, measure
from jaxradar.pareto.report import table, time_text, to_json
from jaxradar.pareto.task import Candidate, Case, Program, Score, Task, estimation_score
from jaxradar.pareto.timing import Spread, first_call, rounds, spread

__all__ = [
    "Candidate",
    "Case",
    "CaseResult",
    "Figure",
    "Frontier",
    "Point",
    "Program",
    "Score",
    "Spread",
    "Task",
    "choose",
    "choose_point",
    "estimation_score",
    "first_call",
    "mean",
    "measure",
    "on_front",
    "percentile",
    "rms",
    "rounds",
    "share",
    "spread",
    "table",
    "time_text",
    "to_json",
]
