"""What can be said of a road and a mounting beyond that there is a step: fits on the host to what detectors found.

- `detect_pair`: two sensors side by side, and the angle of a step's edge, as `PairEvent`s.
- `step_height`: how high a step is, with its uncertainty, out of the sweeps around it.
- `calibrate`: how high a sensor sits and at what angle, out of a stretch of flat road.
"""

from jaxradar.survey.ground import Beam, Ground
from jaxradar.survey.height import HeightFinder, StepHeight, step_height, step_heights
from jaxradar.survey.mounting import Calibration, calibrate
from jaxradar.survey.pair import PairEvent, SensorPair, detect_pair, pair_events

__all__ = [
    "Beam",
    "Calibration",
    "Ground",
    "HeightFinder",
    "PairEvent",
    "SensorPair",
    "StepHeight",
    "calibrate",
    "detect_pair",
    "pair_events",
    "step_height",
    "step_heights",
]
