"""Guarded arithmetic at the values that it guards against."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxradar._numerics import (
    as_scalar,
    finite,
    first_argmax,
    largest_row,
    operations,
    safe_divide,
    safe_sqrt,
    soft_exceeds,
)


def test_soft_threshold_tends_to_the_hard_one(precision: str) -> None:
    """Hard case 21; equality is ½ whatever the temperature, and no detection in the limit from below."""
    values = np.array([-5.0, 0.5, 0.699, 0.7, 0.701, 0.9, 1e30])
    for temperature, slack in ((0.1, 0.5), (1e-3, 0.27), (1e-5, 1e-6)):
        soft = np.asarray(soft_exceeds(values, 0.7, temperature))
        assert np.abs(np.delete(soft, 3) - (np.delete(values, 3) > 0.7)).max() <= slack
        assert soft[3] == pytest.approx(0.5)
        assert (np.diff(soft) >= 0).all()


@pytest.mark.parametrize("temperature", [1.0, 1e-6, 1e-30])
def test_soft_threshold_has_a_finite_gradient(temperature: float, precision: str) -> None:
    values = jnp.asarray([-1e30, 0.0, 0.7, 1.0, 1e30])
    gradients = jax.grad(lambda v, t: soft_exceeds(v, t, temperature).sum(), argnums=(0, 1))(values, jnp.asarray(0.7))
    assert all(np.isfinite(one).all() for one in gradients)


def test_gradient_of_the_soft_threshold_is_its_slope() -> None:
    with jax.enable_x64(True):
        slope = jax.grad(lambda t: soft_exceeds(jnp.asarray(0.75), t, 0.1))(jnp.asarray(0.7))
        wanted = (
            soft_exceeds(jnp.asarray(0.75), 0.7 + 1e-6, 0.1) - soft_exceeds(jnp.asarray(0.75), 0.7 - 1e-6, 0.1)
        ) / 2e-6
        assert float(slope) == pytest.approx(float(wanted), rel=1e-6)


def test_guards_at_zero(precision: str) -> None:
    value, gradient = jax.value_and_grad(lambda x: safe_divide(jnp.asarray(3.0), x, otherwise=7.0))(jnp.asarray(0.0))
    assert (float(value), float(gradient)) == (7, 0)
    for at in (0.0, -1.0):
        value, gradient = jax.value_and_grad(safe_sqrt)(jnp.asarray(at))
        assert (float(value), float(gradient)) == (0, 0)
    assert float(jax.grad(safe_sqrt)(jnp.asarray(4.0))) == pytest.approx(0.25)


def test_finite_leaves_out_what_is_not(precision: str) -> None:
    assert finite(np.array([1.0, np.nan, np.inf, -np.inf, 2.0])).tolist() == [1, 0, 0, 0, 2]
    assert finite(np.array([3, 65535], np.uint16)).dtype == precision


@settings(deadline=None, max_examples=50, derandomize=True)
@given(st.lists(st.integers(0, 3), min_size=8, max_size=8))
def test_first_argmax_is_numpy_s(values: list[int]) -> None:
    assert int(first_argmax(np.array(values, np.int32))) == int(np.argmax(values))


def test_settings_are_strong_leaves() -> None:
    assert as_scalar(0.7).dtype == np.float64
    assert jnp.asarray(0.7).weak_type
    assert not as_scalar(jnp.asarray(0.7)).weak_type


def test_operations_of_loops_products_and_branches() -> None:
    count = lambda work, *inputs: operations(jax.make_jaxpr(work)(*inputs))  # noqa: E731
    two = lambda x: x * x + x  # noqa: E731
    vector = jnp.ones(5)
    assert count(two, vector) == 10
    assert count(jnp.sum, vector) == 5  # what goes in, not the one number that comes out
    assert count(lambda x: x[::-1].reshape(5, 1).T, vector) == 0  # moved, not computed

    def loop(x: jax.Array, turns: int) -> jax.Array:
        return jax.lax.scan(lambda carry, _: (two(carry), None), x, length=turns)[0]

    assert count(lambda x: loop(x, 7), vector) == 7 * 10
    inner = lambda x: jax.lax.scan(lambda carry, _: (loop(carry, 7), None), x, length=3)[0]  # noqa: E731
    assert count(inner, vector) == 3 * 7 * 10
    # A multiplication and an addition for each of the (3, 2) results and each of 4 terms; so for each of a batch of 6.
    assert count(jnp.matmul, jnp.ones((3, 4)), jnp.ones((4, 2))) == 2 * 3 * 2 * 4
    assert count(jax.vmap(jnp.dot), jnp.ones((6, 4)), jnp.ones((6, 4))) == 2 * 6 * 4
    branches = lambda x: jax.lax.cond(x[0] > 0, lambda y: loop(y, 7), two, x)  # noqa: E731
    assert count(branches, vector) - count(lambda x: x[0] > 0, vector) == pytest.approx(70, abs=1)  # and the switch


def test_the_largest_row_shares_its_slope_among_equals() -> None:
    rows = jnp.array([[1.0, 5.0], [3.0, 5.0], [2.0, 4.0]])
    np.testing.assert_array_equal(largest_row(rows), [3.0, 5.0])
    slope = jax.grad(lambda one: largest_row(one) @ jnp.array([1.0, 2.0]))(rows)
    np.testing.assert_array_equal(slope, [[0.0, 1.0], [1.0, 1.0], [0.0, 0.0]])
