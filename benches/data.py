"""Seeded batches of sweeps as a car's radar would send them; nothing to run here, `run.py` calls it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

__all__ = [
    "ESTIMATORS",
    "SWEEPS",
    "TEMPERATURE",
    "THRESHOLD_M_S",
    "Batch",
    "Outputs",
    "UnavailableError",
    "aligned",
    "make_batch",
]

ESTIMATORS = ("argmax", "parabola", "window", "soft")
TEMPERATURE = 0.1  # of both soft-argmaxes, in units of the largest amplitude
THRESHOLD_M_S = 0.7  # of the thesis, section 6.1

SWEEPS = 2000  # in each log
RATE_HZ = 300.0  # "300 acquisitions per second": the thesis of README, trial on a road
SPAN_M = (0.1, 0.8)  # of the axis; with 128 bins they lie 5.5 mm apart
FWHM_M = 0.04
NOISE = 164.0  # counts: the Rayleigh parameter of the floor in the thesis's listing C.1 (its mean is 206)


class UnavailableError(Exception):
    """Something that can be measured on another machine or later; the message says why not here and now."""


class Outputs(NamedTuple):
    """What the pipeline gives for each sweep, all (logs, sweeps)."""

    distance: Any  # metres
    speed: Any  # m/s, 0 for the first sweep
    event: Any  # whether |speed| exceeds the threshold


@dataclass(frozen=True, eq=False)
class Batch:
    """`sweeps` (logs, sweeps, bins) uint16; `times_ns` (logs, sweeps) int64 from 0; `dt` its differences in seconds,
    0 for the first sweep; `flags` zeros; `range_m` (bins,) float64; `track_m` (logs, sweeps): where the echo is."""

    sweeps: np.ndarray
    times_ns: np.ndarray
    flags: np.ndarray
    range_m: np.ndarray
    track_m: np.ndarray

    @property
    def logs(self) -> int:
        return int(self.sweeps.shape[0])

    @property
    def bins(self) -> int:
        return int(self.sweeps.shape[2])

    @property
    def count(self) -> int:
        """Sweeps of all logs."""
        return int(self.flags.size)

    @cached_property
    def dt(self) -> np.ndarray:
        return np.diff(self.times_ns, axis=1, prepend=self.times_ns[:, :1]) / 1e9

    @cached_property
    def dt32(self) -> np.ndarray:
        return _aligned_copy(self.dt.astype(np.float32))

    @cached_property
    def weights(self) -> np.ndarray:
        """(2r)², by which amplitudes are compensated, float32."""
        return _aligned_copy(((2.0 * self.range_m) ** 2).astype(np.float32))

    @property
    def start_m(self) -> float:
        return float(self.range_m[0])

    @property
    def bin_m(self) -> float:
        return float((self.range_m[-1] - self.range_m[0]) / (self.bins - 1))

    @cached_property
    def lengths(self) -> np.ndarray:
        return np.full(self.logs, self.sweeps.shape[1], np.int32)


def aligned(shape: tuple[int, ...], dtype: type, alignment: int = 64) -> np.ndarray:
    """An uninitialised array whose data start on a multiple of `alignment` bytes: JAX takes those in without a copy."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    raw = np.empty(size + alignment, np.uint8)
    start = -raw.ctypes.data % alignment
    return raw[start : start + size].view(dtype).reshape(shape)


def _aligned_copy(values: np.ndarray) -> np.ndarray:
    copy = aligned(values.shape, values.dtype.type)
    copy[...] = values
    return copy


def _track(rng: np.random.Generator, sweeps: int, nearest: float, farthest: float) -> np.ndarray:
    """Slant range of the road over time: a slow swing of the body, and a step up or down each half second or so."""
    times = np.arange(sweeps) / RATE_HZ
    swing = rng.uniform(0.002, 0.008) * np.sin(2 * np.pi * rng.uniform(0.5, 2.0) * times + rng.uniform(0, 2 * np.pi))
    jumps = np.where(rng.random(sweeps) < 2.0 / RATE_HZ, rng.uniform(-0.06, 0.06, sweeps), 0.0)
    # Each step is driven off again within about 0.3 s, so that the echo stays on the axis.
    steps = np.convolve(jumps, np.exp(-np.arange(0, 1.5, 1 / RATE_HZ) / 0.3))[:sweeps]
    return np.clip(
        nearest + rng.uniform(0.3, 0.7) * (farthest - nearest) + swing + steps, nearest + 0.02, farthest - 0.02
    )


def _along_range(range_m: np.ndarray) -> np.ndarray:
    """A matrix that gives white noise the width of the pulse along range, and leaves its variance."""
    offset = range_m[:, None] - range_m
    blur = np.exp(-8 * np.log(2) / FWHM_M**2 * offset * offset)
    return (blur / np.sqrt((blur * blur).sum(axis=0))).astype(np.float32)


def _one_log(rng: np.random.Generator, track: np.ndarray, range_m: np.ndarray, blur: np.ndarray | None) -> np.ndarray:
    """The envelope |echo + noise|, the noise complex: far from the echo it is Rayleigh's."""
    strength = np.float32(np.exp(rng.uniform(np.log(4e3), np.log(2.5e4))))
    offset = (range_m[None, :] - track[:, None]).astype(np.float32)
    echo = strength * np.exp(np.float32(-4 * np.log(2) / FWHM_M**2) * offset * offset)
    noise = rng.standard_normal((2, track.size, range_m.size), dtype=np.float32) * np.float32(NOISE)
    if blur is not None:
        noise = noise @ blur
    return np.rint(np.hypot(echo + noise[0], noise[1])).astype(np.uint16)


def make_batch(
    logs: int,
    bins: int = 128,
    span_m: tuple[float, float] = SPAN_M,
    distinct: int = 64,
    sweeps: int = SWEEPS,
    white: bool = True,
) -> Batch:
    """`logs` logs of `sweeps` sweeps; the same for the same arguments.

    Only `distinct` logs have noise of their own; the others are these, begun at another sweep. `white`: the noise of
    neighbouring bins has nothing in common, as after thinning; else it has the pulse's own width along range, as at
    the sensor's full resolution.
    """
    rng = np.random.default_rng([bins, sweeps])
    range_m = np.linspace(*span_m, bins)
    blur = None if white else _along_range(range_m)
    data = aligned((logs, sweeps, bins), np.uint16)
    track_m = np.empty((logs, sweeps))
    for log in range(logs):
        if log < distinct:
            track_m[log] = _track(rng, sweeps, *span_m)
            data[log] = _one_log(rng, track_m[log], range_m, blur)
        else:
            first, source = int(rng.integers(1, sweeps)), log % distinct
            for values in (data, track_m):
                values[log, : sweeps - first] = values[source, first:]
                values[log, sweeps - first :] = values[source, :first]
    jitter = np.clip(rng.normal(0.0, 0.05, (logs, sweeps)), -0.4, 0.4)
    jitter -= jitter[:, :1]
    times_ns = np.rint((np.arange(sweeps) + jitter) / RATE_HZ * 1e9).astype(np.int64)
    return Batch(data, times_ns, _aligned_copy(np.zeros((logs, sweeps), np.uint16)), range_m, track_m)
