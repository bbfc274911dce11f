"""The detection suite: steps of every kind and roads without one, held against every detector."""

from jaxradar.tasks.detection.ideal import Ideal, ideal_observer
from jaxradar.tasks.detection.run import Found, Quiet, measure_negative, measure_step
from jaxradar.tasks.detection.scenes import NEGATIVES, ROADS, Negative, StepCell, grid, variations
from jaxradar.tasks.detection.suite import CellScore, QuietScore, Suite, run_suite, suite_record

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
