"""Thresholds from theory against simulated noise, with confidence intervals: differences, CUSUM, moving sum, GLR."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import linalg, stats

from jaxradar.estimate import detection as theory

inverse = settings(max_examples=10, deadline=None, derandomize=True)
PER_HOUR, RATE = st.floats(0.01, 1000.0), st.floats(20.0, 500.0)
WINDOW, PROBABILITY = st.integers(1, 60), st.floats(0.5, 0.999)
WHITE, COLOURED = None, 0.6 ** np.arange(200)  # of an autoregression of order 1


def agrees(hits: np.ndarray, probability: float) -> bool:
    """Whether a probability is in the 99.9 % interval of Clopper and Pearson of independent trials."""
    low, high = stats.binomtest(int(hits.sum()), hits.size).proportion_ci(0.999, method="exact")
    return bool(low <= probability <= high)


def within(count: int, expected: float, tolerance: float) -> bool:
    """Whether the 99 % interval of a Poisson count lies within so much of what was expected."""
    low, high = stats.chi2.ppf(0.005, 2 * count) / 2, stats.chi2.ppf(0.995, 2 * count + 2) / 2
    return bool(1 - tolerance <= low / expected and high / expected <= 1 + tolerance)


def noise(seed: int, pieces: int, samples: int, autocorrelation: np.ndarray | None) -> np.ndarray:
    """Independent pieces of a stationary series."""
    white = np.random.default_rng(seed).normal(size=(pieces, samples))
    if autocorrelation is None:
        return white
    return white @ linalg.cholesky(linalg.toeplitz(autocorrelation[:samples]))


def clumps(statistic: np.ndarray, threshold: float, window: int) -> tuple[int, int]:
    """Alarms that begin after a quiet window, and how many samples such a window precedes."""
    begun = exposed = 0
    for row in statistic:
        above = np.flatnonzero(row > threshold)
        begun += int(above.size > 0) + int(np.sum(np.diff(above) > window))
        after = np.concatenate([[0], above])
        exposed += int(np.sum(np.maximum(np.diff(np.concatenate([after, [row.size]])) - window, 0)))
    return begun, exposed


@pytest.mark.parametrize("colour", [WHITE, COLOURED], ids=["white", "coloured"])
@pytest.mark.parametrize("lag", [1, 3])
@pytest.mark.parametrize("threshold", [2.0e-3, 1.2e-3])
def test_exceedances_and_onsets_of_a_difference(lag: int, threshold: float, colour: np.ndarray | None) -> None:
    sd = 0.5e-3
    pieces = sd * noise(1, 150_000, lag + 2, colour)
    now, before = np.abs(pieces[:, -1] - pieces[:, 1]), np.abs(pieces[:, -2] - pieces[:, 0])
    correlation = 0.0 if colour is None else colour[lag]
    assert agrees(now > threshold, theory.difference_false_alarms_per_hour(threshold, sd, 100.0, correlation) / 360_000)
    begins = (now > threshold) & (before <= threshold)
    assert agrees(begins, theory.difference_onsets_per_hour(threshold, sd, 100.0, lag, colour) / 360_000)


def test_one_sample_far_out_makes_two_differences_that_exceed() -> None:
    """Fewer alarms begin than samples exceed, by a third at a low threshold and by ever less at a high one."""
    begin, exceed = theory.difference_onsets_per_hour, theory.difference_false_alarms_per_hour
    ratios = [begin(t, 1.0, 1.0) / exceed(t, 1.0, 1.0) for t in (2.0, 4.0, 7.0)]
    assert ratios == sorted(ratios)
    assert ratios[0] == pytest.approx(0.703, abs=1e-3)
    assert ratios[-1] == pytest.approx(0.99, abs=0.01)


@inverse
@given(PER_HOUR, RATE, st.floats(-0.9, 0.9), st.integers(1, 5))
def test_thresholds_of_a_difference_are_inverses(per_hour: float, rate: float, correlation: float, lag: int) -> None:
    threshold = theory.difference_threshold(per_hour, 0.4e-3, rate, correlation)
    found = theory.difference_false_alarms_per_hour(threshold, 0.4e-3, rate, correlation)
    assert found == pytest.approx(per_hour, rel=1e-9)
    colour = np.abs(correlation) ** np.arange(9.0)
    threshold = theory.difference_onset_threshold(per_hour, 0.4e-3, rate, lag, colour)
    found = theory.difference_onsets_per_hour(threshold, 0.4e-3, rate, lag, colour)
    assert found == pytest.approx(per_hour, rel=1e-6)


def test_thresholds_of_a_difference_reach_the_rarest_alarms() -> None:
    for per_hour in (1e-12, 1e-100):
        threshold = theory.difference_onset_threshold(per_hour, 1.0, 100.0)
        assert theory.difference_onsets_per_hour(threshold, 1.0, 100.0) == pytest.approx(per_hour, rel=1e-6)


def test_the_requirements_table_comes_out() -> None:
    for rate, wanted in ((50.0, 0.159), (100.0, 0.327), (200.0, 0.674), (300.0, 1.027)):
        # The standard deviation in the thesis's table A.3; at the rounded 0.49 mm each is 0.7 % lower.
        assert theory.difference_threshold(1.0, 0.4935e-3, rate) * rate == pytest.approx(wanted, rel=4e-3)


def test_detection_of_a_step() -> None:
    pieces = noise(3, 400_000, 2, WHITE)
    assert agrees(np.abs(pieces[:, 1] - pieces[:, 0] + 3.0) > 4.0, theory.difference_detection(4.0, 3.0, 1.0))
    assert theory.difference_detection(1.0, 2.0, 0.0) == 1.0


@pytest.mark.parametrize("colour", [WHITE, COLOURED], ids=["white", "coloured"])
@pytest.mark.parametrize(("lag", "deadline"), [(1, 1), (3, 3), (3, 5)])
def test_detection_of_a_step_by_any_difference(lag: int, deadline: int, colour: np.ndarray | None) -> None:
    pieces = noise(4, 100_000, lag + deadline, colour)
    pieces[:, lag:] += 2.0
    found = (np.abs(pieces[:, lag:] - pieces[:, :deadline]) > 3.5).any(axis=1)
    assert agrees(found, theory.difference_detection_within(3.5, 2.0, 1.0, lag, deadline, colour))


@pytest.mark.parametrize(("threshold", "reference", "drift"), [(3.0, 0.5, 0.0), (4.0, 0.25, 0.0), (4.0, 0.5, 1.0)])
def test_mean_run_of_a_cusum(threshold: float, reference: float, drift: float) -> None:
    random = np.random.default_rng(4)
    expected = theory.cusum_run_length(threshold, reference, drift)
    # Each walk goes on to its own first alarm: breaking off would favour short ones.
    walks = 8000
    level, lengths, run = np.zeros(walks), [], 0
    while level.size:
        run += 1
        level = np.maximum(level + random.normal(drift, 1, level.size) - reference, 0.0)
        lengths += [run] * int(np.sum(level > threshold))
        level = level[level <= threshold]
    error = 2.6 * np.std(lengths) / math.sqrt(walks)
    assert abs(np.mean(lengths) / expected - 1) + error / expected < 0.08
    alarms = theory.cusum_false_alarms_per_hour(threshold, 100.0, reference)
    assert alarms == pytest.approx(360_000 / theory.cusum_run_length(threshold, reference))


@inverse
@given(PER_HOUR, RATE, st.floats(0.0, 2.0))
def test_cusum_threshold_is_the_inverse(per_hour: float, rate: float, reference: float) -> None:
    threshold = theory.cusum_threshold(per_hour, rate, reference)
    assert theory.cusum_false_alarms_per_hour(threshold, rate, reference) == pytest.approx(per_hour, rel=1e-6)


def test_runs_of_a_cusum_without_drift_and_without_end() -> None:
    assert theory.cusum_run_length(5.0, 0.5, 0.5) == pytest.approx((5.0 + theory.CUSUM_OVERSHOOT) ** 2)
    assert theory.cusum_run_length(1000.0, 0.5) == math.inf


@pytest.mark.parametrize(("window", "threshold"), [(4, 3.3), (10, 3.2), (30, 3.0)])
def test_alarms_of_a_moving_sum(window: int, threshold: float) -> None:
    sums = np.cumsum(noise(5, 100, 20_000 + window, WHITE), axis=1)
    scaled = (sums[:, window:] - sums[:, :-window]) / math.sqrt(window)
    begun, exposed = clumps(scaled, threshold, window)
    assert within(begun, theory.moving_sum_false_alarms_per_hour(threshold, 100.0, window) / 360_000 * exposed, 0.25)


@pytest.mark.parametrize("colour", [WHITE, COLOURED], ids=["white", "coloured"])
@pytest.mark.parametrize(("window", "threshold"), [(1, 2.5), (4, 3.0), (30, 2.5)])
def test_a_moving_sum_rises_above_its_threshold(window: int, threshold: float, colour: np.ndarray | None) -> None:
    pieces = noise(6, 100_000, window + 1, colour)
    before, now = (pieces[:, part].sum(axis=1) / math.sqrt(window) for part in (slice(0, -1), slice(1, None)))
    high = threshold * theory.moving_sum_sd(window, colour)
    begins = (now > high) & (before <= high)
    assert agrees(begins, theory.moving_sum_onsets_per_hour(high, 100.0, window, colour) / 360_000)


@pytest.mark.parametrize("colour", [WHITE, COLOURED], ids=["white", "coloured"])
@pytest.mark.parametrize(("window", "deadline"), [(4, 4), (9, 4), (6, 12)])
def test_a_step_before_its_deadline(window: int, deadline: int, colour: np.ndarray | None) -> None:
    pieces = noise(7, 40_000, window - 1 + deadline, colour)
    pieces[:, window - 1 :] += 1.2
    sums = np.cumsum(np.pad(pieces, ((0, 0), (1, 0))), axis=1)
    scaled = (sums[:, window:] - sums[:, :-window]) / math.sqrt(window)
    assert agrees(scaled[:, -1] > 3.0, theory.moving_sum_detection(3.0, window, 1.2, deadline, colour))
    by_then = theory.moving_sum_detection_within(3.0, window, 1.2, deadline, colour)
    assert agrees((scaled > 3.0).any(axis=1), by_then)
    assert by_then >= theory.moving_sum_detection(3.0, window, 1.2, deadline, colour)


@inverse
@given(st.floats(0.01, 100.0), RATE, WINDOW, PROBABILITY, st.integers(1, 80))
def test_window_limited_tests_have_inverses(
    per_hour: float, rate: float, window: int, probability: float, deadline: int
) -> None:
    threshold = theory.moving_sum_threshold(per_hour, rate, window)
    alarms = theory.moving_sum_false_alarms_per_hour(threshold, rate, window)
    assert alarms == pytest.approx(per_hour, rel=1e-6)
    step = theory.moving_sum_least_step(per_hour, rate, window, probability, deadline)
    assert theory.moving_sum_detection(threshold, window, step, deadline) == pytest.approx(probability, rel=1e-9)
    coloured = theory.moving_sum_onset_threshold(per_hour, rate, window, COLOURED)
    onsets = theory.moving_sum_onsets_per_hour(coloured, rate, window, COLOURED)
    assert onsets == pytest.approx(per_hour, rel=1e-6)
    step = theory.moving_sum_least_step(per_hour, rate, window, probability, None, COLOURED)
    found = theory.moving_sum_detection(coloured, window, step, None, COLOURED)
    assert found == pytest.approx(probability, rel=1e-9)
    likely = theory.glr_threshold(per_hour, rate, window)
    assert theory.glr_false_alarms_per_hour(likely, rate, window) == pytest.approx(per_hour, rel=1e-6)
    step = theory.glr_least_step(per_hour, rate, window, probability, deadline)
    assert theory.glr_detection(likely, window, step, deadline) == pytest.approx(probability, rel=1e-9)


@pytest.mark.parametrize("colour", [WHITE, COLOURED], ids=["white", "coloured"])
@pytest.mark.parametrize("step", [0.5, 1.5, 4.0, 12.0])
def test_the_least_window_is_the_least(step: float, colour: np.ndarray | None) -> None:
    window = theory.moving_sum_least_window(1.0, 100.0, step, 0.99, colour)
    assert theory.moving_sum_least_step(1.0, 100.0, window, 0.99, None, colour) <= step
    if window > 1:
        assert theory.moving_sum_least_step(1.0, 100.0, window - 1, 0.99, None, colour) > step
    assert (window == 1) == (step == 12.0)


@pytest.mark.parametrize(("window", "threshold"), [(1, 3.0), (4, 3.5), (10, 3.5), (30, 3.5), (10, 4.0)])
def test_alarms_of_a_glr(window: int, threshold: float) -> None:
    samples = 50_000 if threshold == 4.0 else 15_000
    sums = np.cumsum(noise(8, 60, samples + window, WHITE), axis=1)
    statistic = np.max(
        [np.abs(sums[:, window:] - sums[:, window - k : -k]) / math.sqrt(k) for k in range(1, window + 1)], axis=0
    )
    begun, exposed = clumps(statistic, threshold, window)
    assert within(begun, theory.glr_false_alarms_per_hour(threshold, 100.0, window) / 360_000 * exposed, 0.3)


@pytest.mark.parametrize(("window", "deadline"), [(8, 8), (8, 3)])
def test_a_glr_finds_at_least_as_many_steps_as_promised(window: int, deadline: int) -> None:
    pieces = noise(9, 60_000, window - 1 + deadline, WHITE)
    pieces[:, window - 1 :] -= 1.5
    sums = np.cumsum(np.pad(pieces, ((0, 0), (1, 0))), axis=1)
    every = [np.abs(sums[:, window:] - sums[:, window - k : -k or None]) / math.sqrt(k) for k in range(1, window + 1)]
    promised = theory.glr_detection(3.5, window, 1.5, deadline)
    assert agrees(every[deadline - 1][:, -1] > 3.5, promised)
    found = np.mean((np.max(every, axis=0) > 3.5).any(axis=1))
    assert promised < found < promised + 0.2


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda: theory.difference_threshold(0.0, 1.0, 100.0), "`per_hour` must be above 0"),
        (lambda: theory.difference_threshold(1.0, 1.0, 0.0), "`rate_hz` must be above 0"),
        (lambda: theory.difference_threshold(1.0, 0.0, 100.0), "`sd` must be above 0"),
        (lambda: theory.difference_threshold(1.0, 1.0, 100.0, 1.0), "`correlation` must be below 1"),
        (lambda: theory.difference_false_alarms_per_hour(1.0, -1.0, 1.0), "`sd` must be 0 or above"),
        (lambda: theory.difference_false_alarms_per_hour(1.0, 1.0, 0.0), "`rate_hz` must be above 0"),
        (lambda: theory.difference_false_alarms_per_hour(1.0, 1.0, 1.0, 1.5), "`correlation` must be between -1 and 1"),
        (
            lambda: theory.difference_onsets_per_hour(1.0, 1.0, 1.0, 1, np.array([0.5])),
            "`autocorrelation` must begin with 1",
        ),
        (lambda: theory.difference_onsets_per_hour(1.0, 1.0, 1.0, 0), "`lag` must be 1 or more"),
        (lambda: theory.difference_onset_threshold(1e5, 1.0, 100.0), "`per_hour` must be above 0 and below 36000"),
        (lambda: theory.cusum_threshold(2e5, 100.0, 0.5), "`per_hour` must be above 0 and below 172"),
        (lambda: theory.cusum_threshold(0.0, 100.0, 0.5), "`per_hour` must be above 0 and below"),
        (lambda: theory.cusum_threshold(1.0, 0.0, 0.5), "`rate_hz` must be above 0"),
        (lambda: theory.moving_sum_threshold(1e9, 100.0, 8), "`per_hour` must be above 0 and below"),
        (lambda: theory.moving_sum_false_alarms_per_hour(3.0, 100.0, 0), "`window` must be 1 or more"),
        (lambda: theory.moving_sum_least_step(1.0, 100.0, 4, 1.0), "`probability` must be above 0 and below 1"),
        (lambda: theory.moving_sum_least_window(1.0, 100.0, 1e-3), "`step` needs a window of more than 4096"),
        (lambda: theory.glr_threshold(1e9, 100.0, 8), "`per_hour` must be above 0 and below"),
        (lambda: theory.glr_least_step(1.0, 100.0, 8, 1e-12), "`probability` must be above that of noise alone"),
    ],
)
def test_what_no_threshold_answers_is_refused(call, name: str) -> None:
    with pytest.raises(ValueError, match=name):
        call()
