"""Gradient-based tuning of a detector's settings."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Float

from jaxradar._errors import ConfigError
from jaxradar._machine import cores
from jaxradar._numerics import compiled_filtered
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
    candidates: int = 256
    spread: float = 2.0
    temperatures: tuple[float, ...] = (0.3, 0.1, 0.03, 0.01)
    steps: int = 32
    logs: int = 64
    seed: int = 0


Ending = Literal["converged", "out of steps", "not finite"]


@dataclasses.dataclass(frozen=True)
class Start:
    """One start: its vector after each stage, (stages + 1, settings), its cost there on the drives that are kept for
    validation, (stages + 1,), and how the solver ended in each stage, (stages,).

    `converged`: it stopped moving. `out of steps`: it had not yet. `not finite`: the cost, or where it led, is no
    number.
    """

    vectors: np.ndarray
    costs: np.ndarray
    outcomes: tuple[Ending, ...]


@dataclasses.dataclass(frozen=True)
class Tuned:
    """What a fit came to.

    - `detector`: at the least cost on the drives kept for validation; `vector`: where it stands in `space`. `before`,
      `after`: that cost of the detector that was given, and of this one, at the last temperature.
    - `starts`: how each went; `best`: which of them was taken.
    """

    detector: StepDetector[Any, Any]
    space: Space
    vector: np.ndarray
    before: float
    after: float
    starts: tuple[Start, ...]
    best: int


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

    Each stage minimises the logarithm of the cost on a mini-batch by BFGS (`optimistix.BFGS`), the starts shared out
    among threads; a start that costs more on `kept` after a stage than before goes on from before, and when two
    stages in a row brought none on, the fit ends. `progress` hears how many stages are done, of how many. Raises
    `ConfigError` for settings that cannot be tuned, and where no start has a finite cost.
    """
    costs, plan = costs or Costs(), plan or Plan()
    space = Space.of(detector, names)
    random = np.random.default_rng(plan.seed)
    own = space.vector(detector)
    last = plan.temperatures[-1]
    logs = min(plan.logs, examples.logs)
    value = lambda held, vectors: costs_of(space, detector, costs, held, last, vectors, logs)  # noqa: E731
    drawn = own + plan.spread * random.normal(size=(plan.candidates, len(own)))
    few = examples.pick(random.permutation(examples.logs)[:logs])
    order = np.argsort(value(few, drawn))
    vectors = np.vstack([own, drawn[order[: plan.starts - 1]]])
    held, scores = [vectors], [value(kept, vectors)]
    outcomes: list[list[Ending]] = []
    if not np.isfinite(scores[0]).any():
        raise ConfigError("no start has a finite cost on the drives kept for validation.")
    waited = 0
    for stage, temperature in enumerate(plan.temperatures, 1):
        batch = examples.pick(random.permutation(examples.logs)[:logs])
        moved, ended = _solve_all(space, detector, costs, batch, temperature, vectors, plan.steps, compiled=stage > 1)
        outcomes.append(ended)
        found = value(kept, moved)
        better = np.isfinite(found) & ~(found >= scores[-1])
        vectors = np.where(better[:, None], moved, vectors)
        held.append(vectors)
        scores.append(np.where(better, found, scores[-1]))
        progress(stage, len(plan.temperatures))
        # Two stages that brought nobody on, on drives that none was fitted to: the rest would not either.
        waited = 0 if better.any() else waited + 1
        if waited == PATIENCE:
            break
    best = int(np.nanargmin(scores[-1]))
    starts = tuple(
        Start(
            np.stack([one[place] for one in held]),
            np.array([one[place] for one in scores]),
            tuple(one[place] for one in outcomes),
        )
        for place in range(len(vectors))
    )
    # A setting on a bound has no place in the vector: what was not moved is given back as it was.
    stayed = np.array_equal(vectors[best], own)
    tuned = detector if stayed else space.detector_at(detector, vectors[best])
    return Tuned(tuned, space, vectors[best], float(scores[0][0]), float(scores[-1][best]), starts, best)


