"""Shapes of a single echo."""

from __future__ import annotations

import math

import jax.numpy as jnp
from jaxtyping import Array, Float

__all__ = ["SIGMA_PER_FWHM", "gaussian_pulse"]

# Half of the maximum at x = σ √(2 ln 2) on either side.
SIGMA_PER_FWHM = 1.0 / (2.0 * math.sqrt(2.0 * math.log(2.0)))


def gaussian_pulse(offset: Float[Array, "*shape"], fwhm: float) -> Float[Array, "*shape"]:
    """Envelope of an echo of height 1 at `offset` from its centre; both in one unit, of bins or metres.

    A Gaussian is what an A111's echo looks like down to a tenth of its height; the maker gives no formula.
    """
    return jnp.exp(-0.5 * (offset / (fwhm * SIGMA_PER_FWHM)) ** 2)
