"""Gradient-based tuning of a detector's settings."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx

from jaxradar._errors import ConfigError
from jaxradar.systems.step import StepDetector, precision
from jaxradar.tuning.examples import Examples
from jaxradar.tuning.loss import Costs, smooth_outcome
from jaxradar.tuning.space import Space

__all__ = ["Plan", "Start", "Tuned", "tune"]

PATIENCE = 2


@dataclasses.dataclass(frozen=True)
class Plan:
    """How the settings are looked for.

    - `starts`: side by side in one solve: the detector as it is, and those that cost least of `candidates`, drawn
      around it with the standard deviation `spread` in each direction of the vector. Far from every step the cost is
      flat, and no slope leads out of there.
    - `temperatures`: of the decision, one stage each, falling. `steps`: most steps of the solver in a stage.
    - `logs`: in the mini-batch of a stage; the next has others.
    - `seed`: of starts and mini-batches.
    """

    starts: int = 4
    candidates: int = 32
    spread: float = 1.5
    temperatures: tuple[float, ...] = (0.3, 0.1, 0.05)
    steps: int = 16
    logs: int = 64
    seed: int = 0


@dataclasses.dataclass(frozen=True)
class Start:
    """One start: its vector after each stage, (stages + 1, settings), and its cost there on the drives that are kept
    for validation, (stages + 1,)."""

    vectors: np.ndarray
    costs: np.ndarray


@dataclasses.dataclass(frozen=True)
class Tuned:
    """What a fit came to.

    - `detector`: at the least cost on the drives kept for validation; `vector`: where it stands in `space`. `before`,
      `after`: that cost of the detector that was given, and of this one, at the last temperature.
    - `starts`: how each went.
    """

    detector: StepDetector[Any, Any]
    space: Space
    vector: np.ndarray
    before: float
    after: float
    starts: tuple[Start, ...]


def tune(
    detector: StepDetector[Any, Any],
    names: Sequence[str],
    examples: Examples,
    kept: Examples,
    *,
    costs: Costs | None = None,
    plan: Plan | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Tuned:
    """Move the settings `names` so that the detector costs less on `examples`, and take what costs least on `kept`.

    Each stage minimises the logarithm of the cost on a mini-batch by BFGS (`optimistix.BFGS`), all starts in one
    vmapped solve; a start that costs more on `kept` after a stage than before goes on from before, and when two
    stages in a row brought none on, the fit ends. `progress` hears how many stages are done, of how many. Raises
    `ConfigError` for settings that cannot be tuned, and where no start has a finite cost.
    """
    costs, plan = costs or Costs(), plan or Plan()
    space = Space.of(detector, names)
    random = np.random.default_rng(plan.seed)
    own = space.vector(detector)
    last = plan.temperatures[-1]
    with precision(detector):
        dtype = jnp.result_type(float)
        drawn = own + plan.spread * random.normal(size=(plan.candidates, len(own)))
        few = examples.pick(random.permutation(examples.logs)[: plan.logs])
        order = np.argsort(np.asarray(_costs_of(space, detector, costs, few, last, jnp.asarray(drawn, dtype))))
        vectors = jnp.asarray(np.vstack([own, drawn[order[: plan.starts - 1]]]), dtype)
        held = [np.asarray(vectors)]
        scores = [np.asarray(_costs_of(space, detector, costs, kept, last, vectors))]
        if not np.isfinite(scores[0]).any():
            raise ConfigError("no start has a finite cost on the drives kept for validation.")
        waited = 0
        for stage, temperature in enumerate(plan.temperatures, 1):
            logs = random.permutation(examples.logs)[: plan.logs]
            moved = _solve(space, detector, costs, examples.pick(logs), temperature, vectors, plan.steps)
            found = np.asarray(_costs_of(space, detector, costs, kept, last, moved))
            better = np.isfinite(found) & ~(found >= scores[-1])
            vectors = jnp.where(better[:, None], moved, vectors)
            held.append(np.asarray(vectors))
            scores.append(np.where(better, found, scores[-1]))
            progress(stage, len(plan.temperatures))
            # Two stages that brought nobody on, on drives that none was fitted to: the rest would not either.
            waited = 0 if better.any() else waited + 1
            if waited == PATIENCE:
                break
    best = int(np.nanargmin(scores[-1]))
    vector = held[-1][best].astype(np.float64)
    tuned = space.detector_at(detector, vector)
    starts = tuple(
        Start(np.stack([one[place] for one in held]), np.array([one[place] for one in scores]))
        for place in range(len(vectors))
    )
    return Tuned(tuned, space, vector, float(scores[0][0]), float(scores[-1][best]), starts)


@eqx.filter_jit
def _costs_of(
    space: Space, detector: Any, costs: Costs, examples: Examples, temperature: float, vectors: jax.Array
) -> jax.Array:
    """Of each start, one after the other: side by side they would want the memory of all."""
    return jax.lax.map(lambda vector: _cost(space, detector, costs, examples, temperature, vector), vectors)


def _cost(
    space: Space, detector: Any, costs: Costs, examples: Examples, temperature: Any, vector: jax.Array
) -> jax.Array:
    outcome = smooth_outcome(space.detector(detector, vector), examples, temperature)
    return jnp.asarray(outcome.cost(examples.hours, costs))


@eqx.filter_jit
def _solve(
    space: Space,
    detector: Any,
    costs: Costs,
    examples: Examples,
    temperature: Any,
    vectors: jax.Array,
    steps: int,
) -> jax.Array:
    def objective(vector: jax.Array, args: Any) -> jax.Array:
        return jnp.log(_cost(space, detector, costs, args[0], args[1], vector) + 1e-9)

    solver: Any = optx.BFGS(rtol=1e-3, atol=1e-3)

    def one(vector: jax.Array) -> jax.Array:
        found: Any = optx.minimise(
            objective, solver, vector, args=(examples, temperature), max_steps=steps, throw=False
        )
        return jnp.asarray(found.value)

    return jax.vmap(one)(vectors)
