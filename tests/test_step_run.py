"""One code for batch, single sweeps and device: equal to each other, padded or not, never recompiled by a value."""

from __future__ import annotations

import dataclasses
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from step_samples import BINS, RANGE_M, echo, over_a_step, series

from jaxradar.drive import SweepFlag
from jaxradar.systems.step import (
    DETECTORS,
    RangeAxis,
    ShiftDetector,
    ThesisDetector,
    detect,
    event_weights,
    precision,
    run,
    run_batch,
    thin,
    time_steps,
)

AXIS = RangeAxis.of(RANGE_M)


def logs():
    generator = np.random.default_rng(0)
    noisy = over_a_step(count=50, at=20)
    noisy = dataclasses.replace(
        noisy, sweeps=(noisy.sweeps + generator.integers(0, 60, noisy.sweeps.shape)).astype(np.uint16)
    )
    return [noisy, over_a_step(count=37, at=30, shift_m=0.02), series([echo(0.3)]), over_a_step(count=44, at=12)]


def batch(padded_to: int, filler: int):
    parts = logs()
    sweeps = np.full((len(parts), padded_to, BINS), filler, np.uint16)
    flags = np.zeros((len(parts), padded_to), np.uint16)
    dt = np.zeros((len(parts), padded_to))
    for i, part in enumerate(parts):
        sweeps[i, : len(part)], dt[i, : len(part)] = part.sweeps, time_steps(part.times_ns)
    return sweeps, flags, dt, np.array([len(part) for part in parts])


# The default compiles for many seconds at each shape; `test_stability.py` looks at its hard cases too.
SLOW = ("shift", "default")  # to compile
DEFAULT_LATER = [pytest.param(name, marks=pytest.mark.long) if name in SLOW else name for name in DETECTORS]
GRADIENTS_LATER = [
    pytest.param(name, marks=pytest.mark.long) if name in ("default", "range-rate") else name for name in DETECTORS
]


@pytest.mark.parametrize("name", DEFAULT_LATER)
@pytest.mark.parametrize(("padded_to", "filler"), [pytest.param(50, 0, marks=pytest.mark.long), (64, 60000)])
def test_padded_batch_equals_single_logs(name: str, padded_to: int, filler: int) -> None:
    detector = DETECTORS[name]()
    with precision(detector):
        together = jax.jit(run_batch)(detector, AXIS, *batch(padded_to, filler))
    for i, part in enumerate(logs()):
        alone = detect(detector, part)
        count = len(part)
        assert np.flatnonzero(together.event[i]).tolist() == [event.sweep for event in alone.events]
        assert np.asarray(together.valid[i, :count]).tolist() == alone.valid.tolist()
        np.testing.assert_allclose(together.range_m[i, :count][alone.valid], alone.range_m[alone.valid], rtol=1e-6)
        np.testing.assert_allclose(together.statistic[i, :count], alone.statistic, atol=1e-5)
        assert not np.asarray(together.valid[i, count:]).any()
        assert not np.asarray(together.event[i, count:]).any()


@pytest.mark.parametrize("name", DETECTORS)
def test_one_sweep_at_a_time_equals_the_scan(name: str) -> None:
    """What the device does: `observe` and `track`, one call a sweep."""
    detector, log = DETECTORS[name](), logs()[0]
    whole = detect(detector, log)
    with precision(detector):
        step = jax.jit(
            lambda state, sweep, flag, dt: detector.track(AXIS, state, detector.observe(AXIS, sweep, flag), None, dt)
        )
        state, decisions = detector.init(AXIS), []
        for sweep, flag, dt in zip(log.sweeps, log.flags, time_steps(log.times_ns), strict=True):
            state, decision = step(state, sweep, flag, jnp.asarray(dt))
            decisions.append(decision)
    assert [i for i, one in enumerate(decisions) if one.event] == [event.sweep for event in whole.events]
    np.testing.assert_allclose([one.range_m for one in decisions], whole.range_m, rtol=1e-6)
    # A range of 0.4 m over a noise of 2 mm rounds to 4e-5 in single precision.
    atol = 1e-4 if name == "innovation" else 1e-5
    np.testing.assert_allclose([one.statistic for one in decisions], whole.statistic, atol=atol)


