"""Track before detect: the theory of its evidence, an oracle, and steps that close in."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from approach_oracle import approach
from scipy import integrate

from jaxradar import ConfigError
from jaxradar.drive import SensorSeries, SweepFlag
from jaxradar.estimate.intervals import rate
from jaxradar.sim import SURFACES, CarMotion, SpeedChange, StepUp, held_out_seeds, load_scene, simulate_batch
from jaxradar.systems.step import ApproachDetector, DefaultDetector, ShiftDetector, detect, detect_batch, run, stack
from jaxradar.systems.step.approach_bank import LONGEST_JUMP, cost, moved_on
from jaxradar.systems.step.config import RangeAxis

AXIS = RangeAxis.of(0.1 + 0.014 * np.arange(64))
SMALL = ApproachDetector(speeds=4, places=12, place_m=0.05, cell_m=0.028)


def settings_of(detector: ApproachDetector) -> dict[str, Any]:
    return {
        one.name: getattr(detector, one.name) if one.metadata.get("static") else float(getattr(detector, one.name))
        for one in dataclasses.fields(detector)
    }


def corner_drive(seed: int, speed: float = 8.0, ahead_m: float = 3.5, rate_hz: float = 300.0) -> SensorSeries:
    """Rayleigh noise with an echo that closes in, gaps, a sweep taken late and one that goes back."""
    random = np.random.default_rng(seed)
    count = 160
    steps = np.full(count, 1.0 / rate_hz)
    steps[30], steps[31] = 2.5 / rate_hz, -0.5 / rate_hz
    times = np.cumsum(steps) - steps[0]
    ahead = ahead_m - speed * times
    slant = np.hypot(0.35, ahead)
    range_m = np.asarray(AXIS.range_m)
    echo = 700.0 * (ahead > 0)[:, None] * np.exp(-0.5 * ((range_m - slant[:, None]) / 0.025) ** 2)
    sweeps = np.abs(random.rayleigh(150.0, (count, 64)) + echo)
    flags = np.zeros(count, np.uint16)
    flags[[1, 50, 51, 100]] = SweepFlag.MISSED_DATA
    return SensorSeries(1, np.rint(times * 1e9).astype(np.int64), np.rint(sweeps).astype(np.uint16), range_m, flags)


@pytest.mark.parametrize("tilt", [0.0, 0.7, 2.0, 5.0, 30.0])
def test_the_cost_makes_the_mean_of_the_likelihood_ratio_one(tilt: float) -> None:
    density = lambda a: 2 * a * math.exp(-a * a + tilt * a - 0.25 * tilt * tilt)  # noqa: E731
    mean, _ = integrate.quad(density, 0, tilt + 40, epsabs=1e-13, epsrel=1e-12, points=[0.5 * tilt, 0.5 * tilt + 1])
    with jax.enable_x64(True):
        assert float(cost(jnp.asarray([tilt]))[0]) == pytest.approx(math.log(mean) + 0.25 * tilt * tilt, rel=1e-10)


@pytest.mark.parametrize("seed", [0, 1])
def test_it_is_what_its_oracle_says(seed: int) -> None:
    series = corner_drive(seed)
    dt = np.diff(series.times_ns, prepend=series.times_ns[:1]) / 1e9
    wanted, events = approach(series.sweeps, dt, series.flags == 0, series.range_m, AXIS.bin_m, settings_of(SMALL))
    with jax.enable_x64(True):
        found = run(SMALL, AXIS, series.sweeps, series.flags, dt)
    np.testing.assert_allclose(found.statistic, wanted, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(found.event, events)
    assert events.sum() == 1


def test_slopes_are_central_differences() -> None:
    series = corner_drive(3)
    dt = np.diff(series.times_ns, prepend=series.times_ns[:1]) / 1e9
    names = ("tilt_far", "tilt_near", "look_m", "noise_share", "reference_s", "fade_share", "height_m", "fastest_m_s")
    with jax.enable_x64(True):

        def total(values: Any) -> Any:
            made = eqx.tree_at(lambda one: [getattr(one, name) for name in names], SMALL, list(values))
            return jnp.sum(jnp.sqrt(1.0 + run(made, AXIS, series.sweeps, series.flags, dt).statistic))

        at = jnp.array([float(getattr(SMALL, name)) for name in names])
        slope, program = jax.jit(jax.grad(total))(at), jax.jit(total)
        for place, name in enumerate(names):
            step = 1e-7 * float(at[place]) * jnp.zeros(len(names)).at[place].set(1.0)
            plain = float(program(at + step) - program(at - step)) / (2e-7 * float(at[place]))
            # A place leaves one cell for the next at a corner of the interpolation.
            assert float(slope[place]) == pytest.approx(plain, rel=1e-4, abs=1e-5), name


def test_evidence_moves_on_by_whole_places_and_keeps_the_rest() -> None:
    evidence = jnp.arange(12.0).reshape(2, 6)
    moved, left = moved_on(evidence, jnp.array([0.3, 0.0]), jnp.array([0.1, 1.7]))
    np.testing.assert_allclose(moved, [[0, 1, 2, 3, 4, 5], [0, 0, 6, 7, 8, 9]])
    np.testing.assert_allclose(left, [0.4, -0.3], atol=1e-6)
    gone, _ = moved_on(evidence, jnp.zeros(2), jnp.array([float(LONGEST_JUMP + 1), 100.0]))
    assert not np.asarray(gone).any()


def test_noise_alone_alarms_less_often_than_theory_bounds() -> None:
    """At 500,000 alarms an hour, so that there are some; the noise is white from cell to cell and sweep to sweep."""
    random = np.random.default_rng(4)
    detector = ApproachDetector.from_false_alarm_rate(500_000.0, rate_hz=300.0)
    sweeps = np.rint(random.rayleigh(300.0, (64, 2000, 64))).astype(np.uint16)
    dt = np.full((64, 2000), 1 / 300.0)
    dt[:, 0] = 0.0
    inputs = (sweeps, np.zeros((64, 2000), np.uint16), dt, np.full(64, 2000, np.int32))
    count = int(np.asarray(detect_batch(detector, AXIS, *inputs, fields=("event",))["event"]).sum())
    found = rate(count, 64 * (2000 / 300 - 0.15) / 3600)
    assert count > 20
    assert found.high < 500_000.0


def test_a_rate_that_makes_no_sense_is_refused() -> None:
    with pytest.raises(ValueError, match="`per_hour` and `rate_hz` must be above 0"):
        ApproachDetector.from_false_alarm_rate(0.0, rate_hz=300.0)
    with pytest.raises(ValueError, match="`evidence` follows"):
        ApproachDetector.from_false_alarm_rate(1.0, rate_hz=300.0, evidence=3.0)
    with pytest.raises(ValueError, match="needs one of the two"):
        DefaultDetector(approach=None, shift=None)


@pytest.fixture(scope="module")
def wet_steps() -> list[Any]:
    base = dataclasses.replace(load_scene("trial"), surface=SURFACES["wet-asphalt"], duration_s=1.2)
    scenes = [dataclasses.replace(base, road=(StepUp(at_m=8.0 + 0.01 * seed, height_m=0.03),)) for seed in range(12)]
    return simulate_batch(scenes, held_out_seeds(5, 12))


def test_a_step_on_a_wet_road_is_seen_early_and_its_impact_foretold(wet_steps: list[Any]) -> None:
    for drive in wet_steps:
        events = detect(DefaultDetector(), drive.sensors[0]).events
        assert len(events) == 1
        lead = drive.truth.steps[0].impact_s - events[0].time_s
        assert 0.04 < lead < 0.12
        assert events[0].impact_in_s == pytest.approx(lead, abs=0.04)


def test_a_part_that_is_off_says_nothing(wet_steps: list[Any]) -> None:
    series = wet_steps[0].sensors[0]
    assert not detect(DefaultDetector(approach=None), series).events
    alone = detect(DefaultDetector(shift=None), series)
    assert [one.time_s for one in alone.events] == [one.time_s for one in detect(ApproachDetector(), series).events]
    raised = detect(DefaultDetector(level=2.0, shift=None), series)
    doubled = detect(ApproachDetector(evidence=2 * float(ApproachDetector().evidence)), series)
    assert [one.time_s for one in raised.events] == [one.time_s for one in doubled.events]
    assert isinstance(DefaultDetector().shift, ShiftDetector)


def test_pulling_away_raises_nothing() -> None:
    base = dataclasses.replace(load_scene("pulling-away"), duration_s=2.5)
    motions = [
        CarMotion(speed_m_s=0.0, changes=(SpeedChange(at_s=1.2, to_m_s=5.0, acceleration_m_s2=1.0 + 0.25 * one),))
        for one in range(8)
    ]
    drives = simulate_batch([dataclasses.replace(base, motion=one) for one in motions], held_out_seeds(6, 8))
    found = detect_batch(DefaultDetector(), *stack([one.sensors[0] for one in drives]), fields=("event",))
    assert not np.asarray(found["event"]).any()


def test_settings_of_parts_are_tuned_by_their_names() -> None:
    from jaxradar.tuning import Space

    space = Space.of(DefaultDetector(), ("approach.evidence", "shift.window_s", "level"))
    start = space.vector(DefaultDetector())
    np.testing.assert_allclose(space.values(start), [15.5, 0.03, 1.0], rtol=1e-4)
    made = space.detector_at(DefaultDetector(), start + 0.1)
    assert float(made.approach.evidence) > 15.5
    with pytest.raises(ConfigError, match=r"has no setting `aproach\.evidence`"):
        Space.of(DefaultDetector(), ("aproach.evidence",))
