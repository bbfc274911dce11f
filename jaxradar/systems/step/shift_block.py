"""The shift detector over a block: what is costly is done for all sweeps at once, what remembers one by one."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, UInt

from jaxradar._numerics import finite, reductions, row_major
from jaxradar.signal.clutter import subtract_floor
from jaxradar.signal.peaks import window_at
from jaxradar.systems.step.config import BlockSweeps, Decision, RangeAxis, each_sweep, is_saturated
from jaxradar.systems.step.shift_states import Followed, ShiftState

if TYPE_CHECKING:
    from jaxradar.systems.step.shift import ShiftDetector

__all__ = ["follow_block"]


def follow_block(
    detector: ShiftDetector,
    axis: RangeAxis,
    state: ShiftState,
    sweeps: BlockSweeps,
    flags: UInt[Array, "logs sweeps"],
    dt: Float[Array, "logs sweeps"],
) -> tuple[ShiftState, Decision]:
    """`StepDetector.follow` with the steps of `observe` and `track` of all sweeps side by side.

    Except where the sweeps are read as recorded, the logs are the last axis of all arrays, so that they fill the
    processor's registers whatever the number of cells is; and that axis is the last in memory, too.
    """
    state = jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 0, -1), state)
    cells = row_major(each_sweep(lambda sweep: detector.averaged(axis, finite(sweep)))(sweeps()))
    flags, steps = row_major(flags.T), row_major(dt.T)
    with reductions("plain"):
        selected = _by_step_and_log(partial(detector.select, axis))(row_major(jnp.transpose(cells, (1, 2, 0))))
        selected = jax.tree.map(row_major, selected)
    read = each_sweep(lambda sweep, near: detector.estimator(axis).read(sweep, near))
    start, taps = read(sweeps(), selected.near.T)
    with reductions("plain"):
        refined = _by_step_and_log(partial(detector.refine, axis))(
            selected.near, row_major(start.T), row_major(jnp.transpose(row_major(taps), (1, 2, 0)))
        )
    # As in `observe`; but looking at all bins again is left out of a block without a saturated sweep.
    position = jax.lax.cond(
        jnp.any(is_saturated(flags)),
        lambda: _with_clipped_tops(detector, sweeps(), flags.T, refined.T).T,
        lambda: refined,
    )
    seen = jax.tree.map(row_major, _by_step_and_log(partial(detector.observed, axis))(selected, position, flags))
    with reductions("plain"):
        remember = _by_log(detector.remember)
        memory, recalled = jax.lax.scan(lambda before, now: remember(before, *now), state.memory, (seen, steps))
        shifts = jax.tree.map(row_major, _by_step_and_log(partial(detector.compare, axis))(seen, recalled))
        by_step = (jnp.arange(cells.shape[1]), selected.floor.level, seen, recalled, shifts, steps)
        echo, decisions = jax.lax.scan(partial(_follow_echo, detector, axis, cells), state.echo, by_step)
    after = jax.tree.map(lambda leaf: jnp.moveaxis(leaf, -1, 0), ShiftState(memory, echo))
    return after, jax.tree.map(jnp.transpose, decisions)


def _follow_echo(
    detector: ShiftDetector, axis: RangeAxis, cells: Array, echo: Followed, now: Any
) -> tuple[Followed, Decision]:
    """One step of time for all logs, with the few cells that it needs read where those of a sweep lie together.

    As in `track`, but for that: the floor is taken away from these cells again.
    """
    step, levels, seen, recalled, shifts, dt = now
    evidence = _by_log(partial(detector.weigh, axis))(echo, seen, recalled, shifts)
    read = jax.vmap(lambda profiles, middle: window_at(profiles[step], middle, detector.search_half_width(axis)))
    start, taps = read(cells, evidence.cell)
    around = start, _by_log(subtract_floor)(row_major(taps.T), levels)
    return _by_log(partial(detector.decide, axis))(echo, seen, recalled, evidence, around, dt)


def _with_clipped_tops(detector: ShiftDetector, sweeps: Array, flags: Array, refined: Array) -> Array:
    clipped, middle = each_sweep(detector.clipped_top)(sweeps, flags)
    return jnp.where(clipped, middle, refined)


def _by_step_and_log(function: Callable[..., Any]) -> Callable[..., Any]:
    """Over arrays of shape (sweeps, ..., logs)."""
    return jax.vmap(_by_log(function))


def _by_log(function: Callable[..., Any]) -> Callable[..., Any]:
    """Over arrays of shape (..., logs)."""
    return jax.vmap(function, in_axes=-1, out_axes=-1)