@pytest.mark.long
def test_events_in_a_batch_do_not_hang_on_its_order() -> None:
    sweeps, flags, dt, lengths = batch(64, 0)
    order = [2, 0, 3, 1]
    runner = jax.jit(partial(run_batch, ShiftDetector(), AXIS))
    forwards, mixed = runner(sweeps, flags, dt, lengths), runner(sweeps[order], flags[order], dt[order], lengths[order])
    np.testing.assert_array_equal(np.asarray(forwards.event)[order], mixed.event)
    np.testing.assert_allclose(np.asarray(forwards.statistic)[order], mixed.statistic, atol=1e-6)


@pytest.mark.parametrize("name", DETECTORS)
def test_the_device_s_step_lowers_without_custom_calls(name: str) -> None:
    detector = DETECTORS[name]()

    def step(state, sweep, flag, dt):
        return detector.track(AXIS, state, detector.observe(AXIS, sweep, flag), None, dt)

    with precision(detector):
        lowered = jax.jit(step).lower(detector.init(AXIS), np.zeros(BINS, np.uint16), np.uint16(0), jnp.zeros(()))
    text = lowered.as_text()
    assert "stablehlo" in text
    assert "custom_call" not in text


def test_retuning_never_recompiles() -> None:
    log = over_a_step()
    runner = eqx.filter_jit(eqx.debug.assert_max_traces(run, max_traces=1))
    inputs = (AXIS, log.sweeps, log.flags, time_steps(log.times_ns))
    for evidence in (0.1, 0.2, np.float64(0.3)):
        runner(ShiftDetector(evidence=evidence), *inputs)
    tuned = eqx.tree_at(lambda one: one.evidence, ShiftDetector(), jnp.asarray(0.99, jnp.float32))
    assert not runner(tuned, *inputs).event.any()
    assert runner(ShiftDetector(), *inputs).event.any()


def test_a_day_of_times_loses_nothing() -> None:
    """In float32 seconds after 24 h are 7.8 ms apart, after an epoch 128 s (hard case 8)."""
    late = over_a_step()
    for offset_s in (86_400, 1_700_000_000):
        shifted = dataclasses.replace(late, times_ns=late.times_ns + offset_s * 1_000_000_000)
        np.testing.assert_array_equal(time_steps(shifted.times_ns), time_steps(late.times_ns))
        for detector in (ThesisDetector(), ShiftDetector()):
            wanted = detect(detector, late)
            got = detect(detector, shifted)
            assert [event.sweep for event in got.events] == [event.sweep for event in wanted.events] == [30]
            np.testing.assert_array_equal(got.statistic, wanted.statistic)
            assert got.events[0].time_s == pytest.approx(offset_s + 0.3, abs=1e-6)


@pytest.mark.long  # as is the same on all recordings
@pytest.mark.parametrize("name", [name for name, kind in DETECTORS.items() if not kind.float64])
def test_float64_and_float32_agree_on_every_event(name: str) -> None:
    # Where a time is up between two sweeps: at one of them, it is up in one precision and not in the other.
    detector = DETECTORS[name](**({"settle_s": 0.152} if name == "innovation" else {}))
    decisions = []
    for double in (False, True):
        with jax.enable_x64(double):
            decisions.append(jax.jit(run_batch)(detector, AXIS, *batch(64, 0)))
    np.testing.assert_array_equal(decisions[0].event, decisions[1].event)
    np.testing.assert_array_equal(decisions[0].valid, decisions[1].valid)
    np.testing.assert_allclose(decisions[0].range_m, decisions[1].range_m, rtol=1e-5)


