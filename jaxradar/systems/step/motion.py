"""The car's motion at the times of sweeps, as it was known by then."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int

from jaxradar.motion import KNOWN, MOTION_FIELDS, Motion, known_motion
from jaxradar.systems.step.config import MotionSample

__all__ = ["check_motion", "motion_at", "no_motion", "put_motion"]


def motion_at(motion: Motion, times_ns: Int[np.ndarray, " sweeps"]) -> MotionSample:
    """Each field (sweeps,), as `known_motion` gives them."""
    return MotionSample(**known_motion(motion, times_ns))


def no_motion(shape: tuple[int, ...]) -> MotionSample:
    """Arrays on the host in which nothing is known."""
    values = {name: np.zeros(shape) for name in KNOWN}
    return MotionSample(**values, **{known: np.zeros(shape, bool) for known in KNOWN.values()})


def put_motion(into: MotionSample, log: int, motion: MotionSample, first: int, count: int) -> None:
    """Copy so many sweeps of one log's motion, from its `first` on, to the beginning of a row of arrays."""
    for name in MOTION_FIELDS:
        getattr(into, name)[log, :count] = getattr(motion, name)[first : first + count]


def check_motion(motion: MotionSample | None, shape: tuple[int, ...]) -> None:
    """Raises `ValueError`, with the name of the field, unless all fields have the shape (logs, sweeps)."""
    if motion is None:
        return
    for name in MOTION_FIELDS:
        if np.shape(getattr(motion, name)) != tuple(shape):
            raise ValueError(
                f"expected `motion.{name}` of shape (logs, sweeps) = {tuple(shape)}; "
                f"got {np.shape(getattr(motion, name))}."
            )
