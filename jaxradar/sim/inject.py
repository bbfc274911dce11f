"""A step put into a recording of flat road: real noise and real echoes, a made-up displacement.

The whole profile is displaced at once, which favours detectors that look at the whole profile: what comes out of this
says whether a detector still sees through real noise, not how it does on a road.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Literal

import numpy as np

from jaxradar.drive import SensorSeries
from jaxradar.units import NANOSECONDS

__all__ = ["inject_step", "retimed"]


def retimed(series: SensorSeries, rate_hz: float) -> SensorSeries:
    """The same sweeps as if they had been taken at `rate_hz`, evenly, from time 0."""
    times = np.rint(np.arange(len(series)) * (NANOSECONDS / rate_hz)).astype(np.int64)
    return dataclasses.replace(series, times_ns=times)


def inject_step(
    series: SensorSeries,
    height_m: float,
    first_sweep: int,
    sensor_height_m: float,
    form: Literal["scaled", "pencil"] = "scaled",
    speed_m_s: float = 30.0 / 3.6,
) -> SensorSeries:
    """Displace the profile from `first_sweep` on as a step of `height_m` would.

    `scaled`: r → r (1 − h/H) with H the height of the sensor over the road, a step seen at every angle at once;
    `pencil`: r → r − √2 h, a pencil beam at 45° (both: requirements, 2A, from the thesis's geometry). The face passes
    within h/v, and `first_sweep` shows the first displacement. Amplitudes between bins are interpolated, those from
    beyond the window repeat its last bin; counts stay whole where they were. Times and flags stay as they are.
    """
    sweeps = np.array(series.sweeps)
    range_m = series.range_m
    start = int(first_sweep)
    if 0 < start < len(series):
        # The face arrives just after the sweep before, so that this one already shows a part of it.
        since = (series.times_ns - series.times_ns[start - 1]) / NANOSECONDS
    else:
        since = np.full(len(series), np.inf)
    face_s = abs(height_m) / speed_m_s
    for i in range(start, len(series)):
        shown = height_m if since[i] >= face_s else height_m * since[i] / face_s
        source = range_m / (1.0 - shown / sensor_height_m) if form == "scaled" else range_m + math.sqrt(2.0) * shown
        moved = np.interp(source, range_m, sweeps[i])
        sweeps[i] = np.rint(moved) if sweeps.dtype == np.uint16 else moved
    return dataclasses.replace(series, sweeps=sweeps)
