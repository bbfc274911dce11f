"""When the sweeps of a drive are taken and recorded."""

from __future__ import annotations

from typing import NamedTuple

from jaxtyping import Array, Bool, Float

from jaxradar._types import Value

__all__ = ["Clock"]


class Clock(NamedTuple):
    """When each sweep was taken, what the recorder wrote down, and whether the sweep was recorded at all; seconds.

    `motion_pace`: how many seconds pass on the clock of the acceleration in one.
    """

    taken_s: Float[Array, " sweeps"]
    recorded_s: Float[Array, " sweeps"]
    kept: Bool[Array, " sweeps"]
    motion_pace: Value | float = 1.0
