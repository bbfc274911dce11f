"""The detection suite: steps of every kind and roads without one, held against every detector."""

from jaxradar.suite.ideal import Ideal, ideal_observer
from jaxradar.suite.run import Found, Quiet, measure_negative, measure_step
from jaxradar.suite.scenes import NEGATIVES, ROADS, Negative, StepCell, grid, variations
from jaxradar.suite.whole import CellScore, QuietScore, Suite, run_suite, suite_record

__all__ = [
    "NEGATIVES",
    "ROADS",
    "CellScore",
    "Found",
    "Ideal",
    "Negative",
    "Quiet",
    "QuietScore",
    "StepCell",
    "Suite",
    "grid",
    "ideal_observer",
    "measure_negative",
    "measure_step",
    "run_suite",
    "suite_record",
    "variations",
]
