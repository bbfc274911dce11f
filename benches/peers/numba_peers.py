"""The pipeline in numba: loops over the bins of a sweep, parallel over logs, `fastmath`. Needs `numba`."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from data import ESTIMATORS, TEMPERATURE, THRESHOLD_M_S, Batch, Outputs, UnavailableError

njit: Any
prange: Any
try:
    import numba

    njit, prange = numba.njit, numba.prange
except ImportError:
    njit = prange = None

__all__ = ["candidates"]

SHARPNESS = np.float32(1.0 / TEMPERATURE)
HALF, ZERO, ONE = np.float32(0.5), np.float32(0.0), np.float32(1.0)


def _largest(sweep: Any, weights: Any) -> Any:
    # The bits of positive floats are in the floats' order, and LLVM vectorises a maximum of integers: without this the
    # arg-max takes 3.5 times as long.
    top = np.int32(0)
    for i in range(sweep.shape[0]):
        top = max(top, np.float32(np.float32(sweep[i]) * weights[i]).view(np.int32))
    return top


def _select(sweep: Any, weights: Any) -> Any:
    top = largest(sweep, weights)
    first = np.int32(sweep.shape[0])
    for i in range(np.int32(sweep.shape[0])):
        equal = np.float32(np.float32(sweep[i]) * weights[i]).view(np.int32) == top
        first = min(first, np.int32(i) if equal else np.int32(1 << 30))
    return first


def _argmax(sweep: Any, weights: Any) -> Any:
    return np.float32(select(sweep, weights))


def _parabola(sweep: Any, weights: Any) -> Any:
    selected = select(sweep, weights)
    centre = min(max(selected, 1), sweep.shape[0] - 2)
    left, middle, right = np.float32(sweep[centre - 1]), np.float32(sweep[centre]), np.float32(sweep[centre + 1])
    curvature = left - middle - middle + right
    offset = HALF * (left - right) / (curvature if curvature < ZERO else ONE)
    return np.float32(centre) + offset if curvature < ZERO and abs(offset) <= ONE else np.float32(selected)


def _window(sweep: Any, weights: Any) -> Any:
    start = min(max(select(sweep, weights) - 4, 0), sweep.shape[0] - 9)
    top = ZERO
    for i in range(9):
        top = max(top, np.float32(sweep[start + i]))
    scale, total, moment = SHARPNESS / top, ZERO, ZERO
    for i in range(9):
        weight = math.exp(np.float32(sweep[start + i]) * scale - SHARPNESS)
        total += weight
        moment += weight * np.float32(i)
    return np.float32(start) + moment / total


def _soft(sweep: Any, weights: Any) -> Any:
    top = np.int32(largest(sweep, weights)).view(np.float32)
    scale, total, moment = SHARPNESS / top, ZERO, ZERO
    for i in range(sweep.shape[0]):
        weight = math.exp(np.float32(sweep[i]) * weights[i] * scale - SHARPNESS)
        total += weight
        moment += weight * np.float32(i)
    return moment / total


if njit is not None:
    largest = njit(fastmath=True, error_model="numpy")(_largest)
    select = njit(fastmath=True, error_model="numpy")(_select)


def _compiled(plain: Any) -> Any:
    locate = njit(fastmath=True, error_model="numpy")(plain)

    def run(
        sweeps: Any,
        weights: Any,
        dt: Any,
        start_m: Any,
        bin_m: Any,
        threshold: Any,
        distance: Any,
        speed: Any,
        event: Any,
    ) -> None:
        for log in prange(sweeps.shape[0]):
            before = ZERO
            for i in range(sweeps.shape[1]):
                here = start_m + bin_m * locate(sweeps[log, i], weights)
                rate = (here - before) / dt[log, i] if i > 0 else ZERO
                distance[log, i], speed[log, i], event[log, i] = here, rate, abs(rate) > threshold
                before = here

    return njit(parallel=True, fastmath=True, error_model="numpy")(run)


def candidates(batch: Batch) -> dict[str, dict[str, Callable[[], Outputs]]]:
    """Raises `UnavailableError` where numba is not installed."""
    if njit is None:
        raise UnavailableError("numba is not installed.")
    shape = batch.flags.shape
    outputs = Outputs(np.empty(shape, np.float32), np.empty(shape, np.float32), np.empty(shape, bool))
    constants = [np.float32(value) for value in (batch.start_m, batch.bin_m, THRESHOLD_M_S)]

    def call(run: Any) -> Outputs:
        run(batch.sweeps, batch.weights, batch.dt32, *constants, *outputs)
        return outputs

    locators = dict(zip(ESTIMATORS, (_argmax, _parabola, _window, _soft), strict=True))
    return {"numba": {name: partial(call, _compiled(locate)) for name, locate in locators.items()}}
