"""One fit of the section `tuning`, in a process of its own."""

from __future__ import annotations

import contextlib
import itertools
import pickle
import resource
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

__all__ = ["fit"]

STEP = 1e-6


class _EnoughError(Exception):
    pass


class _Traced:
    """A cost that remembers when it first came so low."""

    def __init__(self, cost: Callable[[np.ndarray], float], most: int):
        self.cost, self.most, self.begin = cost, most, time.perf_counter()
        self.evaluations, self.best, self.at = 0, np.inf, None
        self.trace: list[tuple[float, float]] = []

    def __call__(self, vector: np.ndarray) -> float:
        if self.evaluations >= self.most:
            raise _EnoughError
        self.evaluations += 1
        value = self.cost(vector)
        if value < self.best:
            self.best, self.at = value, np.array(vector)
            self.trace.append((time.perf_counter() - self.begin, value))
        return value


def fit(path: str, method: str, seed: int, most: int) -> dict[str, Any]:
    """`seconds`, `evaluations`, `cost` on all drives, `trace` of (seconds, cost), `peak` memory of the process."""
    from sections.tuning import COSTS, DETECTOR, GRADIENT, GRID, NAMES, NUMPY, plan, start_of

    from jaxradar.tuning import Space, split, tune
    from jaxradar.tuning.fit import costs_of

    examples = pickle.loads(Path(path).read_bytes())
    space, own = Space.of(DETECTOR, NAMES), plan(seed)
    last = own.temperatures[-1]
    whole = lambda vector: float(  # noqa: E731
        costs_of(space, DETECTOR, COSTS, examples, last, vector[None], examples.logs)[0]
    )
    if method == GRADIENT:
        fitted, kept = (examples.pick(places) for places in split(examples.logs, seed))
        start = space.detector_at(DETECTOR, start_of(seed))
        begin = time.perf_counter()
        tuned = tune(start, NAMES, fitted, kept, costs=COSTS, plan=own)
        seconds = time.perf_counter() - begin
        tune(start, NAMES, fitted, kept, costs=COSTS, plan=own)
        again = time.perf_counter() - begin - seconds
        peak = _peak()
        cost = whole(tuned.vector)
        evaluations = own.candidates + own.starts * len(own.temperatures) * own.steps
        return {
            "seconds": seconds,
            "again": again,
            "evaluations": evaluations,
            "cost": cost,
            "trace": [(seconds, cost)],
            "peak": peak,
            "slope": _slope_error(space, DETECTOR, COSTS, examples.pick(np.arange(min(examples.logs, 20))), own),
        }
    if method == NUMPY:
        from peers.numpy_tuning import NumpyCost

        plain = NumpyCost(examples, COSTS, DETECTOR._half_width(examples.batch.axis), len(DETECTOR.filter))
        traced = _Traced(lambda vector: plain(_values(space, vector), last), most)
    else:
        traced = _Traced(whole, most)
    if method == GRID:
        # Three values of each of the first three settings, two of each weight.
        for one in itertools.product(*[(-1.0, 0.0, 1.0)] * 3, *[(-0.7, 0.7)] * 3):
            with contextlib.suppress(_EnoughError):
                traced(start_of(seed) + np.array(one))
    else:
        _nelder_mead(traced, start_of(seed))
    seconds = time.perf_counter() - traced.begin
    return {
        "seconds": seconds,
        "evaluations": traced.evaluations,
        "cost": whole(traced.at),
        "trace": traced.trace,
        "peak": _peak(),
    }


def _values(space: Any, vector: np.ndarray) -> np.ndarray:
    return space.low + (space.high - space.low) / (1.0 + np.exp(-vector))


def _nelder_mead(cost: _Traced, start: np.ndarray) -> None:
    from scipy.optimize import minimize

    simplex = np.vstack([start, start + 0.5 * np.eye(len(start))])
    options = {"initial_simplex": simplex, "adaptive": True, "xatol": 1e-3, "fatol": 1e-4, "maxfev": 10**6}
    with contextlib.suppress(_EnoughError):
        minimize(cost, start, method="Nelder-Mead", options=options)


def _slope_error(space: Any, detector: Any, costs: Any, examples: Any, own: Any) -> float:
    import jax
    import jax.numpy as jnp

    from jaxradar.tuning import smooth_outcome

    with jax.enable_x64(True):

        def cost(vector: Any) -> Any:
            return smooth_outcome(space.detector(detector, vector), examples, 0.3).cost(examples.hours, costs)

        start = jnp.asarray(space.vector(detector))
        slope = np.asarray(jax.jit(jax.grad(cost))(start))
        program = jax.jit(cost)
        differences = [
            float(program(start + step) - program(start - step)) / (2 * STEP) for step in STEP * np.eye(len(slope))
        ]
    return float(np.abs(slope - differences).max() / np.abs(slope).max())


def _peak() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
