"""Slope of a track on uneven times, causal: at each sample from it and those before it.

All take `values` (samples,), at `dt` (samples,) seconds after the sample before (the first one's is not used), and give
(samples,) in units of the values per second. Only differences are ever summed: of the values to the newest one, and of
times backwards from it, so that neither a large value nor a long track costs digits. Where the times do not tell a
slope, because there are too few samples or they are at one time, it is 0 with gradient 0.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxradar._numerics import safe_divide

__all__ = ["backward_difference", "fitted_slope", "three_point_difference"]

Track = Float[Array | np.ndarray, " samples"]
Windows = Float[Array, "samples window"]


def _before(values: Track, count: int) -> Track:
    """What was there so many samples before; 0 before the first."""
    return jnp.concatenate([jnp.zeros(count, values.dtype), values[: values.shape[0] - count]])


def backward_difference(values: Track, dt: Track) -> Track:
    """Difference to the sample before over the time since then; error of first order in it. A time that does not go
    forward gives 0, and so does the first sample."""
    values, dt = jnp.asarray(values), jnp.asarray(dt)
    known = (jnp.arange(values.shape[0]) > 0) & (dt > 0)
    change = jnp.where(known, values - _before(values, 1), 0.0)
    return safe_divide(change, jnp.where(known, dt, 0.0))


def three_point_difference(values: Track, dt: Track) -> Track:
    """Slope at the newest of three samples of the parabola through them; error of second order.

    With the last two differences d₁ = Δ₁/h₁ and d₂ = Δ₂/h₂: d₁ + h₁ (d₁ − d₂)/(h₁ + h₂) (Fornberg, Mathematics of
    Computation 51, 1988, for three uneven points). The plain difference where there is one interval alone.
    """
    values, dt = jnp.asarray(values), jnp.asarray(dt)
    slope = backward_difference(values, dt)
    before, interval = _before(slope, 1), _before(dt, 1)
    known = (jnp.arange(values.shape[0]) > 1) & (dt > 0) & (interval > 0)
    share = safe_divide(jnp.where(known, dt, 0.0), jnp.where(known, dt + interval, 0.0))
    return slope + share * jnp.where(known, slope - before, 0.0)


def fitted_slope(values: Track, dt: Track, window: int, order: int = 1) -> Track:
    """Slope at the newest sample of the straight line (`order` 1) or the parabola (2) that fits the last `window`
    samples best by least squares: a Savitzky-Golay derivative (Analytical Chemistry 36, 1964) on uneven times.

    Fewer samples at the beginning; a line where there are too few for a parabola. Raises `ValueError` for a window
    that has too few samples for its order, or another order.
    """
    if order not in (1, 2):
        raise ValueError(f"`fitted_slope(order=...)` must be 1 or 2; got {order}.")
    if window <= order:
        raise ValueError(f"`fitted_slope(window=...)` must be > {order}, the order; got {window}.")
    values, dt = jnp.asarray(values), jnp.asarray(dt)
    lag = np.arange(window)
    place = jnp.arange(values.shape[0])[:, None] - lag
    weight = (place >= 0).astype(values.dtype)
    place = jnp.maximum(place, 0)
    change = weight * (values[place] - values[:, None])
    # Backwards in time: the sum of the intervals between the newest sample and each of the others.
    ago = dt[place].astype(values.dtype) @ jnp.asarray(lag[:, None] < lag, values.dtype)
    longest = jnp.max(weight * jnp.abs(ago), axis=1)
    # In units of the window's length, so that squares and fourth powers keep their digits at any rate.
    time = -weight * safe_divide(ago, jnp.broadcast_to(longest[:, None], weight.shape))
    count = jnp.sum(weight, axis=1)
    linear = weight * (time - _mean(time, count))
    slope, strength = _along(linear, change)
    if order == 2:
        square = time * time
        bent, _ = _along(linear, square, strength)
        curved = weight * (square - _mean(square, count)) - bent[:, None] * linear
        # Of three samples the parabola is exact; of two, or of samples at two times, there is none.
        curvature, width = _along(curved, change)
        slope = slope - jnp.where((count > 2) & (width > 1e-6), curvature * bent, 0.0)
    return safe_divide(slope, longest)


def _mean(values: Windows, count: Track) -> Float[Array, "samples 1"]:
    return (jnp.sum(values, axis=1) / count)[:, None]


def _along(shape: Windows, values: Windows, square: Track | None = None) -> tuple[Track, Track]:
    """How much of `shape` is in `values`, and the sum of its squares."""
    square = jnp.sum(shape * shape, axis=1) if square is None else square
    return safe_divide(jnp.sum(shape * values, axis=1), square), square
