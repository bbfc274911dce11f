"""Noise floor of one sweep, and how far a profile has moved."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from jaxradar.signal.clutter import noise_floor
from jaxradar.signal.correlate import NOISE_SHARE, profile_shift, shifted_correlations

CELLS = np.arange(64)
FLOOR = jax.jit(noise_floor)
SHIFT = jax.jit(profile_shift, static_argnums=2)


def profile(centre: float, amplitude: float = 900.0, width: float = 3.0) -> np.ndarray:
    return amplitude * np.exp(-0.5 * ((CELLS - centre) / width) ** 2)


def test_floor_under_an_echo(precision: str) -> None:
    cells = 100.0 + profile(30, 2000.0)
    floor = FLOOR(cells)
    quiet = cells[cells <= cells.mean()]
    assert float(floor.level) == pytest.approx(quiet.mean(), rel=1e-5)
    assert 100 <= float(floor.level) < 125


def test_scatter_does_not_see_a_slope(precision: str) -> None:
    generator = np.random.default_rng(0)
    noise = generator.normal(0, 5, 64)
    flat, sloping = FLOOR(200 + noise), FLOOR(200 + noise + 0.2 * CELLS)
    assert float(sloping.scatter) == pytest.approx(float(flat.scatter), rel=0.35)
    assert 2 < float(flat.scatter) < 6


def test_documented_shares_of_rayleigh_noise() -> None:
    cells = stats.rayleigh.rvs(scale=164 / 1.0, size=200_000, random_state=np.random.default_rng(3))
    floor = FLOOR(cells)
    assert float(floor.level) / cells.mean() == pytest.approx(0.61, abs=0.01)
    assert float(floor.scatter) / cells.mean() == pytest.approx(0.24, abs=0.01)


@pytest.mark.parametrize("shift", [-6.0, -1.5, 0.0, 0.25, 4.0, 9.3])
@pytest.mark.parametrize("gain", [0.5, 1.0, 3.0])
def test_a_moved_and_scaled_profile_is_explained(shift: float, gain: float, precision: str) -> None:
    found = SHIFT(gain * profile(30 + shift), jnp.asarray(profile(30)), 12)
    assert float(found.cells) == pytest.approx(shift, abs=0.02)
    assert float(found.unexplained_moved) == pytest.approx(NOISE_SHARE, abs=0.01)
    # Two Gaussians of width w that lie d apart correlate by exp(−d²/4w²).
    wanted = np.sqrt(1 - np.exp(-(shift**2) / (4 * 3.0**2)) ** 2 + NOISE_SHARE**2)
    assert float(found.unexplained_still) == pytest.approx(wanted, abs=2e-3)


def test_a_fade_and_turns_of_two_patches_are_not_a_shift(precision: str) -> None:
    faded = SHIFT(0.2 * profile(30), jnp.asarray(profile(30)), 12)
    assert float(faded.unexplained_still) == pytest.approx(NOISE_SHARE, abs=1e-4)
    before, after = profile(22) + 0.8 * profile(34), 0.8 * profile(22) + profile(34)
    turned = SHIFT(after, jnp.asarray(before), 12)
    assert float(turned.unexplained_still - turned.unexplained_moved) < 0.02


def test_correlations_equal_a_float64_oracle(precision: str) -> None:
    generator = np.random.default_rng(4)
    a, b = generator.uniform(0, 1000, 64), generator.uniform(0, 1000, 64)
    wanted = []
    for lag in range(-5, 6):
        moved = np.zeros(64)
        moved[max(lag, 0) : 64 + min(lag, 0)] = b[max(-lag, 0) : 64 - max(lag, 0)]
        wanted.append(a @ moved / np.linalg.norm(a) / np.linalg.norm(b))
    np.testing.assert_allclose(shifted_correlations(a, b, 5), wanted, atol=1e-6)


@pytest.mark.long
@pytest.mark.parametrize("one", [np.zeros(64), profile(30)], ids=["silent", "echo"])
@pytest.mark.parametrize("other", [np.zeros(64), profile(30), profile(63)], ids=["silent", "same", "edge"])
def test_values_and_gradients_are_finite(one: np.ndarray, other: np.ndarray, precision: str) -> None:
    def evidence(a, b):
        shift = SHIFT(a, b, 12)
        return shift.unexplained_still - shift.unexplained_moved + shift.cells

    value, gradients = jax.jit(jax.value_and_grad(evidence, argnums=(0, 1)))(jnp.asarray(one), jnp.asarray(other))
    assert np.isfinite(value)
    assert all(np.isfinite(gradient).all() for gradient in gradients)


@pytest.mark.parametrize("cells", [np.zeros(64), np.full(64, 7.0), np.array([1.0, 2.0])], ids=["0", "flat", "two"])
def test_floor_is_finite_with_its_gradient(cells: np.ndarray, precision: str) -> None:
    def total(x):
        floor = FLOOR(x)
        return floor.level + floor.scatter

    value, gradient = jax.jit(jax.value_and_grad(total))(jnp.asarray(cells))
    assert np.isfinite(value)
    assert np.isfinite(gradient).all()
    assert float(FLOOR(jnp.asarray(cells)).scatter) == pytest.approx(0, abs=1e-6)
