"""The car's motion at the times of sweeps, as it was known by then."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Int

from jaxradar.drive import NANOSECONDS, Channel, Motion
from jaxradar.systems.step.config import MotionSample

__all__ = ["HELD_S", "check_motion", "motion_at", "no_motion", "put_motion"]

HELD_S = 0.2  # a value is known for so long, two samples of the slowest channel on a car's bus, 10 Hz

_CHANNELS = {
    "acceleration_m_s2": "acceleration_known",
    "yaw_rate_rad_s": "yaw_rate_known",
    "speed_m_s": "speed_known",
}


def motion_at(motion: Motion, times_ns: Int[np.ndarray, " sweeps"]) -> MotionSample:
    """Each channel's last finite value at or before each time, (sweeps,) float64, and whether there is one.

    Causal: nothing is interpolated. A value older than `HELD_S` is not known any more, and 0; so is a channel that was
    not recorded. Samples are taken in order of their times.
    """
    fields: dict[str, Any] = {}
    for name, known in _CHANNELS.items():
        fields[name], fields[known] = _held(getattr(motion, name), np.asarray(times_ns))
    return MotionSample(**fields)


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


def no_motion(shape: tuple[int, ...]) -> MotionSample:
    """Arrays on the host in which nothing is known."""
    values = {name: np.zeros(shape) for name in _CHANNELS}
    return MotionSample(**values, **{known: np.zeros(shape, bool) for known in _CHANNELS.values()})


def put_motion(into: MotionSample, log: int, motion: MotionSample, first: int, count: int) -> None:
    """Copy so many sweeps of one log's motion, from its `first` on, to the beginning of a row of arrays."""
    for name in (*_CHANNELS, *_CHANNELS.values()):
        getattr(into, name)[log, :count] = getattr(motion, name)[first : first + count]


def check_motion(motion: MotionSample | None, shape: tuple[int, ...]) -> None:
    """Raises `ValueError`, with the name of the field, unless all fields have the shape (logs, sweeps)."""
    if motion is None:
        return
    for name in (*_CHANNELS, *_CHANNELS.values()):
        if np.shape(getattr(motion, name)) != tuple(shape):
            raise ValueError(
                f"expected `motion.{name}` of shape (logs, sweeps) = {tuple(shape)}; "
                f"got {np.shape(getattr(motion, name))}."
            )
