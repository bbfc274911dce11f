"""Whole batches in blocks against one sweep after the other, for every detector, and against plain NumPy."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxradar import ConfigError
from jaxradar._numerics import reductions
from jaxradar.drive import SensorSeries, SweepFlag
from jaxradar.systems.step import (
    ApproachDetector,
    DefaultDetector,
    FilteredRateDetector,
    LabLiveDetector,
    RangeAxis,
    RangeRateDetector,
    ShiftDetector,
    ThesisDetector,
    blocks,
    detect,
    detect_batch,
    event_weights,
    precision,
    run_batch,
    stack,
)
from jaxradar.systems.step import batch as step_batch
from jaxradar.systems.step.config import Decision
from jaxradar.systems.step.range_rate import PEAKS

FIELDS = tuple(field.name for field in dataclasses.fields(Decision))
DETECTORS: dict[str, Any] = {
    "thesis": ThesisDetector(),
    "lab-live": LabLiveDetector(nearest_m=0.35),
    "lab-live as it was": LabLiveDetector(nearest_m=0.35, as_it_was=True),
    "shift": ShiftDetector(),
    "approach": ApproachDetector(),
    "default": DefaultDetector(),
    # A third of the cells, for what does not hang on their number: a program of a second, not of five.
    "few cells": ShiftDetector(cell_m=0.06),
    **{peak: RangeRateDetector(peak=peak) for peak in PEAKS},
    "filtered": FilteredRateDetector(filter=(2.0, 0.5, -0.1)),
    "soft-argmax, compensated": RangeRateDetector(refine_compensated=True),
    "parabola, compensated": RangeRateDetector(peak="parabola", refine_compensated=True),
}
Batch = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def axis_of(bins: int) -> RangeAxis:
    return RangeAxis.of(0.2 + 0.7 / bins * np.arange(bins))


def batch(logs: int, sweeps: int, bins: int, gaps: bool = True, seed: int = 0) -> Batch:
    """Echoes that step, over Rayleigh noise, with all that a log may hold; nonsense beyond the lengths."""
    generator = np.random.default_rng([seed, logs, sweeps, bins])
    range_m = np.asarray(axis_of(bins).range_m)
    steps = np.where(generator.random((logs, sweeps)) < 4 / (sweeps + 4), generator.normal(0, 0.04, (logs, sweeps)), 0)
    place = np.clip(0.45 + np.cumsum(steps, axis=1), 0.25, 0.85)
    amplitude = np.where(generator.random((logs, sweeps)) < 0.06, 2e5, 3000.0)
    echo = amplitude[..., None] * np.exp(-4 * np.log(2) * ((range_m - place[..., None]) / 0.06) ** 2)
    counts = np.minimum(echo + generator.rayleigh(60, echo.shape), 65535).astype(np.uint16)
    flags = np.where((counts == 65535).any(axis=-1), np.uint16(SweepFlag.SATURATED), np.uint16(0))
    dt = generator.normal(0.01, 0.001, (logs, sweeps)).astype(np.float32).astype(np.float64)
    lengths = np.full(logs, sweeps)
    if gaps:
        missing = generator.random((logs, sweeps)) < 0.08
        missing[:, sweeps // 3 : sweeps // 3 + 40 * (sweeps > 200)] = True  # too long for a track
        flags |= np.where(missing, np.uint16(SweepFlag.MISSED_DATA), np.uint16(0))
        counts[generator.random((logs, sweeps)) < 0.03] = 0
        dt = np.where(generator.random((logs, sweeps)) < 0.05, generator.choice([0.0, -0.005], (logs, sweeps)), dt)
        lengths = generator.integers(0, sweeps, logs, endpoint=True)
        lengths[0] = sweeps
        beyond = np.arange(sweeps) >= lengths[:, None]
        counts[beyond], dt[beyond] = 60000, 1e6
    dt[:, 0] = 0.0
    return counts, flags.astype(np.uint16), dt, lengths


def one_log_after_the_other(detector: Any, axis: RangeAxis, inputs: Batch) -> list[dict[str, np.ndarray]]:
    """`observe` on each sweep and `track` over time, one log by itself and without its padding."""

    def one(sweeps: Any, flags: Any, dt: Any) -> Decision:
        observations = jax.vmap(lambda sweep, flag: detector.observe(axis, sweep, flag))(sweeps, flags)

        def step(state: Any, now: Any) -> Any:
            return detector.track(axis, state, now[0], None, now[1])

        return jax.lax.scan(step, detector.init(axis), (observations, dt))[1]

    counts, flags, dt, lengths = inputs
    with precision(detector):
        program = jax.jit(one)
        # The padding goes through as well, so that one program does for all lengths, and is cut off.
        decisions = [
            program(counts[i], flags[i], jnp.asarray(dt[i], jnp.result_type(float))) for i in range(len(lengths))
        ]
        return [
            {name: np.asarray(getattr(one, name))[:length] for name in FIELDS}
            for one, length in zip(decisions, lengths, strict=True)
        ]


def assert_same(
    together: dict[str, Any], alone: list[dict[str, np.ndarray]], lengths: np.ndarray, held: bool = False
) -> None:
    """`held`: the detector keeps what it saw last, so that a sweep without data may be valid."""
    host = {name: np.asarray(one) for name, one in together.items()}
    for i, (log, length) in enumerate(zip(alone, lengths, strict=True)):
        for name in ("event", "valid", "saturated"):
            np.testing.assert_array_equal(host[name][i, :length], log[name], err_msg=name)
        np.testing.assert_allclose(host["range_m"][i, :length], log["range_m"], rtol=1e-5, atol=1e-7)
        np.testing.assert_allclose(host["strength"][i, :length], log["strength"], rtol=1e-5, atol=1e-3)
        # A range rounded in its 7th digit over 10 ms.
        for name in ("statistic", "speed_m_s"):
            np.testing.assert_allclose(host[name][i, :length], log[name], rtol=1e-5, atol=2e-4)
        assert held or not host["valid"][i, length:].any()
        assert not host["event"][i, length:].any()


SIZES = [(1, 331, 128), (3, 64, 127), (130, 7, 16), (3, 2, 2), (3, 1, 200)]
WHOLE = ("thesis", "lab-live", "few cells", "soft-argmax")
FEW_CELLS = pytest.param("few cells", marks=pytest.mark.long)
CASES = [(name, *size) for name in DETECTORS for size in (SIZES if name in WHOLE else [(3, 64, 127), (3, 2, 2)])]
# `shift` compiles for ten seconds; "few cells" is the same with less. Of the others, too, one size shows most.
SLOW = ("shift", "default")
SOON = {(name, 3, 64, 127) for name in DETECTORS if name not in SLOW} | {("thesis", *size) for size in SIZES}
CASES = [case if case in SOON else pytest.param(*case, marks=pytest.mark.long) for case in CASES]
# Ways to find the peak that others stand for.
FEW_PEAKS = [peak if peak == "soft-argmax" else pytest.param(peak, marks=pytest.mark.long) for peak in PEAKS]


@pytest.mark.parametrize(("name", "logs", "sweeps", "bins"), CASES)
def test_a_batch_is_each_log_by_itself(name: str, logs: int, sweeps: int, bins: int) -> None:
    detector, inputs, axis = DETECTORS[name], batch(logs, sweeps, bins), axis_of(bins)
    wanted = one_log_after_the_other(detector, axis, inputs)
    got = detect_batch(detector, axis, *inputs, fields=FIELDS)
    assert_same(got, wanted, inputs[-1], held=name == "lab-live as it was")
    for field in FIELDS:
        assert got[field].shape == (logs, sweeps)
        assert got[field].dtype == (bool if field in ("valid", "saturated", "event") else np.float32)


@pytest.mark.parametrize("name", ["thesis", FEW_CELLS, "soft-argmax"])
def test_a_batch_without_gaps_is_each_log_by_itself(name: str) -> None:
    detector, inputs, axis = DETECTORS[name], batch(3, 64, 128, gaps=False), axis_of(128)
    got = detect_batch(detector, axis, *inputs, fields=FIELDS)
    assert_same(got, one_log_after_the_other(detector, axis, inputs), inputs[-1])
    assert np.asarray(got["event"]).any()
    assert np.asarray(got["valid"]).all()


@pytest.mark.parametrize("name", ["thesis", "lab-live", FEW_CELLS, "soft-argmax"])
@pytest.mark.parametrize("gaps", [pytest.param(True, marks=pytest.mark.long), False])
def test_blocks_and_what_is_left_of_them(name: str, gaps: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Blocks of 2 logs or of 5 sweeps, of 7 logs of 23 sweeps: neither divides."""
    detector, inputs, axis = DETECTORS[name], batch(7, 23, 127, gaps=gaps, seed=1), axis_of(127)
    monkeypatch.setattr(blocks, "BLOCK_BY_LOGS", 2 * 23)
    monkeypatch.setattr(blocks, "BLOCK_BY_TIME", 5 * 7)
    with precision(detector):
        got = jax.jit(lambda *one: run_batch(detector, axis, *one))(*inputs)
    together = {field: np.asarray(getattr(got, field)) for field in FIELDS}
    assert_same(together, one_log_after_the_other(detector, axis, inputs), inputs[-1])


