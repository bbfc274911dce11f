"""The difference of two samples `lag` apart, |x[n] − x[n−m]| > t: the thesis's rule, with its threshold from theory.

All but the onsets and the deadline hang on the noise by its standard deviation and the one correlation ρ(m) alone.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import linalg, optimize, special

from jaxradar.estimate.detection._common import (
    Correlations,
    any_above,
    at_least_one,
    correlations,
    per_hour_of,
    per_sample,
    positive,
    rises_above,
)

__all__ = [
    "difference_detection",
    "difference_detection_within",
    "difference_false_alarms_per_hour",
    "difference_onset_threshold",
    "difference_onsets_per_hour",
    "difference_threshold",
]

MOST_THRESHOLD = 35.0  # standard deviations of the difference; beyond, a double holds the probability no more


def _difference_sd(sd: float, correlation: float = 0.0) -> float:
    """Standard deviation of the difference of two samples that are correlated: √(2 (1 − ρ)) sd."""
    if not sd >= 0:
        raise ValueError(f"`sd` must be 0 or above; got {sd}.")
    if not -1.0 <= correlation <= 1.0:
        raise ValueError(f"`correlation` must be between -1 and 1; got {correlation}.")
    return sd * math.sqrt(2.0 * (1.0 - correlation))


def difference_false_alarms_per_hour(threshold: float, sd: float, rate_hz: float, correlation: float = 0.0) -> float:
    """False alarms an hour of |x[n] − x[n−m]| > `threshold`: 2 Q(t/σ_d) of each sample, each counted (Kay, Fundamentals
    of Statistical Signal Processing II, 1998, section 3.3, of a Gaussian statistic).

    `correlation`: of samples m apart, ρ(m). For the thesis's rule: `threshold` = 0.7 m/s × m / rate. Exact for Gaussian
    noise; checked from 1e-3 to 9e-2 per sample, white and coloured.
    """
    scale = _difference_sd(sd, correlation)
    above = 0.0 if scale == 0 else 2.0 * float(special.ndtr(-threshold / scale))
    return per_hour_of(above, rate_hz)


def difference_threshold(per_hour: float, sd: float, rate_hz: float, correlation: float = 0.0) -> float:
    """The threshold that `difference_false_alarms_per_hour` gives `per_hour` for (Neyman and Pearson's, for a step
    of any height). Raises `ValueError` for more alarms than samples, or none, and where the difference is always 0."""
    positive(sd=sd)
    scale = _difference_sd(sd, correlation)
    if scale == 0:
        raise ValueError(f"`correlation` must be below 1, or the difference is always 0; got {correlation}.")
    return -scale * float(special.ndtri(0.5 * per_sample(per_hour, rate_hz)))


def difference_detection(threshold: float, step: float, sd: float, correlation: float = 0.0) -> float:
    """Probability that one difference across a step exceeds the threshold (Kay II, section 3.3)."""
    scale = _difference_sd(sd, correlation)
    if scale == 0:
        return float(abs(step) > threshold)
    return float(special.ndtr((abs(step) - threshold) / scale) + special.ndtr((-abs(step) - threshold) / scale))


def difference_onsets_per_hour(
    threshold: float, sd: float, rate_hz: float, lag: int = 1, autocorrelation: Correlations | None = None
) -> float:
    """False alarms an hour, counted when they begin: the difference exceeds, and the one before did not.

    One sample that is far out makes two differences that are, of opposite sign: those of neighbouring samples (`lag` 1)
    of white noise are correlated by −1/2, those of a longer `lag` by 0. Exact for Gaussian noise, by Owen's T function
    (Annals of Mathematical Statistics 27, 1956); checked from 1e-3 to 9e-2 per sample, white and coloured.
    `autocorrelation`: ρ(0), ρ(1), …, 0 beyond its end; None is white.
    """
    positive(sd=sd)
    scale, beside = _pair(lag, autocorrelation)
    return per_hour_of(_onset_share(threshold / (sd * scale), beside), rate_hz)


def _pair(lag: int, autocorrelation: Correlations | None) -> tuple[float, float]:
    """Standard deviation of a difference in that of the noise, and its correlation with the one before."""
    at_least_one(lag=lag)
    rho = correlations(autocorrelation, lag + 1)
    own = 2.0 * (1.0 - rho[lag])
    if own <= 0:
        raise ValueError(f"`autocorrelation` is 1 at lag {lag}: the differences are 0.")
    return math.sqrt(own), float((2.0 * rho[1] - rho[lag - 1] - rho[lag + 1]) / own)


def _onset_share(high: float, beside: float) -> float:
    # Above, with the one before below on the same side, less above with the one before above on the other side.
    opposite = float(special.ndtr(-high)) - rises_above(high, -beside)
    return 2.0 * (rises_above(high, beside) - max(opposite, 0.0))


def difference_onset_threshold(
    per_hour: float, sd: float, rate_hz: float, lag: int = 1, autocorrelation: Correlations | None = None
) -> float:
    """The threshold that `difference_onsets_per_hour` gives `per_hour` for. Raises `ValueError` for more than one in
    ten samples: near one in four the number of onsets falls again with a lower threshold."""
    positive(sd=sd)
    scale, beside = _pair(lag, autocorrelation)
    wanted = math.log(per_sample(per_hour, rate_hz, 0.1))
    excess = lambda high: math.log(_onset_share(high, beside)) - wanted  # noqa: E731
    if excess(1.0) < 0:
        raise ValueError(f"`per_hour` is more than begin at a threshold of {sd * scale:.3g}; got {per_hour}.")
    return sd * scale * float(optimize.brentq(excess, 1.0, MOST_THRESHOLD, xtol=1e-14))


def difference_detection_within(
    threshold: float,
    step: float,
    sd: float,
    lag: int = 1,
    deadline: int = 1,
    autocorrelation: Correlations | None = None,
) -> float:
    """Probability that any of the first `deadline` differences from the step on exceeds the threshold.

    The first `lag` of them hold the step, those after it do not. An integral of the multivariate normal density (Genz,
    Journal of Computational and Graphical Statistics 1, 1992), to about 1e-4; checked for lags of 1 and 3, white and
    coloured.
    """
    positive(sd=sd)
    at_least_one(lag=lag, deadline=deadline)
    rho = correlations(autocorrelation, lag + deadline)
    apart = np.arange(deadline)
    line = (2.0 * rho[apart] - rho[np.abs(apart - lag)] - rho[apart + lag]) * sd**2
    mean = np.where(apart < lag, float(step), 0.0)
    return any_above(threshold, mean, linalg.toeplitz(line), two_sided=True)
