"""The default detector: what is one event, what is none, and what is not an echo at all."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from step_samples import BINS, RANGE_M, echo, over_a_step, series

from jaxradar.drive import SensorSeries, SweepFlag
from jaxradar.logs import read_log
from jaxradar.sim.inject import inject_step, retimed
from jaxradar.systems.step import ShiftDetector, detect

DEFAULT = ShiftDetector()


@pytest.mark.parametrize("shift_m", [-0.08, -0.03, -0.015, 0.02, 0.05])
@pytest.mark.parametrize("rate_hz", [31.5, 100.0, 300.0])
def test_a_step_is_one_event_at_its_own_sweep(shift_m: float, rate_hz: float) -> None:
    log = retimed(over_a_step(shift_m=shift_m), rate_hz)
    trace = detect(DEFAULT, log)
    assert [event.sweep for event in trace.events] == [30]
    event = trace.events[0]
    assert event.time_s == log.times_s[30]  # of the sweep that decided, not back-dated
    assert event.range_m == pytest.approx(0.4 + shift_m, abs=0.002)
    assert event.statistic > event.threshold == pytest.approx(float(DEFAULT.evidence))
    np.testing.assert_allclose(trace.range_m[:30], 0.4, atol=0.002)
    np.testing.assert_allclose(trace.range_m[31:], 0.4 + shift_m, atol=0.002)


def test_a_fade_is_none() -> None:
    amplitudes = 2000 * np.exp(-np.abs(np.arange(80) - 40) / 5.0) + 300
    trace = detect(DEFAULT, series([echo(0.4, amplitude) for amplitude in amplitudes]))
    assert trace.events == ()
    assert trace.statistic.max() < 0.3 * trace.threshold


def test_two_patches_that_take_turns_as_the_maximum_are_none_and_the_track_stays() -> None:
    """The two echoes of asphalt at 45° lie 80 mm apart; which is the stronger changes every third sweep."""
    turns = [0.5 + 0.12 * np.sign(np.sin(i / 3)) for i in range(120)]
    log = series([echo(0.37, 1200 * share).astype(int) + echo(0.45, 1200 * (1 - share)) - 100 for share in turns])
    raw = RANGE_M[np.argmax(log.sweeps, axis=1)]
    assert np.ptp(raw) > 0.07  # the raw maximum hops
    trace = detect(DEFAULT, log)
    assert trace.events == ()
    assert np.ptp(trace.range_m) < 0.01


def test_the_track_takes_up_another_echo_that_stays_without_an_event() -> None:
    """One echo sinks slowly into the floor while another has been there all along."""
    shares = np.clip(np.linspace(1.0, -0.2, 200), 0.0, 1.0)
    log = series([echo(0.37, 1500 * share).astype(int) + echo(0.55, 700) - 100 for share in shares])
    trace = detect(DEFAULT, log)
    assert trace.events == ()
    assert trace.range_m[20] == pytest.approx(0.37, abs=0.004)
    assert trace.range_m[-1] == pytest.approx(0.55, abs=0.004)


def noise(seed: int, count: int = 600, sigma: float = 164.0) -> np.ndarray:
    return np.random.default_rng(seed).rayleigh(sigma, (count, BINS))


def test_receiver_noise_alone_is_invalid() -> None:
    """Rayleigh noise as in the thesis's fixture (requirements, 4): single sweeps, white over bins."""
    trace = detect(DEFAULT, series(np.rint(noise(1)).astype(np.uint16)))
    # 6e-5 of 100,000 such sweeps pass both gates; 2 of 600 by chance would be 1 in 1,500.
    assert trace.valid.sum() < 2
    assert trace.events == ()


@pytest.mark.long
def test_an_echo_in_that_noise_is_valid_and_a_step_of_it_found() -> None:
    generator = np.random.default_rng(2)
    hits, false_alarms = 0, 0
    for _ in range(10):
        still = over_a_step(count=80, at=50, shift_m=-0.035)
        quadrature = generator.normal(0, 164, (2, *still.sweeps.shape))
        rice = np.hypot(still.sweeps - 100.0 + quadrature[0], quadrature[1])
        trace = detect(DEFAULT, series(np.rint(rice).astype(np.uint16)))
        assert trace.valid.mean() > 0.99
        sweeps = [event.sweep for event in trace.events]
        hits += any(50 <= sweep <= 54 for sweep in sweeps)
        false_alarms += sum(not 50 <= sweep <= 54 for sweep in sweeps)
    assert hits == 10
    assert false_alarms == 0


