"""The alarm of the lab's acquisition program, which needs no compiled detector (thesis, appendix C.1)."""

from __future__ import annotations

import numpy as np

from jaxradar.drive import SweepFlag
from jaxradar.live.sweeps import LiveSweep

__all__ = ["NEAREST_M", "DistanceRule"]

NEAREST_M = 0.15  # line 142
_LEAST_COUNTS = 1000  # line 264
_VALUES_KEPT = 128  # line 21


class DistanceRule:
    """1 while the strongest echo of the first sensor is an object nearer than 0.15 m, else 0.

    An object is a maximum above 1000 counts, the first of equals. Its distance is its slant range, and a sweep without
    data has no object: lines 253 to 275 with their faults mended. `as_it_was` brings them back: the index runs over the
    whole sweep but is scaled by length/128 and does not begin where the sweep does, and of a sweep without data the
    distance before it stays.

    `range_m`: (bins,) metres. `sensor`: the number of the first sensor.
    """

    def __init__(self, range_m: np.ndarray, sensor: int, *, as_it_was: bool = False) -> None:
        length_m = (range_m[-1] - range_m[0]) * len(range_m) / (len(range_m) - 1)
        self._metres = np.arange(len(range_m)) * (length_m / _VALUES_KEPT) if as_it_was else range_m
        self._sensor, self._as_it_was = sensor, as_it_was
        self._distance_m: float | None = None

    @property
    def near(self) -> bool:
        """Whether there is an object that near."""
        if self._distance_m is None or (self._as_it_was and self._distance_m == 0):
            return False
        return self._distance_m < NEAREST_M

    def take(self, live: LiveSweep) -> None:
        """The next sweep, of any sensor."""
        if live.sensor != self._sensor:
            return
        if live.flags & SweepFlag.INVALID or live.sweep.shape != self._metres.shape:
            self._distance_m = self._distance_m if self._as_it_was else None
            return
        place = int(np.argmax(live.sweep))
        self._distance_m = float(self._metres[place]) if live.sweep[place] > _LEAST_COUNTS else None
