"""Thresholds from theory: from noise, sweep rate and window to false alarms and detections, and back.

The noise is Gaussian, of standard deviation `sd` in each sample (metres, for ranges), independent from sample to sample
unless a correlation is given. Rates count samples above the threshold (of the difference), or alarms that begin (of
the sequential tests). All in float64 on the host.
"""

from __future__ import annotations

import math

import numpy as np
from scipy import integrate, optimize, special

__all__ = [
    "CUSUM_OVERSHOOT",
    "cusum_run_length",
    "cusum_threshold",
    "difference_detection",
    "difference_false_alarms",
    "difference_threshold",
    "effective_cells",
    "moving_sum_detection",
    "moving_sum_false_alarms",
    "moving_sum_threshold",
    "rayleigh_multiplier",
]

SECONDS_PER_HOUR = 3600.0
CUSUM_OVERSHOOT = 1.166  # of a Gaussian walk over two barriers, 2 × 0.583 (Siegmund, Sequential Analysis, 1985, 10.2)


def _difference_sd(sd: float, correlation: float = 0.0) -> float:
    """Standard deviation of the difference of two samples that are correlated: √(2 (1 − ρ)) sd."""
    if not -1.0 <= correlation <= 1.0:
        raise ValueError(f"`correlation` must be between -1 and 1; got {correlation}.")
    return sd * math.sqrt(2.0 * (1.0 - correlation))


def difference_false_alarms(threshold: float, sd: float, rate_hz: float, correlation: float = 0.0) -> float:
    """False alarms an hour of |x[n] − x[n−m]| > `threshold`: 2 Q(t/σ_d) of each sample.

    `correlation`: of samples m apart. For the thesis's rule: `threshold` = 0.7 m/s × m / rate.
    """
    scale = _difference_sd(sd, correlation)
    share = 0.0 if scale == 0 else 2.0 * float(special.ndtr(-threshold / scale))
    return SECONDS_PER_HOUR * rate_hz * share


def difference_threshold(per_hour: float, sd: float, rate_hz: float, correlation: float = 0.0) -> float:
    """The threshold that `difference_false_alarms` gives `per_hour` for (Neyman and Pearson's, for a step of any
    height). Raises `ValueError` for more alarms than samples, or none."""
    share = per_hour / (SECONDS_PER_HOUR * rate_hz)
    if not 0 < share < 1:
        raise ValueError(
            f"`per_hour` must be above 0 and below the {SECONDS_PER_HOUR * rate_hz:g} samples; got {per_hour}."
        )
    return -_difference_sd(sd, correlation) * float(special.ndtri(0.5 * share))


def difference_detection(threshold: float, step: float, sd: float, correlation: float = 0.0) -> float:
    """Probability that the difference across a step exceeds the threshold."""
    scale = _difference_sd(sd, correlation)
    if scale == 0:
        return float(abs(step) > threshold)
    return float(special.ndtr((abs(step) - threshold) / scale) + special.ndtr((-abs(step) - threshold) / scale))


def cusum_run_length(threshold: float, reference: float, drift: float = 0.0) -> float:
    """Mean samples to an alarm of S = max(0, S + x − k) > h, x of standard deviation 1 and mean `drift`.

    (e^(−2Δb) + 2Δb − 1)/(2Δ²), Δ = `drift` − k, b = h + 1.166; b² for Δ = 0. Siegmund's corrected diffusion
    (Sequential Analysis, equation 2.56); compared with simulated walks of 8, 77 and 119 samples
    it is within 4 %.
    """
    excess, barrier = drift - reference, threshold + CUSUM_OVERSHOOT
    if abs(excess) < 1e-6:
        return barrier**2
    product = 2.0 * excess * barrier
    if product < -700.0:
        return math.inf
    return (math.exp(-product) + product - 1.0) / (2.0 * excess**2)


def cusum_threshold(samples: float, reference: float) -> float:
    """The threshold h at which noise alone runs for so many samples on average. Raises `ValueError` for fewer samples
    than a threshold of 0 has."""
    least = cusum_run_length(0.0, reference)
    if not samples >= least:
        raise ValueError(f"`samples` must be at least {least:.3g}, the mean run at a threshold of 0; got {samples}.")
    over = lambda h: math.log(cusum_run_length(h, reference)) - math.log(samples)  # noqa: E731
    high = 1.0
    while over(high) < 0:
        high *= 2.0
    return float(optimize.brentq(over, 0.0, high))


