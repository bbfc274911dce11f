"""How far one profile has moved against another."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxradar._numerics import cpu_shaped, first_largest, largest, safe_divide, safe_sqrt, total
from jaxradar._types import Counts, Index, Lags, Scalar
from jaxradar.signal.peaks import vertex

__all__ = ["ProfileShift", "profile_shift", "shifted_correlations"]


# Of a profile's norm, what is never more than noise. Near a correlation of 1 the sine is steep: without this, float32's
# last digit of the correlation would move it by 3e-4, and its gradient would have no bound.
NOISE_SHARE = 0.03
MOST_UNROLLED = 256  # cells; beyond, the compiler's own time would grow with them


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
    pushes out of it stays in the norm: a shift that loses a part of the echo explains less.
    """
    profile, reference = _scaled(profile), _scaled(reference)
    products = _shifted_products(profile, reference, reach)
    energy = total(profile * profile) * total(reference * reference)
    return safe_divide(products, jnp.broadcast_to(safe_sqrt(energy), products.shape))


def _scaled(profile: Counts) -> Counts:
    # To a largest value of 1, as squares leave float32's range above 1e19 and below 1e-19. The correlation does not
    # hang on that scale, so no gradient is lost with it.
    scale = jax.lax.stop_gradient(largest(profile))
    return profile * safe_divide(jnp.ones_like(scale), scale)


def _shifted_products(profile: Counts, reference: Counts, reach: int) -> Lags:
    lags, count = 2 * reach + 1, profile.shape[0]
    if not cpu_shaped() or count > MOST_UNROLLED:
        padded = jnp.pad(reference, reach)

        def product(lag: Index) -> Scalar:
            window = jax.lax.dynamic_slice(padded, (lags - 1 - lag,), (count,))
            # An accelerator's short floats would move the sine of a small angle by 4e-3.
            return jnp.dot(window, profile, precision=jax.lax.Precision.HIGHEST)

        return jax.lax.map(product, jnp.arange(lags))
    # The lags side by side fill a vector register, and no sum over cells runs across it. The lags rise the other way.
    width = -(-lags // 16) * 16
    padded = jax.lax.optimization_barrier(jnp.pad(reference, (reach, reach + width - lags)))
    products = profile[0] * padded[:width]
    for cell in range(1, count):
        products = products + profile[cell] * padded[cell : cell + width]
    return products[:lags][::-1]


def profile_shift(profile: Counts, reference: Counts, reach: int) -> ProfileShift:
    """The shift within ±`reach` cells that explains `profile` best as a moved and scaled `reference`.

    Both are amplitudes over the noise floor, never negative. The best whole shift is refined by the vertex of the
    parabola through its logarithm and its neighbours', which is exact for Gaussian echoes. Everything is 0 shift and
    wholly unexplained where either profile is silent.
    """
    correlations = shifted_correlations(profile, reference, reach)
    best, highest = first_largest(correlations)
    inner = jnp.clip(best, 1, 2 * reach - 1)
    taps = [correlations[inner + step] for step in (-1, 0, 1)]
    # At the end of the bank there is no neighbour to lean on: the whole shift stands. So it does beside a silence.
    fine = (best == inner) & (jnp.minimum(taps[0], taps[2]) > 0)
    offset, log_height = vertex(*(jnp.log(jnp.where(fine, tap, 1.0)) for tap in taps))
    height = jnp.where(fine, jnp.exp(log_height), correlations[best])
    return ProfileShift(
        cells=jnp.where(highest > 0, best - reach + offset, 0.0),
        unexplained_still=_sine(correlations[reach]),
        unexplained_moved=_sine(height),
    )
