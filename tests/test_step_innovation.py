"""The innovation detector: its filter and tests against plain NumPy, its thresholds against noise, its slopes."""

from __future__ import annotations

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from step_samples import RANGE_M, over_a_step

from jaxradar.drive import Channel, Motion
from jaxradar.estimate.intervals import proportion
from jaxradar.systems.step import (
    InnovationDetector,
    MotionSample,
    RangeAxis,
    detect,
    detect_batch,
    dump_detector,
    load_detector,
    stack,
)
from jaxradar.systems.step.config import SweepPeak
from jaxradar.units import NANOSECONDS

AXIS = RangeAxis.of(RANGE_M)
DT = 1.0 / 300.0


def decided(detector: InnovationDetector, range_m: Any, motion: MotionSample | None = None, valid: Any = None) -> Any:
    """Decisions on ranges (logs, sweeps), without the sweeps."""
    shape = np.shape(range_m)
    seen = np.ones(shape, bool) if valid is None else valid
    each = jax.vmap(jax.vmap(SweepPeak))
    observed = each(jnp.asarray(range_m, float), jnp.full(shape, 100.0), jnp.asarray(seen), jnp.zeros(shape, bool))
    start = jax.tree.map(lambda one: jnp.broadcast_to(one, (shape[0], *jnp.shape(one))), detector.init(AXIS))
    dt = jnp.full(shape, DT).at[:, 0].set(0.0)
    run = eqx.filter_jit(lambda one: one.scan(AXIS, start, observed, dt, motion)[1])
    return run(detector)


def oracle(detector: InnovationDetector, range_m: np.ndarray, acceleration: np.ndarray | None) -> np.ndarray:
    """The statistic of one log without detections, by a filter that carries covariances."""
    get = lambda name: float(getattr(detector, name))  # noqa: E731
    density = get("heave_m2_s3") if acceleration is None else get("known_m2_s3")
    noise = density * np.array([[DT**3 / 3, DT**2 / 2], [DT**2 / 2, DT]])
    step = np.array([[1.0, DT], [0.0, 1.0]])
    mean, covariance = np.array([range_m[0], 0.0]), np.diag([0.03**2, 0.1**2])
    up = down = typical = age = scaled = 0.0
    latest: list[float] = []
    out = [0.0]
    for k in range(1, len(range_m)):
        mean = step @ mean
        if acceleration is not None:
            mean = mean + get("lift") * acceleration[k] * np.array([DT**2 / 2, DT])
        covariance = step @ covariance @ step.T + noise
        age += DT
        settled = age >= get("settle_s")
        scale = max(typical / np.sqrt(2 / np.pi), 1.0)
        variance = covariance[0, 0] + (scale * get("range_noise_m")) ** 2
        white = (range_m[k] - mean[0]) / np.sqrt(variance)
        clipped = np.clip(white, -get("most"), get("most"))
        gain = covariance[:, 0] / variance
        mean = mean + gain * (clipped if settled else white) * np.sqrt(variance)
        covariance = covariance - np.outer(gain, gain) * variance
        statistic = 0.0
        if settled:
            share = DT / (min(get("scale_s"), scaled) + DT + 1e-9)
            scaled += DT
            typical += share * (min(abs(white), get("most")) * scale - typical)
            up, down = max(up + clipped - get("reference"), 0.0), max(down - clipped - get("reference"), 0.0)
            latest = [clipped, *latest[: detector.window - 1]]
            statistic = max(up, down)
            if detector.test == "glr":
                statistic = max(abs(sum(latest[:m])) / np.sqrt(m) for m in range(1, len(latest) + 1))
        out.append(statistic)
    return np.array(out)


@pytest.mark.parametrize("test", ["cusum", "glr"])
@pytest.mark.parametrize("known", [False, True])
def test_filter_and_test_are_those_of_the_book(test: str, known: bool) -> None:
    rng = np.random.default_rng(4)
    push = np.cumsum(rng.normal(0, 0.1, 400))
    range_m = 0.37 + 0.5 * DT**2 * np.cumsum(np.cumsum(push)) + rng.normal(0, 0.002, 400)
    range_m[300:] += 0.01
    detector = InnovationDetector(test=test, limit=1e6, settle_s=0.1 + 0.5 * DT)
    motion = None
    if known:
        yes, no, none = jnp.ones((1, 400), bool), jnp.zeros((1, 400), bool), jnp.zeros((1, 400))
        motion = MotionSample(jnp.asarray(push[None]), none, none, yes, no, no)
    with jax.enable_x64(True):
        found = decided(detector, range_m[None], motion)
        wanted = oracle(detector, range_m, push if known else None)
        np.testing.assert_allclose(found.statistic[0], wanted, rtol=1e-5, atol=1e-6)
    single = decided(detector, range_m[None], motion)
    np.testing.assert_allclose(single.statistic[0], wanted, rtol=2e-3, atol=2e-2)


