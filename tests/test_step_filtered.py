"""A filter over sweeps and a template over the pulse: as the plain forms where they are plain, better where tuned."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from step_samples import RANGE_M, echo, series

from jaxradar import ConfigError
from jaxradar.drive import Channel, Drive, Motion, RoadStep, SweepFlag, Truth
from jaxradar.matching import MatchWindow
from jaxradar.systems.step import (
    Decision,
    DetectorFile,
    FilteredRateDetector,
    RangeRateDetector,
    detect,
    dump_detector,
    load_detector,
    run_batch,
    stack,
)
from jaxradar.tuning import Costs, Plan, Space, examples_of, smooth_outcome, tune

FIELDS = tuple(one.name for one in dataclasses.fields(Decision))


def wandering(seed: int, count: int = 90, gaps: bool = True) -> np.ndarray:
    """Sweeps whose echo wanders, and the flags of a sensor that misses some."""
    rng = np.random.default_rng(seed)
    places = 0.45 + np.cumsum(rng.normal(0, 0.004, count))
    flags = np.where(rng.random(count) < 0.1 * gaps, int(SweepFlag.MISSED_DATA), 0).astype(np.uint16)
    return series([echo(place) + rng.integers(0, 90, len(RANGE_M)) for place in places], flags=flags)


@pytest.mark.parametrize("gaps", [False, True])
@pytest.mark.parametrize("peak", ["soft-argmax", "matched filter"])
def test_plain_weights_decide_as_the_plain_forms(peak: str, gaps: bool) -> None:
    batch = stack([wandering(seed, gaps=gaps) for seed in range(3)])
    one, other = (jax.jit(run_batch)(kind(peak=peak), *batch) for kind in (RangeRateDetector, FilteredRateDetector))
    for name in FIELDS:
        np.testing.assert_array_equal(np.asarray(getattr(other, name)), np.asarray(getattr(one, name)), err_msg=name)


@pytest.mark.parametrize("weights", [(0.0,), (1.0, 1.0, 1.0), (3.0, -0.1, 0.5)])
def test_a_constant_gives_0_and_a_ramp_its_slope_at_any_times(weights: tuple[float, ...]) -> None:
    """On the observations of a known range, so that nothing but the filter speaks."""
    from jaxradar.systems.step.config import RangeAxis, SweepPeak, each_sweep

    rng = np.random.default_rng(3)
    dt = rng.uniform(0.005, 0.02, 40)
    dt[0] = 0.0
    valid = rng.random(40) < 0.8
    detector, axis = FilteredRateDetector(filter=weights), RangeAxis.of(RANGE_M)
    with jax.enable_x64(True):
        for slope in (0.0, 2.5):
            ranges = 0.3 + slope * np.cumsum(dt)
            peaks = (ranges, np.ones(40), valid, np.zeros(40, bool))
            found = each_sweep(SweepPeak)(*(jnp.asarray(one)[None] for one in peaks))
            state = jax.tree.map(lambda leaf: leaf[None], detector.init(axis))
            speed = np.asarray(detector.scan(axis, state, found, jnp.asarray(dt)[None])[1].speed_m_s)[0]
            after = np.flatnonzero(valid)[1:]
            np.testing.assert_allclose(speed[after], slope, rtol=1e-12, atol=1e-14)
            assert not speed[~valid].any()


def test_the_straight_line_is_the_slope_of_least_squares() -> None:
    rng = np.random.default_rng(0)
    for before in (1, 4, 7):
        ranges = rng.normal(size=before + 2)
        weights = np.append(1.0, FilteredRateDetector.straight_line(before))
        slope = np.polyfit(np.arange(before + 2), ranges, 1)[0]
        assert weights @ np.diff(ranges)[::-1] / weights.sum() == pytest.approx(slope, rel=1e-9)


def test_the_threshold_of_theory_knows_the_filter() -> None:
    """Of independent ranges: 1 in 20 sweeps, counted over 200,000 (four standard deviations of a correlated count)."""
    rate, sd, weights = 100.0, 1e-3, FilteredRateDetector.straight_line(5)
    made = FilteredRateDetector.from_false_alarm_rate(0.05 * 3600 * rate, rate_hz=rate, sd_m=sd, filter=weights)
    assert np.asarray(made.filter).tolist() == list(weights)
    ranges = np.random.default_rng(1).normal(0, sd, 200_000)
    taps = np.append(1.0, weights) / (1.0 + sum(weights))
    speed = rate * np.convolve(np.diff(ranges), taps, "valid")
    assert np.mean(np.abs(speed) > float(made.threshold)) == pytest.approx(0.05, abs=0.003)


def test_a_file_holds_weights_and_says_what_is_wrong_with_them(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(dump_detector(DetectorFile(FilteredRateDetector(filter=(0.5, 1.25), template=(1.0, 2.0, 0.5)))))
    read = load_detector(path).detector
    assert isinstance(read, FilteredRateDetector)
    assert np.asarray(read.filter).tolist() == [0.5, 1.25]
    assert np.asarray(read.template).tolist() == [1.0, 2.0, 0.5]
    head = 'format = 1\ndetector = "filtered-rate"\n'
    for line, said in (
        ("filter = 1.0", "must be a list of numbers; got 1.0"),
        ('filter = [1.0, "2"]', "must be a number; got '2'"),
        ("filter = []", "must be 1 to 256 numbers between -0.1 and 8.0; got []"),
        ("filter = [nan]", "must be 1 to 256 numbers between -0.1 and 8.0; got [nan]"),
        ("filter = [0.0, 9.0]", "got [0.0, 9.0]"),
    ):
        path.write_text(head + line + "\n")
        with pytest.raises(ConfigError) as error:
            load_detector(path)
        assert said in str(error.value)


def test_weights_are_named_one_by_one() -> None:
    detector = FilteredRateDetector(filter=(0.0, 1.0, 2.0))
    space = Space.of(detector, ("threshold_m_s", "filter"))
    assert space.names == ("threshold_m_s", "filter[0]", "filter[1]", "filter[2]")
    one = Space.of(detector, ("filter[2]",))
    assert np.asarray(one.detector_at(detector, one.vector(detector) + 1.0).filter)[:2].tolist() == [0.0, 1.0]
    for names, said in (
        (("filter[3]",), r"has 3 values, filter\[0\] to filter\[2\]; got `filter\[3\]`"),
        (("filter[x]",), r"got `filter\[x\]`"),
        (("threshold_m_s[0]",), "no setting"),
        (("filter", "filter[0]"), "each once"),
        (("filtr",), "did you mean `filter`"),
    ):
        with pytest.raises(ConfigError, match=said):
            Space.of(detector, names)


# Tuning


def drives(seeds: range, sd_m: float = 0.006, ramp_m_s: float = 0.8) -> list[tuple[Drive, object]]:
    """Ranges with white noise; every other drive ends on a ramp of 0.1 s before its step."""
    held = []
    for seed in seeds:
        rng, count = np.random.default_rng(seed), 80
        times = np.arange(count) / 200.0
        steps = (RoadStep(0.35),) * (seed % 2)
        rising = ramp_m_s * np.clip(times - 0.25, 0.0, 0.1) if steps else np.zeros(count)
        places = 0.4 + rising + rng.normal(0, sd_m, count)
        one = series([echo(place, fwhm_m=0.05) for place in places], rate_hz=200.0)
        held.append(
            (Drive((one,), Motion(speed_m_s=Channel(one.times_ns, np.full(count, 5.0))), truth=Truth(steps)), one)
        )
    return held


def plain_cost(detector: FilteredRateDetector, names: tuple[str, ...], held: object) -> object:
    space = Space.of(detector, names)
    return space, lambda vector: smooth_outcome(space.detector(detector, vector), held, 0.3).cost(held.hours, Costs())


@pytest.mark.parametrize(
    ("peak", "names"),
    [
        ("soft-argmax", ("threshold_m_s", "exponent", "temperature", "filter")),
        pytest.param("matched filter", ("filter", "template"), marks=pytest.mark.long),
    ],
)
def test_slopes_through_the_whole_pipeline_are_central_differences(peak: str, names: tuple[str, ...]) -> None:
    detector = FilteredRateDetector(
        peak=peak,
        refine_compensated=True,
        filter=(0.8, 0.4, 0.1),
        template=(1.0, 0.7, 1.1, 1.0, 1.3, 0.8, 1.2),
    )
    held = examples_of(drives(range(4)))
    with jax.enable_x64(True):
        space, cost = plain_cost(detector, names, held)
        start = jnp.asarray(space.vector(detector))
        value, slope = jax.jit(jax.value_and_grad(cost))(start)
        program = jax.jit(cost)
        assert np.isfinite(slope).all()
        for place, step in enumerate(1e-5 * np.eye(len(slope))):
            plain = (float(program(start + step)) - float(program(start - step))) / 2e-5
            assert float(slope[place]) == pytest.approx(plain, rel=2e-4, abs=1e-6 * abs(float(value)))


def test_slopes_survive_weights_whose_times_add_up_to_nothing() -> None:
    """The sum of the weights is 0 after some sweeps: no rate, and no NaN."""
    detector = FilteredRateDetector(filter=(-0.1,) * 20)
    held = examples_of(drives(range(2)))
    space, cost = plain_cost(detector, ("filter", "threshold_m_s"), held)
    for vector in (space.vector(detector), np.full(21, -30.0)):
        value, slope = jax.jit(jax.value_and_grad(cost))(jnp.asarray(vector, jnp.float32))
        assert np.isfinite(value)
        assert np.isfinite(slope).all()


def test_a_tuned_filter_beats_the_plain_difference_in_white_noise() -> None:
    """The best weights in white noise are those of a straight line: the fit has to come near to what these reach."""
    window = MatchWindow(0.15, 0.1)
    held, kept = (examples_of(drives(range(low, low + 24)), window) for low in (0, 100))
    costs = Costs(missed=1.0, false_alarm=2e-5, late=0.0)
    plan = Plan(starts=3, candidates=24, steps=40, logs=24)
    reached = {}
    for name, weights, moved in (
        ("plain", (0.0,) * 7, ("threshold_m_s",)),
        ("straight line", FilteredRateDetector.straight_line(7), ("threshold_m_s",)),
        ("tuned", (0.0,) * 7, ("threshold_m_s", "filter")),
    ):
        detector = FilteredRateDetector(filter=weights, exponent=0.0)
        reached[name] = tune(detector, moved, held, kept, costs=costs, plan=plan).after
    assert reached["straight line"] < 0.7 * reached["plain"]
    assert reached["tuned"] < 0.8 * reached["plain"]
    assert reached["tuned"] < reached["straight line"] + 0.15


def test_a_template_of_the_echo_s_own_shape_finds_it_better() -> None:
    """An echo with a long tail under white noise: its own shape, as factors on the Gaussian, scatters less."""
    rng = np.random.default_rng(5)
    offset = (RANGE_M - 0.45) / 0.04
    gaussian = np.exp(-4 * np.log(2) * offset**2)
    factor = np.interp(offset, np.linspace(-1.5, 1.5, 7), (0.0, 0.0, 0.3, 1.0, 2.0, 4.0, 4.0))
    sweeps = 3000 * gaussian * factor + rng.normal(0, 250, (300, len(RANGE_M)))
    own = FilteredRateDetector(peak="matched filter", template=(0.0, 0.0, 0.3, 1.0, 2.0, 4.0, 4.0))
    scatter = [
        np.nanstd(detect(one, series(sweeps)).range_m) for one in (FilteredRateDetector(peak="matched filter"), own)
    ]
    assert scatter[1] < 0.9 * scatter[0]
