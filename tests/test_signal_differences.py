"""Slopes on uneven times: exact for what they fit, of the order they claim, and 0 where there is none."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxradar.signal.differences import backward_difference, fitted_slope, three_point_difference


def uneven(count: int = 40, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    dt = np.random.default_rng(seed).uniform(0.002, 0.005, count)
    return dt, np.cumsum(dt) - dt[0]


def test_exact_for_what_they_fit() -> None:
    dt, time = uneven()
    with jax.enable_x64(True):
        line, parabola = 0.5 + 2.0 * time, 0.5 + 2.0 * time - 30.0 * time**2
        assert np.asarray(backward_difference(line, dt))[1:] == pytest.approx(2.0)
        assert np.asarray(three_point_difference(parabola, dt))[2:] == pytest.approx(2.0 - 60.0 * time[2:])
        assert np.asarray(fitted_slope(parabola, dt, 9, order=2))[2:] == pytest.approx(2.0 - 60.0 * time[2:])


@pytest.mark.parametrize(("window", "order"), [(2, 1), (5, 1), (16, 1), (3, 2), (6, 2), (16, 2)])
def test_a_fit_is_that_of_polyfit(window: int, order: int) -> None:
    dt, time = uneven()
    values = np.random.default_rng(1).standard_normal(len(dt))
    with jax.enable_x64(True):
        found = np.asarray(fitted_slope(values, dt, window, order))
    for last in range(order, len(dt)):
        some = slice(max(0, last - window + 1), last + 1)
        expected = np.polyfit(time[some] - time[last], values[some], order)[-2]
        assert found[last] == pytest.approx(expected, rel=1e-8)
    assert found[0] == 0.0


@pytest.mark.parametrize(
    ("way", "order"),
    [
        (backward_difference, 1),
        (three_point_difference, 2),
        (lambda values, dt: fitted_slope(values, dt, 8, 1), 1),
        (lambda values, dt: fitted_slope(values, dt, 8, 2), 2),
    ],
)
def test_converges_as_fast_as_it_claims(way, order: int) -> None:
    """Half the interval, half or a quarter of the error."""
    errors = []
    with jax.enable_x64(True):
        for interval in (0.01, 0.005, 0.0025):
            dt = interval * (1.0 + 0.3 * np.sin(np.arange(60)))
            time = np.cumsum(dt)
            errors.append(abs(float(way(np.sin(3.0 * (time - time[-1] + 0.4)), dt)[-1]) - 3.0 * np.cos(1.2)))
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert rates == pytest.approx(order, abs=0.15)


def test_a_far_range_and_a_long_drive_cost_no_digits() -> None:
    """In single precision, with ranges a kilometre away: differences alone are summed."""
    dt, time = uneven(2000)
    values = (1000.0 + 2.0 * time).astype(np.float32)
    exact = np.polyfit(time[-16:] - time[-1], values[-16:].astype(np.float64), 1)[0]
    found = float(fitted_slope(values, dt.astype(np.float32), 16)[-1])
    assert found == pytest.approx(exact, rel=2e-5)


@pytest.mark.parametrize("dt", [0.0, -0.01])
@pytest.mark.parametrize(
    "way",
    [
        backward_difference,
        three_point_difference,
        lambda v, dt: fitted_slope(v, dt, 4),
        lambda v, dt: fitted_slope(v, dt, 4, 2),
    ],
)
def test_times_that_stand_still_or_go_back_leave_numbers(way, dt: float) -> None:
    values, steps = jnp.asarray([1.0, 3.0, 2.0, 5.0, 4.0]), jnp.asarray([0.0, 0.01, dt, 0.01, dt])
    assert np.isfinite(np.asarray(way(values, steps))).all()
    slopes = jax.jit(jax.jacrev(way, argnums=(0, 1)))
    still = jnp.zeros(5)
    assert np.asarray(way(values, still)) == pytest.approx(0.0)
    assert all(np.isfinite(np.asarray(one)).all() for one in (*slopes(values, steps), *slopes(values, still)))


def test_refuses_too_short_a_window() -> None:
    with pytest.raises(ValueError, match="window"):
        fitted_slope(jnp.zeros(4), jnp.zeros(4), 2, 2)
    with pytest.raises(ValueError, match="order"):
        fitted_slope(jnp.zeros(4), jnp.zeros(4), 8, 3)
