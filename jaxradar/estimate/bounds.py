"""How well a range can be known from one sweep: Cramér and Rao's bound, and where no estimator can meet it.

The model: an envelope A s(r − r₀) in bins Δ apart, with additive Gaussian noise of standard deviation σ in each bin,
white or of a known covariance. That is the right model where the echo stands well above the floor; below that the
envelope's noise is Rician, and the bound too low. SNR is 20 log₁₀(A/σ). All in float64 on the host.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float
from scipy import linalg, special

from jaxradar.signal.pulses import SIGMA_PER_FWHM

__all__ = [
    "coloured_bound_m",
    "filtered_snr_db",
    "gross_error_probability",
    "threshold_snr_db",
    "total_error_m",
    "white_bound_m",
]


def white_bound_m(snr_db: float, fwhm_m: float, bin_m: float) -> float:
    """Least standard deviation in metres of an unbiased range of a Gaussian pulse of width `fwhm_m` at half height, in
    white noise: var R = 2 s Δ σ² / (√π A²), s its standard deviation in range (Kay, Fundamentals of Statistical Signal
    Processing I, section 3.11, with ∫ s'² = √π/(2 s)). The sum over bins is taken as an integral: right
    to 1e-7 for bins up to 0.3 times the width, to 1 % at half of it.

    Raises `ValueError` for a width or bin that is not above 0.
    """
    _positive(fwhm_m=fwhm_m, bin_m=bin_m)
    sigma = SIGMA_PER_FWHM * fwhm_m
    return math.sqrt(2.0 * sigma * bin_m / math.sqrt(math.pi)) * 10.0 ** (-snr_db / 20.0)


def coloured_bound_m(
    slope: Float[np.ndarray, " bins"],
    covariance: Float[np.ndarray, "bins bins"],
    nuisance: Float[np.ndarray, "others bins"] | None = None,
) -> float:
    """Least standard deviation in metres of an unbiased range in noise of a known covariance: 1/√(s'ᵀ C⁻¹ s').

    `slope`: derivative of the expected sweep by its range, counts per metre; `covariance`: of the noise, counts². (Kay,
    section 3.9.) `nuisance`: derivatives by whatever else is unknown (amplitude, another echo), a row each: what of the
    slope they could explain tells nothing (section 3.7, the inverse of a partitioned matrix). Infinite where nothing is
    left. Raises `ValueError` for a covariance that is none.
    """
    try:
        root = linalg.cholesky(covariance, lower=True)
    except linalg.LinAlgError:
        raise ValueError("`covariance` must be symmetric and positive definite.") from None
    whitened = linalg.solve_triangular(root, slope, lower=True)
    if nuisance is not None:
        others = linalg.solve_triangular(root, np.transpose(nuisance), lower=True)
        others = others / np.maximum(np.linalg.norm(others, axis=0), np.finfo(float).tiny)
        whitened = whitened - others @ np.linalg.lstsq(others, whitened, rcond=None)[0]
    information = float(whitened @ whitened)
    return 1.0 / math.sqrt(information) if information > 0 else math.inf


def gross_error_probability(snr_db: float, window_m: float, fwhm_m: float) -> float:
    """Probability that a matched filter takes noise elsewhere in the window for the echo.

    As many independent places as pulses have room for, each of which wins with Q(A'/√2), A' being the SNR after the
    filter; van Trees, Detection, Estimation, and Modulation Theory I, section 4.2.3. Low, as maxima lie between
    these places too: a filter simulated over 60,000 sweeps of 128 bins erred 1.5 to 2 times as often where it did so in
    8e-3 to 3.5e-4 of them. `snr_db`: after the filter. At most 1.
    """
    _positive(window_m=window_m, fwhm_m=fwhm_m)
    places = max(window_m / (2.0 * SIGMA_PER_FWHM * fwhm_m * math.sqrt(math.pi)) - 1.0, 0.0)
    return min(1.0, places * float(special.ndtr(-(10.0 ** (snr_db / 20.0)) / math.sqrt(2.0))))


def filtered_snr_db(snr_db: float, fwhm_m: float, bin_m: float) -> float:
    """SNR of a bin, 20 log₁₀(A/σ), after a filter matched to the pulse in white noise: its energy is √π s/Δ bins."""
    _positive(fwhm_m=fwhm_m, bin_m=bin_m)
    return snr_db + 10.0 * math.log10(math.sqrt(math.pi) * SIGMA_PER_FWHM * fwhm_m / bin_m)


def total_error_m(snr_db: float, fwhm_m: float, bin_m: float, window_m: float) -> float:
    """RMS error in metres that the best estimator comes to: the bound, and with the probability of a gross error a
    range that is anywhere in the window (method of interval errors; van Trees, section 4.2.3)."""
    gross = gross_error_probability(filtered_snr_db(snr_db, fwhm_m, bin_m), window_m, fwhm_m)
    bound = white_bound_m(snr_db, fwhm_m, bin_m)
    return math.sqrt((1.0 - gross) * bound**2 + gross * window_m**2 / 6.0)


def threshold_snr_db(fwhm_m: float, bin_m: float, window_m: float, excess: float = 1.1) -> float:
    """SNR below which gross errors keep every estimator above `excess` times the bound. Raises `ValueError` unless
    `excess` is above 1."""
    if not excess > 1.0:
        raise ValueError(f"`threshold_snr_db(excess=...)` must be above 1; got {excess}.")
    low, high = -40.0, 80.0
    while high - low > 1e-6:
        middle = 0.5 * (low + high)
        over = total_error_m(middle, fwhm_m, bin_m, window_m) > excess * white_bound_m(middle, fwhm_m, bin_m)
        low, high = (middle, high) if over else (low, middle)
    return high


def _positive(**values: float) -> None:
    for name, value in values.items():
        if not value > 0:
            raise ValueError(f"`{name}` must be above 0; got {value}.")
