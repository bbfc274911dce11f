"""Effects that a road scene may call for, each with its defaults and its source."""

from jaxradar.sim.road.effect import RoadEffect
from jaxradar.sim.road.effects.counts import Gain, Quantisation, Saturation
from jaxradar.sim.road.effects.motion import Accelerometer
from jaxradar.sim.road.effects.propagation import LostEcho, Multipath, Rain, TemperatureDrift, WaterFilm
from jaxradar.sim.road.effects.receiver import DirectLeakage, Interference, ReceiverNoise
from jaxradar.sim.road.effects.sampling import RangeSmoothing, RangeWalk, RunningAverage, Thinning
from jaxradar.sim.road.effects.timing import CpuClock, DroppedSweeps, LateSweeps, TimeJitter

__all__ = [
    "EFFECTS",
    "Accelerometer",
    "CpuClock",
    "DirectLeakage",
    "DroppedSweeps",
    "Gain",
    "Interference",
    "LateSweeps",
    "LostEcho",
    "Multipath",
    "Quantisation",
    "Rain",
    "RangeSmoothing",
    "RangeWalk",
    "ReceiverNoise",
    "RunningAverage",
    "Saturation",
    "TemperatureDrift",
    "Thinning",
    "TimeJitter",
    "WaterFilm",
]

EFFECTS: dict[str, type[RoadEffect]] = {
    kind.name: kind
    for kind in (
        DirectLeakage,
        ReceiverNoise,
        Interference,
        Multipath,
        LostEcho,
        Rain,
        WaterFilm,
        TemperatureDrift,
        RangeWalk,
        Thinning,
        RangeSmoothing,
        RunningAverage,
        Gain,
        Saturation,
        Quantisation,
        TimeJitter,
        LateSweeps,
        DroppedSweeps,
        CpuClock,
        Accelerometer,
    )
}
