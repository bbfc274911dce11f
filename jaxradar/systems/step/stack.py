"""Series of one range axis as the padded arrays that `detect_batch` and `run_batch` take."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from jaxradar.drive import SensorSeries
from jaxradar.systems.step.config import RangeAxis
from jaxradar.systems.step.pipeline import time_steps

__all__ = ["SweepBatch", "stack"]

ALIGNMENT = 64  # bytes: an array that begins at a multiple enters a program without a copy


class SweepBatch(NamedTuple):
    """`axis` and the inputs of `detect_batch`, in its order: `detect_batch(detector, *stack(series))`."""

    axis: RangeAxis
    sweeps: np.ndarray
    flags: np.ndarray
    dt: np.ndarray
    lengths: np.ndarray


def stack(series: Sequence[SensorSeries]) -> SweepBatch:
    """Series side by side, each padded with zeros to the longest.

    Returns the axis, sweeps (logs, sweeps, bins) of the series' dtype, flags (logs, sweeps) uint16, dt (logs, sweeps)
    float64 in seconds and lengths (logs,) int32. Raises `ValueError` for no series, and for series of different range
    axes or dtypes.
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
    return SweepBatch(RangeAxis.of(first.range_m), sweeps, flags, dt, lengths)


def aligned(shape: tuple[int, ...], dtype: np.dtype) -> np.ndarray:
    """Zeros that begin where a program reads them without a copy."""
    size = int(np.prod(shape)) * dtype.itemsize
    raw = np.zeros(size + ALIGNMENT, np.uint8)
    start = -raw.ctypes.data % ALIGNMENT
    return raw[start : start + size].view(dtype).reshape(shape)
