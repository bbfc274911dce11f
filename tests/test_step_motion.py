"""The car's motion on its way to a detector: what was known by then, the same through every door."""

from __future__ import annotations

import dataclasses
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from step_samples import over_a_step, series

from jaxradar.drive import Channel, Motion
from jaxradar.motion import HELD_S
from jaxradar.systems.step import (
    DETECTORS,
    MotionSample,
    RangeAxis,
    RangeRateDetector,
    detect,
    detect_batch,
    detect_series,
    lanes,
    motion_at,
    run,
    run_batch,
    stack,
    time_steps,
)
from jaxradar.units import NANOSECONDS


def channel(times_s: Any, values: Any) -> Channel:
    return Channel(np.rint(np.asarray(times_s) * NANOSECONDS).astype(np.int64), np.asarray(values, float))


def held(channel: Channel, times_ns: np.ndarray) -> tuple[list[float], list[bool]]:
    """By going through all samples."""
    values, known = [], []
    for now in times_ns:
        seen = [
            (at, order, value)
            for order, (at, value) in enumerate(zip(channel.times_ns, channel.values, strict=True))
            if at <= now and np.isfinite(value)
        ]
        last = max(seen, default=None)
        fresh = last is not None and now - last[0] <= HELD_S * NANOSECONDS
        known.append(fresh)
        values.append(last[2] if last is not None and fresh else 0.0)
    return values, known


def test_a_sweep_knows_what_was_known_by_then() -> None:
    rng = np.random.default_rng(2)
    times = np.cumsum(rng.uniform(-0.005, 0.05, 80))
    recorded = channel(times, np.where(rng.random(80) < 0.1, np.nan, rng.normal(size=80)))
    asked = np.sort(rng.uniform(-0.2, times.max() + 0.5, 300) * NANOSECONDS).astype(np.int64)
    found = motion_at(Motion(acceleration_m_s2=recorded), asked)
    values, known = held(recorded, asked)
    np.testing.assert_array_equal(found.acceleration_m_s2, values)
    np.testing.assert_array_equal(found.acceleration_known, known)
    assert not np.any(found.yaw_rate_known) and not np.any(found.speed_known)
    assert not all(known) and any(known)


def test_a_sample_at_the_very_time_counts_and_one_just_after_does_not() -> None:
    recorded = channel([1.0], [5.0])
    asked = np.array([-1, 0, round(HELD_S * NANOSECONDS), round(HELD_S * NANOSECONDS) + 1]) + NANOSECONDS
    found = motion_at(Motion(speed_m_s=recorded), asked)
    np.testing.assert_array_equal(found.speed_known, [False, True, True, False])
    np.testing.assert_array_equal(found.speed_m_s, [0.0, 5.0, 5.0, 0.0])


def test_nothing_is_known_of_channels_that_hold_nothing() -> None:
    for motion in (Motion(), Motion(channel([], [])), Motion(channel([0.0, 0.1], [np.nan, np.inf]))):
        found = motion_at(motion, np.arange(5))
        for field in dataclasses.fields(MotionSample):
            assert not np.any(getattr(found, field.name))


class SpeedDetector(RangeRateDetector):
    """Alarms where the car goes backwards; its statistic is the acceleration."""

    name: ClassVar[str] = "speed"
    uses_motion: ClassVar[bool] = True

    def follow(self, axis, state, sweeps, flags, dt, motion=None):  # type: ignore[no-untyped-def]
        observations = jax.vmap(jax.vmap(lambda *one: self.observe(axis, *one)))(sweeps(), flags)
        return self.scan(axis, state, observations, dt, motion)

    def track(self, axis, state, observation, motion, dt):  # type: ignore[no-untyped-def]
        state, decision = super().track(axis, state, observation, motion, dt)
        if motion is None:
            return state, dataclasses.replace(decision, statistic=jnp.full_like(decision.statistic, -1.0))
        return state, dataclasses.replace(
            decision,
            statistic=motion.acceleration_m_s2 + 0.0 * decision.statistic,
            event=motion.speed_known & (motion.speed_m_s < 0),
        )