@pytest.mark.long
def test_many_logs_go_to_threads_and_come_back_in_order(monkeypatch: pytest.MonkeyPatch) -> None:
    detector, inputs, axis = DETECTORS["few cells"], batch(130, 7, 16), axis_of(16)
    wanted = one_log_after_the_other(detector, axis, inputs)
    calls, inner = [], step_batch._in_precision

    def counted(*args: Any) -> Any:
        calls.append(len(args[-2]))
        return inner(*args)

    monkeypatch.setattr(step_batch, "_in_precision", counted)
    for threads in (1, 2):
        monkeypatch.setattr(step_batch, "_threads", lambda detector, logs, threads=threads: threads)
        assert_same(detect_batch(detector, axis, *inputs, fields=FIELDS), wanted, inputs[-1])
    assert sorted(calls) == [65, 65, 130]


def test_threads_run_in_the_caller_s_precision(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []
    monkeypatch.setattr(step_batch, "_threads", lambda detector, logs: 2)
    monkeypatch.setattr(step_batch, "_batch", lambda *args: seen.append(jnp.zeros(()).dtype) or {"event": jnp.zeros(1)})
    for name, double in (("shift", False), ("shift", True), ("lab-live", False)):
        with jax.enable_x64(double):
            detect_batch(DETECTORS[name], axis_of(2), *batch(3, 2, 2))
    assert seen == [np.float32] * 2 + [np.float64] * 4


def test_threads_are_for_what_goes_through_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(step_batch, "cores", lambda: 8)
    monkeypatch.setattr(step_batch.jax, "default_backend", lambda: "cpu")
    threads = step_batch._threads
    assert [threads(DETECTORS["shift"], logs) for logs in (0, 1, 127, 128, 200, 512, 10_000)] == [1, 1, 1, 2, 3, 8, 8]
    assert threads(DETECTORS["thesis"], 10_000) == 1
    monkeypatch.setattr(step_batch.jax, "default_backend", lambda: "gpu")
    assert threads(DETECTORS["shift"], 10_000) == 1


def test_size_of_a_block() -> None:
    """Divisors where there are good ones, never more than asked for, at least 1."""
    asked = ((331, 31), (64, 31), (60, 31), (5, 100), (7, 0))
    assert [blocks._block_size(count, wanted) for count, wanted in asked] == [31, 16, 30, 5, 1]


@pytest.mark.parametrize("name", ["thesis", "few cells"])
@pytest.mark.parametrize(("logs", "sweeps"), [(0, 5), (3, 0)])
def test_an_empty_batch(name: str, logs: int, sweeps: int) -> None:
    inputs = (
        np.zeros((logs, sweeps, 16), np.uint16),
        np.zeros((logs, sweeps), np.uint16),
        np.zeros((logs, sweeps)),
        np.zeros(logs, int),
    )
    got = detect_batch(DETECTORS[name], axis_of(16), *inputs)
    assert {one.shape for one in got.values()} == {(logs, sweeps)}


def test_shapes_that_make_no_batch_are_named() -> None:
    counts, flags, dt, lengths = batch(3, 2, 16)
    wrong = [(counts[0], flags, dt, lengths), (counts, flags[:, :1], dt, lengths), (counts, flags, dt, lengths[:2])]
    for inputs in wrong:
        with pytest.raises((ValueError, TypeError)):
            detect_batch(DETECTORS["thesis"], axis_of(16), *inputs)
    with pytest.raises(ValueError, match=r"with 17 bins; got \(3, 2, 16\), \(3, 2\), \(3, 2\), \(3,\)"):
        detect_batch(DETECTORS["thesis"], axis_of(17), counts, flags, dt, lengths)


@pytest.mark.parametrize("name", ["thesis", "lab-live", pytest.param("default", marks=pytest.mark.long), *FEW_PEAKS])
def test_both_forms_of_reduction_give_the_same_events(name: str) -> None:
    detector, inputs, axis = DETECTORS[name], batch(3, 64, 128, seed=5), axis_of(128)
    decisions = []
    for form in ("staged", "plain"):

        def inside(*one: Any, form: str = form) -> Decision:
            with reductions(form):
                return run_batch(detector, axis, *one)

        with precision(detector):
            decisions.append(jax.jit(inside)(*inputs))
    for field in ("event", "valid", "saturated"):
        np.testing.assert_array_equal(getattr(decisions[0], field), getattr(decisions[1], field))
    np.testing.assert_allclose(decisions[0].range_m, decisions[1].range_m, rtol=1e-5)
    assert np.asarray(decisions[0].valid).any()


@pytest.mark.parametrize("name", ["thesis", pytest.param("few cells", marks=pytest.mark.long)])
def test_only_what_is_picked_comes_out(name: str) -> None:
    detector, inputs, axis = DETECTORS[name], batch(3, 64, 127), axis_of(127)
    with precision(detector):
        whole = jax.jit(lambda *one: run_batch(detector, axis, *one))(*inputs)
        picked = jax.jit(
            lambda *one: run_batch(detector, axis, *one, pick=lambda d: {"twice": 2 * d.range_m, "event": d.event})
        )(*inputs)
    assert set(picked) == {"twice", "event"}
    np.testing.assert_allclose(picked["twice"], 2 * np.asarray(whole.range_m), rtol=1e-6)
    np.testing.assert_array_equal(picked["event"], whole.event)


def test_unknown_fields_are_named() -> None:
    inputs = batch(3, 2, 2)
    with pytest.raises(ConfigError, match=r"unknown field `rang_m`.*range_m.*; expected range_m, speed_m_s"):
        detect_batch(DETECTORS["thesis"], axis_of(2), *inputs, fields=("event", "rang_m"))
    assert list(detect_batch(DETECTORS["thesis"], axis_of(2), *inputs, fields=("event",))) == ["event"]


def aligned(values: np.ndarray, offset: int) -> np.ndarray:
    """A copy that begins `offset` bytes after a multiple of 64."""
    room = np.zeros(values.nbytes + 128, np.uint8)
    start = -room.ctypes.data % 64 + offset
    copy = room[start : start + values.nbytes].view(values.dtype).reshape(values.shape)
    copy[...] = values
    assert copy.ctypes.data % 64 == offset
    return copy


@pytest.mark.parametrize("name", ["thesis", "few cells", "soft-argmax"])
def test_wherever_the_sweeps_lie(name: str, tmp_path: Path) -> None:
    detector, (counts, *rest), axis = DETECTORS[name], batch(3, 64, 127), axis_of(127)
    counts.tofile(tmp_path / "sweeps")
    places = {
        "aligned": aligned(counts, 0),
        "unaligned": aligned(counts, 2),
        "on the device": jnp.asarray(counts),
        "mapped": np.memmap(tmp_path / "sweeps", np.uint16, "r", shape=counts.shape),
        "a view": np.repeat(counts, 2, axis=0)[::2],
    }
    wanted = detect_batch(detector, axis, counts, *rest, fields=FIELDS)
    for place, sweeps in places.items():
        got = detect_batch(detector, axis, sweeps, *rest, fields=FIELDS)
        for field in FIELDS:
            np.testing.assert_array_equal(got[field], wanted[field], err_msg=f"{place}: {field}")


# Gradients


SETTINGS = {"exponent": 2.0, "temperature": 0.1, "threshold_m_s": 0.7}


@pytest.mark.parametrize(
    "options",
    [{"peak": "soft-argmax over all bins"}, {"refine_compensated": True}, {"peak": "soft-argmax"}],
    ids=["all bins", "compensated window", "raw window"],
)
@pytest.mark.parametrize("gaps", [True, pytest.param(False, marks=pytest.mark.long)])
def test_gradient_through_a_batch_agrees_with_central_differences(options: dict[str, Any], gaps: bool) -> None:
    inputs, axis = batch(3, 24, 64, gaps=gaps, seed=3), axis_of(64)
    target = np.random.default_rng(0).uniform(-1, 1, (3, 24))

    def loss(settings: Any) -> jax.Array:
        detector = RangeRateDetector(**settings, **options)
        decisions = run_batch(detector, axis, *inputs)
        return jnp.sum(event_weights(detector, decisions, 0.3) * target) + jnp.sum(decisions.range_m * target)

    with jax.enable_x64(True):
        point = {name: jnp.asarray(value) for name, value in SETTINGS.items()}
        both = jax.jit(jax.value_and_grad(loss))
        slopes = both(point)[1]
        for name, value in SETTINGS.items():
            step = 1e-5 * value
            ends = [float(both({**point, name: point[name] + sign * step})[0]) for sign in (1, -1)]
            assert float(slopes[name]) == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-5, abs=1e-8)
            # In the window the exponent only selects, unless it weighs what is refined.
            assert (abs(float(slopes[name])) > 1e-6) == (name != "exponent" or options != {"peak": "soft-argmax"})


