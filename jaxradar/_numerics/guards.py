"""Arithmetic that stays finite, in value and in gradient."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxradar._types import RawSweep, Setting, Sweep

__all__ = [
    "as_scalar",
    "finite",
    "nonnegative",
    "safe_divide",
    "safe_sqrt",
    "soft_exceeds",
]


def as_scalar(value: Any) -> Any:
    """A setting as an array leaf: what JAX already holds as it is, a Python number as NumPy's float64.

    NumPy keeps the double until a program takes it in, so that one that runs in float64 compares with 0.7 and not
    with float32's 0.69999999; and its type is never weak, so that another value does not recompile.
    """
    if isinstance(value, jax.Array):
        return jax.lax.convert_element_type(value, value.dtype)  # the same value with a strong type
    return np.asarray(value, np.float64)


def finite(sweep: RawSweep) -> Sweep:
    """A sweep as floats of the program's precision, with 0 where it is NaN or infinite.

    Without this, one NaN bin would win every arg-max (`jnp.argmax` returns a NaN's index).
    """
    whole = jnp.issubdtype(jnp.asarray(sweep).dtype, jnp.integer)
    values = jnp.asarray(sweep).astype(jnp.result_type(float))
    return values if whole else jnp.where(jnp.isfinite(values), values, 0.0)


def nonnegative(sweep: RawSweep) -> Sweep:
    """A sweep as `finite` gives it, with 0 for what is negative: an amplitude below 0 is no echo."""
    values = finite(sweep)
    return values if jnp.issubdtype(jnp.asarray(sweep).dtype, jnp.unsignedinteger) else jnp.maximum(values, 0.0)


def safe_divide(
    numerator: Float[Array | np.ndarray, "*shape"],
    denominator: Float[Array | np.ndarray, "*shape"],
    otherwise: float = 0.0,
) -> Float[Array, "*shape"]:
    """`numerator / denominator`, and `otherwise` with gradient 0 where the denominator is 0.

    Derivatives are finite wherever float32 holds them.
    """
    dtype = jnp.result_type(numerator, denominator)
    return _divided(otherwise, jnp.asarray(numerator, dtype), jnp.asarray(denominator, dtype))


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _divided(otherwise: float, numerator: Array, denominator: Array) -> Array:
    # The divisor is guarded and not only the result: a mask over 1/0 leaves a NaN gradient.
    zero = denominator == 0
    return jnp.where(zero, otherwise, numerator / jnp.where(zero, 1.0, denominator))


@_divided.defjvp
def _divided_jvp(otherwise: float, primals: tuple[Array, Array], tangents: tuple[Array, Array]) -> tuple[Array, Array]:
    # Not by 1/d², which leaves float32's range below d = 1e-19: amplitudes of 1e-30 have a position and its slope.
    ratio = _divided(otherwise, *primals)
    return ratio, _divided(0.0, tangents[0] - ratio * tangents[1], primals[1])


def safe_sqrt(value: Float[Array | np.ndarray, "*shape"]) -> Float[Array, "*shape"]:
    """Square root, with value and gradient 0 where `value` <= 0."""
    positive = value > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, value, 1.0)), 0.0)


def soft_exceeds(
    value: Float[Array | np.ndarray, "*shape"], threshold: Setting, temperature: Setting
) -> Float[Array, "*shape"]:
    """`value > threshold` as a number between 0 and 1 that gradients flow through: σ((value − threshold)/temperature).

    Tends to the hard decision as `temperature`, in the unit of `value`, falls to 0; ½ at equality. Where the slope is
    too small for the type it is 0 in all derivatives.
    """
    dtype = jnp.result_type(value)
    excess, unit = jnp.asarray(value) - jnp.asarray(threshold, dtype), jnp.asarray(temperature, dtype)
    # Far from the threshold 0 times the steep derivatives of the margin would be NaN.
    decided = jnp.abs(excess) > -math.log(float(jnp.finfo(dtype).tiny)) * unit
    margin = safe_divide(jnp.where(decided, 0.0, excess), jnp.where(decided, 1.0, unit))
    return jnp.where(decided, (excess > 0).astype(dtype), jax.nn.sigmoid(margin))
