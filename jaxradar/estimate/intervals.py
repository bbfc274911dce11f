"""A value and how well it is known: errors against the truth, shares, and their 95 % confidence intervals."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import betaincinv, gammaincinv, ndtri

__all__ = ["Estimate", "mean", "percentile", "proportion", "rate", "rms"]

CONFIDENCE = 0.95
_SIGMAS = float(ndtri(0.5 + 0.5 * CONFIDENCE))


@dataclass(frozen=True)
class Estimate:
    """A value and the ends of its 95 % confidence interval."""

    value: float
    low: float
    high: float

    def scaled(self, factor: float) -> Estimate:
        """In another unit; `factor` above 0."""
        return Estimate(self.value * factor, self.low * factor, self.high * factor)

    def below(self, other: Estimate) -> bool:
        """Whether it is smaller beyond the error bars of both."""
        return self.high < other.low


def mean(values: np.ndarray) -> Estimate:
    """Of independent values, by the central limit theorem; without an end where there are fewer than two."""
    middle = float(np.mean(values))
    if len(values) < 2:
        return Estimate(middle, -math.inf, math.inf)
    half = _SIGMAS * float(np.std(values, ddof=1)) / math.sqrt(len(values))
    return Estimate(middle, middle - half, middle + half)


def rms(errors: np.ndarray) -> Estimate:
    """Root of the mean square, with the interval of the mean square by the central limit theorem: too narrow where it
    hangs on errors so rare and large that there are only a few among them, or none; look at those apart."""
    square = mean(np.square(errors))
    return Estimate(*(math.sqrt(max(one, 0.0)) for one in (square.value, square.low, square.high)))


def proportion(count: int, total: int) -> Estimate:
    """A share of independent trials, with Clopper and Pearson's interval (Biometrika 26, 1934)."""
    if not 0 <= count <= total or total < 1:
        raise ValueError(f"`proportion` takes a count of 0 to `total` trials; got {count} of {total}.")
    tail = 0.5 * (1.0 - CONFIDENCE)
    low = float(betaincinv(count, total - count + 1, tail)) if count else 0.0
    high = float(betaincinv(count + 1, total - count, 1.0 - tail)) if count < total else 1.0
    return Estimate(count / total, low, high)


def rate(count: int, time: float) -> Estimate:
    """Events that come independently, per unit of `time`, with Garwood's interval (Biometrika 28, 1936)."""
    tail = 0.5 * (1.0 - CONFIDENCE)
    low = float(gammaincinv(count, tail)) if count else 0.0
    high = float(gammaincinv(count + 1, 1.0 - tail))
    return Estimate(count / time, low / time, high / time)


def percentile(values: np.ndarray, percent: float) -> Estimate:
    """Of independent values; the interval lies between two of them, whose ranks are binomial (David and Nagaraja,
    Order Statistics, section 7.1), or has no end where no rank is far enough."""
    ordered = np.sort(values)
    tail = 0.5 * (1.0 - CONFIDENCE)
    from scipy import stats  # takes long to import

    ranks = stats.binom.ppf((tail, 1.0 - tail), len(ordered), percent / 100.0)
    low = float(ordered[int(ranks[0]) - 1]) if ranks[0] >= 1 else -math.inf
    high = float(ordered[int(ranks[1])]) if ranks[1] < len(ordered) else math.inf
    return Estimate(float(np.percentile(ordered, percent)), low, high)
