"""The detection suite: steps of every kind and roads without one, held against every detector."""

from jaxradar.suite.heights import HeightErrors, height_bound_m, heights_grid, measure_heights
from jaxradar.suite.ideal import Ideal, ideal_observer
from jaxradar.suite.oblique import Oblique, ObliqueCell, measure_oblique, oblique_grid, oblique_total
from jaxradar.suite.recordings import Recorded, found_in_time, measure_recordings, recorded_record
from jaxradar.suite.run import Found, Quiet, measure_negative, measure_step, threshold_at
from jaxradar.suite.scenes import NEGATIVES, ROADS, Negative, StepCell, grid, variations
from jaxradar.suite.whole import CellScore, QuietScore, Suite, run_suite, suite_record

__all__ = [
    "NEGATIVES",
    "ROADS",
    "CellScore",
    "Found",
    "HeightErrors",
    "Ideal",
    "Negative",
    "Oblique",
    "ObliqueCell",
    "Quiet",
    "QuietScore",
    "Recorded",
    "StepCell",
    "Suite",
    "found_in_time",
    "grid",
    "height_bound_m",
    "heights_grid",
    "ideal_observer",
    "measure_heights",
    "measure_negative",
    "measure_oblique",
    "measure_recordings",
    "measure_step",
    "oblique_grid",
    "oblique_total",
    "recorded_record",
    "run_suite",
    "suite_record",
    "threshold_at",
    "variations",
]
