"""Peak estimators against a float64 oracle, away from the origin, at the edges and at the worst inputs."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxradar.signal.peaks import ArgMax, MatchedFilter, Parabola, Peak, PeakEstimator, SoftArgmax, vertex

BINS, FWHM = 128, 8.0
ESTIMATORS: dict[str, PeakEstimator] = {
    "arg-max": ArgMax(),
    "parabola": Parabola(),
    "wide parabola": Parabola(reach=3),
    "soft-argmax": SoftArgmax(0.05),
    "windowed soft-argmax": SoftArgmax(0.2, half_width=8),
    "matched filter": MatchedFilter(FWHM),
    "windowed matched filter": MatchedFilter(FWHM, half_width=12),
}
# Compiled once each: op by op these tests would spend a minute in the compiler.
FIND: dict[str, Callable[[np.ndarray], Peak]] = {
    name: jax.jit(lambda sweep, estimator=estimator: estimator(sweep)) for name, estimator in ESTIMATORS.items()
}
SLOPE = {
    name: jax.jit(jax.value_and_grad(lambda sweep, estimator=estimator: estimator(sweep).position))
    for name, estimator in ESTIMATORS.items()
}
# The worst offset of a clean pulse, in bins: half a bin for the arg-max; the others fit its shape.
WORST = {"arg-max": 0.5, "parabola": 0.01, "wide parabola": 0.05, "windowed soft-argmax": 0.03}


def echo(centre: float, amplitude: float = 3000.0) -> np.ndarray:
    return amplitude * np.exp(-4 * np.log(2) * ((np.arange(BINS) - centre) / FWHM) ** 2)


@pytest.mark.parametrize("name", ESTIMATORS)
@pytest.mark.parametrize("centre", [20.0, 40.3, 64.5, 99.75])
def test_finds_a_clean_pulse_wherever_it_lies(name: str, centre: float, precision: str) -> None:
    peak = FIND[name](echo(centre))
    assert bool(peak.found)
    assert float(peak.position) == pytest.approx(centre, abs=WORST.get(name, 1e-2))


@pytest.mark.parametrize("name", ESTIMATORS)
@pytest.mark.parametrize("shift", [1, 7, 30])
def test_follows_the_echo_bin_for_bin(name: str, shift: int, precision: str) -> None:
    moved, still = FIND[name](echo(50.3 + shift)), FIND[name](echo(50.3))
    assert float(moved.position) - float(still.position) == pytest.approx(shift, abs=2e-4)


@pytest.mark.parametrize("name", ESTIMATORS)
@pytest.mark.parametrize("gain", [1e-3, 10.0])
def test_gain_moves_nothing(name: str, gain: float, precision: str) -> None:
    louder = FIND[name](gain * echo(40.3)).position
    np.testing.assert_allclose(louder, FIND[name](echo(40.3)).position, atol=2e-4)


@pytest.mark.parametrize("name", ESTIMATORS)
@pytest.mark.parametrize("centre", [0, BINS - 1])
def test_peak_in_the_first_or_last_bin_stays_in_the_sweep(name: str, centre: int, precision: str) -> None:
    position = float(FIND[name](echo(centre)).position)
    assert 0 <= position <= BINS - 1
    assert position == pytest.approx(centre, abs=4.0)  # a one-sided window draws inwards, by at most half a pulse


@pytest.mark.parametrize("centre", [0, 1, 2.4, 3, 124.5, 126, 127])
def test_matched_filter_knows_what_an_edge_cuts_off(centre: float, precision: str) -> None:
    assert float(FIND["matched filter"](echo(centre)).position) == pytest.approx(centre, abs=0.3)


def test_soft_argmax_equals_a_float64_softmax(precision: str) -> None:
    sweep = echo(40.3) + 200.0
    weights = np.exp((sweep / sweep.max() - 1) / 0.1)
    wanted = np.sum(weights * np.arange(BINS)) / np.sum(weights)
    np.testing.assert_allclose(SoftArgmax(0.1)(sweep).position, wanted, atol=1e-4)


@pytest.mark.parametrize("temperature", [0.3, 0.1, 0.03, 0.01, 0.001])
def test_soft_argmax_tends_to_the_arg_max(temperature: float, precision: str) -> None:
    sweep = np.round(echo(40.2)) + 100.0
    error = abs(float(SoftArgmax(temperature)(sweep).position) - 40)
    # The next bin is 7.6 % lower, so that its weight is exp(−.076/T) at most, on either side.
    weights = np.exp((sweep / sweep.max() - 1) / temperature)
    wanted = abs(np.sum(weights * np.arange(BINS)) / np.sum(weights) - 40)
    assert error == pytest.approx(wanted, abs=1e-4)
    assert {0.3: error > 1, 0.1: error > 0.15, 0.03: error < 0.2, 0.01: error < 0.1, 0.001: error < 1e-6}[temperature]


def test_too_soft_is_biased_towards_the_middle_of_the_window(precision: str) -> None:
    errors = [abs(float(SoftArgmax(t)(echo(40.0) + 300.0).position) - 40) for t in (0.03, 0.1, 0.3, 1.0)]
    assert errors == sorted(errors)
    assert errors[0] < 0.05
    assert errors[-1] > 10


def test_two_equal_echoes(precision: str) -> None:
    two = np.round(echo(30.0) + echo(90.0))
    assert float(ArgMax()(two).position) == 30  # the first of equals
    assert float(SoftArgmax(0.05)(two).position) == pytest.approx(60, abs=0.01)  # the phantom
    assert float(SoftArgmax(0.05, half_width=8)(two).position) == pytest.approx(30, abs=0.01)
    assert float(MatchedFilter(FWHM)(two).position) == pytest.approx(30, abs=0.01)


@pytest.mark.parametrize("name", ["arg-max", "parabola", "soft-argmax", "matched filter"])
def test_saturated_plateau_gives_its_midpoint(name: str, precision: str) -> None:
    sweep = np.minimum(echo(60.0, 2e5), 65535).astype(np.uint16)
    top = np.flatnonzero(sweep == 65535)
    assert float(FIND[name](sweep).position) == pytest.approx(top.mean(), abs=1e-3)


@pytest.mark.parametrize("name", ESTIMATORS)
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_one_bad_bin_is_left_out(name: str, bad: float, precision: str) -> None:
    sweep = echo(60.0)
    sweep[10] = bad
    assert float(FIND[name](sweep).position) == pytest.approx(60, abs=0.5)


@pytest.mark.parametrize("name", ESTIMATORS)
@pytest.mark.parametrize("sweep", [np.zeros(BINS), np.full(BINS, np.nan), np.zeros(2)], ids=["zeros", "nan", "2 bins"])
def test_silence_is_no_peak(name: str, sweep: np.ndarray, precision: str) -> None:
    peak = FIND[name](sweep)
    assert not bool(peak.found)
    assert float(peak.position) == 0


WORST_SWEEPS = {
    "zeros": np.zeros(BINS),
    "constant": np.full(BINS, 100.0),
    "saturated": np.full(BINS, 65535.0),
    "compensated": echo(127, 258e3),
    "one count": np.eye(1, BINS, 60)[0],
    "tie": echo(30) + echo(90),
    "first bin": echo(0),
    "two bins": np.array([3.0, 5.0]),
}


@pytest.mark.parametrize("name", ESTIMATORS)
@pytest.mark.parametrize("sweep", WORST_SWEEPS.values(), ids=WORST_SWEEPS)
def test_value_and_gradient_are_finite_at_the_worst_sweeps(name: str, sweep: np.ndarray, precision: str) -> None:
    value, gradient = SLOPE[name](jnp.asarray(sweep))
    assert 0 <= float(value) <= len(sweep) - 1
    assert np.isfinite(gradient).all()


@pytest.mark.parametrize("name", ["parabola", "wide parabola", "soft-argmax", "windowed soft-argmax", "matched filter"])
def test_gradient_agrees_with_central_differences(name: str) -> None:
    with jax.enable_x64(True):
        sweep, step = echo(40.3) + 50.0, 1e-2
        _, gradient = SLOPE[name](jnp.asarray(sweep))
        for at in (36, 39, 40, 43, 60):
            bump = step * np.eye(1, BINS, at)[0]
            ends = [float(FIND[name](sweep + sign * bump).position) for sign in (1, -1)]
            assert float(gradient[at]) == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-4, abs=1e-10)


def test_gradient_of_the_temperature_agrees_with_central_differences() -> None:
    with jax.enable_x64(True):
        sweep = echo(40.3) + 300.0

        def position(temperature):
            return SoftArgmax(temperature)(sweep).position

        slope = jax.grad(position)(jnp.asarray(0.1))
        assert float(slope) == pytest.approx(float(position(0.1 + 1e-6) - position(0.1 - 1e-6)) / 2e-6, rel=1e-6)


@pytest.mark.long
def test_wide_parabola_beats_three_points_on_rough_bins() -> None:
    generator = np.random.default_rng(1)
    sweeps = np.stack([echo(40.3) for _ in range(400)]) + generator.normal(0, 100, (400, BINS))

    def rmse(estimator: PeakEstimator) -> float:
        return float(np.sqrt(np.mean((np.asarray(jax.vmap(lambda x: estimator(x).position)(sweeps)) - 40.3) ** 2)))

    assert rmse(Parabola(reach=3)) < 0.6 * rmse(Parabola())


@pytest.mark.long
def test_matched_filter_reaches_the_cramer_rao_bound() -> None:
    """var = 2 s Δ σ² / (√π A²) for a Gaussian pulse in white noise; here at 30 dB, 2,000 sweeps."""
    generator, noise = np.random.default_rng(2), 3000.0 / 10**1.5
    sweeps = np.stack([echo(64.3)] * 2000) + generator.normal(0, noise, (2000, BINS))
    positions = np.asarray(jax.vmap(lambda x: MatchedFilter(FWHM)(x).position)(sweeps))
    sigma = FWHM / (2 * np.sqrt(2 * np.log(2)))
    bound = np.sqrt(2 * sigma / np.sqrt(np.pi)) * noise / 3000.0
    # The standard error of a standard deviation out of 2,000 is 1.6 %; three of them on either side.
    assert np.std(positions) / bound == pytest.approx(1.0, abs=0.05)
    assert np.mean(positions) == pytest.approx(64.3, abs=4 * bound / np.sqrt(2000))


@settings(deadline=None, max_examples=50)
@given(st.lists(st.integers(0, 65535), min_size=3, max_size=40))
def test_arg_max_is_the_midpoint_of_the_first_highest_plateau(counts: list[int]) -> None:
    sweep = np.array(counts, np.uint16)
    first = last = int(np.argmax(sweep))
    while last + 1 < len(sweep) and sweep[last + 1] == sweep[first]:
        last += 1
    peak = FIND["arg-max"](np.pad(sweep, (0, 40 - len(sweep))))
    assert bool(peak.found) == (max(counts) > 0)
    assert float(peak.position) == (0.5 * (first + last) if max(counts) > 0 else 0)


@settings(max_examples=30, deadline=None)
@given(
    left=st.integers(-(10**6), 10**6), slope=st.integers(1, 10**5), scale=st.sampled_from([1e-6, 1 / 3, 1.0, 0.7, 1e4])
)
def test_three_on_a_line_within_rounding_have_no_vertex(left: int, slope: int, scale: float) -> None:
    """However they were rounded: offset 0, the middle's height and no slope; a bend beyond rounding is a vertex."""
    three = [jnp.float32((left + slope * place) * scale) for place in range(3)]
    offset, height = vertex(*three)
    assert float(offset) == 0.0
    assert height == three[1]
    slopes = jax.grad(lambda *given: vertex(*given)[0], argnums=(0, 1, 2))(*three)
    assert [float(one) for one in slopes] == [0.0, 0.0, 0.0]
    size = sum(abs(float(one)) for one in three)
    bent = jnp.float32(float(three[2]) - 1e-5 * size)
    offset = float(vertex(three[0], three[1], bent)[0])
    # A bend as large as the slope puts the vertex on the middle or on its other side.
    assert offset > 0.0 or slope * scale <= 1.01e-5 * size


def test_vertex_of_a_known_parabola() -> None:
    offset, height = vertex(*(jnp.asarray(5.0 - 2.0 * (x - 0.2) ** 2) for x in (-1.0, 0.0, 1.0)))
    assert float(offset) == pytest.approx(0.2, abs=1e-6)
    assert float(height) == pytest.approx(5.0, abs=1e-5)


def test_settings_out_of_bounds_are_refused() -> None:
    with pytest.raises(ValueError, match=r"Parabola\(reach=...\).*>= 1; got 0"):
        Parabola(reach=0)
    with pytest.raises(ValueError, match=r"MatchedFilter\(fwhm=...\).*got -1"):
        MatchedFilter(-1.0)
