"""How the car moved, and what of it is known at the time of a sweep."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxradar.units import NANOSECONDS

__all__ = ["HELD_S", "KNOWN", "MOTION_FIELDS", "Channel", "Motion", "integer_times", "known_motion"]

HELD_S = 0.2  # a value is known for so long, two samples of the slowest channel on a car's bus, 10 Hz
# Each quantity, and the flag that says whether it is known.
KNOWN = {
    "acceleration_m_s2": "acceleration_known",
    "yaw_rate_rad_s": "yaw_rate_known",
    "speed_m_s": "speed_known",
}
MOTION_FIELDS = (*KNOWN, *KNOWN.values())


def integer_times(values: Any, name: str) -> np.ndarray:
    """(n,) int64. Raises `ValueError`, with the name, for anything but a vector of int64 nanoseconds."""
    times = np.asarray(values)
    if times.ndim != 1 or times.dtype != np.int64:
        raise ValueError(f"`{name}` must be a vector of int64 nanoseconds; got {times.dtype} of shape {times.shape}.")
    return times


@dataclass(frozen=True, eq=False)
class Channel:
    """One quantity over time: `times_ns` (n,) int64 since the first sweep of the drive, `values` (n,) float64."""

    times_ns: np.ndarray
    values: np.ndarray

    def __post_init__(self) -> None:
        count = len(integer_times(self.times_ns, "Channel(times_ns=...)"))
        if self.values.shape != (count,) or self.values.dtype != np.float64:
            raise ValueError(
                f"`Channel(values=...)` must be float64 of shape {(count,)}; "
                f"got {self.values.dtype} of shape {self.values.shape}."
            )

    @property
    def times_s(self) -> np.ndarray:
        """(n,) float64 seconds since the first sweep of the drive."""
        return self.times_ns / NANOSECONDS


@dataclass(frozen=True, eq=False)
class Motion:
    """How the car moved, each part as far as it was recorded.

    `acceleration_m_s2`: vertical acceleration of the body. `yaw_rate_rad_s`: positive to the left.
    `speed_m_s`: positive forwards.
    """

    acceleration_m_s2: Channel | None = None
    yaw_rate_rad_s: Channel | None = None
    speed_m_s: Channel | None = None

    @property
    def recorded(self) -> bool:
        """Whether any part was."""
        return any(getattr(self, name) is not None for name in KNOWN)


def known_motion(motion: Motion, times_ns: np.ndarray) -> dict[str, np.ndarray]:
    """`MOTION_FIELDS` at each time: a channel's last finite value at or before it, (times,) float64, and whether there
    is one.

    Causal: nothing is interpolated. A value older than `HELD_S` is not known any more, and 0; so is a channel that was
    not recorded. Samples are taken in order of their times.
    """
    held = {name: _held(getattr(motion, name), np.asarray(times_ns)) for name in KNOWN}
    known = {KNOWN[name]: some for name, (_, some) in held.items()}
    return {name: values for name, (values, _) in held.items()} | known


def _held(channel: Channel | None, times_ns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    some = np.zeros(0, bool) if channel is None else np.isfinite(channel.values)
    if channel is None or not some.any():
        return np.zeros(len(times_ns)), np.zeros(len(times_ns), bool)
    order = np.argsort(channel.times_ns[some], kind="stable")
    times, values = channel.times_ns[some][order], channel.values[some][order]
    place = np.searchsorted(times, times_ns, side="right") - 1
    last = np.maximum(place, 0)
    known = (place >= 0) & (times_ns - times[last] <= round(HELD_S * NANOSECONDS))
    return np.where(known, values[last], 0.0), known
