"""A batch gone through in blocks: a few logs, or a few sweeps of all logs, at a time."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxradar._errors import ConfigError
from jaxradar._toml import nearest
from jaxradar.drive import SweepFlag
from jaxradar.systems.step.config import Decision, MotionSample, RangeAxis, StepDetector

# Sweeps in a block: what is made of them stays in the processor's cache, and a block's loops outweigh their starts.
BLOCK_BY_LOGS = 32768
BLOCK_BY_TIME = 4096
# From so many bins on a sweep outweighs all that is made of it (some 50 bytes), and the batch is gone through at once:
# the compiler copies a block of long sweeps before it reads it.
WHOLE_FROM_BINS = 400

__all__ = ["advance", "check_fields", "check_shapes", "in_blocks", "initial"]

Block = Callable[..., tuple[Any, Any]]


def check_fields(fields: Iterable[str]) -> None:
    """Raises `ConfigError` for a name that no `Decision` has."""
    known = [field.name for field in dataclasses.fields(Decision)]
    for name in fields:
        if name not in known:
            raise ConfigError(f"unknown field `{name}`{nearest(name, known)}; expected {', '.join(known)}.")


def check_shapes(axis: RangeAxis, sweeps: Any, flags: Any, dt: Any, lengths: Any) -> None:
    """Raises `ValueError`, with all shapes, unless these make a batch."""
    shapes = [values.shape for values in (sweeps, flags, dt, lengths)]
    logs_and_sweeps = sweeps.shape[:2]
    if shapes != [(*logs_and_sweeps, axis.bins), logs_and_sweeps, logs_and_sweeps, logs_and_sweeps[:1]]:
        raise ValueError(
            "expected sweeps, flags, dt and lengths of shapes (logs, sweeps, bins), (logs, sweeps), (logs, sweeps) and "
            f"(logs,) with {axis.bins} bins; got {', '.join(map(str, shapes))}."
        )


def in_blocks(
    detector: StepDetector[Any, Any],
    axis: RangeAxis,
    pick: Callable[[Decision], Any],
    *inputs: Array,
    motion: MotionSample | None = None,
) -> Any:
    """What `pick` makes of all decisions, as (logs, sweeps, ...). `inputs`: as `check_shapes` takes them."""
    block, start = partial(_block, detector, axis, pick), partial(initial, detector, axis)
    logs, sweeps = inputs[1].shape
    if not logs or not sweeps:
        one_sweep = jax.tree.map(
            lambda values: jnp.zeros((1, 1, *values.shape[2:])[: values.ndim], values.dtype), (*inputs, motion)
        )
        shapes = jax.eval_shape(partial(_by_logs, block, start), *one_sweep)
        return jax.tree.map(lambda leaf: jnp.zeros((logs, sweeps, *leaf.shape[2:]), leaf.dtype), shapes)
    if detector.sequential:
        return _by_time(block, start(logs), *inputs, motion)[1]
    return _by_logs(block, start, *inputs, motion)


def advance(
    detector: StepDetector[Any, Any],
    axis: RangeAxis,
    pick: Callable[[Decision], Any],
    state: Any,
    *inputs: Array,
    motion: MotionSample | None = None,
) -> tuple[Any, Any]:
    """As `in_blocks`, from a state on for each log (`initial` gives the first), with the states after the last sweep.

    Sweeps beyond a log's length leave nothing in its state that a later call could use: begin it anew.
    """
    block = partial(_block, detector, axis, pick)
    if detector.sequential:
        return _by_time(block, state, *inputs, motion)
    sweeps, flags, dt, lengths = inputs
    return block(state, lambda: sweeps, flags, dt, lengths, motion)


def _block(
    detector: StepDetector[Any, Any],
    axis: RangeAxis,
    pick: Callable[[Decision], Any],
    state: Any,
    sweeps: Callable[[], Array],
    flags: Array,
    dt: Array,
    left: Array,
    motion: MotionSample | None,
) -> tuple[Any, Any]:
    """One block, of which the first `left` sweeps of each log are real."""
    beyond = jnp.arange(flags.shape[1]) >= left[:, None]
    flags = jnp.where(beyond, flags | np.uint16(SweepFlag.NO_AMPLITUDES), flags).astype(jnp.uint16)
    state, decisions = detector.follow(axis, state, sweeps, flags, dt, motion)
    return state, pick(decisions)


def initial(detector: StepDetector[Any, Any], axis: RangeAxis, logs: int) -> Any:
    """The state before the first sweep, for each log."""
    return jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (logs, *jnp.shape(leaf))), detector.init(axis))


def _block_size(count: int, wanted: int) -> int:
    """The largest divisor of `count` that is not above `wanted`, or `wanted` if all of them are far smaller."""
    wanted = max(1, min(count, wanted))
    divisor = next(one for one in range(wanted, 0, -1) if count % one == 0)
    return divisor if 2 * divisor >= wanted else wanted


def _cut(values: Any, first: Any, count: int, axis: int) -> Any:
    """So many logs, or sweeps, of what is an array, or arrays, or None."""
    return jax.tree.map(lambda one: jax.lax.dynamic_slice_in_dim(one, first, count, axis), values)


def _by_logs(block: Block, start: Callable[[int], Any], *inputs: Any) -> Any:
    """A few logs at a time, each from its first sweep to its last."""
    logs, sweeps = inputs[1].shape
    part = logs if inputs[0].shape[2] >= WHOLE_FROM_BINS else _block_size(logs, BLOCK_BY_LOGS // sweeps)
    groups = logs // part

    def one(first: Any, count: int) -> Any:
        cut = [partial(_cut, values, first, count, 0) for values in inputs]
        return block(start(count), cut[0], *(values() for values in cut[1:]))[1]

    if groups == 1:
        done = one(0, part)
    else:
        done = jax.lax.map(partial(one, count=part), part * jnp.arange(groups, dtype=jnp.int32))
        done = jax.tree.map(lambda leaf: leaf.reshape(groups * part, *leaf.shape[2:]), done)
    if groups * part == logs:
        return done
    rest = one(groups * part, logs - groups * part)
    return jax.tree.map(lambda a, b: jnp.concatenate([a, b]), done, rest)


def _by_time(block: Block, state: Any, *inputs: Any) -> tuple[Any, Any]:
    """All logs side by side, a few sweeps at a time; with the states after the last of them."""
    *columns, lengths, motion = inputs
    columns.append(motion)
    logs, sweeps = columns[1].shape
    part = _block_size(sweeps, BLOCK_BY_TIME // logs)
    blocks = sweeps // part

    def one(state: Any, first: Any) -> Any:
        cut = [partial(_cut, values, first, part, 1) for values in columns]
        return block(state, cut[0], cut[1](), cut[2](), lengths - first, cut[3]())

    state, done = jax.lax.scan(one, state, part * jnp.arange(blocks, dtype=jnp.int32))
    done = jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 0, 1).reshape(logs, blocks * part), done)
    if blocks * part == sweeps:
        return state, done
    first = blocks * part
    cut = [partial(_cut, values, first, sweeps - first, 1) for values in columns]
    state, ending = block(state, cut[0], cut[1](), cut[2](), lengths - first, cut[3]())
    return state, jax.tree.map(lambda a, b: jnp.concatenate([a, b], axis=1), done, ending)