def test_a_lost_echo_makes_no_event_and_a_new_track_settles_first() -> None:
    flat = np.full(BINS, 100, np.uint16)
    sweeps = [echo(0.4)] * 30 + [flat] * 50 + [echo(0.45)] * 5 + [echo(0.42)] * 20
    trace = detect(DEFAULT, series(sweeps))
    assert trace.events == ()  # back elsewhere after half a second; moves before the track has settled
    assert not trace.valid[30:80].any()
    assert trace.valid[80:].all()


def test_a_short_drop_out_does_not_end_the_track() -> None:
    log = over_a_step(shift_m=-0.03)
    flags = np.zeros(len(log), np.uint16)
    flags[[10, 28, 29]] = SweepFlag.MISSED_DATA, SweepFlag.COMMUNICATION_ERROR, SweepFlag.NO_AMPLITUDES
    trace = detect(DEFAULT, dataclasses.replace(log, flags=flags))
    assert [event.sweep for event in trace.events] == [30]
    assert (~trace.valid).sum() == 3


def test_steps_soon_after_each_other_are_one_and_later_ones_two() -> None:
    def at(*changes: int) -> SensorSeries:
        return series([echo(0.45 - 0.03 * sum(i >= change for change in changes)) for i in range(120)])

    assert [event.sweep for event in detect(DEFAULT, at(40, 46)).events] == [40]
    assert [event.sweep for event in detect(DEFAULT, at(40, 80)).events] == [40, 80]


@pytest.mark.long
def test_a_shift_between_profiles_that_have_little_in_common_is_none() -> None:
    generator = np.random.default_rng(8)
    # Blobs as wide as a pulse, new in every sweep: noise at full resolution without averaging.
    kernel = np.exp(-0.5 * (np.arange(-12, 13) / 3.0) ** 2)
    quadrature = np.array(
        [[np.convolve(row, kernel, "same") for row in part] for part in generator.normal(0, 60, (2, 400, BINS))]
    )
    noise = series(np.rint(np.hypot(*quadrature)).astype(np.uint16))
    assert detect(DEFAULT, noise).events == ()
    assert detect(ShiftDetector(most_unexplained=1.1), noise).events  # the evidence alone would not do


@pytest.mark.parametrize("rate_hz", [20.0, 31.5, 100.0, 300.0])
def test_speed_of_a_steady_approach(rate_hz: float) -> None:
    times = np.arange(round(rate_hz)) / rate_hz
    trace = detect(DEFAULT, series([echo(0.5 - 0.1 * t) for t in times], rate_hz=rate_hz))
    np.testing.assert_allclose(trace.speed_m_s[times > 0.3].mean(), -0.1, atol=0.004)


def test_times_that_jitter_backwards_do_not_hide_a_step() -> None:
    """1.5 ms of jitter at 300 Hz: a sweep in seven is dated before the one before it."""
    generator = np.random.default_rng(9)
    for _ in range(10):
        times = np.sort(np.arange(300) / 300 * 0.999) + generator.normal(0, 0.0015, 300)
        log = series([echo(0.4 - 0.03 * (i >= 150)) for i in range(300)], times_s=times - times[0])
        assert (np.diff(times) < 0).sum() > 5
        assert [150 <= event.sweep <= 153 for event in detect(DEFAULT, log).events] == [True]


def test_the_range_is_held_while_another_echo_dominates() -> None:
    generator = np.random.default_rng(10)
    sweeps = [echo(0.37)] * 60 + [echo(0.62)] * 60
    noisy = np.abs(np.asarray(sweeps) + generator.normal(0, 20, (120, BINS)))
    trace = detect(DEFAULT, series(np.rint(noisy).astype(np.uint16)))
    assert trace.events == ()
    near = np.minimum(abs(trace.range_m - 0.37), abs(trace.range_m - 0.62))
    assert near.max() < 0.01
    assert trace.range_m[85] == pytest.approx(0.37, abs=0.01)
    assert trace.range_m[-1] == pytest.approx(0.62, abs=0.01)


