"""Truth proposed from the acceleration: when the car was shaken, it had met a step a moment before."""

from __future__ import annotations

import math

import numpy as np

from jaxradar.drive import Channel, RoadStep
from jaxradar.units import NANOSECONDS

__all__ = ["propose_steps"]


def propose_steps(
    acceleration: Channel,
    *,
    threshold_m_s2: float = 15.0,
    delay_s: float = 0.018,
    hold_off_s: float = 0.5,
) -> tuple[RoadStep, ...]:
    """One step for each separate bump in the vertical acceleration, in order of time; their heights stay unknown.

    - `threshold_m_s2`: a bump begins with a sample this far, or farther, from the median of the recording. The median
      is taken away because logs hold gravity or do not and do not say so; either direction counts because the sign of
      the axis is not recorded either, and because a step may lead down.
    - `delay_s`: from the tyre's first contact to that sample. A quarter car over 40 mm takes 18 ms to 15 m/s².
    - `hold_off_s`: bumps less than this apart, from the last sample over the threshold to the next, are one: the body
      sways on, and the rear axle follows the front one.

    Samples that are no numbers are left out; times may come in any order. Raises `ValueError` unless the threshold is
    above 0 and the times are finite and at least 0.
    """
    for name, value in (("threshold_m_s2", threshold_m_s2), ("delay_s", delay_s), ("hold_off_s", hold_off_s)):
        if not (math.isfinite(value) and value >= 0) or (name == "threshold_m_s2" and value == 0):
            raise ValueError(
                f"`propose_steps({name}=...)` must be finite and {'>' if name[0] == 't' else '>='} 0; got {value}."
            )
    finite = np.isfinite(acceleration.values)
    times_ns, values = acceleration.times_ns[finite], acceleration.values[finite]
    if not values.size:
        return ()
    over = np.sort(times_ns[np.abs(values - np.median(values)) >= threshold_m_s2])
    if not over.size:
        return ()
    first = np.concatenate([[True], np.diff(over) > hold_off_s * NANOSECONDS])
    delay_ns = round(delay_s * NANOSECONDS)
    return tuple(RoadStep((time - delay_ns) / NANOSECONDS) for time in over[first].tolist())
