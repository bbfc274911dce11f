"""Road steps out of radar sweeps: the thesis's rule, the lab's live alarm, and the detector to use."""

from jaxradar.systems.step.approach import ApproachDetector
from jaxradar.systems.step.batch import detect_batch
from jaxradar.systems.step.config import Decision, MotionSample, RangeAxis, StepDetector
from jaxradar.systems.step.default import DefaultDetector
from jaxradar.systems.step.files import DETECTORS, DetectorFile, dump_detector, load_detector
from jaxradar.systems.step.filtered_rate import FilteredRateDetector
from jaxradar.systems.step.ground import Beam, Ground
from jaxradar.systems.step.height import HeightFinder, StepHeight, step_height, step_heights
from jaxradar.systems.step.innovation import InnovationDetector
from jaxradar.systems.step.lab_live import LabLiveDetector
from jaxradar.systems.step.lanes import detect_series
from jaxradar.systems.step.motion import motion_at, stack_motion
from jaxradar.systems.step.mounting import Calibration, calibrate
from jaxradar.systems.step.pair import PairEvent, SensorPair, detect_pair, pair_events
from jaxradar.systems.step.pipeline import (
    detect,
    event_weights,
    precision,
    run,
    run_batch,
    thin,
    time_steps,
)
from jaxradar.systems.step.range_rate import RangeRateDetector
from jaxradar.systems.step.result import StepEvent, StepTrace
from jaxradar.systems.step.shift import ShiftDetector
from jaxradar.systems.step.stack import SweepBatch, stack
from jaxradar.systems.step.thesis import ThesisDetector

__all__ = [
    "DETECTORS",
    "ApproachDetector",
    "Beam",
    "Calibration",
    "Decision",
    "DefaultDetector",
    "DetectorFile",
    "FilteredRateDetector",
    "Ground",
    "HeightFinder",
    "InnovationDetector",
    "LabLiveDetector",
    "MotionSample",
    "PairEvent",
    "RangeAxis",
    "RangeRateDetector",
    "SensorPair",
    "ShiftDetector",
    "StepDetector",
    "StepEvent",
    "StepHeight",
    "StepTrace",
    "SweepBatch",
    "ThesisDetector",
    "calibrate",
    "detect",
    "detect_batch",
    "detect_pair",
    "detect_series",
    "dump_detector",
    "event_weights",
    "load_detector",
    "motion_at",
    "pair_events",
    "precision",
    "run",
    "run_batch",
    "stack",
    "stack_motion",
    "step_height",
    "step_heights",
    "thin",
    "time_steps",
]