@pytest.mark.parametrize("test", ["cusum", "glr"])
def test_false_alarms_are_as_many_as_asked_for(test: str) -> None:
    """In noise as the filter takes it to be; rates that the approximations know within 30 %."""
    per_sweep = 1 / 300
    made = InnovationDetector.from_false_alarm_rate(
        3600 * 300 * per_sweep, rate_hz=300.0, sd_m=0.002, test=test, window=10, release=1.0,
        refractory_s=0.0, most=1e3, scale_s=100.0, heave_m2_s3=1e-3, settle_s=0.05,
    )  # fmt: skip
    rng = np.random.default_rng(8)
    logs, sweeps = 400, 900
    range_m = 0.4 + rng.normal(0, 0.002, (logs, sweeps))
    # The filter is told of more heave than there is; its innovations are white all the same where that is little.
    made = eqx.tree_at(lambda one: one.heave_m2_s3, made, np.float64(1e-9))
    found = decided(made, range_m)
    # After a detection the filter settles: those sweeps do not count.
    waiting = round(float(made.settle_s) / DT) + 1
    events = int(np.sum(found.event))
    counted = logs * (sweeps - waiting) - events * waiting
    share = proportion(events, counted)
    assert share.low < 1.35 * per_sweep
    assert share.high > 0.65 * per_sweep


def test_the_threshold_follows_from_the_test() -> None:
    made = InnovationDetector.from_false_alarm_rate(1.0, rate_hz=300.0, sd_m=0.003, reference=1.0)
    # Half of the rate for each side: (e^2b/2 − b − ½) = 2 · 3600 · 300 with b = h + 1.166.
    b = float(made.limit) + 1.166
    assert (np.exp(2 * b) - 2 * b - 1) / 2 == pytest.approx(2 * 3600 * 300, rel=1e-6)
    assert float(made.range_noise_m) == 0.003
    with pytest.raises(ValueError, match="`limit` follows"):
        InnovationDetector.from_false_alarm_rate(1.0, rate_hz=300.0, sd_m=0.003, limit=3.0)
    with pytest.raises(ValueError, match="`per_hour` must be above 0"):
        InnovationDetector.from_false_alarm_rate(0.0, rate_hz=300.0, sd_m=0.003)


@pytest.mark.parametrize("test", ["cusum", "glr"])
@pytest.mark.parametrize("shift_m", [0.03, -0.03])
def test_a_jump_is_one_detection(test: str, shift_m: float) -> None:
    made = InnovationDetector.from_false_alarm_rate(1.0, rate_hz=100.0, sd_m=0.002, test=test)
    one = over_a_step(120, at=60, shift_m=shift_m)
    (event,) = detect(made, one).events
    assert 60 <= event.sweep <= 66
    assert not detect(made, over_a_step(120, at=60, shift_m=0.0)).events


