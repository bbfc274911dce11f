"""The height of a step: the compiled likelihood against an oracle, and steps of simulated roads."""

from __future__ import annotations

import math

import jax.numpy as jnp
import numpy as np
import pytest
from step_samples import series

from jaxradar._errors import ConfigError
from jaxradar.drive import Channel, Motion
from jaxradar.sim import drive_seeds
from jaxradar.suite import StepCell, height_bound_m, heights_grid, measure_heights
from jaxradar.suite.heights import HeightErrors
from jaxradar.survey import Beam, Ground, step_height, step_heights
from jaxradar.survey.ground import strip_powers, strips_of
from jaxradar.survey.height import HEIGHTS_M, _inflation, _rise
from jaxradar.survey.height_grid import Car, Passage, height_likelihood, road_table
from jaxradar.systems.step import DefaultDetector, StepEvent
from jaxradar.units import NANOSECONDS

GROUND = Ground(*(jnp.asarray(one) for one in (0.35, math.radians(45.0), math.log(0.21), 14.0, 11.0, 9.0)))
RANGE_M = np.arange(0.24, 0.65, 0.014)
CAR = Car(*(jnp.asarray(one) for one in (0.15, 0.2, 2.0 * math.pi * 1.8, 0.3, 1.125, 0.011, 0.3)))
LEVELS = 0.35 + np.arange(-0.13, 0.13, 0.0025)


def likely(powers: np.ndarray, times_s: np.ndarray, rise_m: np.ndarray, heights_m: np.ndarray) -> np.ndarray:
    table = road_table(Beam(), GROUND, jnp.asarray(LEVELS), jnp.asarray(strips_of(Beam(), 0.98)), jnp.asarray(RANGE_M))
    passage = (times_s, powers, np.ones(len(times_s)), rise_m, [0.0], [0.0], 8.0, heights_m, [0.0])
    held = Passage(*(jnp.asarray(one, float) for one in passage))
    return np.asarray(height_likelihood(Beam(), GROUND, table, jnp.asarray(RANGE_M), CAR, held))[0, 0]


def road(height_m: float, rise_m: float, ahead_m: float) -> np.ndarray:
    """Mean power, strip by strip: those before the edge lie lower by the rise alone."""
    strips = strips_of(Beam(), 0.98)
    low = np.asarray(strip_powers(Beam(), GROUND, jnp.asarray(0.35 + rise_m), strips, RANGE_M))
    high = np.asarray(strip_powers(Beam(), GROUND, jnp.asarray(0.35 + rise_m - height_m), strips, RANGE_M))
    return np.where((strips < ahead_m)[:, None], low, high).sum(axis=0) + math.exp(9.0)


@pytest.mark.parametrize("height_m", [-0.04, 0.02, 0.07])
def test_the_likelihood_is_largest_at_the_true_height(height_m: float) -> None:
    """Of sweeps that are as bright as expected; the body's rise is known, and a part of the road yet to come."""
    times = np.arange(-0.004, 0.1, 1.0 / 300.0)
    rise = np.linspace(0.0, 0.6 * height_m, len(times))
    powers = np.stack([road(height_m, up, -8.0 * at) for up, at in zip(rise, times, strict=True)])
    found = likely(powers, times, rise, HEIGHTS_M)
    assert HEIGHTS_M[np.argmax(found)] == pytest.approx(height_m, abs=0.0026)


def test_the_likelihood_is_that_of_exponential_power() -> None:
    times, rise = np.array([0.02, 0.03]), np.array([0.0, 0.001])
    powers = np.random.default_rng(0).exponential(1.0, (2, len(RANGE_M))) * road(0.03, 0.0, -1.0)
    heights = np.array([0.01, 0.03])
    wanted = []
    for height in heights:
        mean = np.stack([road(height, up, -8.0 * at) for up, at in zip(rise, times, strict=True)])
        wanted.append(np.sum(-np.log(mean) - powers / mean))
    found = likely(powers, times, rise, heights)
    assert found[1] - found[0] == pytest.approx(wanted[1] - wanted[0], rel=0.1)


