"""The soft position against a softmax in float64, with its derivatives, and what these keep in memory."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxradar._numerics import compiled, reductions
from jaxradar.signal.soft import soft_position

SIZES = (1, 2, 3, 31, 33, 127, 128, 827, 1448)


def position(values: Any, temperature: Any, log_gain: Any, exponent: Any) -> jax.Array:
    return soft_position(values, temperature, log_gain, exponent)[0]


def jitted(form: str, function: Callable[..., Any]) -> Callable[..., Any]:
    def inside(*args: Any) -> Any:
        with reductions(form):
            return function(*args)

    return jax.jit(inside)


FIND = {form: jitted(form, soft_position) for form in ("staged", "plain")}
SLOPES = {form: jitted(form, jax.grad(position, argnums=(0, 1, 2, 3))) for form in ("staged", "plain")}


def oracle(values: np.ndarray, temperature: float, log_gain: np.ndarray, exponent: float) -> float:
    compensated = values * np.exp(exponent * log_gain)
    weights = np.exp((compensated / compensated.max() - 1) / temperature)
    return float(np.sum(weights * np.arange(len(values))) / np.sum(weights))


def sweep(bins: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """An echo over rough bins, as whole counts, and the logarithm of a gain that rises with range."""
    generator = np.random.default_rng(seed)
    bump = 3000 * np.exp(-0.5 * ((np.arange(bins) - 0.37 * bins) / (0.03 * bins + 0.5)) ** 2)
    return np.rint(bump + generator.rayleigh(100, bins)), np.log(2 * np.linspace(0.1, 0.9, bins))


@pytest.mark.parametrize("form", FIND)
@pytest.mark.parametrize(
    "bins", [bins if bins in (1, 33, 128, 827) else pytest.param(bins, marks=pytest.mark.long) for bins in SIZES]
)
def test_equals_a_softmax_in_float64(bins: int, form: str, precision: str) -> None:
    values, log_gain = sweep(bins)
    for temperature in (1.0, 0.1, 0.01, 1e-3):
        for exponent in (0.0, 2.0):
            found, seen = FIND[form](values.astype(precision), temperature, log_gain, exponent)
            wanted = oracle(values, temperature, log_gain, exponent)
            # A ratio is rounded at 1 and divided by the temperature; of that the mean over the axis.
            slack = bins * (4 * float(np.finfo(precision).eps) / temperature + 1e-15)
            assert float(found) == pytest.approx(wanted, abs=slack)
            assert bool(seen)
            assert found.dtype == precision


def test_no_gain_is_a_gain_of_one(precision: str) -> None:
    values, log_gain = sweep(128)
    alone = jax.jit(lambda x: soft_position(x, 0.1)[0])(values.astype(precision))
    assert float(alone) == pytest.approx(float(FIND["staged"](values.astype(precision), 0.1, log_gain, 0.0)[0]))


@pytest.mark.parametrize("form", SLOPES)
@pytest.mark.parametrize("bins", [2, 33, 128])
def test_first_derivatives_agree_with_central_differences(bins: int, form: str) -> None:
    values, log_gain = sweep(bins, seed=4)
    generator = np.random.default_rng(1)
    none, one = np.zeros(bins), np.eye(1, bins, int(np.argmax(values * np.exp(1.7 * log_gain))))[0]
    directions = [
        (generator.normal(size=bins), 0.0, none, 0.0),
        (one, 0.0, none, 0.0),
        (none, 1.0, none, 0.0),
        (none, 0.0, generator.normal(size=bins), 0.0),
        (none, 0.0, none, 1.0),
    ]
    for temperature in (0.5, 0.1, 0.03):
        with jax.enable_x64(True):
            point = (values, np.float64(temperature), log_gain, np.float64(1.7))
            slopes = [np.asarray(slope) for slope in SLOPES[form](*point)]
            for direction in directions:
                step = 1e-2 if np.any(direction[0]) else 1e-6
                ends = [
                    float(FIND[form](*(a + k * step * d for a, d in zip(point, direction, strict=True)))[0])
                    for k in (1.0, -1.0)
                ]
                got = sum(float(np.sum(slope * d)) for slope, d in zip(slopes, direction, strict=True))
                assert got == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=2e-5, abs=1e-8 * bins)


def test_forward_and_reverse_mode_agree(precision: str) -> None:
    values, log_gain = sweep(128)
    point = [jnp.asarray(one) for one in (values, 0.1, log_gain, 2.0)]
    backward = SLOPES["staged"](*point)
    forward = jax.jit(jax.jacfwd(position, argnums=(0, 1, 2, 3)))(*point)
    for one, other in zip(backward, forward, strict=True):
        np.testing.assert_allclose(one, other, rtol=2e-3 if precision == "float32" else 1e-10, atol=1e-6)


def test_second_derivatives_of_the_scalars() -> None:
    """By temperature and exponent, each after itself and after the other."""
    values, log_gain = sweep(128, seed=2)
    slopes = jax.jit(jax.grad(position, argnums=(1, 3)))
    bends = jax.jit(jax.hessian(position, argnums=(1, 3)))
    with jax.enable_x64(True):
        point = [jnp.asarray(one) for one in (values, 0.1, log_gain, 2.0)]
        got = np.array(bends(*point))
        for column, argument in enumerate((1, 3)):
            ends = []
            for sign in (1.0, -1.0):
                moved = list(point)
                moved[argument] = moved[argument] + sign * 1e-6
                ends.append(np.array(slopes(*moved)))
            np.testing.assert_allclose(got[:, column], (ends[0] - ends[1]) / 2e-6, rtol=1e-5)
    assert np.abs(got).min() > 1e-3


def test_counts_as_recorded_and_bins_that_are_not_finite(precision: str) -> None:
    values, log_gain = sweep(128)
    log_gain = log_gain.astype(precision)
    point = (0.1, log_gain, jnp.asarray(2.0))
    for form in FIND:
        wanted = float(FIND[form](values.astype(precision), *point)[0])
        assert float(FIND[form](values.astype(np.uint16), *point)[0]) == pytest.approx(wanted, rel=1e-6)
        for bad in (np.nan, np.inf, -np.inf):
            holes = np.where(np.isin(np.arange(128), [3, 47, 127]), 0.0, values)
            broken = np.where(np.isin(np.arange(128), [3, 47, 127]), bad, values).astype(precision)
            assert float(FIND[form](broken, *point)[0]) == pytest.approx(oracle(holes, 0.1, log_gain, 2.0), abs=1e-3)
            slopes = SLOPES[form](broken, jnp.asarray(0.1), *point[1:])
            assert all(np.isfinite(one).all() for one in slopes)


@pytest.mark.parametrize("bins", [1, 2, 33, 128])
def test_a_silent_sweep_gives_the_middle_and_finite_gradients(bins: int, precision: str) -> None:
    log_gain = np.linspace(-1, 1, bins).astype(precision)
    silent = np.zeros(bins, precision)
    for form in FIND:
        found, seen = FIND[form](silent, 0.1, log_gain, 2.0)
        assert float(found) == pytest.approx(0.5 * (bins - 1), abs=1e-5)
        assert not bool(seen)
        slopes = SLOPES[form](silent, jnp.asarray(0.1), log_gain, jnp.asarray(2.0))
        assert all(np.isfinite(one).all() for one in slopes)


WORST = {
    "constant": np.full(128, 100.0),
    "saturated": np.full(128, 65535.0),
    "one count": np.eye(1, 128, 90)[0],
    "two equal": np.where(np.isin(np.arange(128), [20, 100]), 5000.0, 100.0),
    "huge": np.linspace(1e15, 1e18, 128),
    "tiny": np.linspace(0.0, 1e-30, 128),
}


@pytest.mark.parametrize("temperature", [10.0, 0.1, 1e-3])
@pytest.mark.parametrize("case", WORST)
def test_values_and_gradients_at_the_worst_sweeps(case: str, temperature: float, precision: str) -> None:
    values, log_gain = WORST[case].astype(precision), np.log(2 * np.linspace(0.1, 0.9, 128)).astype(precision)
    for form in FIND:
        found = float(FIND[form](values, temperature, log_gain, 2.0)[0])
        wanted = oracle(values.astype(np.float64), temperature, log_gain.astype(np.float64), 2.0)
        assert found == pytest.approx(wanted, abs=2e-2 if precision == "float32" else 1e-9)
        slopes = SLOPES[form](values, jnp.asarray(temperature), log_gain, jnp.asarray(2.0))
        assert all(np.isfinite(one).all() for one in slopes)


@pytest.mark.parametrize("gain", [1e-6, 0.25, 3.0, 1e12])
def test_a_gain_moves_nothing(gain: float, precision: str) -> None:
    values, log_gain = sweep(128)
    still = float(FIND["staged"](values.astype(precision), 0.1, log_gain, 2.0)[0])
    moved = float(FIND["staged"]((gain * values).astype(precision), 0.1, log_gain, 2.0)[0])
    assert moved == pytest.approx(still, abs=1e-3 if precision == "float32" else 1e-11)


def test_equal_largest_values_share_the_gradient() -> None:
    """Raising all of them together is the same as lowering the rest: the mean of both directions."""
    values, log_gain = np.full(64, 10.0), np.zeros(64)
    values[[5, 40]] = 100.0
    with jax.enable_x64(True):
        slopes = np.asarray(SLOPES["staged"](values, jnp.asarray(0.2), log_gain, jnp.asarray(0.0))[0])
        ends = [float(FIND["staged"](values * (1 + k * 1e-6 * (values > 50)), 0.2, log_gain, 0.0)[0]) for k in (1, -1)]
    assert float(np.sum(slopes * values * (values > 50))) == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=1e-5)
    assert float(np.sum(slopes * values)) == pytest.approx(0.0, abs=1e-12)  # a gain moves nothing


def test_a_batch_is_the_same_as_one_after_the_other(precision: str) -> None:
    rows = np.stack([sweep(127, seed)[0] for seed in range(5)]).astype(precision)
    log_gain = sweep(127)[1].astype(precision)
    alone = [float(FIND["staged"](row, 0.1, log_gain, 2.0)[0]) for row in rows]
    for axis in (0, -1):
        together = jax.jit(
            jax.vmap(lambda row: position(row, jnp.asarray(0.1), log_gain, jnp.asarray(2.0)), in_axes=axis)
        )(rows if axis == 0 else rows.T)
        np.testing.assert_allclose(together, alone, rtol=1e-5 if precision == "float32" else 1e-13)


def mean_position(settings: tuple[Any, Any], sweeps: jax.Array) -> jax.Array:
    exponent, temperature = settings
    log_gain = np.log(2 * np.linspace(0.1, 0.9, sweeps.shape[1])).astype(np.float32)
    each = jax.vmap(lambda row: position(row.astype(jnp.float32), temperature, log_gain, exponent))
    return jnp.mean(each(sweeps))


COUNTS = jax.ShapeDtypeStruct((20_000, 128), np.uint16)


@pytest.mark.parametrize("form", FIND)
def test_reverse_mode_keeps_a_few_numbers_a_sweep(form: str) -> None:
    """What goes from the forward to the backward pass, for a gradient with respect to the two settings."""

    def backward(settings: tuple[Any, Any], sweeps: jax.Array) -> Any:
        with reductions(form):
            return jax.vjp(lambda now: mean_position(now, sweeps), settings)[1]

    kept = jax.tree.leaves(jax.eval_shape(backward, (jnp.asarray(2.0), jnp.asarray(0.1)), COUNTS))
    assert 0 < sum(one.size for one in kept) <= 8 * COUNTS.shape[0]


def test_a_gradient_needs_little_more_memory_than_the_sweeps_as_floats() -> None:
    """Of the batch in one piece; differentiated bin by bin it needs three times that."""
    program = compiled(jax.value_and_grad(mean_position))
    point = (jnp.asarray(2.0), jnp.asarray(0.1))
    needed = program.lower(point, COUNTS).compile().memory_analysis().temp_size_in_bytes
    assert needed < 1.3 * COUNTS.size * 4