def test_a_batch_decides_as_one_log() -> None:
    made = InnovationDetector(test="glr", limit=5.0)
    logs = [over_a_step(count, at=count // 2) for count in (120, 1, 77)]
    together = detect_batch(made, *stack(logs), fields=("statistic", "event"))
    for place, one in enumerate(logs):
        alone = detect(made, one)
        np.testing.assert_allclose(together["statistic"][place, : len(one)], alone.statistic, rtol=1e-4, atol=1e-4)
        assert np.flatnonzero(together["event"][place]).tolist() == [event.sweep for event in alone.events]


def test_springs_that_are_measured_raise_less_than_those_that_are_not() -> None:
    """3 cm at 3 Hz: the filter knows from the acceleration alone where the range goes."""
    times = np.arange(600) * DT
    heave = 0.03 * np.sin(2 * np.pi * 3 * times)
    push = -0.03 * (2 * np.pi * 3) ** 2 * np.sin(2 * np.pi * 3 * times)
    range_m = 0.4 + heave + np.random.default_rng(1).normal(0, 0.001, 600)
    made = InnovationDetector(limit=1e6, range_noise_m=0.001, heave_m2_s3=1e-3, known_m2_s3=1e-3)
    yes, no, none = jnp.ones((1, 600), bool), jnp.zeros((1, 600), bool), jnp.zeros((1, 600))
    known = decided(made, range_m[None], MotionSample(jnp.asarray(push[None]), none, none, yes, no, no))
    unknown = decided(made, range_m[None])
    assert float(jnp.max(known.statistic)) < 12.0 < 30.0 < float(jnp.max(unknown.statistic))


def test_a_car_that_moves_is_believed_less() -> None:
    rng = np.random.default_rng(2)
    noisy = 0.4 + rng.normal(0, 0.01, (1, 300))
    yes, no, none = jnp.ones((1, 300), bool), jnp.zeros((1, 300), bool), jnp.zeros((1, 300))
    made = InnovationDetector(limit=1e6, scale_s=100.0)
    standing = decided(made, noisy, MotionSample(none, none, none, no, no, yes))
    driving = decided(made, noisy, MotionSample(none, none, none + 20.0, no, no, yes))
    assert float(jnp.max(driving.statistic)) < 0.5 * float(jnp.max(standing.statistic))


def test_gaps_begin_anew_and_invalid_sweeps_say_nothing() -> None:
    made = InnovationDetector(limit=1e6)
    range_m = np.full((1, 300), 0.4)
    range_m[0, 200:] = 0.6
    valid = np.ones((1, 300), bool)
    valid[0, 100:200] = False  # 0.33 s
    found = decided(made, np.where(valid, range_m, np.nan), valid=valid)
    for field in dataclasses.fields(found):
        assert np.isfinite(np.float64(getattr(found, field.name))).all()
    assert not found.statistic[0, 100:].any()
    np.testing.assert_allclose(found.range_m[0, 200:], 0.6, atol=1e-6)


@pytest.mark.parametrize("test", ["cusum", "glr"])
def test_slopes_are_those_of_central_differences(test: str) -> None:
    rng = np.random.default_rng(6)
    range_m = 0.4 + rng.normal(0, 0.001, (1, 60))
    range_m[0, 45:] += 0.002
    made = InnovationDetector(test=test, limit=1e6, settle_s=0.05)
    names = ("range_noise_m", "heave_m2_s3", "reference")

    def cost(values: Any, moved: Any) -> Any:
        held = eqx.tree_at(lambda one: [getattr(one, name) for name in names], made, list(values))
        return jnp.sum(decided(held, moved).statistic[:, -5:])

    with jax.enable_x64(True):
        given = [jnp.asarray(float(getattr(made, name))) for name in names]
        slopes, along = jax.grad(cost, (0, 1))(given, jnp.asarray(range_m))
        for place, value in enumerate(given):
            step = 1e-6 * value
            ahead, back = (
                cost([one + sign * step * (at == place) for at, one in enumerate(given)], range_m) for sign in (1, -1)
            )
            np.testing.assert_allclose(slopes[place], (ahead - back) / (2 * step), rtol=1e-4, atol=1e-6)
        turn = rng.normal(size=range_m.shape)
        ahead, back = (cost(given, range_m + sign * 1e-9 * turn) for sign in (1, -1))
        np.testing.assert_allclose(np.sum(along * turn), (ahead - back) / 2e-9, rtol=1e-4)


def test_it_has_a_name_and_a_file(tmp_path: Any) -> None:
    path = tmp_path / "one.toml"
    path.write_text(dump_detector("innovation").replace('test = "cusum"', 'test = "glr"'))
    assert load_detector(path).detector.test == "glr"
    with pytest.raises(ValueError, match="must be one of cusum, glr"):
        InnovationDetector(test="sum")


def test_motion_comes_in_by_the_front_door() -> None:
    one = over_a_step(120, at=60, shift_m=0.0)
    random = np.random.default_rng(4)
    counts = np.clip(one.sweeps + random.normal(0.0, 60.0, one.sweeps.shape), 0.0, None)
    one = dataclasses.replace(one, sweeps=np.rint(counts).astype(np.uint16))
    fast = Channel(one.times_ns, np.full(len(one), 10.0))
    assert one.times_ns[1] == NANOSECONDS // 100
    made = InnovationDetector(limit=1e6, range_noise_m=1e-6, moving_noise_m=0.002)
    driving, unknown = detect(made, one, Motion(speed_m_s=fast)), detect(made, one)
    assert 0 < driving.statistic.max() < unknown.statistic.max()
