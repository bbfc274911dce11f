"""How well drives determine what was fitted to them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxradar._numerics import compiled_filtered
from jaxradar.systems.step import StepDetector, precision
from jaxradar.tuning.examples import Examples
from jaxradar.tuning.fit import Tuned
from jaxradar.tuning.loss import Costs, smooth_outcome
from jaxradar.tuning.space import Space

__all__ = ["Fitted", "uncertainty"]

STEP = 0.05  # of the vector, over which curvature is taken
SHARED = 0.1  # of a flat direction, as the product of two settings' parts of it
CORRELATED = 0.95
LOOSE = 1.0  # a setting that is known to no more than a factor of e, towards its nearer bound, is not


@dataclass(frozen=True)
class Fitted:
    """A setting as it came out: its value, the standard deviation of that (infinite where the cost does not hang on
    it), and whether the drives determine it at all.

    `together`: others with which it is determined in combination, where the drives do not determine it by itself but
    would if these were held: many values of them all cost the same. Empty for the rest.
    """

    name: str
    value: float
    sd: float
    determined: bool
    together: tuple[str, ...] = ()


def uncertainty(
    tuned: Tuned,
    detector: StepDetector[Any, Any],
    examples: Examples,
    costs: Costs | None = None,
    temperature: float = 0.1,
) -> tuple[Fitted, ...]:
    """Of each setting that was fitted, by how the drives' own slopes scatter.

    The sandwich H⁻¹ J H⁻¹ of an estimate that minimises a sum over drives (Huber, Proceedings of the Fifth Berkeley
    Symposium, 1967; White, Econometrica 50, 1982): H the curvature of the cost, by central differences of its slope
    over `STEP` of the vector, J the scatter of the slopes of single drives, worked out exactly in forward mode. A
    direction in which the cost does not curve upwards is not determined, nor is any setting that lies in it.
    """
    costs = costs or Costs()
    space, vector = tuned.space, tuned.vector
    count = len(vector)
    with precision(detector):
        dtype = jnp.result_type(float)
        slopes = lambda at: np.asarray(  # noqa: E731
            _slopes(space, detector, costs, examples, temperature, jnp.asarray(at, dtype)), np.float64
        )
        own = slopes(vector)
        curvature = np.empty((count, count))
        for place in range(count):
            step = np.zeros(count)
            step[place] = STEP
            curvature[place] = (slopes(vector + step).sum(axis=0) - slopes(vector - step).sum(axis=0)) / (2 * STEP)
    curvature = 0.5 * (curvature + curvature.T)
    centred = own - own.mean(axis=0)
    scatter = centred.T @ centred
    values, directions = np.linalg.eigh(curvature)
    firm = values > 1e-3 * max(float(np.abs(values).max()), 1e-12)
    inverse = (directions[:, firm] / values[firm]) @ directions[:, firm].T
    covariance = inverse @ scatter @ inverse
    variance = np.diag(covariance)
    # A share of each axis lies in directions of which nothing is known.
    unknown = np.sum(directions[:, ~firm] ** 2, axis=1)
    sd = np.where(unknown > 0.1, np.inf, np.sqrt(np.maximum(variance, 0.0)))
    together = _together(curvature, scatter, covariance, directions[:, ~firm])
    settings = np.asarray(space.values(vector), np.float64)
    return tuple(
        Fitted(name, float(value), float(one * step), bool(one < LOOSE), () if one < LOOSE else others)
        for name, value, one, step, others in zip(
            space.names,
            settings,
            sd,
            space.steps(vector),
            (tuple(space.names[place] for place in found) for found in together),
            strict=True,
        )
    )


def _together(
    curvature: np.ndarray, scatter: np.ndarray, covariance: np.ndarray, flat: np.ndarray
) -> list[tuple[int, ...]]:
    """Of each setting that is determined while all others are held: those that share a `flat` direction with it, or are
    as good as proportional to it in what is known of both."""
    own, spread = np.diag(curvature), np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    alone = (own > 0) & (np.sqrt(np.diag(scatter)) < LOOSE * own)
    shared = np.abs(flat @ flat.T) > SHARED
    proportional = np.abs(covariance) > CORRELATED * np.outer(spread, spread)
    linked = (shared | proportional) & np.outer(alone, alone) & ~np.eye(len(own), dtype=bool)
    return [tuple(int(other) for other in np.flatnonzero(row)) for row in linked]


@compiled_filtered
def _slopes(
    space: Space, detector: Any, costs: Costs, examples: Examples, temperature: float, vector: jax.Array
) -> jax.Array:
    """(logs, settings): of what each drive adds to the cost."""
    steps, hours = (jnp.sum(jnp.asarray(one, vector.dtype)) for one in (examples.real, examples.hours))

    def share(at: jax.Array) -> jax.Array:
        found = smooth_outcome(space.detector(detector, at), examples, temperature)
        return costs.total(found.missed, found.late_s, found.false, steps, hours)

    one = lambda direction: jax.jvp(share, (vector,), (direction,))[1]  # noqa: E731
    return jax.lax.map(one, jnp.eye(len(vector), dtype=vector.dtype)).T
