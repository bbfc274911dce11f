"""The window-limited generalised likelihood ratio for a step of unknown height and age, up or down.

The statistic is the largest |sum of the last k samples|/√k over k = 1 .. m, in white noise of standard deviation 1 with
a known level (0) before the step.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import optimize, special

from jaxradar.estimate.detection._common import (
    at_least_one,
    normal_density,
    overshoot,
    per_hour_of,
    per_sample,
    share,
)

__all__ = ["glr_detection", "glr_false_alarms_per_hour", "glr_least_step", "glr_threshold"]

LEAST_THRESHOLD, MOST_THRESHOLD = 2.0, 35.0


def glr_false_alarms_per_hour(threshold: float, rate_hz: float, window: int) -> float:
    """Alarms an hour in noise alone, those less than a window apart counted as one.

    2 Σ b³ φ(b) ν²(b/√k)/(4 k²) per sample, over the lengths k, the sum for which Siegmund and Venkatraman (Annals of
    Statistics 23, 1995) write b φ(b) ∫ x ν²(x) dx, x = b/√k, cut at the window as by Lai (Journal of the Royal
    Statistical Society B 57, 1995). Asymptotic, for a probability per window that is small. Compared with simulated
    rates for windows of 4, 10 and 30 at thresholds of 3.5 and 4 it is within 30 %: low by 15 % for short windows. A
    window of 1 is exact.
    """
    return per_hour_of(_alarm_share(threshold, window), rate_hz)


def _alarm_share(threshold: float, window: int) -> float:
    at_least_one(window=window)
    if window == 1:
        return 2.0 * float(special.ndtr(-threshold))
    lengths = np.arange(1, window + 1)
    over = overshoot(threshold / np.sqrt(lengths))
    return 0.5 * threshold**3 * normal_density(threshold) * float(np.sum((over / lengths) ** 2))


def glr_threshold(per_hour: float, rate_hz: float, window: int) -> float:
    """The threshold that `glr_false_alarms_per_hour` gives `per_hour` for. Raises `ValueError` for more than there are
    at a threshold of 2."""
    wanted = per_sample(per_hour, rate_hz, _alarm_share(LEAST_THRESHOLD, window))
    over = lambda b: math.log(_alarm_share(b, window)) - math.log(wanted)  # noqa: E731
    return float(optimize.brentq(over, LEAST_THRESHOLD, MOST_THRESHOLD))


def glr_detection(threshold: float, window: int, step: float, deadline: int | None = None) -> float:
    """Least probability that a step of so many standard deviations is found within `deadline` sweeps, at most the
    window (None).

    Q(b − |δ| √d) + Q(b + |δ| √d): what the one sum that holds the step and nothing else does at the deadline; sums of
    other lengths and earlier alarms come on top.
    """
    filled = _filled(window, deadline)
    shift = abs(step) * math.sqrt(filled)
    return float(special.ndtr(shift - threshold) + special.ndtr(-shift - threshold))


def glr_least_step(
    per_hour: float, rate_hz: float, window: int, probability: float = 0.99, deadline: int | None = None
) -> float:
    """The least step, in standard deviations of the noise, that `glr_detection` finds with this probability at so many
    false alarms an hour. Raises `ValueError` for a probability that noise alone reaches."""
    share("probability", probability)
    threshold, filled = glr_threshold(per_hour, rate_hz, window), _filled(window, deadline)
    if probability <= glr_detection(threshold, window, 0.0, deadline):
        raise ValueError(f"`probability` must be above that of noise alone; got {probability}.")
    over = lambda step: glr_detection(threshold, window, step, deadline) - probability  # noqa: E731
    return float(optimize.brentq(over, 0.0, (threshold + 40.0) / math.sqrt(filled), xtol=1e-13))


def _filled(window: int, deadline: int | None) -> int:
    at_least_one(window=window, deadline=window if deadline is None else deadline)
    return window if deadline is None else min(deadline, window)
