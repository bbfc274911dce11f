"""The detection suite: steps of every kind and roads without one, held against every detector."""

from jaxradar.suite.ideal import Ideal, ideal_observer
from jaxradar.suite.recordings import Recorded, found_in_time, measure_recordings, recorded_record
from jaxradar.suite.run import Found, Quiet, measure_negative, measure_step, threshold_at
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
    "Recorded",
    "StepCell",
    "Suite",
    "found_in_time",
    "grid",
    "ideal_observer",
    "measure_negative",
    "measure_recordings",
    "measure_step",
    "recorded_record",
    "run_suite",
    "suite_record",
    "threshold_at",
    "variations",
]
