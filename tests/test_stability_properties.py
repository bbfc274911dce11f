"""What must hold for every peak and every detector, by drawn examples: scale, shift, order, padding, batches, limits.

Sweeps are drawn as counts; one program serves all examples of a property.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import hard_inputs as hard
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from stability_estimators import estimator_kinds

from jaxradar._numerics import soft_exceeds
from jaxradar.drive import SweepFlag
from jaxradar.signal.clutter import noise_floor
from jaxradar.signal.correlate import profile_shift
from jaxradar.signal.differences import backward_difference, fitted_slope, three_point_difference
from jaxradar.signal.peaks import MatchedFilter, SoftArgmax
from jaxradar.systems.step import DETECTORS, RangeAxis, detect_batch

BINS, EPS = 56, float(np.finfo(np.float32).eps)
KINDS = estimator_kinds()
# The matched filter takes seconds to compile: it waits for the long run.
CHEAP = [pytest.param(name, marks=pytest.mark.long) if name == "MatchedFilter" else name for name in KINDS]
FEW = settings(deadline=None, max_examples=12, derandomize=True)


@functools.cache
def finder(name: str) -> Callable[..., Any]:
    """Positions of a batch of sweeps."""
    return jax.jit(jax.vmap(lambda sweep: KINDS[name]()(sweep).position))


def find(name: str, sweeps: np.ndarray) -> np.ndarray:
    return np.asarray(finder(name)(jnp.asarray(sweeps, jnp.float32)), np.float64)


# An echo over rough bins, as drawn: no two bins are equal by accident of the draw alone.
echoes = st.tuples(st.floats(18.0, 38.0), st.floats(500.0, 60000.0), st.integers(0, 2**31 - 1))


def drawn(one: tuple[float, float, int], bins: int = BINS) -> np.ndarray:
    centre, amplitude, seed = one
    return np.rint(hard.echo(bins, centre, amplitude) + np.random.default_rng(seed).rayleigh(10.0, bins))


@pytest.mark.parametrize("name", CHEAP)
@FEW
@given(echoes, st.integers(-90, 90))
def test_a_gain_moves_no_position(name: str, one: tuple[float, float, int], power: int) -> None:
    """By powers of two, which float32 multiplies without rounding; and by a tenth, which it rounds."""
    sweep = drawn(one)
    positions = find(name, np.stack([sweep, sweep * 2.0**power, 0.1 * sweep, sweep]))
    assert positions[1] == pytest.approx(positions[0], abs=1e-4)
    assert positions[2] == pytest.approx(positions[0], abs=1e-3)
    assert positions[3] == positions[0]


@pytest.mark.parametrize("name", CHEAP)
@FEW
@given(st.floats(16.0, 27.0), st.integers(1, 12), st.floats(0.05, 0.95))
def test_the_estimate_moves_with_the_echo(name: str, centre: float, whole: int, part: float) -> None:
    """By whole bins exactly; by parts of a bin as far as a method sees between bins."""
    positions = find(name, np.stack([hard.echo(BINS, centre + move) for move in (0.0, whole, part, 0.0)]))
    still = positions[0]
    # Of a soft-argmax over all bins the empty ones draw to the middle, with a weight of exp(-10) each.
    assert positions[1] - still == pytest.approx(whole, abs=2e-3 * whole if name == "SoftArgmax" else 1e-4)
    # The arg-max sees whole bins; a Gaussian is no parabola.
    slack = {"ArgMax": 1.0, "Parabola": 0.02}.get(name, 5e-3)
    assert positions[2] - still == pytest.approx(part, abs=slack)


@pytest.mark.parametrize(
    "kind", [SoftArgmax, pytest.param(MatchedFilter, marks=pytest.mark.long)], ids=lambda one: one.__name__
)
@FEW
@given(st.floats(16.0, 40.0))
def test_nothing_jumps_where_the_window_begins_to_move(kind: Any, centre: float) -> None:
    """The window follows the largest bin: where that changes, half way between two, the estimate must not."""
    middle = np.floor(centre) + 0.5
    sweeps = np.stack([hard.echo(BINS, middle + away) for away in (-0.01, 0.01)])
    positions = np.asarray(windowed(kind)(jnp.asarray(sweeps, jnp.float32)))
    assert positions[1] - positions[0] == pytest.approx(0.02, abs=5e-3)


@functools.cache
def windowed(kind: Any) -> Callable[..., Any]:
    return jax.jit(jax.vmap(lambda sweep: kind(half_width=10)(sweep).position))


@pytest.mark.parametrize("name", CHEAP)
@FEW
@given(st.lists(echoes, min_size=4, max_size=4), st.permutations(range(4)))
def test_order_in_a_batch_changes_nothing(name: str, ones: list[Any], order: list[int]) -> None:
    sweeps = np.stack([drawn(one) for one in ones])
    np.testing.assert_array_equal(find(name, sweeps[order]), find(name, sweeps)[order])


@pytest.mark.parametrize("name", CHEAP)
@FEW
@given(echoes)
def test_a_batch_is_one_after_the_other(name: str, one: tuple[float, float, int]) -> None:
    sweep = drawn(one).astype(np.float32)
    alone = float(single(name)(sweep))
    np.testing.assert_allclose(find(name, np.stack([sweep] * 4)), alone, atol=2e-5)


@functools.cache
def single(name: str) -> Callable[..., Any]:
    return jax.jit(lambda sweep: KINDS[name]()(sweep).position)


# Soft to hard


@FEW
@given(echoes)
def test_the_soft_arg_max_tends_to_the_hard_one(one: tuple[float, float, int]) -> None:
    """Down to its bound: as far as the second largest bin stays behind, at each temperature."""
    sweep = drawn(one)
    top = int(np.argmax(sweep))
    behind = 1.0 - np.delete(sweep, top).max() / sweep[top]
    found = np.asarray(cooled(jnp.asarray(sweep, jnp.float32), jnp.asarray([1e-3, 3e-3, 1e-2, 3e-2])))
    errors = np.abs(found - top)
    for error, temperature in zip(errors, (1e-3, 3e-3, 1e-2, 3e-2), strict=True):
        assert error <= BINS * (BINS - 1) * np.exp(-behind / temperature) + 2 * BINS * EPS


cooled = jax.jit(jax.vmap(lambda sweep, temperature: SoftArgmax(temperature)(sweep).position, in_axes=(None, 0)))


@FEW
@given(st.floats(-1e6, 1e6, width=32), st.floats(-1e3, 1e3, width=32))
def test_the_soft_decision_tends_to_the_hard_one(value: float, threshold: float) -> None:
    shares = np.asarray(softened(jnp.float32(value), jnp.float32(threshold), TEMPERATURES))
    hard_one = float(np.float32(value) > np.float32(threshold)) if value != threshold else 0.5
    # Never farther as it cools, and there once the margin is 100 temperatures.
    assert (np.diff(np.abs(shares - hard_one)) <= 2 * EPS).all()
    cold = abs(np.float32(value) - np.float32(threshold)) > 100 * np.asarray(TEMPERATURES)
    np.testing.assert_array_equal(shares[cold], hard_one)


TEMPERATURES = jnp.asarray([10.0, 1.0, 0.1, 1e-2, 1e-3], jnp.float32)
softened = jax.jit(jax.vmap(soft_exceeds, in_axes=(None, None, 0)))


# Floors and shifts


@FEW
@given(echoes, st.integers(-40, 40))
def test_a_gain_scales_the_floor_and_leaves_the_shift(one: tuple[float, float, int], power: int) -> None:
    cells = drawn(one, 32)
    level, scatter, shift = (np.asarray(found) for found in seen(np.stack([cells, cells * 2.0**power]).astype("f4")))
    np.testing.assert_allclose(level[1], level[0] * 2.0**power, rtol=1e-5)
    np.testing.assert_allclose(scatter[1], scatter[0] * 2.0**power, rtol=1e-5)
    np.testing.assert_allclose(shift[1], shift[0], atol=1e-4)


@FEW
@given(st.floats(12.0, 18.0), st.floats(-3.5, 3.5))
def test_the_shift_of_a_moved_profile_is_the_move(centre: float, move: float) -> None:
    found = shifted(*(hard.echo(32, place).astype(np.float32) for place in (centre + move, centre)))
    assert float(found) == pytest.approx(move, abs=0.03)


seen = jax.jit(
    jax.vmap(
        lambda cells: (
            noise_floor(cells).level,
            noise_floor(cells).scatter,
            profile_shift(cells, jnp.flip(cells), 4).cells,
        )
    )
)
shifted = jax.jit(lambda profile, reference: profile_shift(profile, reference, 5).cells)


# Gradients against differences: the error of a central difference falls with the square of its step.


@pytest.mark.parametrize("name", [one for one in CHEAP if one != "ArgMax"])
def test_differences_tend_to_the_gradient_with_the_second_order(name: str) -> None:
    with jax.enable_x64(True):
        sweep = jnp.asarray(hard.echo(BINS, 30.3) + 50.0)
        direction = jnp.asarray(np.random.default_rng(3).normal(size=BINS) * 30.0)
        along = jax.jit(lambda step: KINDS[name]()(sweep + step * direction).position)
        slope = float(jax.jit(jax.grad(along))(jnp.zeros(())))
        steps = (0.4, 0.2, 0.1)
        errors = [abs(float(along(step) - along(-step)) / (2 * step) - slope) for step in steps]
    assert abs(slope) > 1e-4
    for coarse, fine in pairwise(errors):
        assert fine == pytest.approx(coarse / 4, rel=0.15, abs=1e-10)


ORDERS = {
    "backward_difference": (backward_difference, 1),
    "three_point_difference": (three_point_difference, 2),
    "fitted_slope, a line": (lambda values, dt: fitted_slope(values, dt, 4), 1),
    "fitted_slope, a parabola": (lambda values, dt: fitted_slope(values, dt, 4, 2), 2),
}


@pytest.mark.parametrize("name", ORDERS)
def test_slopes_of_a_track_converge_with_their_order(name: str) -> None:
    """Of a sine on uneven times: half the step, half or a quarter of the error."""
    function, order = ORDERS[name]
    errors = []
    with jax.enable_x64(True):
        slope = jax.jit(function)
        for step in (0.02, 0.01, 0.005):
            dt = step * np.tile([1.0, 1.5, 0.75, 1.25], 3)
            times = 0.7 + np.cumsum(dt) - dt.sum()  # the newest sample is at one time for all steps
            errors.append(abs(float(slope(np.sin(times), dt)[-1]) - np.cos(0.7)))
    for coarse, fine in pairwise(errors):
        assert coarse / fine == pytest.approx(2.0**order, rel=0.1)


# Batches of logs

SWEEPS, LOG_BINS = 12, 16
AXIS = RangeAxis.of(0.2 + 0.03 * np.arange(LOG_BINS))
# One of the quick ones alone in the plain run: `test_step_run.py` and `test_step_batch.py` pad logs too.
DETECTED = [name if name == "range-rate" else pytest.param(name, marks=pytest.mark.long) for name in DETECTORS]


def logs_of(seed: int, count: int) -> tuple[np.ndarray, ...]:
    """Logs of echoes that step, with sweeps that are missing."""
    generator = np.random.default_rng(seed)
    places = 6.0 + 3.0 * (np.arange(SWEEPS) >= generator.integers(3, SWEEPS, (count, 1)))
    sweeps = np.rint(3000.0 * np.exp(-(((np.arange(LOG_BINS) - places[..., None]) / 1.5) ** 2)))
    sweeps = (sweeps + generator.integers(0, 30, sweeps.shape)).astype(np.uint16)
    flags = np.where(generator.random((count, SWEEPS)) < 0.1, np.uint16(SweepFlag.MISSED_DATA), np.uint16(0))
    dt = generator.choice([0.01, 0.011, 0.0, 0.02], (count, SWEEPS))
    return sweeps, flags, dt


@pytest.mark.parametrize("name", DETECTED)
@settings(deadline=None, max_examples=8, derandomize=True)
@given(st.integers(0, 2**31 - 1), st.permutations(range(3)), st.lists(st.integers(1, SWEEPS), min_size=3, max_size=3))
def test_padding_and_order_of_logs_change_nothing(name: str, seed: int, order: list[int], lengths: list[int]) -> None:
    """`detect_batch` of padded logs, in any order, is each log by itself; what is beyond its length is invalid."""
    detector = DETECTORS[name]()
    sweeps, flags, dt = logs_of(seed, 3)
    junk = np.arange(SWEEPS) >= np.array(lengths)[:, None]
    noisy, odd = np.where(junk[..., None], np.uint16(60000), sweeps), np.where(junk, 1e6, dt)
    padded = detect_batch(detector, AXIS, noisy, flags, odd, np.array(lengths))
    turned = detect_batch(detector, AXIS, noisy[order], flags[order], odd[order], np.array(lengths)[order])
    whole = detect_batch(detector, AXIS, sweeps, flags, dt, np.full(3, SWEEPS))
    for key, one in padded.items():
        np.testing.assert_array_equal(np.asarray(turned[key]), np.asarray(one)[order], err_msg=key)
        for log, length in enumerate(lengths):
            np.testing.assert_allclose(
                np.asarray(one)[log, :length], np.asarray(whole[key])[log, :length], rtol=1e-5, atol=1e-6, err_msg=key
            )
    assert not np.asarray(padded["event"])[junk].any()
