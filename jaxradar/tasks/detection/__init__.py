"""The detection suite: steps of every kind and roads without one, held against every detector."""

from jaxradar.tasks.detection.run import Found, Quiet, measure_negative, measure_step
from jaxradar.tasks.detection.scenes import NEGATIVES, ROADS, Negative, StepCell, grid, variations

__all__ = [
    "NEGATIVES",
    "ROADS",
    "Found",
    "Negative",
    "Quiet",
    "StepCell",
    "grid",
    "measure_negative",
    "measure_step",
    "variations",
]