@pytest.mark.parametrize("name", [name for name, kind in DETECTORS.items() if kind.float64])
def test_detectors_for_double_precision_refuse_single(name: str) -> None:
    """Near-ties would fall otherwise than its document says; `precision` is the context to run it in."""
    with pytest.raises(ValueError, match=f"`{name}` needs double precision; call it inside"):
        run_batch(DETECTORS[name](), AXIS, *batch(64, 0))


@pytest.mark.long
def test_gradient_through_a_whole_log_agrees_with_central_differences() -> None:
    """Of ranges and statistics, with respect to a setting and to amplitudes, where they move them smoothly."""
    log = over_a_step(count=40, at=20)

    with jax.enable_x64(True):
        sweeps = jnp.asarray(log.sweeps, jnp.float64)

        def total(window_s, sweeps):
            tuned = eqx.tree_at(lambda one: one.window_s, ShiftDetector(), window_s)
            decisions = run(tuned, AXIS, sweeps, log.flags, time_steps(log.times_ns))
            return decisions.statistic.sum() + decisions.range_m.sum()

        value_and_slopes = jax.jit(jax.value_and_grad(total, argnums=(0, 1)))
        _, (slope, slopes) = value_and_slopes(jnp.asarray(0.03), sweeps)

        def difference(step_s, step_counts):
            ends = [float(value_and_slopes(0.03 + k * step_s, sweeps + k * step_counts)[0]) for k in (1.0, -1.0)]
            return (ends[0] - ends[1]) / 2

        assert float(slope) == pytest.approx(difference(1e-6, 0.0) / 1e-6, rel=1e-4)
        assert abs(float(slope)) > 1e-3
        generator = np.random.default_rng(0)
        for sweep in (5, 20, 21):
            direction = np.zeros(log.sweeps.shape)
            direction[sweep, 30:55] = generator.normal(size=25)
            wanted = float(jnp.sum(slopes * direction))
            assert wanted == pytest.approx(difference(0.0, 1e-3 * direction) / 1e-3, rel=1e-4)
            assert abs(wanted) > 1e-7


HARD = {
    "constant floats": lambda: series(np.full((9, 100), np.float32(40.974483)), range_m=RANGE_M[:100]),
    "all zero": lambda: series(np.zeros((9, BINS), np.uint16)),
    "constant": lambda: series(np.full((9, BINS), 400, np.uint16)),
    "saturated": lambda: series(np.full((9, BINS), 65535, np.uint16)),
    "all NaN": lambda: series(np.full((9, BINS), np.nan)),
    "one NaN": lambda: series(np.where(np.arange(BINS) == 5, np.nan, [echo(0.4)] * 9)),
    "tie": lambda: series([echo(0.3).astype(int) + echo(0.7) - 100] * 9),
    "first bin": lambda: series([echo(RANGE_M[0])] * 9),
    "last bin": lambda: series([echo(RANGE_M[-1])] * 9),
    "dt = 0": lambda: series([echo(0.4), echo(0.45), echo(0.4)] * 3, times_s=np.zeros(9)),
    "time back": lambda: series([echo(0.4), echo(0.45), echo(0.4)] * 3, times_s=-np.arange(9) / 100),
    "one sweep": lambda: series([echo(0.4)]),
    "no sweep": lambda: series(np.zeros((0, BINS), np.uint16)),
    "two bins": lambda: series(np.array([[9, 5000]] * 9, np.uint16), range_m=np.array([0.2, 0.21])),
    "all missed": lambda: series([echo(0.4)] * 9, flags=np.full(9, SweepFlag.MISSED_DATA)),
    "float32": lambda: dataclasses.replace(over_a_step(), sweeps=over_a_step().sweeps.astype(np.float32)),
}
# (valid sweeps, range where valid) for `thesis`; None: not asked
WANTED = {
    "all zero": (0, None), "constant": (9, RANGE_M[-1]), "constant floats": (9, RANGE_M[99]),
    "saturated": (9, RANGE_M[-1]), "all NaN": (0, None),
    "one NaN": (9, 0.4), "tie": (9, 0.7), "first bin": (9, None), "last bin": (9, RANGE_M[-1]), "dt = 0": (9, None),
    "time back": (9, None), "one sweep": (1, None), "no sweep": (0, None), "two bins": (9, 0.21),
    "all missed": (0, None), "float32": (60, None),
}  # fmt: skip
INVALID_BY_DEFAULT = {"all zero", "constant", "constant floats", "saturated", "all NaN", "no sweep", "all missed"}