def costs_of(
    space: Space,
    detector: StepDetector[Any, Any],
    costs: Costs,
    examples: Examples,
    temperature: float,
    vectors: Float[np.ndarray, "vectors settings"],
    part: int,
) -> Float[np.ndarray, " vectors"]:
    """Of each vector on all drives, a `part` of them at a time: one program, whatever the number of drives is."""
    places = np.arange(-(-examples.logs // part) * part).reshape(-1, part)
    with precision(detector):
        dtype = jnp.result_type(float)
        arguments = jnp.asarray(temperature, dtype), jnp.asarray(vectors, dtype)
        shares = [_sums(space, detector, examples.pick(one % examples.logs), *arguments) for one in places]
        # What fills up the last part was counted before.
        sums = np.concatenate([np.asarray(one, np.float64) for one in shares], axis=-1)[..., : examples.logs].sum(-1)
    missed, late_s, false = sums.T
    found = costs.total(missed, late_s, false, float(np.sum(examples.real)), float(np.sum(examples.hours)))
    return np.asarray(found, np.float64)


def _cost(
    space: Space, detector: Any, costs: Costs, examples: Examples, temperature: Any, vector: jax.Array
) -> jax.Array:
    outcome = smooth_outcome(space.detector(detector, vector), examples, temperature)
    return jnp.asarray(outcome.cost(examples.hours, costs))


@compiled_filtered
def _sums(space: Space, detector: Any, examples: Examples, temperature: jax.Array, vectors: jax.Array) -> jax.Array:
    """(vectors, 3, logs): misses, lateness and false alarms of each drive. Of each vector, one after the other: side by
    side they would want the memory of all."""

    def one(vector: jax.Array) -> jax.Array:
        found = smooth_outcome(space.detector(detector, vector), examples, temperature)
        return jnp.stack([found.missed, found.late_s, found.false])

    return jax.lax.map(one, vectors)


def _solve_all(
    space: Space,
    detector: Any,
    costs: Costs,
    examples: Examples,
    temperature: float,
    vectors: np.ndarray,
    steps: int,
    *,
    compiled: bool,
) -> tuple[np.ndarray, list[Ending]]:
    """Each start by itself: none waits for the slowest line search. `compiled`: whether the program is there; where it
    is not, the first start makes it for all."""

    def one(vector: np.ndarray) -> tuple[np.ndarray, Ending]:
        with precision(detector):  # a context of JAX belongs to one thread
            dtype = jnp.result_type(float)
            moved, cost, converged = _solve(
                space,
                detector,
                costs,
                examples,
                jnp.asarray(temperature, dtype),
                jnp.asarray(vector, dtype),
                steps,
            )
            where = np.asarray(moved, np.float64)
        if not (np.isfinite(cost) and np.isfinite(where).all()):
            return where, "not finite"
        return where, "converged" if converged else "out of steps"

    alone = 0 if compiled else 1
    with ThreadPoolExecutor(cores()) as pool:
        found = [*map(one, vectors[:alone]), *pool.map(one, vectors[alone:])]
    return np.stack([where for where, _ in found]), [ended for _, ended in found]


@compiled_filtered
def _solve(
    space: Space,
    detector: Any,
    costs: Costs,
    examples: Examples,
    temperature: jax.Array,
    vector: jax.Array,
    steps: int,
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Where it ends, the logarithm of the cost there, and whether it stopped moving."""

    def objective(vector: jax.Array, args: Any) -> Any:
        found = jnp.log(_cost(space, detector, costs, args[0], args[1], vector) + 1e-9)
        return found, found

    solver: Any = optx.BFGS(rtol=1e-3, atol=1e-3)
    found: Any = optx.minimise(
        objective, solver, vector, args=(examples, temperature), max_steps=steps, throw=False, has_aux=True
    )
    return found.value, found.aux, found.result == optx.RESULTS.successful