@pytest.mark.parametrize(
    "name",
    [
        "soft-argmax",
        *(pytest.param(one, marks=pytest.mark.long) for one in ("few cells", "parabola", "matched filter")),
    ],
)
def test_gradients_through_a_batch_are_finite(name: str, precision: str) -> None:
    counts, flags, dt, lengths = batch(3, 24, 64, seed=4)
    axis = axis_of(64)

    def loss(detector: Any, sweeps: Any) -> jax.Array:
        decisions = run_batch(detector, axis, sweeps, flags, dt, lengths)
        weights = event_weights(detector, decisions, 0.1)
        return weights.sum() + decisions.range_m.sum() + decisions.statistic.sum() + decisions.speed_m_s.sum()

    detector = jax.tree.map(jnp.asarray, DETECTORS[name])
    slopes, moved = jax.jit(jax.grad(loss, argnums=(0, 1)))(detector, jnp.asarray(counts, jnp.result_type(float)))
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves((slopes, moved)))
    assert np.abs(np.asarray(moved)).max() > 0
    beyond = np.arange(24) >= lengths[:, None]
    assert not np.asarray(moved)[beyond].any()  # the padding moves nothing


@pytest.mark.parametrize("peak", PEAKS)
def test_gradients_of_two_bins_are_finite(peak: str) -> None:
    counts, flags, dt, lengths = batch(3, 2, 2)
    axis, detector = axis_of(2), jax.tree.map(jnp.asarray, RangeRateDetector(peak=peak))

    def loss(detector: Any, sweeps: Any) -> jax.Array:
        decisions = run_batch(detector, axis, sweeps, flags, dt, lengths)
        return decisions.range_m.sum() + decisions.statistic.sum()

    slopes = jax.jit(jax.grad(loss, argnums=(0, 1)))(detector, jnp.asarray(counts, jnp.float32))
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(slopes))


