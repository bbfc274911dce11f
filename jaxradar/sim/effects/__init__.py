"""Effects that a road scene may call for, each with its defaults and its source."""

from jaxradar.sim.effects.counts import Gain, Quantisation, Saturation
from jaxradar.sim.effects.motion import Accelerometer
from jaxradar.sim.effects.propagation import LostEcho, Multipath, Rain, TemperatureDrift, WaterFilm
from jaxradar.sim.effects.receiver import DirectLeakage, Interference, ReceiverNoise
from jaxradar.sim.effects.sampling import RangeSmoothing, RangeWalk, RunningAverage, Thinning
from jaxradar.sim.effects.timing import CpuClock, DroppedSweeps, LateSweeps, TimeJitter
from jaxradar.sim.scene import Effect

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

EFFECTS: dict[str, type[Effect]] = {
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
