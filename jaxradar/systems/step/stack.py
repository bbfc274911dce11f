"""Series of one range axis as the padded arrays that `detect_batch` and `run_batch` take."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jaxradar.drive import Motion, SensorSeries
from jaxradar.systems.step.config import MotionSample, RangeAxis
from jaxradar.systems.step.motion import motion_at, no_motion, put_motion
from jaxradar.systems.step.pipeline import time_steps

__all__ = ["SweepBatch", "stack"]

ALIGNMENT = 64  # bytes: an array that begins at a multiple enters a program without a copy


class SweepBatch(NamedTuple):
    """`axis` and the inputs of `detect_batch`, in its order: `detect_batch(detector, *stack(series))`. `motion`: None
    where none was given."""

    axis: RangeAxis
    sweeps: np.ndarray
    flags: np.ndarray
    dt: np.ndarray
    lengths: np.ndarray
    motion: MotionSample | None = None


def stack(series: Sequence[SensorSeries], motions: Sequence[Motion | None] | None = None) -> SweepBatch:
    """Series side by side, each padded with zeros to the longest; with the `motions` of their drives, for detectors
    that use them.

    Returns the axis, sweeps (logs, sweeps, bins) of the series' dtype, flags (logs, sweeps) uint16, dt (logs, sweeps)
    float64 in seconds, lengths (logs,) int32 and the motion, each field (logs, sweeps): nothing is known of a log whose
    motion is None, nor beyond its end. Raises `ValueError` for no series, for series of different range axes or dtypes,
    and unless there are as many motions.
    """
    if not series:
        raise ValueError("`stack` needs at least one series.")
    first = series[0]
    for place, one in enumerate(series):
        if one.sweeps.dtype != first.sweeps.dtype or not np.array_equal(one.range_m, first.range_m):
            raise ValueError(
                f"`stack` takes series of one range axis and dtype; series {place} has {one.sweeps.dtype} in "
                f"{len(one.range_m)} bins from {one.range_m[0]:g} to {one.range_m[-1]:g} m, the first has "
                f"{first.sweeps.dtype} in {len(first.range_m)} from {first.range_m[0]:g} to {first.range_m[-1]:g} m."
            )
    lengths = np.array([len(one) for one in series], np.int32)
    shape = len(series), int(lengths.max())
    sweeps = aligned((*shape, len(first.range_m)), first.sweeps.dtype)
    flags, dt = aligned(shape, np.dtype(np.uint16)), aligned(shape, np.dtype(np.float64))
    for place, one in enumerate(series):
        sweeps[place, : len(one)], flags[place, : len(one)] = one.sweeps, one.flags
        dt[place, : len(one)] = time_steps(one.times_ns)
    motion = None if motions is None else _moved(series, motions, shape)
    return SweepBatch(RangeAxis.of(first.range_m), sweeps, flags, dt, lengths, motion)


def _moved(series: Sequence[SensorSeries], motions: Sequence[Motion | None], shape: tuple[int, int]) -> MotionSample:
    if len(series) != len(motions):
        raise ValueError(f"`stack` takes a motion for each series; got {len(motions)} for {len(series)}.")
    found = no_motion(shape)
    for place, (one, motion) in enumerate(zip(series, motions, strict=True)):
        put_motion(found, place, motion_at(motion or Motion(), one.times_ns), 0, len(one))
    return found


def aligned(shape: tuple[int, ...], dtype: np.dtype) -> np.ndarray:
    """Zeros that begin where a program reads them without a copy."""
    size = int(np.prod(shape)) * dtype.itemsize
    raw = np.zeros(size + ALIGNMENT, np.uint8)
    start = -raw.ctypes.data % ALIGNMENT
    return raw[start : start + size].view(dtype).reshape(shape)
