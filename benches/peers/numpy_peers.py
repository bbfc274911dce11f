"""The pipeline in NumPy, float32: the whole array at once, and one log at a time into buffers that are used again."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from data import ESTIMATORS, TEMPERATURE, THRESHOLD_M_S, Batch, Outputs

__all__ = ["BY_LOG", "WHOLE", "candidates"]

WHOLE, BY_LOG = "NumPy, whole array", "NumPy, log by log"
SHARPNESS = np.float32(1.0 / TEMPERATURE)
TAPS = np.arange(9)


class _Whole:
    """Sweeps of any leading shape at once: the shortest way to write it."""

    def __init__(self, batch: Batch):
        self.batch = batch
        self.last = batch.bins - 1
        self.moments = np.stack([np.ones(batch.bins), np.arange(batch.bins)], axis=1).astype(np.float32)

    def argmax(self) -> np.ndarray:
        return (self.batch.sweeps * self.batch.weights).argmax(axis=-1).astype(np.float32)

    def parabola(self) -> np.ndarray:
        selected = (self.batch.sweeps * self.batch.weights).argmax(axis=-1)
        centre = np.clip(selected, 1, self.last - 1)
        taps = np.take_along_axis(self.batch.sweeps, centre[..., None] + np.arange(-1, 2), axis=-1).astype(np.float32)
        offset, inside = _vertex(taps[..., 0], taps[..., 1], taps[..., 2])
        return np.where(inside, centre.astype(np.float32) + offset, selected.astype(np.float32))

    def window(self) -> np.ndarray:
        selected = (self.batch.sweeps * self.batch.weights).argmax(axis=-1)
        start = np.clip(selected - 4, 0, self.last - 8)
        taps = np.take_along_axis(self.batch.sweeps, start[..., None] + TAPS, axis=-1).astype(np.float32)
        return start.astype(np.float32) + _soft_mean(taps, self.moments[:9])

    def soft(self) -> np.ndarray:
        return _soft_mean(self.batch.sweeps * self.batch.weights, self.moments)

    def __call__(self, estimator: str) -> Outputs:
        distance = np.float32(self.batch.start_m) + np.float32(self.batch.bin_m) * getattr(self, estimator)()
        speed = np.zeros_like(distance)
        np.divide(np.diff(distance, axis=1), self.batch.dt32[:, 1:], out=speed[:, 1:])
        return Outputs(distance, speed, np.abs(speed) > THRESHOLD_M_S)


def _vertex(left: np.ndarray, middle: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Offset from the middle, and whether it is one: a vertex among the taps."""
    curvature = left - 2 * middle + right
    peaked = curvature < 0
    offset = np.zeros_like(left)
    np.divide(np.float32(0.5) * (left - right), curvature, out=offset, where=peaked)
    return offset, peaked & (np.abs(offset) <= 1.0)


def _soft_mean(values: np.ndarray, moments: np.ndarray) -> np.ndarray:
    """Overwrites `values`. Both sums are one product of matrices."""
    values *= SHARPNESS / values.max(axis=-1, keepdims=True)
    values -= SHARPNESS
    np.exp(values, out=values)
    sums = values @ moments
    return sums[..., 1] / sums[..., 0]


class _ByLog:
    """One log at a time: everything stays in the second-level cache and nothing of its size is allocated."""

    def __init__(self, batch: Batch):
        count = batch.sweeps.shape[1]
        self.batch = batch
        self.last = batch.bins - 1
        self.compensated = np.empty((count, batch.bins), np.float32)
        self.selected = np.empty(count, np.intp)
        self.begins = np.arange(count) * batch.bins
        self.indices = np.empty((count, 9), np.intp)
        self.raw = np.empty((count, 9), np.uint16)
        self.taps = np.empty((count, 9), np.float32)
        self.moments = np.stack([np.ones(batch.bins), np.arange(batch.bins)], axis=1).astype(np.float32)
        shape = batch.flags.shape
        self.outputs = Outputs(np.empty(shape, np.float32), np.zeros(shape, np.float32), np.zeros(shape, bool))

    def compensate(self, sweeps: np.ndarray) -> np.ndarray:
        # Converted first: a product of two types goes through NumPy's small buffers and takes half as long again.
        np.copyto(self.compensated, sweeps)
        return np.multiply(self.compensated, self.batch.weights, out=self.compensated)

    def argmax(self, sweeps: np.ndarray) -> np.ndarray:
        self.compensate(sweeps)
        return np.argmax(self.compensated, axis=1, out=self.selected)

    def parabola(self, sweeps: np.ndarray) -> np.ndarray:
        selected = self.argmax(sweeps)
        centre = np.clip(selected, 1, self.last - 1)
        flat, at = sweeps.reshape(-1), self.begins + centre
        left, middle, right = (flat.take(at + tap).astype(np.float32) for tap in (-1, 0, 1))
        offset, inside = _vertex(left, middle, right)
        return np.where(inside, centre + offset, selected)

    def window(self, sweeps: np.ndarray) -> np.ndarray:
        start = np.clip(self.argmax(sweeps) - 4, 0, self.last - 8)
        np.add((self.begins + start)[:, None], TAPS, out=self.indices)
        np.take(sweeps.reshape(-1), self.indices, out=self.raw, mode="clip")
        np.copyto(self.taps, self.raw)
        return start + _soft_mean(self.taps, self.moments[:9])

    def soft(self, sweeps: np.ndarray) -> np.ndarray:
        return _soft_mean(self.compensate(sweeps), self.moments)

    def __call__(self, estimator: str) -> Outputs:
        locate, batch = getattr(self, estimator), self.batch
        for log in range(batch.logs):
            distance, speed, event = (values[log] for values in self.outputs)
            np.multiply(locate(batch.sweeps[log]), np.float32(batch.bin_m), out=distance, casting="same_kind")
            distance += np.float32(batch.start_m)
            np.subtract(distance[1:], distance[:-1], out=speed[1:])
            speed[1:] /= batch.dt32[log, 1:]
            np.greater(np.abs(speed), np.float32(THRESHOLD_M_S), out=event)
        return self.outputs


def candidates(batch: Batch) -> dict[str, dict[str, Callable[[], Outputs]]]:
    peers: dict[str, Callable[[str], Outputs]] = {WHOLE: _Whole(batch), BY_LOG: _ByLog(batch)}
    return {name: {estimator: partial(peer, estimator) for estimator in ESTIMATORS} for name, peer in peers.items()}
