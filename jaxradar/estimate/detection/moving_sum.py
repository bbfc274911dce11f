"""The window-limited test (FMA): the sum of the last m samples over √m rises above b, one-sided, with a deadline.

Samples are in standard deviations of the noise, and the level before the step is known (0). For steps of either sign
two such tests stand side by side, each with half of the false alarms. White noise unless an `autocorrelation` ρ(0),
ρ(1), … is given, which is 0 beyond its end.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from scipy import linalg, optimize, special

from jaxradar.estimate.detection._common import (
    Correlations,
    any_above,
    at_least_one,
    correlations,
    normal_density,
    overshoot,
    per_hour_of,
    per_sample,
    positive,
    rises_above,
    share,
)

__all__ = [
    "moving_sum_detection",
    "moving_sum_detection_within",
    "moving_sum_false_alarms_per_hour",
    "moving_sum_least_step",
    "moving_sum_least_window",
    "moving_sum_onset_threshold",
    "moving_sum_onsets_per_hour",
    "moving_sum_sd",
    "moving_sum_threshold",
]

LEAST_THRESHOLD, MOST_THRESHOLD = 1.5, 35.0
LONGEST_WINDOW = 4096


def moving_sum_sd(window: int, autocorrelation: Correlations | None = None) -> float:
    """Standard deviation of the sum over √`window`: √(1 + 2 Σ (1 − k/m) ρ(k)), 1 for white noise
    (Brockwell and Davis, Time Series: Theory and Methods, 1991, section 7.1)."""
    return math.sqrt(_sum_covariance(window, autocorrelation, 0)[0])


def _sum_covariance(window: int, autocorrelation: Correlations | None, lags: int) -> np.ndarray:
    """Covariance of scaled sums 0 .. `lags` samples apart: ρ weighted by the triangle that two windows share."""
    at_least_one(window=window)
    rho = correlations(autocorrelation, window + lags)
    reach = np.arange(-window + 1, window)
    triangle = (1.0 - np.abs(reach) / window) if window > 1 else np.ones(1)
    return np.array([triangle @ rho[np.abs(reach + apart)] for apart in range(lags + 1)])


def moving_sum_false_alarms_per_hour(threshold: float, rate_hz: float, window: int) -> float:
    """Alarms an hour of the test in white noise, those less than a window apart counted as one.

    b φ(b) ν(b √(2/m))/m per sample, the rate at which clumps of exceedances come (Siegmund and Yakir, The Statistics of
    Gene Mapping, 2007, section 5.2: the sum's correlation falls as |lag|/m); asymptotic, for a probability per window
    that is small; within 25 % of simulated rates for windows of 4, 10 and 30 at thresholds of 3 to 3.3. A window of 1
    is exact.
    """
    return per_hour_of(_alarm_share(threshold, window), rate_hz)


def _alarm_share(threshold: float, window: int) -> float:
    at_least_one(window=window)
    if window == 1:
        return float(special.ndtr(-threshold))
    return threshold * normal_density(threshold) * float(overshoot(threshold * math.sqrt(2.0 / window))) / window


def moving_sum_threshold(per_hour: float, rate_hz: float, window: int) -> float:
    """The threshold, in standard deviations of the scaled sum, that `moving_sum_false_alarms_per_hour` gives `per_hour`
    for. Raises `ValueError` for more than there are at a threshold of 1.5."""
    wanted = per_sample(per_hour, rate_hz, _alarm_share(LEAST_THRESHOLD, window))
    over = lambda b: math.log(_alarm_share(b, window)) - math.log(wanted)  # noqa: E731
    return float(optimize.brentq(over, LEAST_THRESHOLD, MOST_THRESHOLD))


def moving_sum_onsets_per_hour(
    threshold: float, rate_hz: float, window: int, autocorrelation: Correlations | None = None
) -> float:
    """How often an hour the test rises above its threshold, each time counted: P(z[n] > b ≥ z[n−1]).

    Exact for Gaussian noise of any colour, by Owen's T function (Annals of Mathematical Statistics 27, 1956), and so an
    upper bound of the alarms that a test with a pause after each raises. Checked for windows of 1 to 30 at 5e-4 to
    6e-3 per sample, white and coloured.
    """
    own, beside = _sum_covariance(window, autocorrelation, 1)
    return per_hour_of(rises_above(threshold / math.sqrt(own), beside / own), rate_hz)


def moving_sum_onset_threshold(
    per_hour: float, rate_hz: float, window: int, autocorrelation: Correlations | None = None
) -> float:
    """The threshold that `moving_sum_onsets_per_hour` gives `per_hour` for. Raises `ValueError` for more than there are
    at a threshold of one standard deviation of the sum."""
    own, beside = _sum_covariance(window, autocorrelation, 1)
    rises = lambda z: rises_above(z, beside / own)  # noqa: E731
    wanted = per_sample(per_hour, rate_hz, rises(1.0))
    over = lambda z: math.log(rises(z)) - math.log(wanted)  # noqa: E731
    return math.sqrt(own) * float(optimize.brentq(over, 1.0, MOST_THRESHOLD, xtol=1e-14))


def moving_sum_detection(
    threshold: float,
    window: int,
    step: float,
    deadline: int | None = None,
    autocorrelation: Correlations | None = None,
) -> float:
    """Probability that the test is above its threshold `deadline` sweeps into a step of so many standard deviations.

    Q((b − δ min(d, m)/√m)/σ), σ = `moving_sum_sd`; None is the window itself. A lower bound of finding it by then, as
    earlier alarms count too: `moving_sum_detection_within`.
    """
    at_least_one(window=window, deadline=window if deadline is None else deadline)
    filled = window if deadline is None else min(deadline, window)
    return float(special.ndtr((step * filled / math.sqrt(window) - threshold) / moving_sum_sd(window, autocorrelation)))


def moving_sum_detection_within(
    threshold: float, window: int, step: float, deadline: int, autocorrelation: Correlations | None = None
) -> float:
    """Probability that the test rises above its threshold in any of the first `deadline` sweeps of a step.

    An integral of the multivariate normal density (Genz, Journal of Computational and Graphical Statistics 1, 1992), to
    about 1e-3; checked for deadlines of 4 to 12 sweeps, white and coloured.
    """
    at_least_one(deadline=deadline)
    covariance = _sum_covariance(window, autocorrelation, deadline - 1)
    mean = step * np.minimum(np.arange(1, deadline + 1), window) / math.sqrt(window)
    return any_above(threshold, mean, linalg.toeplitz(covariance), two_sided=False)


def moving_sum_least_step(
    per_hour: float,
    rate_hz: float,
    window: int,
    probability: float = 0.99,
    deadline: int | None = None,
    autocorrelation: Correlations | None = None,
) -> float:
    """The least step, in standard deviations of the noise, that is found by the deadline with at least this
    probability (`moving_sum_detection`) at so many false alarms an hour; with an `autocorrelation` each rise above
    the threshold is one."""
    share("probability", probability)
    at_least_one(window=window, deadline=window if deadline is None else deadline)
    filled = window if deadline is None else min(deadline, window)
    threshold = _threshold(per_hour, rate_hz, window, autocorrelation)
    margin = moving_sum_sd(window, autocorrelation) * float(special.ndtri(probability))
    return (threshold + margin) * math.sqrt(window) / filled


def moving_sum_least_window(
    per_hour: float,
    rate_hz: float,
    step: float,
    probability: float = 0.99,
    autocorrelation: Correlations | None = None,
) -> int:
    """The shortest window, and so the earliest deadline in sweeps, by which a step of so many standard deviations is
    found with at least this probability at so many false alarms an hour. Raises `ValueError` for a step so low
    that the window would be longer than 4,096. For noise of which a longer mean is never the noisier one.
    """
    positive(step=step)
    least = partial(moving_sum_least_step, per_hour, rate_hz, probability=probability, autocorrelation=autocorrelation)
    low, high = 0, 1
    while least(high) > step:
        low, high = high, 2 * high
        if high > LONGEST_WINDOW:
            raise ValueError(f"`step` needs a window of more than {LONGEST_WINDOW} sweeps; got {step}.")
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if least(middle) > step else (low, middle)
    return high


def _threshold(per_hour: float, rate_hz: float, window: int, autocorrelation: Correlations | None) -> float:
    if autocorrelation is None:
        return moving_sum_threshold(per_hour, rate_hz, window)
    return moving_sum_onset_threshold(per_hour, rate_hz, window, autocorrelation)