def test_motion_that_never_stops_does_not_silence_the_detector_for_ever() -> None:
    shaken = series([echo(0.4 + 0.03 * (i // 4 % 2)) for i in range(400)])
    events = detect(DEFAULT, shaken).events
    assert len(events) >= 3
    assert min(np.diff([event.time_s for event in events])) >= float(DEFAULT.refractory_s)


def test_a_new_track_does_not_shorten_the_refractory_time() -> None:
    times = np.arange(80) / 100.0
    times[45:] -= 10.0
    log = series([echo(0.45 - 0.03 * ((i >= 40) + (i >= 54))) for i in range(80)], times_s=times)
    assert [event.sweep for event in detect(DEFAULT, log).events] == [40]


@pytest.mark.long
def test_a_higher_gate_keeps_out_the_noise_of_sweeps_that_were_not_averaged(road_recordings) -> None:
    """The sensor averaged with factor .7; without it (the thesis's own setting) the noise in the gap is rougher."""
    log = read_log(road_recordings["demo1"]).sensors[0]
    raw = log.sweeps.astype(np.float64)
    raw[1:] = (raw[1:] - 0.7 * raw[:-1]) / 0.3
    trace = detect(ShiftDetector(over_floor=1.0), dataclasses.replace(log, sweeps=np.maximum(raw, 0.0)))
    gone = (trace.times_s > 6.3) & (trace.times_s < 7.6)
    assert not trace.valid[gone].any()
    assert not [event for event in trace.events if 6.3 < event.time_s < 7.6]


@pytest.mark.parametrize("jump", [-100.0, 0.0, 3600.0], ids=["back", "still", "gap"])
def test_a_clock_that_jumps_while_the_echo_moves_makes_no_event(jump: float) -> None:
    times = np.arange(60) / 100.0
    times[30:] += jump - 0.01 if jump == 0 else jump
    trace = detect(DEFAULT, dataclasses.replace(over_a_step(), times_ns=np.rint(times * 1e9).astype(np.int64)))
    # At equal times the next sweep, 10 ms later, still shows the displacement.
    assert [event.sweep for event in trace.events] == ([31] if jump == 0 else [])


def test_saturated_sweeps_are_flagged_and_used() -> None:
    trace = detect(DEFAULT, over_a_step(amplitude=2e5))
    assert trace.saturated.all()
    assert trace.valid.all()
    assert [event.sweep for event in trace.events] == [30]
    plateau = np.flatnonzero(echo(0.4, 2e5) == 65535)
    assert trace.range_m[0] == pytest.approx(RANGE_M[plateau].mean(), abs=1e-4)


@pytest.mark.long
def test_fine_and_coarse_bins_give_the_same_answer() -> None:
    fine = 0.1 + 0.000484 * np.arange(1450)
    sweeps = [echo(0.4 - 0.03 * (i >= 30), axis=fine) for i in range(60)]
    traces = [detect(DEFAULT, series(sweeps, range_m=fine)), detect(DEFAULT, over_a_step())]
    assert [[event.sweep for event in trace.events] for trace in traces] == [[30], [30]]
    np.testing.assert_allclose(traces[0].range_m, traces[1].range_m, atol=1e-3)


@pytest.mark.long
def test_exponent_chooses_the_farther_of_two_equal_echoes() -> None:
    log = series([echo(0.35).astype(int) + echo(0.7, 1900) - 100])
    assert detect(DEFAULT, log).range_m[0] == pytest.approx(0.35, abs=0.003)
    assert detect(ShiftDetector(exponent=2.0), log).range_m[0] == pytest.approx(0.7, abs=0.003)


def test_standing_recordings_raise_nothing_and_injected_steps_are_seen(road_recordings) -> None:
    """A short form of scripts/road_recordings.py, which prints the whole of it."""
    for name in ("Roughgravel_0_45", "cement_0_0.2", "grass_0_60", "water_0_45"):
        log = read_log(road_recordings[name]).sensors[0]
        for rate in (100.0, 300.0):
            assert detect(DEFAULT, retimed(log, rate)).events == ()
            stepped = inject_step(retimed(log, rate), 0.03, 50, 0.335)
            deadline = 50 + int(0.04 * rate)
            assert any(50 <= event.sweep <= deadline for event in detect(DEFAULT, stepped).events), (name, rate)


@pytest.mark.long
def test_demo1_is_invalid_while_its_echo_is_gone(road_recordings) -> None:
    trace = detect(DEFAULT, read_log(road_recordings["demo1"]).sensors[0])
    gone = (trace.times_s > 6.3) & (trace.times_s < 7.6)
    assert gone.sum() == 41
    assert not trace.valid[gone].any()
    assert not (trace.range_m > 0.79).any()
    assert trace.valid[(trace.times_s < 6.0) | (trace.times_s > 8.0)].all()