def _overshoot(x: float) -> float:
    """Siegmund's ν(x), of the discrete walk over a boundary, in its closed approximation (Siegmund and Yakir, The Statistics
    of Gene Mapping, 2007, section 5.2)."""
    if x < 1e-8:
        return 1.0
    half = 0.5 * x
    density = math.exp(-0.5 * half**2) / math.sqrt(2.0 * math.pi)
    share = float(special.ndtr(half))
    return (share - 0.5) / half / (half * share + density)


def moving_sum_false_alarms(threshold: float, window: int) -> float:
    """Alarms that begin, per sample, of a window-limited test in white noise of standard deviation 1: the sum of the
    last `window` samples over √`window` rises above `threshold`, one-sided.

    b φ(b) ν(b √(2/m))/m, the rate at which clumps of exceedances come (Siegmund and Yakir, section 5.2: the sum's
    correlation falls as |lag|/m); asymptotic, for a probability per window that is small;
    within 25 % of simulated rates at thresholds of 3 to 3.5.
    """
    if window < 1:
        raise ValueError(f"`window` must be 1 or more; got {window}.")
    if window == 1:
        return float(special.ndtr(-threshold))
    density = math.exp(-0.5 * threshold**2) / math.sqrt(2.0 * math.pi)
    return threshold * density * _overshoot(threshold * math.sqrt(2.0 / window)) / window


def moving_sum_threshold(per_hour: float, rate_hz: float, window: int) -> float:
    """The threshold of the moving sum for so many false alarms an hour, in standard deviations of the scaled sum.
    Raises `ValueError` for more than the formula can be asked for."""
    wanted = per_hour / (SECONDS_PER_HOUR * rate_hz)
    low, high = 1.5, 35.0
    if not 0 < wanted < moving_sum_false_alarms(low, window):
        most = moving_sum_false_alarms(low, window) * SECONDS_PER_HOUR * rate_hz
        raise ValueError(f"`per_hour` must be above 0 and below {most:.3g}; got {per_hour}.")
    over = lambda b: math.log(moving_sum_false_alarms(b, window)) - math.log(wanted)  # noqa: E731
    return float(optimize.brentq(over, low, high))


def moving_sum_detection(threshold: float, window: int, step: float) -> float:
    """Probability that a step of so many standard deviations is found by the time that it fills the window: the
    deadline of the test. A lower bound, as earlier alarms count too: Q(b − δ √m)."""
    return float(special.ndtr(step * math.sqrt(window) - threshold))


def rayleigh_multiplier(false_alarm: float, cells: float) -> float:
    """What the mean of `cells` floor cells is multiplied by for a threshold on a Rayleigh envelope (linear law).

    P(x > α m) = E[exp(−α² m²/(2σ²))] over the mean m of the cells, whose distribution is taken as a gamma of the same
    mean σ √(π/2) and variance (2 − π/2) σ²/`cells` (exact moments; `cells` may be an effective number of correlated
    ones). Right to 3 % in α for 4 cells and more
    (compared at 1e-2 and 1e-3). Raises `ValueError` outside 0 < `false_alarm` < 1.
    """
    if not 0 < false_alarm < 1:
        raise ValueError(f"`false_alarm` must be above 0 and below 1; got {false_alarm}.")
    mean, variance = math.sqrt(0.5 * math.pi), (2.0 - 0.5 * math.pi) / cells
    shape, scale = mean**2 / variance, variance / mean

    def share(multiplier: float) -> float:
        def under(m: float) -> float:
            log = (shape - 1.0) * math.log(m / scale) - m / scale - special.gammaln(shape) - math.log(scale)
            return math.exp(log - 0.5 * (multiplier * m) ** 2)

        spread = 12.0 * math.sqrt(variance)
        return float(integrate.quad(under, max(1e-9, mean - spread), mean + spread, limit=200)[0])

    over = lambda a: math.log(max(share(a), 1e-300)) - math.log(false_alarm)  # noqa: E731
    return float(optimize.brentq(over, 1e-3, 100.0))


def effective_cells(correlation: np.ndarray) -> float:
    """How many independent cells the mean of correlated ones is worth: n² over the sum of their correlation matrix."""
    return float(correlation.shape[0] ** 2 / np.sum(correlation))
