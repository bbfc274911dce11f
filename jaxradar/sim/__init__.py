"""Drives that nobody drove. A simulator knows nothing of the detectors that it tests.

A scene says what there is: a radar on a mount, a road, a surface, a car in motion, and effects. `simulate` makes a
`Drive` of it, with its truth; `render` is the pure function inside, for gradients and batches.
"""

from jaxradar.sim.explain import Contribution, Difference, Significance, Tolerance, significant
from jaxradar.sim.files import dump_scene, load_scene, ready_scenes
from jaxradar.sim.radar import Radar
from jaxradar.sim.road.drives import drive_seeds, held_out_seeds, simulate, simulate_batch, simulate_each
from jaxradar.sim.road.effect import RoadEffect
from jaxradar.sim.road.effects import (
    EFFECTS,
    Accelerometer,
    CpuClock,
    DirectLeakage,
    DroppedSweeps,
    Gain,
    Interference,
    LateSweeps,
    LostEcho,
    Multipath,
    Quantisation,
    Rain,
    RangeSmoothing,
    RangeWalk,
    ReceiverNoise,
    RunningAverage,
    Saturation,
    TemperatureDrift,
    Thinning,
    TimeJitter,
    WaterFilm,
)
from jaxradar.sim.road.elements import (
    ELEMENTS,
    FlatTopHump,
    Kerb,
    Pothole,
    RoadElement,
    SinusoidalHump,
    StepDown,
    StepUp,
)
from jaxradar.sim.road.motion import CarMotion, Curve, SpeedChange
from jaxradar.sim.road.plan import Plan, plan_scene
from jaxradar.sim.road.render import Rendered, render
from jaxradar.sim.road.roughness import Roughness
from jaxradar.sim.road.scene import Mount, RoadScene
from jaxradar.sim.road.surface import SURFACES, Surface
from jaxradar.sim.road.vehicle import HalfCar, QuarterCar, Vehicle

__all__ = [
    "EFFECTS",
    "ELEMENTS",
    "SURFACES",
    "Accelerometer",
    "CarMotion",
    "Contribution",
    "CpuClock",
    "Curve",
    "Difference",
    "DirectLeakage",
    "DroppedSweeps",
    "FlatTopHump",
    "Gain",
    "HalfCar",
    "Interference",
    "Kerb",
    "LateSweeps",
    "LostEcho",
    "Mount",
    "Multipath",
    "Plan",
    "Pothole",
    "Quantisation",
    "QuarterCar",
    "Radar",
    "Rain",
    "RangeSmoothing",
    "RangeWalk",
    "ReceiverNoise",
    "Rendered",
    "RoadEffect",
    "RoadElement",
    "RoadScene",
    "Roughness",
    "RunningAverage",
    "Saturation",
    "Significance",
    "SinusoidalHump",
    "SpeedChange",
    "StepDown",
    "StepUp",
    "Surface",
    "TemperatureDrift",
    "Thinning",
    "TimeJitter",
    "Tolerance",
    "Vehicle",
    "WaterFilm",
    "drive_seeds",
    "dump_scene",
    "held_out_seeds",
    "load_scene",
    "plan_scene",
    "ready_scenes",
    "render",
    "significant",
    "simulate",
    "simulate_batch",
    "simulate_each",
]
