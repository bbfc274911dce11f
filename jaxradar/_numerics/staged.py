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
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Shaped

__all__ = [
    "cpu_shaped",
    "first_argmax",
    "first_largest",
    "largest",
    "packed_largest",
    "reductions",
    "select_largest",
    "sliced",
    "smallest",
    "summed",
    "total",
    "totals",
    "value_at",
]

LANES = 32
MOST_STAGED = 8192  # bins; the program's size grows with them, so what is longer is reduced in the plain form

Values = Shaped[Array | np.ndarray, "*shape bins"]
Reduced = Shaped[Array, "*shape"]
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


def _staged(values: Array) -> bool:
    return cpu_shaped() and 0 < values.shape[-1] <= MOST_STAGED


def _filled_slices(values: Array) -> list[Array]:
    """Slices of `LANES` bins, the last one filled up with 0."""
    count = values.shape[-1]
    parts = [values[..., start : start + LANES] for start in range(0, count, LANES)]
    if count > LANES and count % LANES:
        parts[-1] = jnp.pad(parts[-1], [(0, 0)] * (values.ndim - 1) + [(0, -count % LANES)])
    return parts


def _starts(count: int) -> list[int]:
    """Where slices begin that cover all bins, some of them twice: that moves no extreme."""
    starts = list(range(0, count - LANES + 1, LANES)) or [0]
    return starts if count <= LANES or starts[-1] + LANES == count else [*starts, count - LANES]


def _covering_slices(values: Array) -> list[Array]:
    return [values[..., start : start + LANES] for start in _starts(values.shape[-1])]


def _tree(parts: list[Any], combine: Combine) -> Any:
    while len(parts) > 1:
        odd = parts[-1:] if len(parts) % 2 else []
        parts = [combine(a, b) for a, b in zip(parts[::2], parts[1::2], strict=False)] + odd
    return parts[0]


def total(values: Values) -> Reduced:
    """Sum over the last axis, of the type that `jnp.sum` gives."""
    values = jnp.asarray(values)
    return _total(values) if _staged(values) else jnp.sum(values, axis=-1)


@jax.custom_jvp
def _total(values: Array) -> Array:
    wide = values.astype(jax.eval_shape(jnp.sum, values).dtype)
    return jnp.sum(_tree(_filled_slices(wide), jnp.add), axis=-1)


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
    if not _staged(whole[0]):
        return [tuple(whole)]
    return list(zip(*(_filled_slices(one) for one in whole), strict=True))


def summed(terms: Sequence[tuple[Array, ...]], count: int) -> tuple[Reduced, ...]:
    """The sums of terms made slice by slice out of what `sliced` gave for an axis of `count` bins."""
    *others, last = terms
    filled = len(terms) * last[0].shape[-1] - count
    if filled:
        real = jnp.arange(last[0].shape[-1]) < last[0].shape[-1] - filled
        last = tuple(jnp.where(real, one, 0) for one in last)
    sums = _tree([*others, last], lambda a, b: tuple(x + y for x, y in zip(a, b, strict=True)))
    return tuple(jnp.sum(one, axis=-1) for one in sums)


def largest(values: Values) -> Reduced:
    """Maximum over the last axis; in the staged form NaN if there is one. Equal maxima share the gradient equally."""
    values = jnp.asarray(values)
    return _largest(values) if _staged(values) else jnp.max(values, axis=-1)


def smallest(values: Values) -> Reduced:
    """Minimum over the last axis; in the staged form NaN if there is one. Equal minima share the gradient equally."""
    values = jnp.asarray(values)
    return _smallest(values) if _staged(values) else jnp.min(values, axis=-1)


@jax.custom_jvp
def _largest(values: Array) -> Array:
    return _extreme(values, jnp.maximum, jnp.max, jnp.nan)


@jax.custom_jvp
def _smallest(values: Array) -> Array:
    return _extreme(values, jnp.minimum, jnp.min, -jnp.nan)


def _extreme(values: Array, combine: Combine, reduce: Callable[..., Array], nan: float) -> Array:
    lanes = _tree(_covering_slices(values), combine)
    if lanes.dtype != jnp.float32:
        return reduce(lanes, axis=-1)
    # As integers of the same order: the compiler does not chain those. A NaN must win: of all floats, the negative one
    # has the lowest integer, the positive one the highest.
    return _from_ordered_bits(reduce(_ordered_bits(jnp.where(jnp.isnan(lanes), nan, lanes)), axis=-1))


