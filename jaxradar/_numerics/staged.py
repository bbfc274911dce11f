"""Reductions over the last axis, in the shape that the processor wants.

XLA turns a reduction over the last axis into a chain of single numbers on a CPU. Here the axis is cut into slices of
`LANES` bins, one vector register or two, which are combined element by element in a tree; a chain is left for the last
`LANES` alone. An axis that is no multiple of `LANES` has its last slice filled up, so that any length will do.
An accelerator reduces well by itself: there the plain form is taken, and so it is where sweeps lie side by side, the
batch being the last axis in memory (`reductions("plain")`). The maxima (but for the sign of 0) and the arg-maxima are
the same bit by bit in both forms, with one rule for ties, so that no platform moves a peak; sums agree within rounding
(the tree errs less than a chain).
"""

from __future__ import annotations

import contextlib
import contextvars
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Shaped

__all__ = [
    "covering_slices",
    "cpu_shaped",
    "from_ordered_bits",
    "in_stages",
    "largest",
    "largest_of",
    "largest_row",
    "ordered_bits",
    "reductions",
    "slice_starts",
    "sliced",
    "smallest",
    "summed",
    "total",
    "totals",
    "tree",
    "written_out",
]

LANES = 32
LONGEST_SUM = 24  # terms
MOST_STAGED = 8192  # bins; the program's size grows with them, so what is longer is reduced in the plain form

Values = Shaped[Array | np.ndarray, "*shape bins"]
Reduced = Shaped[Array, "*shape"]
Rows = Shaped[Array | np.ndarray, "rows *shape"]
Combine = Callable[[Any, Any], Any]

_form: contextvars.ContextVar[str] = contextvars.ContextVar("form", default="by platform")


@contextlib.contextmanager
def reductions(form: str) -> Iterator[None]:
    """What is traced inside reduces in the `"staged"` or the `"plain"` form, whatever the platform."""
    if form not in ("staged", "plain"):
        raise ValueError(f'`reductions(form=...)` must be "staged" or "plain"; got {form!r}.')
    token = _form.set(form)
    try:
        yield
    finally:
        _form.reset(token)


def cpu_shaped() -> bool:
    """Whether to trace the form that a CPU wants. The one place that chooses."""
    form = _form.get()
    return jax.default_backend() == "cpu" if form == "by platform" else form == "staged"


def written_out(values: Any) -> Any:
    """The same, made before it is read: where a CPU's loops want it. In the plain form it is left to the compiler."""
    return jax.lax.optimization_barrier(values) if cpu_shaped() else values


def in_stages(values: Array) -> bool:
    """Whether to reduce these in the staged form."""
    return cpu_shaped() and 0 < values.shape[-1] <= MOST_STAGED


def _filled_slices(values: Array) -> list[Array]:
    """Slices of `LANES` bins, the last one filled up with 0."""
    count = values.shape[-1]
    parts = [values[..., start : start + LANES] for start in range(0, count, LANES)]
    if count > LANES and count % LANES:
        parts[-1] = jnp.pad(parts[-1], [(0, 0)] * (values.ndim - 1) + [(0, -count % LANES)])
    return parts


def slice_starts(count: int) -> list[int]:
    """Where slices begin that cover all bins, some of them twice: that moves no extreme."""
    starts = list(range(0, count - LANES + 1, LANES)) or [0]
    return starts if count <= LANES or starts[-1] + LANES == count else [*starts, count - LANES]


def covering_slices(values: Array) -> list[Array]:
    return [values[..., start : start + LANES] for start in slice_starts(values.shape[-1])]


def tree(parts: list[Any], combine: Combine) -> Any:
    while len(parts) > 1:
        odd = parts[-1:] if len(parts) % 2 else []
        parts = [combine(a, b) for a, b in zip(parts[::2], parts[1::2], strict=False)] + odd
    return parts[0]


def total(values: Values) -> Reduced:
    """Sum over the last axis, of the type that `jnp.sum` gives."""
    values = jnp.asarray(values)
    return _total(values) if in_stages(values) else _plain_sum(values)


