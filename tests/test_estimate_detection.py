"""Thresholds from theory against simulated noise, with confidence intervals."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from jaxradar.estimate import detection as theory


def exceedances(values: np.ndarray, threshold: float) -> tuple[int, int]:
    return int(np.sum(values > threshold)), values.size


def agrees(count: int, of: int, probability: float) -> bool:
    """Whether a probability is in the 99.9 % interval of a count."""
    low, high = stats.binomtest(count, of).proportion_ci(0.999)
    return bool(low <= probability <= high)


@pytest.mark.parametrize("lag", [1, 3])
def test_differences_of_white_noise(lag: int) -> None:
    noise = np.random.default_rng(1).normal(0, 0.5e-3, 2_000_000)
    difference = np.abs(noise[lag:] - noise[:-lag])
    threshold = 2.0e-3
    count, of = exceedances(difference[:: lag + 1], threshold)
    assert agrees(count, of, theory.difference_false_alarms(threshold, 0.5e-3, 100.0) / 360_000)


def test_differences_of_correlated_noise() -> None:
    random = np.random.default_rng(2)
    one, other = random.normal(size=(2, 1_000_000))
    correlated = 0.6 * one + 0.8 * other
    count, of = exceedances(np.abs(one - correlated), 2.5)
    assert agrees(count, of, theory.difference_false_alarms(2.5, 1.0, 1.0, 0.6) / 3600)


def test_the_threshold_is_the_inverse_and_the_requirements_table_comes_out() -> None:
    for rate, wanted in ((50.0, 0.159), (100.0, 0.327), (200.0, 0.674), (300.0, 1.027)):
        threshold = theory.difference_threshold(1.0, 0.4935e-3, rate)  # table A.3's standard deviation
        assert threshold * rate == pytest.approx(wanted, rel=4e-3)
        assert theory.difference_false_alarms(threshold, 0.4935e-3, rate) == pytest.approx(1.0, rel=1e-9)
    with pytest.raises(ValueError, match="`per_hour` must be above 0"):
        theory.difference_threshold(0.0, 1.0, 100.0)


def test_detection_of_a_step() -> None:
    noise = np.random.default_rng(3).normal(0, 1, (2, 400_000))
    count, of = exceedances(np.abs(noise[0] - noise[1] + 3.0), 4.0)
    assert agrees(count, of, theory.difference_detection(4.0, 3.0, 1.0))
    assert theory.difference_detection(1.0, 2.0, 0.0) == 1.0


@pytest.mark.parametrize(("threshold", "reference", "drift"), [(3.0, 0.5, 0.0), (4.0, 0.25, 0.0), (4.0, 0.5, 1.0)])
def test_mean_run_of_a_cusum(threshold: float, reference: float, drift: float) -> None:
    random = np.random.default_rng(4)
    walks = 4000
    level, run, lengths = np.zeros(walks), np.zeros(walks, int), []
    for _ in range(6000):
        level = np.maximum(level + random.normal(drift, 1, walks) - reference, 0.0)
        run += 1
        over = level > threshold
        lengths.extend(run[over])
        level[over], run[over] = 0.0, 0
    mean = np.mean(lengths)
    assert theory.cusum_run_length(threshold, reference, drift) == pytest.approx(mean, rel=0.04)


def test_cusum_threshold_is_the_inverse() -> None:
    for samples in (100.0, 1e5, 3.6e6):
        threshold = theory.cusum_threshold(samples, 0.5)
        assert theory.cusum_run_length(threshold, 0.5) == pytest.approx(samples, rel=1e-6)
    assert theory.cusum_run_length(5.0, 0.5, 0.5) == pytest.approx((5.0 + theory.CUSUM_OVERSHOOT) ** 2)
    assert theory.cusum_run_length(1000.0, 0.5) == math.inf


@pytest.mark.parametrize(("window", "threshold"), [(4, 3.5), (10, 3.3), (30, 3.0)])
def test_alarms_of_a_moving_sum(window: int, threshold: float) -> None:
    random = np.random.default_rng(5)
    series = random.normal(size=(200, 50_000 + window))
    sums = np.cumsum(series, axis=1)
    scaled = (sums[:, window:] - sums[:, :-window]) / math.sqrt(window)
    # Clumps: exceedances less than a window apart belong together.
    begun = 0
    for row in scaled:
        above = np.flatnonzero(row > threshold)
        begun += int(above.size > 0) + int(np.sum(np.diff(above) > window))
    found = begun / scaled.size
    assert theory.moving_sum_false_alarms(threshold, window) == pytest.approx(found, rel=0.25)
    per_hour = theory.moving_sum_false_alarms(threshold, window) * 3600 * 100.0
    assert theory.moving_sum_threshold(per_hour, 100.0, window) == pytest.approx(threshold, rel=1e-6)


def test_a_step_that_fills_the_window() -> None:
    random = np.random.default_rng(6)
    sums = (random.normal(0.8, 1.0, (200_000, 9))).sum(axis=1) / 3.0
    count, of = exceedances(sums, 3.0)
    assert agrees(count, of, theory.moving_sum_detection(3.0, 9, 0.8))


@pytest.mark.parametrize(("cells", "false_alarm"), [(4, 1e-2), (16, 1e-2), (16, 1e-3)])
def test_multiplier_for_rayleigh_envelopes(cells: int, false_alarm: float) -> None:
    random = np.random.default_rng(7)
    envelope = np.hypot(*random.normal(size=(2, 1_000_000, 1)))[:, 0]
    floor = np.hypot(*random.normal(size=(2, 1_000_000, cells))).mean(axis=1)
    wanted = np.quantile(envelope / floor, 1 - false_alarm)
    assert theory.rayleigh_multiplier(false_alarm, cells) == pytest.approx(wanted, rel=0.03)


def test_effective_cells() -> None:
    assert theory.effective_cells(np.eye(8)) == pytest.approx(8.0)
    assert theory.effective_cells(np.ones((8, 8))) == pytest.approx(1.0)
