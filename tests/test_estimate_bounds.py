"""Bounds against Monte Carlo with the maximum-likelihood estimator."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import linalg

from jaxradar.estimate import bounds
from jaxradar.signal.pulses import SIGMA_PER_FWHM

FWHM_M, BIN_M = 0.04, 0.0055
AXIS = np.arange(128) * BIN_M


def pulse(at: np.ndarray) -> np.ndarray:
    return np.exp(-0.5 * ((AXIS - at[:, None]) / (SIGMA_PER_FWHM * FWHM_M)) ** 2)


def likeliest(sweeps: np.ndarray, start: np.ndarray, whiten: np.ndarray) -> np.ndarray:
    """Gauss and Newton from the truth, amplitude free, in whitened noise."""
    place, sigma = start.copy(), SIGMA_PER_FWHM * FWHM_M
    for _ in range(8):
        shape = pulse(place)
        slope = shape * (AXIS - place[:, None]) / sigma**2
        shape, slope, seen = (one @ whiten.T for one in (shape, slope, sweeps))
        amplitude = np.sum(seen * shape, axis=1) / np.sum(shape**2, axis=1)
        across = slope - shape * (np.sum(slope * shape, axis=1) / np.sum(shape**2, axis=1))[:, None]
        place = place + np.sum((seen - amplitude[:, None] * shape) * across, axis=1) / (
            amplitude * np.sum(across**2, axis=1)
        )
    return place


@pytest.mark.parametrize("snr_db", [20.0, 40.0])
def test_white_noise(snr_db: float) -> None:
    random = np.random.default_rng(1)
    truth = random.uniform(0.3, 0.4, 4000)
    sweeps = pulse(truth) + random.normal(0, 10 ** (-snr_db / 20), (4000, 128))
    error = likeliest(sweeps, truth, np.eye(128)) - truth
    # The standard deviation of a standard deviation of 4000 is 1.1 %.
    assert np.sqrt(np.mean(error**2)) == pytest.approx(bounds.white_bound_m(snr_db, FWHM_M, BIN_M), rel=0.04)


def test_coloured_noise() -> None:
    random = np.random.default_rng(2)
    covariance = 1e-4 * (np.exp(-0.5 * (np.subtract.outer(AXIS, AXIS) / 0.008) ** 2) + 0.01 * np.eye(128))
    root = linalg.cholesky(covariance, lower=True)
    truth = random.uniform(0.3, 0.4, 4000)
    sweeps = pulse(truth) + random.normal(size=(4000, 128)) @ root.T
    error = likeliest(sweeps, truth, linalg.inv(root)) - truth
    at = np.array([0.35])
    slope = (pulse(at) * (AXIS - at[:, None]) / (SIGMA_PER_FWHM * FWHM_M) ** 2)[0]
    assert np.sqrt(np.mean(error**2)) == pytest.approx(bounds.coloured_bound_m(slope, covariance), rel=0.05)


def test_white_is_a_case_of_coloured_and_the_plan_holds() -> None:
    at = np.array([0.35])
    slope = (pulse(at) * (AXIS - at[:, None]) / (SIGMA_PER_FWHM * FWHM_M) ** 2)[0]
    white = bounds.white_bound_m(20.0, FWHM_M, BIN_M)
    assert bounds.coloured_bound_m(slope, 0.01 * np.eye(128)) == pytest.approx(white, rel=1e-4)
    for snr_db, millimetres in ((10, 3.25), (20, 1.03), (30, 0.325), (40, 0.103)):
        assert 1e3 * bounds.white_bound_m(snr_db, FWHM_M, BIN_M) == pytest.approx(millimetres, rel=5e-3)


def test_gross_errors_set_in_below_the_threshold() -> None:
    low = bounds.threshold_snr_db(FWHM_M, BIN_M, 0.7)
    assert bounds.total_error_m(low + 3, FWHM_M, BIN_M, 0.7) < 1.1 * bounds.white_bound_m(low + 3, FWHM_M, BIN_M)
    assert bounds.total_error_m(low - 3, FWHM_M, BIN_M, 0.7) > 1.5 * bounds.white_bound_m(low - 3, FWHM_M, BIN_M)
    with pytest.raises(ValueError, match="must be above 1"):
        bounds.threshold_snr_db(FWHM_M, BIN_M, 0.7, 1.0)
    with pytest.raises(ValueError, match="`bin_m` must be above 0"):
        bounds.white_bound_m(20.0, 0.04, 0.0)
    with pytest.raises(ValueError, match="positive definite"):
        bounds.coloured_bound_m(np.ones(2), np.zeros((2, 2)))


@pytest.mark.parametrize(("share", "within"), [(0.3, 2e-7), (0.5, 0.012)])
def test_the_sum_over_bins_is_the_integral_while_bins_are_narrow(share: float, within: float) -> None:
    bin_m = share * FWHM_M
    for shifted in (0.0, 0.25, 0.5):
        offset = (np.arange(-60, 61) - shifted) * bin_m
        sigma = SIGMA_PER_FWHM * FWHM_M
        slope = np.exp(-0.5 * (offset / sigma) ** 2) * offset / sigma**2
        exact = bounds.coloured_bound_m(slope, 0.01 * np.eye(121))
        assert bounds.white_bound_m(20.0, FWHM_M, bin_m) == pytest.approx(exact, rel=within)
