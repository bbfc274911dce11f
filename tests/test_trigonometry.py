"""Sines and angles against NumPy's in float64."""

from __future__ import annotations

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxradar._numerics import angle_of, compiled, cosine_sine

BOUND = {"float32": 4e-7, "float64": 4e-15}


@pytest.fixture(params=["float32", "float64"])
def dtype(request: pytest.FixtureRequest) -> Iterator[str]:
    with jax.enable_x64(request.param == "float64"):
        yield request.param


def test_cosine_and_sine(dtype: str) -> None:
    turns = np.random.default_rng(0).uniform(-3.0, 3.0, 5000).astype(dtype)
    turns[:9] = [0.0, 0.25, 0.5, 0.75, 1.0, -0.25, -0.5, 2.5, -2.25]
    cosine, sine = compiled(cosine_sine)(jnp.asarray(turns))
    angle = 2 * np.pi * np.float64(turns)
    assert np.abs(cosine - np.cos(angle)).max() < BOUND[dtype]
    assert np.abs(sine - np.sin(angle)).max() < BOUND[dtype]
    assert cosine.dtype == sine.dtype == dtype


def test_many_turns_keep_their_digits() -> None:
    turns = np.float32(np.random.default_rng(1).uniform(-500, 500, 1000))
    cosine, _ = cosine_sine(jnp.asarray(turns))
    assert np.abs(cosine - np.cos(2 * np.pi * np.float64(turns))).max() < 4e-7


def test_angle(dtype: str) -> None:
    angle = np.random.default_rng(2).uniform(-3.1, 3.1, 5000)
    angle[:5] = [0.0, np.pi / 2, -np.pi / 2, 3.1, 1e-6]
    found = compiled(angle_of)(jnp.asarray(np.sin(angle), dtype), jnp.asarray(np.cos(angle), dtype))
    near = np.abs(angle) < 2.0
    assert np.abs(found - angle)[near].max() < 4 * BOUND[dtype]
    assert np.abs(found - angle).max() < 1e3 * BOUND[dtype]  # 1 + c has few digits left straight backwards


def test_derivatives(dtype: str) -> None:
    at = jnp.asarray(np.linspace(-0.9, 0.9, 21), dtype)
    slope = jax.vmap(jax.grad(lambda t: cosine_sine(t)[1]))(at)
    assert np.abs(slope - 2 * np.pi * np.cos(2 * np.pi * np.float64(at))).max() < 100 * BOUND[dtype]
    slope = jax.vmap(jax.grad(lambda s: angle_of(s, jnp.sqrt(1 - s**2))))(at)
    assert np.abs(slope * np.sqrt(1 - np.float64(at) ** 2) - 1).max() < 50 * BOUND[dtype]


def test_angle_is_finite_straight_backwards() -> None:
    value, slope = jax.value_and_grad(lambda s: angle_of(s, jnp.float32(-1.0)))(jnp.float32(0.0))
    assert np.isfinite(value)
    assert np.isfinite(slope)
