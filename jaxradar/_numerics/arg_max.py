"""The largest value and where it is: exact, the first of equals, in the form that the processor wants."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from jaxradar._numerics.staged import (
    Reduced,
    Values,
    covering_slices,
    from_ordered_bits,
    in_stages,
    largest,
    ordered_bits,
    slice_starts,
    smallest,
    tree,
    written_out,
)

__all__ = ["first_argmax", "first_largest", "packed_largest", "select_largest", "value_at"]


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
    if in_stages(whole[0]) and jnp.dtype(dtype).itemsize <= 4 and dtype != jnp.uint32:
        return _keyed(whole, of)
    # Two reductions: exact, and every back end has them. What they read is made once.
    values = written_out(of(*whole))
    count, top = values.shape[-1], largest(values)
    bins = jnp.arange(count, dtype=jnp.int32)
    return smallest(jnp.where(values == top[..., None], bins, count - 1)), top


def value_at(values: Values, index: Int[Array | np.ndarray, "*shape"]) -> Reduced:
    """What `values` hold at `index`: in the plain form by a sum, as a gather would turn round sweeps side by side."""
    values = jnp.asarray(values)
    if in_stages(values):
        return jnp.take_along_axis(values, index[..., None], axis=-1)[..., 0]
    here = jnp.arange(values.shape[-1], dtype=jnp.int32) == index[..., None]
    return jnp.sum(jnp.where(here, values, jnp.zeros((), values.dtype)), axis=-1)


def select_largest(candidates: Sequence[tuple[Any, ...]]) -> tuple[Any, ...]:
    """Of tuples (value, ...) the first with the largest value, with its index in front: element by element.

    What is carried along comes without a gather, and gradients flow through all but the index. No value may be NaN.
    """
    pairs = [(jnp.int32(index), *one) for index, one in enumerate(candidates)]
    return tuple(tree(pairs, _later_if_larger))


def _later_if_larger(first: Any, second: Any) -> Any:
    larger = second[1] > first[1]
    return tuple(jnp.where(larger, b, a) for a, b in zip(first, second, strict=True))


def _keyed(whole: list[Array], of: Callable[..., Array]) -> tuple[Array, Array]:
    """Value and index are selected together down to `LANES` pairs, each of which makes one 64-bit key."""
    count = whole[0].shape[-1]
    parts = [of(*slices) for slices in zip(*map(covering_slices, whole), strict=True)]
    dtype = parts[0].dtype
    floating = jnp.issubdtype(dtype, jnp.floating)
    with jax.enable_x64(True):  # for the key alone; nothing of it is left outside
        lanes = jnp.arange(parts[0].shape[-1], dtype=jnp.int32)
        wide = [part.astype(jnp.float32 if floating else jnp.int32) for part in parts]
        index, top = tree(
            list(zip([start + lanes for start in slice_starts(count)], wide, strict=True)), _later_if_larger
        )
        ordered = ordered_bits(top) if floating else top
        best = jnp.max((ordered.astype(jnp.int64) << 32) | (count - 1 - index).astype(jnp.int64), axis=-1)
        high = (best >> 32).astype(jnp.int32)
        found = (count - 1) - (best & 0xFFFFFFFF).astype(jnp.int32)
    return found, (from_ordered_bits(high) if floating else high).astype(dtype)


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
    if in_stages(whole[0]):
        parts = [keys(*part) for part in zip(*map(covering_slices, reverse), strict=True)]
        best = jnp.max(tree(parts, jnp.maximum), axis=-1)
    else:
        best = jnp.max(keys(*reverse), axis=-1)
    return (low - (best & low)).astype(jnp.int32), jax.lax.bitcast_convert_type(best & ~low, jnp.float64)
