"""The mean of a sweep under weights that favour its largest bins, with a gradient that needs no memory."""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax.custom_derivatives import SymbolicZero

from jaxradar._numerics import (
    cpu_shaped,
    finite,
    first_largest,
    largest_of,
    reductions,
    safe_divide,
    sliced,
    summed,
    value_at,
)
from jaxradar._types import Flag, RawSweep, Scalar, Setting, Sweep

__all__ = ["soft_position"]


class _Weighed(NamedTuple):
    """The bin of the largest compensated value, and that value; slice by slice the weights; their sum and the mean of
    the bins under them, from the middle of the axis."""

    at: Any  # an index; None where no derivative asks for it
    top: Scalar
    parts: list[tuple[Any, ...]]  # compensated value as a share of the largest, log gain, bin from the middle
    weights: list[Any]
    whole: Scalar
    mean: Scalar


def _weigh(
    values: RawSweep, log_gain: Sweep, exponent: Scalar, temperature: Scalar, differentiable: bool = False
) -> _Weighed:
    bins = jnp.arange(values.shape[-1], dtype=log_gain.dtype) - _middle(values)
    gains = jnp.exp(exponent * log_gain)
    if differentiable:  # in the rule for a derivative, of which there may be another
        at, _ = first_largest(values, gains, of=_compensated)
        top = value_at(finite(values), at) * value_at(gains, at)
    else:
        at, top = None, largest_of(_compensated, values, gains)
    inverse = _inverse(top)
    # The largest weight is 1, so the sum is at least 1, whatever underflows beside it; so it is in a silent sweep.
    most = jnp.where(top > 0, 1.0, 0.0)
    parts = [(finite(value) * gain * inverse, *rest) for value, gain, *rest in sliced(values, gains, log_gain, bins)]
    cold = 1.0 / temperature
    weights = [jnp.exp((ratio - most) * cold) for ratio, _, _ in parts]
    terms = [(weight, weight * offset) for weight, (_, _, offset) in zip(weights, parts, strict=True)]
    whole, first = summed(terms, values.shape[-1])
    return _Weighed(at, top, parts, weights, whole, first / whole)


def _inverse(top: Scalar) -> Scalar:
    # 0 where nothing is above 0: of bins below it the lowest would have the largest share, whose exponential overflows.
    return safe_divide(jnp.ones_like(top), jnp.maximum(top, 0.0))


def _compensated(value: Any, gain: Any) -> Any:
    return finite(value) * gain


def _middle(values: RawSweep) -> float:
    # Offsets from the middle, not from bin 0: small numbers keep float32's digits.
    return 0.5 * (values.shape[-1] - 1)


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _position(
    form: str, values: RawSweep, log_gain: Sweep, exponent: Scalar, temperature: Scalar
) -> tuple[Scalar, Scalar]:
    with reductions(form):
        found = _weigh(values, log_gain, exponent, temperature)
    return _middle(values) + found.mean, jax.lax.stop_gradient(found.top)


def _position_jvp(form: str, primals: Any, tangents: Any) -> tuple[Any, Any]:
    # A rule is traced when it is needed, and must find the form that was chosen when the function was called.
    with reductions(form):
        return _differentiated(primals, tangents)


def _differentiated(primals: Any, tangents: Any) -> tuple[Any, Any]:
    # With u = v/v_max and w = exp((u - 1)/T): d mean = sum w (i - mean) d((u - 1)/T) / sum w. What depends on the
    # two scalars is two sums a sweep; arrays of the sweep's size come in only if the amplitudes themselves change.
    values, log_gain, exponent, temperature = primals
    d_values, d_log_gain, d_exponent, d_temperature = tangents
    found = _weigh(values, log_gain, exponent, temperature, differentiable=True)
    pulls = [w * (offset - found.mean) for w, (_, _, offset) in zip(found.weights, found.parts, strict=True)]
    terms = [(p * ratio, p * ratio * logarithm) for p, (ratio, logarithm, _) in zip(pulls, found.parts, strict=True)]
    pull, pull_log = summed(terms, values.shape[-1])
    change = jnp.zeros_like(pull)
    if not isinstance(d_temperature, SymbolicZero):
        change = change - pull / temperature * d_temperature
    if not isinstance(d_exponent, SymbolicZero):
        change = change + (pull_log - pull * value_at(log_gain, found.at)) * d_exponent
    change = change + _moved(found, pull, primals, d_values, d_log_gain)
    # The largest value is only asked whether there is one: its own derivative is left out.
    return (_middle(values) + found.mean, found.top), (change / (temperature * found.whole), jnp.zeros_like(found.top))


def _moved(found: _Weighed, pull: Scalar, primals: Any, d_values: Any, d_log_gain: Any) -> Scalar:
    """The part of the derivative that comes from changes of the amplitudes or of their gains.

    A plain sum, because its transpose is a broadcast.
    """
    recorded, log_gain, exponent, temperature = primals
    values = finite(recorded).astype(log_gain.dtype)
    gains = jnp.exp(exponent * log_gain)
    inverse = _inverse(found.top)[..., None]
    ratio = values * gains * inverse
    offsets = jnp.arange(values.shape[-1], dtype=values.dtype) - _middle(values) - found.mean[..., None]
    force = jnp.exp((ratio - 1.0) / temperature) * offsets
    at_top = (values * gains == found.top[..., None]).astype(values.dtype)
    change = jnp.zeros_like(pull)
    for tangent, factor in ((d_values, gains), (d_log_gain, values * gains * exponent)):
        if not isinstance(tangent, SymbolicZero):
            # What is left out of the value is left out of its derivative.
            moved = jnp.where(jnp.isfinite(recorded), tangent * factor * inverse, 0.0)
            shared = jnp.sum(moved * at_top, axis=-1) / jnp.maximum(jnp.sum(at_top, axis=-1), 1.0)
            change = change + jnp.sum(force * moved, axis=-1) - pull * shared
    return change


_position.defjvp(_position_jvp, symbolic_zeros=True)


def soft_position(
    values: RawSweep, temperature: Setting, log_gain: Sweep | None = None, exponent: Setting = 0.0
) -> tuple[Scalar, Flag]:
    """Mean of the bins, in bins from 0, under weights exp((v/v_max - 1) / `temperature`), and whether any is above 0.

    Here v = values × e^(exponent × log_gain), NaN and infinities left out; the middle if none is above 0. In float32 no
    v may be above 1e37. Derivatives by `temperature` and `exponent` are taken from moments of the sweep, so that
    reverse mode keeps a few numbers a sweep and no array of its size.
    """
    values = jnp.asarray(values)
    dtype = values.dtype if jnp.issubdtype(values.dtype, jnp.floating) else jnp.result_type(float)
    if log_gain is None:
        log_gain = jnp.zeros(values.shape[-1], dtype)
    position, top = _position(
        "staged" if cpu_shaped() else "plain",
        values,
        jnp.asarray(log_gain, dtype),
        jnp.asarray(exponent, dtype),
        jnp.asarray(temperature, dtype),
    )
    return position, top > 0