def _shared(extreme: Callable[[Array], Array]) -> Callable[..., tuple[Array, Array]]:
    def rule(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
        (values,), (change,) = primals, tangents
        found = extreme(values)
        equal = (values == found[..., None]).astype(change.dtype)
        return found, jnp.sum(change * equal, axis=-1) / jnp.maximum(jnp.sum(equal, axis=-1), 1)

    return rule


_largest.defjvp(_shared(_largest))
_smallest.defjvp(_shared(_smallest))


def first_argmax(values: Values) -> Int[Array, "*shape"]:
    """Index of the largest value, the first of equals, 0.0 and -0.0 being equal. `values` must hold no NaN."""
    return first_largest(values)[0]


def _itself(values: Array) -> Array:
    return values


def first_largest(*arrays: Values, of: Callable[..., Array] = _itself) -> tuple[Int[Array, "*shape"], Reduced]:
    """Index of the largest value, the first of equals, and the value; exact. No value may be NaN.

    The values are what `of` makes of the arrays, element by element: it is applied to one slice after the other, so
    that they are not written to memory first. No gradient flows through either result.
    """
    whole = [jax.lax.stop_gradient(jnp.asarray(one)) for one in arrays]
    dtype = jax.eval_shape(of, *whole).dtype
    if _staged(whole[0]) and jnp.dtype(dtype).itemsize <= 4 and dtype != jnp.uint32:
        return _keyed(whole, of)
    # Two reductions: exact, and every back end has them. What they read is made once.
    values = jax.lax.optimization_barrier(of(*whole))
    count, top = values.shape[-1], largest(values)
    bins = jnp.arange(count, dtype=jnp.int32)
    return smallest(jnp.where(values == top[..., None], bins, count - 1)), top


def value_at(values: Values, index: Int[Array | np.ndarray, "*shape"]) -> Reduced:
    """What `values` hold at `index`: in the plain form by a sum, as a gather would turn round sweeps side by side."""
    values = jnp.asarray(values)
    if _staged(values):
        return jnp.take_along_axis(values, index[..., None], axis=-1)[..., 0]
    here = jnp.arange(values.shape[-1], dtype=jnp.int32) == index[..., None]
    return jnp.sum(jnp.where(here, values, jnp.zeros((), values.dtype)), axis=-1)


def select_largest(candidates: Sequence[tuple[Any, ...]]) -> tuple[Any, ...]:
    """Of tuples (value, ...) the first with the largest value, with its index in front: element by element.

    What is carried along comes without a gather, and gradients flow through all but the index. No value may be NaN.
    """
    pairs = [(jnp.int32(index), *one) for index, one in enumerate(candidates)]
    return tuple(_tree(pairs, _later_if_larger))


def _later_if_larger(first: Any, second: Any) -> Any:
    larger = second[1] > first[1]
    return tuple(jnp.where(larger, b, a) for a, b in zip(first, second, strict=True))


def _keyed(whole: list[Array], of: Callable[..., Array]) -> tuple[Array, Array]:
    """Value and index are selected together down to `LANES` pairs, each of which makes one 64-bit key."""
    count = whole[0].shape[-1]
    parts = [of(*slices) for slices in zip(*map(_covering_slices, whole), strict=True)]
    dtype = parts[0].dtype
    floating = jnp.issubdtype(dtype, jnp.floating)
    with jax.enable_x64(True):  # for the key alone; nothing of it is left outside
        lanes = jnp.arange(parts[0].shape[-1], dtype=jnp.int32)
        wide = [part.astype(jnp.float32 if floating else jnp.int32) for part in parts]
        index, top = _tree(list(zip([start + lanes for start in _starts(count)], wide, strict=True)), _later_if_larger)
        ordered = _ordered_bits(top) if floating else top
        best = jnp.max((ordered.astype(jnp.int64) << 32) | (count - 1 - index).astype(jnp.int64), axis=-1)
        high = (best >> 32).astype(jnp.int32)
        found = (count - 1) - (best & 0xFFFFFFFF).astype(jnp.int32)
    return found, (_from_ordered_bits(high) if floating else high).astype(dtype)


def _ordered_bits(values: Float[Array, "*shape"]) -> Int[Array, "*shape"]:
    """Floats as integers of the same order: the bits as they are, those of negative numbers turned round."""
    bits = jax.lax.bitcast_convert_type(
        jnp.where(values == 0, jnp.zeros((), values.dtype), values).astype(jnp.float32), jnp.int32
    )
    return bits ^ ((bits >> 31) & 0x7FFFFFFF)


def _from_ordered_bits(ordered: Int[Array, "*shape"]) -> Float[Array, "*shape"]:
    return jax.lax.bitcast_convert_type(ordered ^ ((ordered >> 31) & 0x7FFFFFFF), jnp.float32)


def packed_largest(
    *arrays: Values, of: Callable[..., Array] = _itself
) -> tuple[Int[Array, "*shape"], Float[Array, "*shape"]]:
    """Index and value of the largest of doubles, none below 0 and none NaN, in a single pass; `of` as above.

    The last ⌈log₂ bins⌉ bits of each number are replaced by its index. Values that differ in these alone count as
    equal, and the first wins: at 128 bins a share of at most 3e-14. The product of a 16-bit count and a
    single-precision weight has no such bits (up to 8192 bins): there the result is exact. Raises `TypeError` where
    `of` does not give float64.
    """
    whole = [jax.lax.stop_gradient(jnp.asarray(one)) for one in arrays]
    dtype = jax.eval_shape(of, *whole).dtype
    if dtype != jnp.float64:
        raise TypeError(f"`packed_largest` takes float64; got {dtype}.")
    count = whole[0].shape[-1]
    low = (1 << max(count - 1, 1).bit_length()) - 1

    def keys(index: Array, *part: Array) -> Array:
        return (jax.lax.bitcast_convert_type(of(*part), jnp.int64) & ~low) | (low - index)

    reverse = [jnp.arange(count), *whole]
    if _staged(whole[0]):
        parts = [keys(*part) for part in zip(*map(_covering_slices, reverse), strict=True)]
        best = jnp.max(_tree(parts, jnp.maximum), axis=-1)
    else:
        best = jnp.max(keys(*reverse), axis=-1)
    return (low - (best & low)).astype(jnp.int32), jax.lax.bitcast_convert_type(best & ~low, jnp.float64)
