"""Road steps out of radar sweeps: the detector to use and its parts, the thesis's rule, and others beside them."""

from jaxradar.systems.step.approach import ApproachDetector
from jaxradar.systems.step.batch import detect_batch
from jaxradar.systems.step.config import Decision, MotionSample, RangeAxis, StepDetector
from jaxradar.systems.step.default import DefaultDetector
from jaxradar.systems.step.files import DETECTORS, DetectorFile, dump_detector, load_detector, with_mounting
from jaxradar.systems.step.filtered_rate import FilteredRateDetector
from jaxradar.systems.step.innovation import InnovationDetector
from jaxradar.systems.step.lab_live import LabLiveDetector
from jaxradar.systems.step.lanes import detect_series
from jaxradar.systems.step.motion import motion_at
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
    "Decision",
    "DefaultDetector",
    "DetectorFile",
    "FilteredRateDetector",
    "InnovationDetector",
    "LabLiveDetector",
    "MotionSample",
    "RangeAxis",
    "RangeRateDetector",
    "ShiftDetector",
    "StepDetector",
    "StepEvent",
    "StepTrace",
    "SweepBatch",
    "ThesisDetector",
    "detect",
    "detect_batch",
    "detect_series",
    "dump_detector",
    "event_weights",
    "load_detector",
    "motion_at",
    "precision",
    "run",
    "run_batch",
    "stack",
    "thin",
    "time_steps",
    "with_mounting",
]
