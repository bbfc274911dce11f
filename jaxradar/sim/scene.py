"""The idea of a scene: what emits and receives, what reflects, what moves, and a tuple of effects.

Not tied to roads. A scene is an `equinox.Module` of settings; an *effect* is a module of its own that does one thing to
one stage of the simulation. What a scene does not name is not in the traced program. Each effect draws from a random
stream of its own, named after its class and counted among its like, so that adding or removing one leaves the draws of
the others as they were.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Sequence
from typing import Any, ClassVar, TypeVar

import jax
from jaxtyping import Array, PRNGKeyArray

from jaxradar._settings import Settings

__all__ = ["Effect", "named_stream", "of_stage", "through"]

Value = TypeVar("Value")


class Effect(Settings):
    """One thing that a scene may call for.

    It is called with what its stage holds, what is known beside it, and a random key, and gives the same changed. Which
    stages there are is the kind of scene's to say.

    - `name`: what scene files and tables call it.
    - `stage`: which part of the simulation it changes.
    - `explains`: the observation that it is there for.
    - `smooth`: whether gradients flow through it (a rounding has none).
    - `alone`: whether a scene may hold only one of its kind.
    """

    name: ClassVar[str]
    stage: ClassVar[str]
    explains: ClassVar[str]
    smooth: ClassVar[bool] = True
    alone: ClassVar[bool] = True


def named_stream(key: PRNGKeyArray, name: str, index: int = 0) -> PRNGKeyArray:
    """The key of a part of a simulation: it depends on its name alone, not on what else there is."""
    return jax.random.fold_in(jax.random.fold_in(key, zlib.crc32(name.encode()) & 0x7FFFFFFF), index)


def of_stage(effects: Sequence[Effect], stage: str, key: PRNGKeyArray) -> Iterator[tuple[Any, PRNGKeyArray]]:
    """The effects of one stage in the scene's order, each with its own stream."""
    seen: dict[type[Effect], int] = {}
    for effect in effects:
        index = seen.get(type(effect), 0)
        seen[type(effect)] = index + 1
        if effect.stage == stage:
            yield effect, named_stream(key, effect.name, index)


def through(
    effects: Sequence[Effect], stage: str, value: Value, context: Any, key: PRNGKeyArray, moment: Array | None = None
) -> Value:
    """`value` as it is with all effects of a stage, one after the other. `moment`: the number of the sweep, folded
    into the streams of what is drawn anew in each."""
    for effect, stream in of_stage(effects, stage, key):
        value = effect(value, context, stream if moment is None else jax.random.fold_in(stream, moment))
    return value
