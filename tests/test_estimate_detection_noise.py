"""The colour of noise found and taken away, and multipliers for Rayleigh envelopes, against simulated noise."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import linalg, signal

from jaxradar.estimate import detection as theory

COEFFICIENTS = {"white": [], "first order": [0.7], "second order": [0.5, -0.3]}


@pytest.mark.parametrize("kind", COEFFICIENTS)
def test_the_colour_of_a_record_is_found_and_taken_away(kind: str) -> None:
    wanted = np.array(COEFFICIENTS[kind], float)
    white = np.random.default_rng(1).normal(0, 0.3, 20_000)
    record = 5.0 + signal.lfilter([1.0], np.concatenate([[1.0], -wanted]), white)
    half = record.size // 2
    model = theory.fit_noise(record[:half])
    assert model.order >= wanted.size  # AICC may keep one or two more, near 0
    np.testing.assert_allclose(model.coefficients[: wanted.size], wanted, atol=0.04)
    assert np.all(np.abs(model.coefficients[wanted.size :]) < 0.04)
    assert model.innovation_sd == pytest.approx(0.3, rel=0.03)
    assert model.sd == pytest.approx(np.std(record[:half]), rel=1e-3)
    left = model.whitened(record[half:])
    assert left.size == half - model.order
    # 4 standard errors of a correlation of white noise.
    assert np.all(np.abs(theory.sample_autocorrelation(left, 10)[1:]) < 4 / math.sqrt(left.size))
    exact = theory.fit_noise(record, order=wanted.size).autocorrelation(30)
    np.testing.assert_allclose(exact, theory.sample_autocorrelation(record, 30), atol=0.06)


def test_the_rate_of_false_alarms_follows_from_a_record() -> None:
    """Fitted on one half, predicted for the other: of the coloured difference, and of the whitened innovation."""
    white = np.random.default_rng(2).normal(0, 1e-3, 300_000)
    record = signal.lfilter([1.0], [1.0, -0.7], white)
    half = record.size // 2
    model = theory.fit_noise(record[:half])
    rho = model.autocorrelation(2)
    for lag in (1, 2):
        threshold = 2.6 * model.sd * math.sqrt(2 * (1 - rho[lag]))
        counted = np.mean(np.abs(record[half + lag :] - record[half:-lag]) > threshold)
        predicted = theory.difference_false_alarms_per_hour(threshold, model.sd, 1.0, rho[lag]) / 3600
        assert predicted == pytest.approx(counted, rel=0.12)
    alarms = np.mean(np.abs(model.whitened(record[half:])) > 2.6 * model.innovation_sd)
    assert alarms == pytest.approx(math.erfc(2.6 / math.sqrt(2)), rel=0.1)


@pytest.mark.parametrize(
    ("record", "order", "name"),
    [
        (np.ones(100), None, "finite and not constant"),
        (np.full(100, 0.1), None, "finite and not constant"),
        (np.append(np.arange(99.0), np.nan), None, "finite and not constant"),
        (np.arange(10.0), None, "must hold 11 samples"),
        (np.arange(10.0), -1, "the order being 0 or more"),
    ],
)
def test_a_record_that_says_nothing_is_refused(record: np.ndarray, order: int | None, name: str) -> None:
    with pytest.raises(ValueError, match=name):
        theory.fit_noise(record, order)


def complex_noise(random: np.random.Generator, trials: int, correlation: np.ndarray) -> np.ndarray:
    """Circular Gaussian cells of this correlation, given from lag 0 on."""
    # A smooth correlation is all but singular.
    matrix = linalg.toeplitz(correlation) + 1e-9 * np.eye(correlation.size)
    parts = random.normal(size=(2, trials, correlation.size)) @ linalg.cholesky(matrix)
    return parts[0] + 1j * parts[1]


@pytest.mark.parametrize(
    ("cells", "width", "rates"),
    [
        (16, 0.0, (1e-1, 1e-2, 1e-3)),
        (32, 0.0, (1e-1, 1e-2, 1e-3)),
        (16, 3.0, (1e-1, 1e-2, 1e-3, 1e-4)),
        (32, 3.0, (1e-1, 1e-2, 1e-3, 1e-4)),
    ],
    ids=["16", "32", "16 correlated", "32 correlated"],
)
def test_multiplier_for_rayleigh_envelopes(cells: int, width: float, rates: tuple[float, ...]) -> None:
    # As wide along range as a pulse that is sampled several times.
    correlation = np.exp(-0.5 * (np.arange(cells) / width) ** 2) if width else np.eye(cells)[0]
    worth = theory.effective_cells(theory.envelope_correlation(correlation))
    assert worth == pytest.approx(cells) if not width else worth < 0.25 * cells
    floor = np.abs(complex_noise(np.random.default_rng(7), 60_000, correlation)).mean(axis=1)
    for wanted in rates:
        # Of the cell under test the distribution is known: what is left to chance is the floor.
        shares = np.exp(-0.5 * (theory.rayleigh_multiplier(wanted, worth) * floor) ** 2)
        error = 2.6 * shares.std() / math.sqrt(shares.size)
        assert abs(shares.mean() - wanted) < 0.08 * wanted + error


def test_correlation_of_envelopes() -> None:
    random = np.random.default_rng(8)
    for correlation in (0.3, 0.8):
        pairs = np.abs(complex_noise(random, 150_000, np.array([1.0, correlation])))
        wanted = np.corrcoef(pairs.T)[0, 1]
        assert theory.envelope_correlation(np.array([correlation]))[0] == pytest.approx(wanted, abs=0.01)
    np.testing.assert_allclose(theory.envelope_correlation(np.array([0.0, 1.0, -1.0])), [0, 1, 1], atol=1e-12)


@settings(max_examples=5, deadline=None, derandomize=True)
@given(st.floats(1e-6, 0.3), st.floats(2.0, 100.0))
def test_the_multiplier_is_the_inverse(false_alarm: float, cells: float) -> None:
    multiplier = theory.rayleigh_multiplier(false_alarm, cells)
    assert theory.rayleigh_false_alarm(multiplier, cells) == pytest.approx(false_alarm, rel=1e-6)


def test_effective_cells() -> None:
    assert theory.effective_cells(np.eye(8)) == pytest.approx(8.0)
    assert theory.effective_cells(np.ones((8, 8))) == pytest.approx(1.0)
    assert theory.effective_cells(np.eye(8)[0]) == pytest.approx(8.0)
    with pytest.raises(ValueError, match="`false_alarm` must be above 0"):
        theory.rayleigh_multiplier(0.0, 4)