@pytest.mark.parametrize("case", HARD)
@pytest.mark.parametrize("name", DEFAULT_LATER)
def test_hard_cases_by_value_and_flag(name: str, case: str) -> None:
    log = HARD[case]()
    trace = detect(DETECTORS[name](), log)
    assert len(trace.valid) == len(trace.statistic) == len(log)
    assert np.isfinite(trace.statistic).all()
    assert np.isfinite(trace.strength).all()
    np.testing.assert_array_equal(np.isnan(trace.range_m), ~trace.valid)
    # An object in the first bin, or a sweep that is saturated from there on, is within 0.15 m indeed.
    near = name == "lab-live" and case in ("saturated", "first bin")
    assert len(trace.events) == (near or (case == "float32" and name not in ("lab-live", "approach")))
    assert trace.saturated.all() == (case in ("saturated", "no sweep"))
    if name == "thesis":
        count, range_m = WANTED[case]
        assert trace.valid.sum() == count
        if range_m is not None:
            np.testing.assert_allclose(trace.range_m, range_m, atol=0.0071)
    if name in SLOW:
        assert trace.valid.any() != (case in INVALID_BY_DEFAULT)


def _total(detector, axis, sweeps, flags, dt):
    decisions = run(detector, axis, sweeps, flags, dt)
    return decisions.statistic.sum() + decisions.range_m.sum() + decisions.speed_m_s.sum()


# One program for each detector, precision and shape.
GRADIENTS = jax.jit(jax.grad(_total, argnums=(0, 2)))


@pytest.mark.parametrize("case", [case for case in HARD if case not in ("no sweep", "one sweep", "float32")])
@pytest.mark.parametrize("name", GRADIENTS_LATER)
def test_hard_cases_by_gradient(name: str, case: str, precision: str) -> None:
    """Of the ranges and statistics, with respect to every setting and every amplitude."""
    if DETECTORS[name].float64 and precision == "float32":
        pytest.skip("runs in double precision alone")
    log = HARD[case]()
    detector = jax.tree.map(jnp.asarray, DETECTORS[name]())
    sweeps = jnp.asarray(log.sweeps, jnp.result_type(float))
    gradients = GRADIENTS(detector, RangeAxis.of(log.range_m), sweeps, log.flags, time_steps(log.times_ns))
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(gradients))


def test_thin_refuses_more_bins_than_there_are() -> None:
    with pytest.raises(Exception, match="cannot thin 128 range bins to 129; expected a number from 2 to 128"):
        thin(over_a_step(), 129)


@pytest.mark.long
def test_soft_events_tend_to_the_hard_threshold_and_carry_its_gradient() -> None:
    log, detector = over_a_step(), ShiftDetector()
    decisions = jax.jit(run)(detector, AXIS, log.sweeps, log.flags, time_steps(log.times_ns))
    hard = np.asarray(decisions.statistic) > float(detector.evidence)
    assert hard.any()
    np.testing.assert_allclose(event_weights(detector, decisions, 1e-5), hard, atol=1e-6)

    def total(evidence):
        return event_weights(ShiftDetector(evidence=evidence), decisions, 0.05).sum()

    assert float(jax.grad(total)(jnp.asarray(0.16))) < -1.0  # a lower threshold, more detections
