"""Constant false-alarm rate on a Rayleigh envelope (linear law, not square law): the multiple of the floor's mean."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float
from scipy import integrate, linalg, optimize, special

from jaxradar.estimate.detection._common import positive, share

__all__ = ["effective_cells", "envelope_correlation", "rayleigh_false_alarm", "rayleigh_multiplier"]


def rayleigh_false_alarm(multiplier: float, cells: float) -> float:
    """Probability that a cell of noise is above `multiplier` times the mean of `cells` other cells.

    P(x > α m) = E[exp(−α² m²/(2σ²))] over the mean m, whose distribution is taken as a gamma of the same mean σ √(π/2)
    and variance (2 − π/2) σ²/`cells` (the exact moments; a sum of Rayleigh variables has no closed distribution).
    The cell under test is independent of the others; `cells` may be an effective number of correlated ones. Checked
    for 16 and 32 cells at 1e-1 to 1e-3, and for 16 and 32 that are correlated as exp(−(lag/3)²/2), worth 3.5 and 6.5,
    to 1e-4: within 8 %. For few independent ones it is too low: the rate is 1.2 of it for 4 cells at 1e-2, 1.6 at 1e-3.
    """
    positive(multiplier=multiplier, cells=cells)
    mean, variance = math.sqrt(0.5 * math.pi), (2.0 - 0.5 * math.pi) / cells
    shape, scale = mean**2 / variance, variance / mean

    def under(m: float) -> float:
        log = (shape - 1.0) * math.log(m / scale) - m / scale - special.gammaln(shape) - math.log(scale)
        return math.exp(log - 0.5 * (multiplier * m) ** 2)

    spread = 12.0 * math.sqrt(variance)
    return float(integrate.quad(under, max(1e-9, mean - spread), mean + spread, limit=200)[0])


def rayleigh_multiplier(false_alarm: float, cells: float) -> float:
    """What the mean of `cells` floor cells is multiplied by for so many false alarms a cell: the inverse of
    `rayleigh_false_alarm`. Raises `ValueError` outside 0 < `false_alarm` < 1."""
    share("false_alarm", false_alarm)
    over = lambda a: math.log(max(rayleigh_false_alarm(a, cells), 1e-300)) - math.log(false_alarm)  # noqa: E731
    return float(optimize.brentq(over, 1e-3, 100.0))


def envelope_correlation(correlation: Float[np.ndarray, " lags"]) -> Float[np.ndarray, " lags"]:
    """Correlation of Rayleigh envelopes whose complex amplitudes have the (modulus of) correlation given.

    π/4 (₂F₁(−½, −½; 1; |ρ|²) − 1)/(1 − π/4) (Middleton, An Introduction to Statistical Communication Theory, 1960,
    chapter 9); nearly |ρ|².
    """
    return 0.25 * math.pi * (special.hyp2f1(-0.5, -0.5, 1.0, np.abs(correlation) ** 2) - 1.0) / (1.0 - 0.25 * math.pi)


def effective_cells(correlation: Float[np.ndarray, "cells cells"] | Float[np.ndarray, " cells"]) -> float:
    """How many independent cells the mean of correlated ones is worth: n² over the sum of their correlation matrix.

    A line of values is that of evenly spaced cells, from lag 0 on. (The variance of a mean; Brockwell and
    Davis, Time Series: Theory and Methods, 1991, section 7.1.) Of envelopes: `envelope_correlation`
    gives that where the correlation of the complex amplitudes is known.
    """
    matrix = linalg.toeplitz(correlation) if correlation.ndim == 1 else correlation
    return float(matrix.shape[0] ** 2 / np.sum(matrix))
