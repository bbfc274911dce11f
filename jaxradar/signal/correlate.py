"""How far one profile has moved against another."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxradar._numerics import safe_divide, safe_sqrt, select_largest, total
from jaxradar._types import Counts, Index, Lags, Scalar
from jaxradar.signal.peaks import vertex

__all__ = ["ProfileShift", "profile_shift", "shifted_correlations"]


# Of a profile's norm, what is never more than noise. Near a correlation of 1 the sine is steep: without this, float32's
# last digit of the correlation would move it by 3e-4, and its gradient would have no bound.
NOISE_SHARE = 0.03
MOST_UNROLLED = 64  # lags; the time to compile grows with them


class ProfileShift(eqx.Module):
    """`cells`: by how many cells the profile lies further out than the reference, a fraction included.

    `unexplained_still`: the share of the profile's norm that the reference leaves unexplained if nothing moved;
    `unexplained_moved`: the same with the best shift. Both are the sine of the angle between two vectors: 0 if one
    is a multiple of the other, 1 if they have nothing in common. The gain is free, so a fade changes neither.
    `NOISE_SHARE` is added in squares to both.
    """

    cells: Scalar
    unexplained_still: Scalar
    unexplained_moved: Scalar


def _sine(correlation: Scalar) -> Scalar:
    return jnp.sqrt(1.0 - jnp.minimum(correlation, 1.0) ** 2 + NOISE_SHARE**2)


def shifted_correlations(profile: Counts, reference: Counts, reach: int) -> Lags:
    """Normalised correlation of `profile` with `reference` moved outwards by −reach ... reach cells.

    Shape (2 reach + 1,); 0 where either is silent. What a shift brings in from beyond the window counts as 0, what it
    pushes out of it stays in the norm: a shift that loses a part of the echo explains less. In float32 amplitudes must
    lie below 1e18, and count as silence below 1e-19, where their squares leave its range.
    """
    return jnp.stack(_correlations(profile, reference, reach))


def _correlations(profile: Counts, reference: Counts, reach: int) -> list[Scalar]:
    count = profile.shape[0]
    # Apart: the product of the two energies would leave float32's range far earlier than each of them.
    inverse = _inverse_norm(profile) * _inverse_norm(reference)
    lags = range(-reach, reach + 1)
    if len(lags) > MOST_UNROLLED:
        padded = jnp.pad(reference, reach)

        def product(lag: Index) -> Scalar:
            return inverse * total(profile * jax.lax.dynamic_slice(padded, (reach - lag,), (count,)))

        return list(jax.lax.map(product, jnp.arange(-reach, reach + 1)))
    # One after the other, not as an array: a loop over lags would do one sweep at a time.
    overlaps = ((max(0, lag), count + min(0, lag), lag) for lag in lags)
    return [
        inverse * total(profile[low:high] * reference[low - lag : high - lag]) if low < high else 0.0 * inverse
        for low, high, lag in overlaps
    ]


def _inverse_norm(profile: Counts) -> Scalar:
    energy = total(profile * profile)
    return safe_divide(jnp.ones_like(energy), safe_sqrt(energy))


def profile_shift(profile: Counts, reference: Counts, reach: int) -> ProfileShift:
    """The shift within ±`reach` cells that explains `profile` best as a moved and scaled `reference`.

    Both are amplitudes over the noise floor, never negative. The best whole shift is refined by the vertex of the
    parabola through its logarithm and its neighbours', which is exact for Gaussian echoes. Everything is 0 shift and
    wholly unexplained where either profile is silent.
    """
    correlations = _correlations(profile, reference, reach)
    # At the ends of the bank, and beside a silence, there is no neighbour to lean on: the whole shift stands.
    beyond = jnp.zeros_like(correlations[0])
    padded = [beyond, *correlations, beyond]
    best, highest, left, right = select_largest(list(zip(correlations, padded, padded[2:], strict=False)))
    fine = jnp.minimum(left, right) > 0
    offset, log_height = vertex(*(jnp.log(jnp.where(fine, tap, 1.0)) for tap in (left, highest, right)))
    return ProfileShift(
        cells=jnp.where(highest > 0, best - reach + offset, 0.0),
        unexplained_still=_sine(correlations[reach]),
        unexplained_moved=_sine(jnp.where(fine, jnp.exp(log_height), highest)),
    )
