"""What the tests share: rates per hour and per sample, correlated Gaussian pairs, checks of arguments."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy import special

SECONDS_PER_HOUR = 3600.0
Correlations = Float[np.ndarray, " lags"]


def per_sample(per_hour: float, rate_hz: float, most: float = 1.0) -> float:
    """Alarms per sample, which must be above 0 and below `most`."""
    positive(rate_hz=rate_hz)
    samples = SECONDS_PER_HOUR * rate_hz
    wanted = per_hour / samples
    if not 0 < wanted < most:
        raise ValueError(f"`per_hour` must be above 0 and below {most * samples:.6g}; got {per_hour}.")
    return wanted


def per_hour_of(share: float, rate_hz: float) -> float:
    """Alarms an hour, of so many per sample."""
    positive(rate_hz=rate_hz)
    return SECONDS_PER_HOUR * rate_hz * share


def positive(**values: float) -> None:
    for name, value in values.items():
        if not (value > 0 and math.isfinite(value)):
            raise ValueError(f"`{name}` must be above 0 and finite; got {value}.")


def at_least_one(**values: int) -> None:
    for name, value in values.items():
        if value < 1:
            raise ValueError(f"`{name}` must be 1 or more; got {value}.")


def share(name: str, value: float) -> None:
    if not 0 < value < 1:
        raise ValueError(f"`{name}` must be above 0 and below 1; got {value}.")


def correlations(autocorrelation: Correlations | None, lags: int) -> Float[np.ndarray, " kept"]:
    """ρ(0 .. `lags`), 0 beyond what is given; None is white noise."""
    full = np.zeros(lags + 1)
    if autocorrelation is None:
        full[0] = 1.0
        return full
    if (
        autocorrelation.size < 1
        or not np.isclose(autocorrelation[0], 1.0)
        or np.any(np.abs(autocorrelation) > 1 + 1e-9)
    ):
        raise ValueError("`autocorrelation` must begin with 1, and no value of it may be beyond ±1.")
    kept = autocorrelation[: lags + 1]
    full[: kept.size] = kept
    return full


def normal_density(x: float) -> float:
    return math.exp(-0.5 * x * x) / math.sqrt(2.0 * math.pi)


def rises_above(threshold: float, correlation: float) -> float:
    """P(x > h ≥ y) of two standard normal values of this correlation: 2 T(h, √((1 − ρ)/(1 + ρ))), T being Owen's
    (Annals of Mathematical Statistics 27, 1956). No small difference of large terms."""
    if correlation <= -1.0:
        return float(special.ndtr(-abs(threshold)))
    return 2.0 * float(special.owens_t(threshold, math.sqrt(max(1.0 - correlation, 0.0) / (1.0 + correlation))))


def overshoot(x: float | np.ndarray) -> Any:
    """Siegmund's ν(x), of the discrete walk over a boundary, in its closed approximation (Siegmund and Yakir, The
    Statistics of Gene Mapping, 2007, section 5.2)."""
    half = 0.5 * np.maximum(x, 1e-6)  # 0/0 at 0, where ν is 1
    below = special.ndtr(half)
    return (below - 0.5) / half / (half * below + np.exp(-0.5 * half**2) / math.sqrt(2.0 * math.pi))


def any_above(threshold: float, mean: np.ndarray, covariance: np.ndarray, *, two_sided: bool) -> float:
    """1 − P(all below the threshold); the seed is fixed, so that equal arguments give equal results."""
    from scipy import stats  # which takes long to import

    held = stats.multivariate_normal(mean, covariance, allow_singular=True, seed=0, maxpts=20_000 * mean.size)
    high = np.full(mean.size, threshold)
    return 1.0 - float(held.cdf(high, lower_limit=-high if two_sided else None))
