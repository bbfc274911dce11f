"""What an effect of a road scene is: the stages that there are, what each is given, and what it may say beforehand."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import numpy as np
from jaxtyping import Array, Bool, Shaped

from jaxradar.sim.radar import Radar
from jaxradar.sim.scene import Effect

__all__ = ["STAGES", "Counts", "RoadEffect", "SweepContext"]

# In the order in which they are gone through, with what an effect of each is given and gives back changed.
STAGES = {
    "clock": "`Clock` of the whole drive; beside it the period in s",
    "surface": "`Surface`",
    "acceleration": "(sweeps,) m/s²: what the body feels when each sweep is taken",
    "axis": "(bins,) m as a NumPy array: the range axis",
    "paths": "`Paths` of one sweep; beside it, here and in the next three, its `SweepContext`",
    "sampling": "`Paths` of one sweep, after all effects of the stage before",
    "field": "`Field` of one sweep at `context.range_m`",
    "smoothing": "(places,) counts: the envelope at `context.range_m`; gives (bins,) at `context.bins_m`",
    "average": "(block, bins) counts: successive sweeps; beside them the last one before, as changed",
    "gain": "`Counts` of a block of sweeps",
    "limit": "`Counts` of a block of sweeps",
    "rounding": "`Counts` of a block of sweeps",
}


class SweepContext(NamedTuple):
    """What an effect may know of the sweep that it changes: the radar, when the sweep is taken, where the field is
    worked out and where the envelope is wanted."""

    radar: Radar
    taken_s: Array
    range_m: np.ndarray
    bins_m: np.ndarray


class Counts(NamedTuple):
    """Sweeps on their way into a log, and which of them reached full scale."""

    values: Shaped[Array, "sweeps bins"]
    saturated: Bool[Array, " sweeps"]


class RoadEffect(Effect):
    """An effect of a road scene: called with what its stage holds, with what is known beside it (`STAGES`; else None),
    and with a random key. Defining one of an unknown stage raises `TypeError`.

    - `needs_rates`: whether it needs to know how fast ranges change.
    """

    needs_rates: ClassVar[bool] = False

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if cls.stage not in STAGES:
            raise TypeError(f"`{cls.__name__}.stage` must be one of {', '.join(STAGES)}; got {cls.stage!r}.")

    def places(self, range_m: np.ndarray) -> np.ndarray:
        """Where the field must be worked out for an envelope at `range_m`."""
        return range_m

    def stated(self, range_m: np.ndarray) -> np.ndarray:
        """The axis that the log states for the sensor's own."""
        return range_m

    def turn_rad_m(self, radar: Radar, speed_m_s: float) -> float:
        """By how much at most it turns an echo's phase from range to range, at closing speeds up to `speed_m_s`."""
        return 0.0