def test_the_rise_is_the_acceleration_integrated_twice() -> None:
    times = np.arange(0.0, 1.0, 0.002)
    swing = Channel((times * NANOSECONDS).astype(np.int64), np.where(times > 0.2, 3.0, 0.0))
    rise = _rise(Motion(acceleration_m_s2=swing), 0.1, 0.5, 1.125)
    assert rise is not None
    assert rise(np.array(0.5)) == pytest.approx(1.125 * 0.5 * 3.0 * 0.3**2, rel=0.02)
    assert rise(np.array(0.15)) == 0.0
    assert np.isnan(rise(np.array(1.1)))  # not recorded any more


@pytest.mark.parametrize("lost", ["none of it", "the end", "the beginning", "the middle"])
def test_an_acceleration_that_was_not_recorded_is_no_rise(lost: str) -> None:
    times = np.arange(0.0, 1.0, 0.002)
    values = np.ones(500)
    values[
        {"none of it": slice(0), "the end": slice(180, 500), "the beginning": slice(80), "the middle": slice(100, 130)}[
            lost
        ]
    ] = np.nan
    channel = Channel((times * NANOSECONDS).astype(np.int64), values)
    rise = _rise(Motion(acceleration_m_s2=channel), 0.1, 0.5, 1.0)
    assert (rise is None) == (lost != "none of it")
    assert _rise(None, 0.1, 0.5, 1.0) is None
    assert _rise(Motion(), 0.1, 0.5, 1.0) is None


def test_scores_that_are_shared_say_less() -> None:
    white = np.random.default_rng(0).normal(size=4000)
    assert _inflation(white, 1.0) == pytest.approx(1.0, abs=0.25)
    slow = np.convolve(white, np.ones(4), "valid")  # variance 4, of a sum 16
    assert _inflation(slow, 4.0) == pytest.approx(4.0, rel=0.35)


def test_what_has_no_height_is_refused() -> None:
    flat = series(np.full((300, 128), 100, np.uint16), rate_hz=300.0)
    event = StepEvent(0.5, 0.5, 1.0, 20.0, 16.5, 150)
    with pytest.raises(ConfigError, match="does not say when the impact is"):
        step_height(flat, event, speed_m_s=5.0)
    with pytest.raises(ConfigError, match="the speed at"):
        step_height(flat, event)
    with pytest.raises(ConfigError, match="no echo of a road"):
        step_height(flat, event, speed_m_s=5.0, passes_s=0.6)
    assert step_heights(flat, [event], speed_m_s=5.0) == (None,)


def test_the_bound_falls_with_looks() -> None:
    one, many = height_bound_m(GROUND, 1.0), height_bound_m(GROUND, 25.0)
    assert one == pytest.approx(5.0 * many)
    assert 1e-4 < many < 5e-3


def test_errors_are_counted() -> None:
    errors = HeightErrors(np.array([0.001, -0.003, 0.0015, np.nan]), np.array([0.002, 0.002, 0.002, np.nan]))
    assert errors.found.value == 0.75
    assert errors.honest.value == pytest.approx(2 / 3)
    assert errors.median_m.value == pytest.approx(0.001)
    assert errors.record()["said_m"] == pytest.approx(0.002)
    assert len({cell.name for cell in heights_grid()}) == 80


@pytest.mark.long
@pytest.mark.parametrize("told", [True, False])
def test_heights_on_a_wet_road_are_known_to_5_mm(told: bool) -> None:
    detector = DefaultDetector() if told else None
    found = measure_heights(StepCell("wet", 30.0, 0.03), detector, 12, seeds=drive_seeds)
    assert found.found.value == 1.0
    assert found.usual_m.value < 0.005
