"""Tuning: settings between bounds, a smooth loss that tends to the counts, its slopes, and fits that get better."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxradar import ConfigError
from jaxradar.drive import Channel, Drive, Motion, RoadStep, SensorSeries, SweepFlag, Truth
from jaxradar.matching import MatchWindow, match_steps
from jaxradar.systems.step import RangeRateDetector, ShiftDetector, run_batch
from jaxradar.tuning import Costs, Examples, Plan, Space, examples_of, smooth_outcome, split, tune
from jaxradar.tuning.fit import costs_of
from jaxradar.tuning.uncertainty import _together

AXIS = 0.2 + 0.01 * np.arange(40)


def drive(
    seed: int, count: int = 120, *, steps: tuple[float, ...] = (0.7,), noise: float = 30.0, gaps: bool = False
) -> Drive:
    """An echo at 100 Hz over Rayleigh noise that jumps by 4 cm at 0.15 s before each step."""
    rng = np.random.default_rng(seed)
    times = np.arange(count) / 100.0
    place = 0.4 + 0.04 * sum(((times >= step - 0.15).astype(float) for step in steps), np.zeros(count))
    echo = 3000.0 * np.exp(-4 * math.log(2) * ((AXIS - place[:, None]) / 0.05) ** 2)
    sweeps = np.rint(np.hypot(echo + rng.normal(0, noise, echo.shape), rng.normal(0, noise, echo.shape)))
    flags = np.zeros(count, np.uint16)
    if gaps:
        flags[rng.random(count) < 0.1] = int(SweepFlag.MISSED_DATA)
    series = SensorSeries(3, np.rint(1e9 * times).astype(np.int64), sweeps.astype(np.uint16), AXIS, flags)
    speed = Channel(series.times_ns, np.full(count, 5.0))
    return Drive((series,), Motion(speed_m_s=speed), truth=Truth(tuple(RoadStep(step) for step in steps)))


def examples(drives: list[Drive], window: MatchWindow | None = None) -> Examples:
    return examples_of([(one, one.sensors[0]) for one in drives], window)


# Settings


@settings(deadline=None)
@given(vector=st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=3))
def test_every_point_is_between_the_bounds(vector: list[float]) -> None:
    space = Space.of(RangeRateDetector(), ("threshold_m_s", "exponent", "temperature"))
    for double in (False, True):
        with jax.enable_x64(double):
            values = np.asarray(space.values(jnp.asarray(vector, float)))
        assert (values >= space.low.astype(values.dtype)).all()
        assert (values <= space.high.astype(values.dtype)).all()


def test_a_detector_comes_back_from_its_vector() -> None:
    detector = RangeRateDetector(threshold_m_s=0.03, exponent=5.9, temperature=0.2)
    space = Space.of(detector, ("threshold_m_s", "exponent", "temperature"))
    with jax.enable_x64(True):
        again = space.detector(detector, space.vector(detector))
    for name in space.names:
        assert float(getattr(again, name)) == pytest.approx(float(getattr(detector, name)), rel=1e-9)
    assert np.isfinite(space.vector(RangeRateDetector(exponent=0.0))).all()  # on its bound


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (("treshold_m_s",), r"no setting `treshold_m_s` \(did you mean `threshold_m_s`"),
        (("window_m",), "`window_m` of the detector `range-rate` sets a shape"),
        (("peak",), "`peak` of the detector `range-rate` sets a shape or a choice"),
        ((), "got none"),
        (("exponent", "exponent"), "each once"),
    ],
)
def test_what_cannot_be_tuned_is_said(names: tuple[str, ...], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        Space.of(RangeRateDetector(), names)


def test_costs_are_sensible() -> None:
    for wrong in ((-1.0, 0.0, 0.0), (0.0, 0.0, 0.0), (math.nan, 0.0, 0.0)):
        with pytest.raises(ConfigError, match=r"cost"):
            Costs(*wrong)


# Examples


@settings(deadline=None, max_examples=50)
@given(
    at=st.integers(0, 119),
    steps=st.lists(st.floats(0.05, 1.5), max_size=3, unique=True),
    seconds=st.floats(0.0, 0.5),
)
def test_windows_are_those_of_the_matching(at: int, steps: list[float], seconds: float) -> None:
    held, window = drive(0, steps=tuple(steps)), MatchWindow(seconds, 0.5)
    found = examples([held], window)
    outcome = match_steps([at / 100.0], held.truth.steps, window=window, speed=held.motion.speed_m_s)  # type: ignore[union-attr]
    assert bool(found.false[0, at]) == (outcome.false_alarms == 1)
    assert bool((found.window[0, :, at] & found.real[0]).any()) == (outcome.false_alarms == 0)
    if outcome.hits:
        place = next(n for n, hit in enumerate(outcome.hit_by) if hit is not None)
        assert found.lead_s[0, place, at] == pytest.approx(outcome.lead_s[0], abs=1e-6)


def test_examples_need_a_truth() -> None:
    with pytest.raises(ValueError, match="that of drive 1 is not"):
        examples([drive(0), dataclasses.replace(drive(1), truth=None)])


@pytest.mark.parametrize("seed", range(5))
def test_each_kind_of_drive_is_on_either_side(seed: int) -> None:
    kinds = [True] * 2 + [False] * 9
    fitted, kept = split(11, seed, kinds=kinds)
    assert sorted([*fitted, *kept]) == list(range(11))
    assert [sum(kinds[place] for place in side) for side in (fitted, kept)] == [1, 1]
    assert len(kept) == 3
    assert [len(side) for side in split(3, seed, kinds=["a", "b", "c"])] == [2, 1]
    assert [len(side) for side in split(8, seed)] == [6, 2]


# The loss


def plainly(
    statistic: np.ndarray, valid: np.ndarray, threshold: float, temperature: float, held: Examples, merged: bool
) -> Any:
    """The same by loops over sweeps, in float64."""
    logs, sweeps = statistic.shape
    missed, late, false = np.zeros(logs), np.zeros(logs), np.zeros(logs)
    seen = np.zeros(logs)
    for log in range(logs):
        weight = [
            1 / (1 + (threshold / statistic[log, t]) ** (1 / temperature))
            if valid[log, t] and statistic[log, t]
            else 0.0
            for t in range(sweeps)
        ]
        for step in range(held.real.shape[1]):
            if not held.real[log, step]:
                continue
            leads = held.lead_s[log, step][held.window[log, step]]
            quiet = 1.0
            for t in np.flatnonzero(held.window[log, step]):
                late[log] += quiet * weight[t] * (leads.max() - held.lead_s[log, step, t])
                quiet *= 1.0 - weight[t]
            missed[log] += quiet
            seen[log] += 1.0 - quiet
        for t in range(sweeps):
            if held.false[log, t]:
                false[log] += weight[t] * (1.0 - (weight[t - 1] if t and merged else 0.0))
    return missed, seen, late, false


class Merged(RangeRateDetector):
    """As if sweeps above the threshold that follow each other were one detection."""

    merged: ClassVar[bool] = True


@pytest.mark.parametrize("kind", [RangeRateDetector, Merged])
@pytest.mark.parametrize("temperature", [1.0, 0.1])
def test_the_outcome_is_that_of_its_definition(temperature: float, kind: Any) -> None:
    detector = kind(threshold_m_s=0.5)
    held = examples([drive(seed, 100 + seed, steps=(0.5, 0.9)[: seed % 3], gaps=True) for seed in range(5)])
    with jax.enable_x64(True):
        decisions = jax.jit(run_batch)(detector, *held.batch)
        found = jax.jit(lambda one: smooth_outcome(one, held, temperature))(detector)
    wanted = plainly(np.asarray(decisions.statistic), np.asarray(decisions.valid), 0.5, temperature, held, kind.merged)
    for got, want in zip((found.missed, found.seen, found.late_s, found.false), wanted, strict=True):
        np.testing.assert_allclose(np.asarray(got), want, rtol=1e-6, atol=1e-9)  # leads are single


def test_it_tends_to_what_is_counted() -> None:
    detector = RangeRateDetector(threshold_m_s=1.0)
    drives = [drive(seed, steps=(0.5, 0.9)[: seed % 3], noise=100.0) for seed in range(6)]
    held = examples(drives)
    with jax.enable_x64(True):
        events = np.asarray(jax.jit(run_batch)(detector, *held.batch).event)
        found = jax.jit(lambda one: smooth_outcome(one, held, 1e-6))(detector)
    for log, one in enumerate(drives):
        hits = match_steps(np.flatnonzero(events[log]) / 100.0, one.truth.steps, speed=one.motion.speed_m_s)  # type: ignore[union-attr]
        assert float(found.missed[log]) == pytest.approx(hits.misses, abs=1e-6)
        assert float(found.seen[log]) == pytest.approx(hits.hits, abs=1e-6)
        assert float(found.false[log]) == pytest.approx(hits.false_alarms, abs=1e-6)
    assert events.any()


@pytest.mark.parametrize(
    ("detector", "names"),
    [
        (RangeRateDetector(threshold_m_s=0.5), ("threshold_m_s", "exponent", "temperature")),
        pytest.param(
            ShiftDetector(),
            ("evidence", "window_s", "over_floor", "template_m", "exponent", "most_unexplained"),
            marks=pytest.mark.long,
        ),
    ],
    ids=["range-rate", "default"],
)
def test_slopes_of_the_cost_are_central_differences(detector: Any, names: tuple[str, ...]) -> None:
    space = Space.of(detector, names)
    held = examples([drive(seed, 80, steps=(0.5,)[: seed % 2], noise=80.0, gaps=True) for seed in range(4)])
    with jax.enable_x64(True):

        def cost(vector: Any) -> Any:
            return smooth_outcome(space.detector(detector, vector), held, 0.3).cost(held.hours, Costs())

        start = jnp.asarray(space.vector(detector))
        value, slope = jax.jit(jax.value_and_grad(cost))(start)
        assert np.isfinite(value)
        assert np.isfinite(slope).all()
        program = jax.jit(cost)
        for place in range(len(names)):
            step = np.zeros(len(names))
            step[place] = 1e-5
            plain = (float(program(start + step)) - float(program(start - step))) / 2e-5
            assert float(slope[place]) == pytest.approx(plain, rel=2e-4, abs=1e-6 * abs(float(value)))


# The fit


def test_a_fit_finds_a_threshold_between_noise_and_step() -> None:
    """The noise of the range is far below the jump: almost any threshold between the two costs nothing."""
    held, kept = (
        examples([drive(seed, steps=(0.7,)[: seed % 2]) for seed in range(low, low + 12)]) for low in (0, 100)
    )
    heard: list[tuple[int, int]] = []
    found = tune(
        RangeRateDetector(threshold_m_s=50.0),
        ("threshold_m_s",),
        held,
        kept,
        plan=Plan(starts=3, logs=8, steps=12, temperatures=(0.3, 0.1, 0.05)),
        progress=lambda done, total: heard.append((done, total)),
    )
    assert heard == [(1, 3), (2, 3), (3, 3)]
    assert found.before > 0.9
    assert found.after < 0.1
    assert 0.1 < float(found.detector.threshold) < 4.0
    assert len(found.starts) == 3
    for one in found.starts:
        assert (np.diff(one.costs) <= 0).all()
        assert len(one.outcomes) == 3
        assert set(one.outcomes) <= {"converged", "out of steps"}
    assert found.starts[found.best].costs[-1] == found.after


@pytest.mark.long
def test_a_fit_is_the_same_again() -> None:
    held, kept = (
        examples([drive(seed, steps=(0.7,)[: seed % 2]) for seed in range(low, low + 12)]) for low in (0, 100)
    )
    found, again = (_fit(held, kept) for _ in range(2))
    assert float(again.detector.threshold) == float(found.detector.threshold)


def _fit(held: Examples, kept: Examples) -> Any:
    return tune(RangeRateDetector(threshold_m_s=50.0), ("threshold_m_s",), held, kept, plan=Plan(3, logs=8, steps=12))


def test_starts_say_how_they_ended() -> None:
    """One step is too few to converge with; a cost that is no number is told, and the fit goes on from the others."""
    held, kept = (examples([drive(seed, steps=(0.7,)[: seed % 2]) for seed in range(low, low + 8)]) for low in (0, 100))
    plan = Plan(2, candidates=4, temperatures=(0.1,), logs=8, steps=1)
    short = tune(RangeRateDetector(threshold_m_s=50.0), ("threshold_m_s",), held, kept, plan=plan)
    assert "out of steps" in {one.outcomes[-1] for one in short.starts}
    broken = held._replace(hours=np.full_like(held.hours, np.nan))
    found = tune(RangeRateDetector(threshold_m_s=50.0), ("threshold_m_s",), broken, kept, plan=plan)
    assert {one.outcomes for one in found.starts} == {("not finite",)}
    assert found.after <= found.before  # where they began
    with pytest.raises(ConfigError, match="no start has a finite cost"):
        tune(RangeRateDetector(), ("threshold_m_s",), held, kept._replace(hours=broken.hours), plan=plan)


def test_all_drives_at_once_or_in_parts_cost_the_same() -> None:
    held = examples([drive(seed, steps=(0.7,)[: seed % 2], noise=100.0) for seed in range(7)])
    detector = RangeRateDetector(threshold_m_s=0.5)
    space = Space.of(detector, ("threshold_m_s",))
    vectors = space.vector(detector) + np.array([[0.0], [1.0]])
    whole = [
        float(smooth_outcome(space.detector(detector, one), held, 0.1).cost(held.hours, Costs())) for one in vectors
    ]
    for part in (7, 3, 1, 10):
        found = costs_of(space, detector, Costs(), held, 0.1, vectors, part)
        np.testing.assert_allclose(found, whole, rtol=1e-4)


def test_settings_that_go_together_are_named() -> None:
    """Two in whose sum alone the cost curves; one by itself; one without any slope."""
    random = np.random.default_rng(0)
    drawn = random.normal(size=(200, 3))
    scatter = (drawn @ np.diag([1.0, 1.0, 1.0])).T @ drawn
    total = np.array([1.0, 1.0, 0.0])
    curvature = np.zeros((4, 4))
    curvature[:3, :3] = 400.0 * (np.outer(total, total) + np.diag([0.0, 0.0, 1.0]))
    full = np.zeros((4, 4))
    full[:3, :3] = scatter
    values, directions = np.linalg.eigh(curvature)
    firm = values > 1e-3 * values.max()
    inverse = (directions[:, firm] / values[firm]) @ directions[:, firm].T
    found = _together(curvature, full, inverse @ full @ inverse, directions[:, ~firm])
    assert found == [(1,), (0,), (), ()]