def _plain_sum(values: Array) -> Array:
    """Sum over the last axis in parts of `LONGEST_SUM`: what is longer XLA's CPU compiler turns into sums over windows,
    which take four times as long where that axis is not the last in memory."""
    count = values.shape[-1]
    if jax.default_backend() != "cpu" or not LONGEST_SUM < count <= MOST_STAGED:
        return jnp.sum(values, axis=-1)
    parts = -(-count // LONGEST_SUM)
    ends = [count * part // parts for part in range(parts + 1)]
    return tree([jnp.sum(values[..., a:b], axis=-1) for a, b in pairwise(ends)], jnp.add)


@jax.custom_jvp
def _total(values: Array) -> Array:
    wide = values.astype(jax.eval_shape(jnp.sum, values).dtype)
    return jnp.sum(tree(_filled_slices(wide), jnp.add), axis=-1)


@_total.defjvp
def _total_jvp(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    # The plain sum transposes to a broadcast, a tree of slices to as many padded arrays.
    return _total(*primals), jnp.sum(tangents[0], axis=-1)


def totals(function: Callable[..., tuple[Array, ...]], *arrays: Values) -> tuple[Reduced, ...]:
    """Sums over the last axis of each of the arrays that `function` makes of `arrays`, element by element.

    As `tuple(total(y) for y in function(*arrays))`, but for the form: `function` is applied to one slice after the
    other, so that what is dear in it (an exponential) is computed once for all sums.
    """
    return summed([function(*part) for part in sliced(*arrays)], arrays[0].shape[-1])


def sliced(*arrays: Values) -> list[tuple[Array, ...]]:
    """The slices of some arrays of one last axis, for terms that `summed` adds up; one slice in the plain form."""
    whole = [jnp.asarray(one) for one in arrays]
    if not in_stages(whole[0]):
        return [tuple(whole)]
    return list(zip(*(_filled_slices(one) for one in whole), strict=True))


def summed(terms: Sequence[tuple[Array, ...]], count: int) -> tuple[Reduced, ...]:
    """The sums of terms made slice by slice out of what `sliced` gave for an axis of `count` bins."""
    *others, last = terms
    filled = len(terms) * last[0].shape[-1] - count
    if filled:
        real = jnp.arange(last[0].shape[-1]) < last[0].shape[-1] - filled
        last = tuple(jnp.where(real, one, 0) for one in last)
    sums = tree([*others, last], lambda a, b: tuple(x + y for x, y in zip(a, b, strict=True)))
    return tuple(_plain_sum(one) for one in sums)


def largest_of(of: Callable[..., Array], *arrays: Values) -> Reduced:
    """`largest(of(*arrays))`, for an `of` that goes element by element: applied to one slice after the other.

    No gradient flows through it.
    """
    whole = [jax.lax.stop_gradient(jnp.asarray(one)) for one in arrays]
    if not in_stages(whole[0]):
        return jnp.max(of(*whole), axis=-1)
    return _reduced(
        [of(*part) for part in zip(*map(covering_slices, whole), strict=True)], jnp.maximum, jnp.max, jnp.nan
    )


def largest(values: Values) -> Reduced:
    """Maximum over the last axis; in the staged form NaN if there is one. Equal maxima share the gradient equally."""
    values = jnp.asarray(values)
    return _largest(values) if in_stages(values) else jnp.max(values, axis=-1)


def smallest(values: Values) -> Reduced:
    """Minimum over the last axis; in the staged form NaN if there is one. Equal minima share the gradient equally."""
    values = jnp.asarray(values)
    return _smallest(values) if in_stages(values) else jnp.min(values, axis=-1)


@jax.custom_jvp
def _largest(values: Array) -> Array:
    return _reduced(covering_slices(values), jnp.maximum, jnp.max, jnp.nan)


@jax.custom_jvp
def _smallest(values: Array) -> Array:
    return _reduced(covering_slices(values), jnp.minimum, jnp.min, -jnp.nan)


def _reduced(parts: list[Array], combine: Combine, reduce: Callable[..., Array], nan: float) -> Array:
    lanes = tree(parts, combine)
    if lanes.dtype != jnp.float32:
        return reduce(lanes, axis=-1)
    # As integers of the same order: the compiler does not chain those. A NaN must win: of all floats, the negative one
    # has the lowest integer, the positive one the highest.
    return from_ordered_bits(reduce(ordered_bits(jnp.where(jnp.isnan(lanes), nan, lanes)), axis=-1))


def _shared(extreme: Callable[[Array], Array]) -> Callable[..., tuple[Array, Array]]:
    def rule(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
        (values,), (change,) = primals, tangents
        found = extreme(values)
        equal = (values == found[..., None]).astype(change.dtype)
        return found, jnp.sum(change * equal, axis=-1) / jnp.maximum(jnp.sum(equal, axis=-1), 1)

    return rule


@jax.custom_jvp
def largest_row(rows: Rows) -> Shaped[Array, "*shape"]:
    """Maximum over the first axis, element by element, in a tree. Equal maxima share the gradient equally."""
    return tree(list(jnp.asarray(rows)), jnp.maximum)


@largest_row.defjvp
def _largest_row_jvp(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    (rows,), (change,) = primals, tangents
    found = largest_row(rows)
    equal = (rows == found).astype(change.dtype)
    return found, jnp.sum(change * equal, axis=0) / jnp.maximum(jnp.sum(equal, axis=0), 1)


_largest.defjvp(_shared(_largest))
_smallest.defjvp(_shared(_smallest))


def ordered_bits(values: Float[Array, "*shape"]) -> Int[Array, "*shape"]:
    """Floats as integers of the same order: the bits as they are, those of negative numbers turned round."""
    bits = jax.lax.bitcast_convert_type(
        jnp.where(values == 0, jnp.zeros((), values.dtype), values).astype(jnp.float32), jnp.int32
    )
    return bits ^ ((bits >> 31) & 0x7FFFFFFF)


def from_ordered_bits(ordered: Int[Array, "*shape"]) -> Float[Array, "*shape"]:
    return jax.lax.bitcast_convert_type(ordered ^ ((ordered >> 31) & 0x7FFFFFFF), jnp.float32)