def moved(seed: int) -> Motion:
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.0, 0.03, 40))
    return Motion(channel(times, rng.normal(size=40)), None, channel(times, rng.normal(size=40)))


LOGS = [over_a_step(count, at=count // 2) for count in (60, 3, 41, 200)]
MOTIONS = [moved(1), None, moved(2), moved(3)]


def wanted(place: int) -> tuple[np.ndarray, list[int]]:
    sample = motion_at(MOTIONS[place] or Motion(), LOGS[place].times_ns)
    backwards = np.flatnonzero(np.asarray(sample.speed_known) & (np.asarray(sample.speed_m_s) < 0))
    return np.float32(sample.acceleration_m_s2), backwards.tolist()


def test_every_way_in_hands_on_the_same_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lanes, "LANES_BY_TIME", 2)
    monkeypatch.setattr(lanes, "CHUNK_SWEEPS_BY_TIME", 2 * 16)
    monkeypatch.setattr(lanes, "LANES_BY_LOGS", 2)
    monkeypatch.setattr(lanes, "CHUNK_SWEEPS_BY_LOGS", 2 * 16)
    detector = SpeedDetector()
    together = detect_batch(detector, *stack(LOGS, MOTIONS), fields=("statistic", "event"))
    pairs = [(one, motion or Motion()) for one, motion in zip(LOGS, MOTIONS, strict=True)]
    in_lanes = dict(detect_series(detector, pairs, ("statistic", "event")))
    for place, one in enumerate(LOGS):
        statistic, events = wanted(place)
        found = detect(detector, one, MOTIONS[place] or Motion())
        np.testing.assert_array_equal(found.statistic, statistic)
        assert [event.sweep for event in found.events] == events
        for name, values in (("statistic", statistic), ("event", np.isin(np.arange(len(one)), events))):
            np.testing.assert_array_equal(together[name][place, : len(one)], values)
            np.testing.assert_array_equal(in_lanes[place][name], values)
        sample = motion_at(MOTIONS[place] or Motion(), one.times_ns)
        alone = run(detector, RangeAxis.of(one.range_m), one.sweeps, one.flags, time_steps(one.times_ns), sample)
        np.testing.assert_array_equal(alone.statistic, statistic)


def test_without_motion_a_detector_is_told_none() -> None:
    assert (detect(SpeedDetector(), LOGS[0]).statistic == -1.0).all()
    batch = stack(LOGS)
    assert (detect_batch(SpeedDetector(), *batch, fields=("statistic",))["statistic"] == -1.0).all()


@pytest.mark.parametrize("name", ["thesis", "default"])
def test_what_does_not_use_it_compiles_to_the_same_program(name: str) -> None:
    detector = DETECTORS[name]()
    assert not detector.uses_motion
    with jax.enable_x64(detector.float64):
        plain = str(jax.make_jaxpr(lambda: run_batch(detector, *stack(LOGS)))())
        handed = str(jax.make_jaxpr(lambda: run_batch(detector, *stack(LOGS, MOTIONS)))())
    assert plain == handed


def test_shapes_that_do_not_fit_are_refused() -> None:
    batch = stack(LOGS)
    with pytest.raises(ValueError, match=r"motion\.acceleration_m_s2` of shape \(logs, sweeps\) = \(4, 200\)"):
        detect_batch(SpeedDetector(), *batch._replace(motion=stack(LOGS[:2], MOTIONS[:2]).motion))
    with pytest.raises(ValueError, match="a motion for each series; got 1 for 4"):
        stack(LOGS, MOTIONS[:1])


def test_a_log_without_sweeps_has_no_motion() -> None:
    empty = series(np.zeros((0, 128), np.uint16))
    assert motion_at(moved(1), empty.times_ns).speed_m_s.shape == (0,)
    assert dict(detect_series(SpeedDetector(), [(empty, moved(1))], ("event",)))[0]["event"].shape == (0,)