# The range-rate detector against plain NumPy


def window(values: np.ndarray, centre: int, half: int) -> tuple[int, np.ndarray]:
    start = int(np.clip(centre - half, 0, len(values) - 2 * half - 1))
    return start, values[start : start + 2 * half + 1]


def soft_mean(values: np.ndarray, temperature: float) -> float:
    weights = np.exp((values / values.max() - 1) / temperature)
    return float(np.sum(weights * np.arange(len(values))) / np.sum(weights))


def matched(values: np.ndarray, fwhm: float) -> float:
    """The place of a Gaussian whose correlation, over the root of its energy in the window, is largest; by search."""

    def likelihood(places: np.ndarray) -> np.ndarray:
        pulse = np.exp(-4 * np.log(2) * ((np.arange(len(values)) - places[:, None]) / fwhm) ** 2)
        return pulse @ values / np.sqrt(np.sum(pulse**2, axis=1))

    places = np.arange(len(values), dtype=np.float64)
    for width in (1.0, 1e-2, 1e-4):
        best = places[np.argmax(likelihood(places))]
        places = best + width * np.linspace(-1, 1, 401)
    return float(np.clip(places[np.argmax(likelihood(places))], 0, len(values) - 1))


def place_in_numpy(peak: str, values: np.ndarray, range_m: np.ndarray, bin_m: float, compensated: bool) -> float:
    gain = (2 * range_m) ** 2.0
    selected = int(np.argmax(values * gain))
    half = min(max(1, round(0.5 * 0.045 / bin_m)), (len(values) - 1) // 2)
    start, taps = window(values * gain if compensated else values, selected, half)
    if peak == "arg-max":
        return selected
    if peak == "soft-argmax over all bins":
        return soft_mean(values * gain, 0.1)
    if peak == "matched filter":
        return matched(values, 0.04 / bin_m)
    if peak == "soft-argmax":
        return start + soft_mean(taps, 0.1)
    a, b, _ = np.polyfit(np.arange(-half, half + 1), taps, 2)
    if a >= -1e-6 * taps.max() or abs(b / (2 * a)) > half:
        return selected
    return start + half - b / (2 * a)


@pytest.mark.parametrize("compensated", [False, True])
@pytest.mark.parametrize("peak", PEAKS)
@pytest.mark.parametrize("bins", [63, pytest.param(128, marks=pytest.mark.long)])
def test_range_rate_equals_plain_numpy(peak: str, compensated: bool, bins: int) -> None:
    if compensated and peak not in ("parabola", "soft-argmax"):
        pytest.skip("has no window to refine in")
    counts, flags, dt, lengths = batch(3, 40, bins, seed=6)
    axis = axis_of(bins)
    range_m = np.asarray(axis.range_m)
    detector = RangeRateDetector(peak=peak, refine_compensated=compensated)
    with jax.enable_x64(True):
        got = jax.jit(lambda *one: run_batch(detector, axis, *one))(counts, flags, dt, lengths)
    slack = {"matched filter": 1e-3}.get(peak, 1e-9)
    for i, length in enumerate(lengths):
        last_m, elapsed, seen = 0.0, 0.0, False
        for k in range(length):
            elapsed += dt[i, k]
            values = counts[i, k].astype(np.float64)
            valid = not flags[i, k] & int(SweepFlag.INVALID) and values.max() > 0
            assert bool(got.valid[i, k]) == valid
            if not valid:
                continue
            place = place_in_numpy(peak, values, range_m, axis.bin_m, compensated)
            now_m = float(np.interp(place, np.arange(bins), range_m))
            assert float(got.range_m[i, k]) == pytest.approx(now_m, abs=slack * axis.bin_m)
            speed = (now_m - last_m) / elapsed if seen and elapsed > 0 else 0.0
            error = 2 * slack * axis.bin_m / max(elapsed, 1e-3) + 1e-9
            assert float(got.speed_m_s[i, k]) == pytest.approx(speed, abs=error)
            if abs(abs(speed) - 0.7) > error:
                assert bool(got.event[i, k]) == (abs(speed) > 0.7)
            last_m, elapsed, seen = now_m, 0.0, True


def test_retuning_a_batch_never_recompiles() -> None:
    inputs, axis = batch(3, 2, 16), axis_of(16)
    counting: Callable[..., Any] = eqx.filter_jit(eqx.debug.assert_max_traces(run_batch, max_traces=1))
    for threshold in (0.1, 0.5, 3.0):
        counting(RangeRateDetector(threshold_m_s=threshold), axis, *inputs)


def test_stacked_series_are_each_by_itself() -> None:
    """Lengths, times that stand still, and nothing beside the batch itself."""
    counts, flags, dt, lengths = batch(4, 50, 40, seed=8)
    range_m = np.asarray(axis_of(40).range_m)
    held = [
        SensorSeries(
            3, np.cumsum(np.rint(1e9 * dt[log, :n])).astype(np.int64), counts[log, :n], range_m, flags[log, :n]
        )
        for log, n in enumerate(lengths)
    ]
    stacked = stack(held)
    assert stacked.sweeps.shape == (4, int(lengths.max()), 40)
    assert all(one.ctypes.data % 64 == 0 for one in (stacked.sweeps, stacked.flags, stacked.dt))
    found = detect_batch(ThesisDetector(), *stacked, fields=("event", "valid"))
    for log, series in enumerate(held):
        alone = detect(ThesisDetector(), series)
        assert np.flatnonzero(found["event"][log]).tolist() == [event.sweep for event in alone.events]
        assert np.asarray(found["valid"])[log, : len(series)].tolist() == alone.valid.tolist()
        assert not np.asarray(found["valid"])[log, len(series) :].any()
    with pytest.raises(ValueError, match="at least one"):
        stack([])
    with pytest.raises(ValueError, match=r"series 1 has uint16 in 40 bins from 0\.3"):
        stack([held[0], dataclasses.replace(held[1], range_m=range_m + 0.1)])
