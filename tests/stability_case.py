"""A case of the table of what must stay stable: a function of one input, its hard inputs, its oracle, its bounds."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import partial
from itertools import product
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import stability_oracles as oracles

Inputs = dict[str, tuple[Any, ...]]
# Eight roundings in float32 of an echo 8 bins wide, against the bound of 1e-4 of the axis.
ROUNDED = 8 * 2.0**-24 * 8 / 1e-4


@dataclasses.dataclass(frozen=True, eq=False)
class Case:
    """`function`: of the arrays of one input, gives named numbers and flags. `inputs`: by size, or None as the size.

    `answer`: what the oracle says of one input. `scale`: what the error of each number is divided by, in words for the
    report; `bound`: on that error in float32, `bound64` in float64. `smooth`: the arguments to differentiate by,
    `settings`: those of them, scalars, that tuning bends (a second derivative). `flat`: numbers that have no gradient
    by contract. `undefined`: inputs whose answer is open, only to be finite.
    """

    name: str
    covers: tuple[str, ...]
    function: Callable[..., dict[str, Any]]
    inputs: Callable[[Any], Inputs]
    answer: Callable[..., dict[str, Any]]
    scale: dict[str, str]
    bound: float
    bound64: float = 1e-9
    sizes: tuple[Any, ...] = (None,)
    quick: tuple[Any, ...] = (None,)  # the sizes of the plain run and of the golden file
    smooth: tuple[int, ...] = (0,)
    settings: tuple[int, ...] = ()
    flat: frozenset[str] = frozenset()
    undefined: frozenset[str] = frozenset()
    dtypes: tuple[str, ...] = ("float32", "float64")

    def scale_of(self, key: str, arguments: tuple[Any, ...], wanted: Any) -> float:
        kind, first = self.scale[key], np.asarray(arguments[0], np.float64)
        if kind == "1":
            return 1.0
        if kind == "bins":
            return float(first.shape[0])
        if kind == "bins, or what rounding leaves":
            # Of an echo on an offset, sums keep that much less than of the echo alone.
            seen = oracles.finite(first)
            contrast = float(np.abs(seen).max()) / max(float(np.ptp(seen)), 1e-300)
            return max(float(first.shape[0]), ROUNDED * min(contrast, 1e300))
        if kind == "largest":
            return max(float(np.abs(oracles.finite(first)).max()), 1e-300)
        if kind == "largest step in the shortest time":
            steps = np.abs(np.asarray(arguments[1]))
            largest = max(float(np.abs(np.diff(first)).max(initial=0.0)), 1e-7 * float(np.abs(first).max()))
            return largest / float(np.min(steps, where=steps > 0, initial=1.0)) or 1.0
        if kind == "steps":  # of so many metres in the shortest time
            steps = np.asarray(arguments[1])
            return 1.0 / float(np.min(steps, where=steps > 0, initial=1.0))
        assert kind == "itself"
        return np.maximum(np.abs(np.asarray(wanted)), 1e-300)


def stacked(inputs: Inputs, dtype: Any) -> tuple[np.ndarray, ...]:
    """All inputs of one shape as one batch; whole numbers stay as they are."""
    columns = zip(*inputs.values(), strict=True)
    with np.errstate(over="ignore"):
        return tuple(
            np.stack([np.asarray(one) if np.issubdtype(np.asarray(one).dtype, np.integer) else np.asarray(one, dtype)
                      for one in column])
            for column in columns
        )  # fmt: skip


def loss(case: Case, *arguments: Any) -> Any:
    """One number through which everything that the function gives flows."""
    given = case.function(*arguments)
    whole = [one for one in given.values() if jnp.issubdtype(jnp.asarray(one).dtype, jnp.floating)]
    return sum(jnp.sum(one) for one in whole)


def bend(case: Case, *arguments: Any) -> Any:
    """Second derivatives by all settings, each after itself and after the others."""
    places = case.settings

    def slopes(*moved: Any) -> Any:
        given = list(arguments)
        for place, one in zip(places, moved, strict=True):
            given[place] = one
        return jax.grad(partial(loss, case), argnums=places)(*given)

    return jax.jacfwd(slopes, argnums=tuple(range(len(places))))(*(arguments[place] for place in places))


def derivatives(case: Case, *arguments: Any) -> dict[str, Any]:
    """Gradient and second derivative of one input: one program."""
    return {
        "gradient": jax.grad(partial(loss, case), argnums=case.smooth)(*arguments) if case.smooth else (),
        "bend": bend(case, *arguments) if case.settings else (),
    }


def scalars(*columns: tuple[float, ...]) -> Inputs:
    return {
        " and ".join(f"{value:g}" for value in values): tuple(np.float64(np.float32(value)) for value in values)
        for values in product(*columns)
    }


def as_before(inputs: dict[str, np.ndarray]) -> Inputs:
    return {name: (one,) for name, one in inputs.items()}


def crossed(inputs: dict[str, np.ndarray], **settings: tuple[float, ...]) -> Inputs:
    """Each input with each of the settings' hard values."""
    return {
        ", ".join([name, *(f"{key} {value:g}" for key, value in zip(settings, values, strict=True))]): (
            one,
            *(np.float32(value) for value in values),
        )
        for name, one in inputs.items()
        for values in product(*settings.values())
    }
