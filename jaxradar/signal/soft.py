"""The mean of a sweep under weights that favour its largest bins, with a gradient that needs no memory."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero

from jaxradar._numerics import largest, safe_divide, totals
from jaxradar._types import Flag, Scalar, Setting, Sweep

__all__ = ["soft_position"]


def _moments(values: Sweep, log_gain: Sweep, exponent: Scalar, temperature: Scalar) -> tuple[Scalar, Scalar, Scalar]:
    """Largest compensated value, sum of the weights, and the weighted mean of the bins from the middle of the axis."""
    bins = jnp.arange(values.shape[-1], dtype=values.dtype) - _middle(values)
    top = largest(values * jnp.exp(exponent * log_gain))
    scale = safe_divide(jnp.ones_like(top), top * temperature)
    # The largest weight is 1, so the sum is at least 1, whatever underflows beside it; so it is in a silent sweep.
    most = jnp.where(top > 0, 1.0 / temperature, 0.0)

    def terms(value: Any, gain: Any, offset: Any) -> tuple[Any, Any]:
        weight = jnp.exp(value * gain * scale - most)
        return weight, weight * offset

    weights, first = totals(terms, values, jnp.exp(exponent * log_gain), bins)
    return top, weights, first / weights


def _middle(values: Sweep) -> float:
    # Offsets from the middle, not from bin 0: small numbers keep float32's digits.
    return 0.5 * (values.shape[-1] - 1)


@jax.custom_jvp
def _position(values: Sweep, log_gain: Sweep, exponent: Scalar, temperature: Scalar) -> tuple[Scalar, Scalar]:
    top, _, mean = _moments(values, log_gain, exponent, temperature)
    return _middle(values) + mean, jax.lax.stop_gradient(top)


def _position_jvp(primals: Any, tangents: Any) -> tuple[Any, Any]:
    # With u = v/v_max and w = exp((u - 1)/T): d mean = sum w (i - mean) d((u - 1)/T) / sum w. What hangs on the
    # two scalars is two sums a sweep; arrays of the sweep's size come in only if the amplitudes themselves change.
    values, log_gain, exponent, temperature = primals
    d_values, d_log_gain, d_exponent, d_temperature = tangents
    top, weights, mean = _moments(*primals)
    offsets = jnp.arange(values.shape[-1], dtype=values.dtype) - _middle(values) - mean
    inverse = safe_divide(jnp.ones_like(top), top)

    def share(value: Any, gain: Any, offset: Any) -> tuple[Any, Any]:
        ratio = value * gain * inverse
        return ratio, jnp.exp((ratio - 1.0) / temperature) * offset

    def terms(value: Any, gain: Any, logarithm: Any, offset: Any) -> tuple[Any, ...]:
        ratio, pull = share(value, gain, offset)
        at_top = (value * gain == top).astype(value.dtype)
        return pull * ratio, pull * ratio * logarithm, at_top, at_top * logarithm

    gains = jnp.exp(exponent * log_gain)
    pull, pull_log, at_top, log_at_top = totals(terms, values, gains, log_gain, offsets)
    change = jnp.zeros_like(mean)
    if not isinstance(d_temperature, SymbolicZero):
        change = change - pull / temperature * d_temperature
    if not isinstance(d_exponent, SymbolicZero):
        change = change + (pull_log - pull * log_at_top / jnp.maximum(at_top, 1.0)) * d_exponent
    for tangent, factor in ((d_values, gains), (d_log_gain, values * gains * exponent)):
        if not isinstance(tangent, SymbolicZero):
            moved = tangent * factor * inverse
            ratio, force = share(values, gains, offsets)
            at = (ratio == 1.0).astype(values.dtype)
            top_moved = jnp.sum(moved * at, axis=-1) / jnp.maximum(jnp.sum(at, axis=-1), 1.0)
            change = change + jnp.sum(force * moved, axis=-1) - pull * top_moved
    # The largest value is only asked whether there is one: its own derivative is left out.
    return (_middle(values) + mean, top), (change / (temperature * weights), jnp.zeros_like(top))


_position.defjvp(_position_jvp, symbolic_zeros=True)


def soft_position(
    values: Sweep, temperature: Setting, log_gain: Sweep | None = None, exponent: Setting = 0.0
) -> tuple[Scalar, Flag]:
    """Mean of the bins, in bins from 0, under weights exp((v/v_max - 1) / `temperature`), and whether any is above 0.

    Here v = values × e^(exponent × log_gain). For amplitudes that are finite; the middle if all are 0. Derivatives by
    `temperature` and `exponent` are taken from moments of the sweep, so that reverse mode keeps a few numbers a sweep
    and no array of its size.
    """
    dtype = jnp.result_type(values)
    if log_gain is None:
        log_gain = jnp.zeros(values.shape[-1], dtype)
    position, top = _position(
        jnp.asarray(values),
        jnp.asarray(log_gain, dtype),
        jnp.asarray(exponent, dtype),
        jnp.asarray(temperature, dtype),
    )
    return position, top > 0
