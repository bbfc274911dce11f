"""Receiver noise as it is in the recordings: smooth along range."""

from __future__ import annotations

import numpy as np
from scipy import linalg

__all__ = ["RECORDED_NOISE", "draw_recorded", "recorded_covariance"]

# Share and correlation length in mm of three parts, each ρ(d) = exp(−d²/(2 ℓ²)), the last one a bin's own. Fitted to
# the mean autocorrelation over range of the floor in 11 standing A111 recordings at 30 to 60°, from differences of
# neighbouring sweeps (scripts/recorded_noise.py prints both): .995 one bin of .484 mm away, .981 at 2.4 mm,
# .909 at 9.7 mm, .61 at 29 mm, .29 at 48 mm. The long part is the pulse's own width (66 mm at half height: 28 mm), the
# bin's own is what whole counts leave.
RECORDED_NOISE = ((0.972, 30.0), (0.024, 2.5), (0.004, 0.0))


def recorded_covariance(bins: int, bin_m: float) -> np.ndarray:
    """(bins, bins) correlation of recorded noise of standard deviation 1 in bins of `bin_m` metres."""
    distance_mm = 1e3 * bin_m * np.abs(np.arange(bins)[:, None] - np.arange(bins))
    whole = np.zeros((bins, bins))
    for share, length_mm in RECORDED_NOISE:
        whole += share * (np.exp(-0.5 * (distance_mm / length_mm) ** 2) if length_mm else np.eye(bins))
    return whole


def draw_recorded(random: np.random.Generator, shape: tuple[int, int], bin_m: float) -> np.ndarray:
    """(sweeps, bins) of it, Gaussian."""
    root = linalg.cholesky(recorded_covariance(shape[1], bin_m), lower=True)
    drawn: np.ndarray = random.standard_normal(shape) @ root.T
    return drawn
