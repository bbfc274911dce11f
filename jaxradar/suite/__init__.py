"""The detection suite: steps of every kind and roads without one, held against every detector."""

from jaxradar.suite.heights import HeightErrors, height_bound_m, heights_grid, measure_heights
from jaxradar.suite.ideal import Ideal, ideal_observer
from jaxradar.suite.oblique import Oblique, ObliqueCell, measure_oblique, oblique_grid, oblique_total
from jaxradar.suite.run import Found, Quiet, measure_negative, measure_step
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
    "StepCell",
    "Suite",
    "grid",
    "height_bound_m",
    "heights_grid",
    "ideal_observer",
    "measure_heights",
    "measure_negative",
    "measure_oblique",
    "measure_step",
    "oblique_grid",
    "oblique_total",
    "run_suite",
    "suite_record",
    "variations",
]
