"""The fit of a pulse: exact without noise, at the bound with it, whole at the ends."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxradar.estimate.bounds import white_bound_m
from jaxradar.signal.pulse_fit import PulseFit

BINS, FWHM = 128, 8.0


def echo(centre: float | np.ndarray, amplitude: float = 3000.0, fwhm: float = FWHM) -> np.ndarray:
    return amplitude * np.exp(-4 * np.log(2) * ((np.arange(BINS) - np.asarray(centre)[..., None]) / fwhm) ** 2)


def find(estimator: PulseFit, sweeps: np.ndarray) -> np.ndarray:
    return np.asarray(jax.jit(jax.vmap(estimator))(sweeps).position)


@pytest.mark.parametrize(("search", "width"), [(1, 1.0), (6, 0.5), (14, 1.5)])
def test_one_step_is_exact_for_a_gaussian_whatever_the_widths(width: float, search: int, precision: str) -> None:
    centres = np.linspace(24.0, 100.0, 77) + 0.37
    found = find(PulseFit(width * FWHM, 18, search), echo(centres))
    # What the template leaves out beyond its reach is 2e-3 of a weight.
    assert np.abs(found - centres).max() < 0.01


@pytest.mark.parametrize(("snr_db", "search", "most"), [(20.0, 1, 1.05), (20.0, 6, 1.05), (10.0, 6, 1.1)])
def test_meets_the_bound(snr_db: float, search: int, most: float) -> None:
    random = np.random.default_rng(5)
    truth = random.uniform(30.0, 98.0, 10_000)
    sweeps = echo(truth, 1.0) + 10 ** (-snr_db / 20) * random.standard_normal((10_000, BINS))
    error = find(PulseFit(FWHM, 9, search), sweeps.astype(np.float32)) - truth
    bound = white_bound_m(snr_db, FWHM, 1.0)
    # The RMS of 10,000 errors is known to 1.4 % (95 %).
    assert 0.97 * bound < np.sqrt(np.mean(error**2)) < most * bound


def test_at_the_ends_the_window_moves_inwards_and_the_place_stays() -> None:
    centres = np.array([2.0, 6.3, 121.6, 125.0])
    assert np.abs(find(PulseFit.of_width(FWHM), echo(centres)) - centres).max() < 0.5 * FWHM
    assert np.abs(find(PulseFit.of_width(FWHM), echo(centres))[1:3] - centres[1:3]).max() < 0.3


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("search", [6, 14])
def test_bins_that_are_no_numbers_are_left_out(search: int, bad: float) -> None:
    centres = np.array([40.3, 64.0, 90.6])
    sweeps = echo(centres)
    sweeps[:, 20:23] = bad
    assert np.abs(find(PulseFit(FWHM, 12, search), sweeps) - centres).max() < 0.02
    sweeps[:, np.array([38, 64, 92])] = bad  # on the echo itself
    assert np.abs(find(PulseFit(FWHM, 12, search), sweeps) - centres).max() < 0.5 * FWHM


@pytest.mark.parametrize("bins", [1, 2, 3, 5])
def test_few_bins_are_enough(bins: int) -> None:
    peak = PulseFit(4.0, 6, 2)(jnp.arange(bins, dtype=jnp.float32) + 1.0)
    assert bool(peak.found)
    assert 0.0 <= float(peak.position) <= bins - 1


def test_the_width_may_be_tuned() -> None:
    sweep = jnp.asarray(echo(50.3) + 400.0 * np.cos(np.arange(BINS)))
    with jax.enable_x64(True):
        place = jax.jit(lambda fwhm: PulseFit(fwhm, 12, 4)(jnp.asarray(sweep, jnp.float64)).position)
        slope = float(jax.grad(place)(8.0))
        assert slope == pytest.approx(float(place(8.001) - place(7.999)) / 0.002, rel=1e-5)
    assert slope != 0.0


def test_refuses_what_makes_no_template() -> None:
    with pytest.raises(ValueError, match="fwhm"):
        PulseFit(0.5)
    with pytest.raises(ValueError, match="half_width"):
        PulseFit(4.0, 0)
    with pytest.raises(ValueError, match="search"):
        PulseFit(4.0, 4, 0)
    assert PulseFit.of_width(0.1).half_width == 2
