"""The thesis's rule against a plain transcription of it, and the lab program's live rule against its C code."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from step_samples import BINS, RANGE_M, echo, series

from jaxradar.drive import SweepFlag
from jaxradar.systems.step import LabLiveDetector, ThesisDetector, detect, thin

FIXED_LENGTH = 24  # one program for all examples


def thesis_in_python(sweeps, range_m, times_s, invalid, threshold=0.7):
    """Stages 1 to 7 of figure 5.5, one sweep after the other, in Python's doubles."""
    found, last = [], None
    for i, sweep in enumerate(sweeps):
        if invalid[i] or max(sweep) == 0:
            continue
        best = 0
        for k in range(len(sweep)):
            if float(sweep[k]) * (2 * range_m[k]) ** 2 > float(sweep[best]) * (2 * range_m[best]) ** 2:
                best = k
        elapsed = 0.0 if last is None else times_s[i] - last[1]
        if elapsed > 0 and abs(range_m[best] - last[0]) / elapsed > threshold:
            found.append(i)
        last = (range_m[best], times_s[i])
    return found


@settings(deadline=None, max_examples=60, derandomize=True)
@given(st.integers(0, 2**32 - 1))
def test_equals_a_plain_transcription(seed: int) -> None:
    generator = np.random.default_rng(seed)
    bins = 32
    range_m = 0.099768 + 0.0070338 * np.arange(bins)
    # Few levels, so that ties and near-ties of the compensated amplitudes are common; whole milliseconds, some <= 0.
    sweeps = generator.integers(0, generator.choice([2, 5, 60000]), (FIXED_LENGTH, bins)).astype(np.uint16)
    sweeps[generator.random(FIXED_LENGTH) < 0.1] = 0
    invalid = generator.random(FIXED_LENGTH) < 0.1
    times_s = np.cumsum(generator.choice([0.01, 0.02, 0.003, 0.0, -0.05], FIXED_LENGTH, p=[0.6, 0.2, 0.1, 0.05, 0.05]))
    log = series(sweeps, times_s=times_s - times_s[0], flags=invalid * int(SweepFlag.MISSED_DATA), range_m=range_m)
    wanted = thesis_in_python(sweeps.tolist(), range_m.tolist(), (log.times_ns / 1e9).tolist(), invalid)
    assert [event.sweep for event in detect(ThesisDetector(), log).events] == wanted


def test_near_tie_falls_as_float64_would_choose() -> None:
    """On the fixture's axis, 62616 counts in its first bin beat 54640 in its second by 5e-9, and not in float32."""
    range_m = 0.099768 + 0.0070338 * np.arange(BINS)
    sweeps = np.zeros((2, BINS), np.uint16)
    sweeps[:, 0], sweeps[:, 1] = 62616, 54640
    for dtype, wanted in ((np.float64, 0), (np.float32, 1)):
        assert np.argmax(sweeps[0].astype(dtype) * (2 * range_m.astype(dtype)) ** 2) == wanted
    np.testing.assert_array_equal(detect(ThesisDetector(), series(sweeps, range_m=range_m)).range_m, range_m[0])


def test_threshold_is_strict() -> None:
    """A quarter of a metre in a quarter of a second is 1 m/s exactly, in binary too."""
    range_m = np.array([0.25, 0.5, 0.75])
    log = series(np.array([[9, 0, 0], [0, 9, 0]], np.uint16), times_s=[0, 0.25], range_m=range_m)
    assert detect(ThesisDetector(threshold_m_s=1.0), log).events == ()
    assert len(detect(ThesisDetector(threshold_m_s=np.nextafter(1.0, 0)), log).events) == 1


def test_one_bin_at_100_hz_is_over_the_threshold() -> None:
    """Bins of 7.034 mm: .7034 m/s at 10 ms, .67 at 10.5 ms (requirements, table of section 1)."""
    range_m = 0.099768 + 0.0070338 * np.arange(BINS)
    sweeps = [echo(range_m[50], axis=range_m), echo(range_m[51], axis=range_m)]
    assert len(detect(ThesisDetector(), series(sweeps, times_s=[0, 0.010], range_m=range_m)).events) == 1
    assert len(detect(ThesisDetector(), series(sweeps, times_s=[0, 0.0105], range_m=range_m)).events) == 0


def test_difference_is_taken_to_the_last_valid_sweep() -> None:
    # Three bins in 40 ms are .528 m/s; to the sweep just before it would be four times that.
    sweeps = [echo(RANGE_M[43]), np.zeros(BINS, np.uint16), echo(0.9), np.zeros(BINS, np.uint16), echo(RANGE_M[46])]
    flags = [0, 0, SweepFlag.MISSED_DATA, SweepFlag.NO_AMPLITUDES, 0]
    trace = detect(ThesisDetector(), series(sweeps, flags=flags))
    assert trace.events == ()
    assert trace.valid.tolist() == [True, False, False, False, True]
    assert trace.statistic[-1] == pytest.approx(3 * 0.0070338 / 0.04, abs=1e-12)
    assert np.isnan(trace.range_m[1:4]).all()


def test_each_sweep_over_the_threshold_is_a_detection_of_its_own() -> None:
    log = series([echo(RANGE_M[k]) for k in (43, 46, 49, 49, 46)])
    events = detect(ThesisDetector(), log).events
    assert [event.sweep for event in events] == [1, 2, 4]
    assert [event.time_s for event in events] == [0.01, 0.02, 0.04]
    assert events[0].statistic == pytest.approx(3 * 0.0070338 / 0.01)
    assert events[0].threshold == 0.7


def test_exponent_is_a_parameter() -> None:
    """528 counts at .993 m beat an echo under 2125 at .495 m with (2r)² and not with 2r (requirement 30)."""
    range_m = 0.1 + 0.001 * np.arange(900)
    sweep = np.zeros(900, np.uint16)
    sweep[[395, 893]] = 2124, 528
    log = series([sweep], range_m=range_m)
    assert detect(ThesisDetector(), log).range_m[0] == pytest.approx(0.993)
    assert detect(ThesisDetector(exponent=1.0), log).range_m[0] == pytest.approx(0.495)


def lab_program(sweeps, start, length, ok=None):
    """The loop of appendix C.1 as it is: distances after each sweep, and the bytes it writes."""
    distance, distances, sent = 0.0, [], []
    index_to_meter = length / 128
    for i, sweep in enumerate(sweeps):
        if ok is None or ok[i]:
            max_data, max_index = 0.0, 0
            for k, value in enumerate(sweep):
                if max_data < value:
                    max_index, max_data = k, value
            distance = index_to_meter * max_index if max_data > 1000 else 0.0
        distances.append(distance)
        sent.append(1 if distance != 0 and distance < 0.15 else 0)
    return distances, sent


@pytest.mark.parametrize("bins", [128, 1446])
def test_lab_live_as_it_was_equals_the_program(bins: int) -> None:
    generator = np.random.default_rng(5)
    range_m = 0.1 + 0.7 / bins * np.arange(bins)
    sweeps = generator.integers(0, 990, (40, bins)).astype(np.uint16)
    peaks = generator.integers(0, bins // 3, 40)
    sweeps[np.arange(40), peaks] = generator.choice([900, 1000, 1001, 5000], 40)
    ok = generator.random(40) > 0.2
    distances, sent = lab_program(sweeps, 0.1, 0.7, ok)
    log = series(sweeps, flags=~ok * int(SweepFlag.NO_AMPLITUDES), range_m=range_m)
    trace = detect(LabLiveDetector(as_it_was=True), log)
    np.testing.assert_allclose(np.nan_to_num(trace.range_m), distances, rtol=1e-12)
    rises = [i for i in range(40) if sent[i] and not (i and sent[i - 1])]
    assert [event.sweep for event in trace.events] == rises
    assert rises or bins > 128  # the full sweep is scaled 11.3 times too far: hardly anything is ever near


def test_lab_live_mended_measures_from_the_axis() -> None:
    range_m = 0.1 + 0.000484 * np.arange(1446)
    near, far = int(np.argmin(abs(range_m - 0.12))), int(np.argmin(abs(range_m - 0.6)))
    sweeps = np.zeros((6, 1446), np.uint16)
    sweeps[[0, 1, 2, 3, 4, 5], [far, near, near, far, near, 0]] = [2000, 2000, 2000, 2000, 1000, 2000]
    trace = detect(LabLiveDetector(), series(sweeps, range_m=range_m))
    assert [event.sweep for event in trace.events] == [1, 5]  # a rise each; 1000 counts are none; bin 0 is an object
    assert trace.valid.tolist() == [True, True, True, True, False, True]
    np.testing.assert_allclose(trace.range_m[:4], range_m[[far, near, near, far]])
    assert trace.events[0].statistic > trace.events[0].threshold == pytest.approx(1 / 0.15)


def test_lab_live_takes_an_object_at_no_distance_for_one() -> None:
    trace = detect(LabLiveDetector(), series(np.array([[0, 0], [5000, 0]], np.uint16), range_m=np.array([0.0, 0.1])))
    assert [event.sweep for event in trace.events] == [1]
    assert trace.valid.tolist() == [False, True]
    assert np.isfinite(trace.statistic).all()


def test_lab_live_correction_is_the_disabled_line() -> None:
    """data + 0.5·data·(i·index_to_meter), back in uint16: the later of two equal echoes wins."""
    sweeps = np.zeros((1, BINS), np.uint16)
    sweeps[0, [10, 90]] = 2000
    assert detect(LabLiveDetector(), series(sweeps)).range_m[0] == pytest.approx(RANGE_M[10])
    trace = detect(LabLiveDetector(correct_loss=True), series(sweeps))
    assert trace.range_m[0] == pytest.approx(RANGE_M[90])
    assert trace.strength[0] == np.floor(2000 + 0.5 * 2000 * 90 * 0.0070338)


def test_thinning_is_the_program_s() -> None:
    range_m = 0.2 + 0.000484 * np.arange(1240)
    log = series(np.arange(1240, dtype=np.uint16)[None], range_m=range_m)
    kept = [1240 * i // 128 for i in range(128)]
    thinned = thin(log, 128)
    assert thinned.sweeps[0].tolist() == kept
    np.testing.assert_array_equal(thinned.range_m, range_m[kept])
    assert dataclasses.replace(thinned).times_ns is log.times_ns


def test_real_recordings_give_the_counts_of_plain_numpy(road_recordings) -> None:
    from jaxradar.logs import read_log

    total = 0
    for path in road_recordings.values():
        log = thin(read_log(path).sensors[0], 128)
        peaks = log.range_m[np.argmax(log.sweeps * (2 * log.range_m) ** 2, axis=1)]
        wanted = np.flatnonzero(np.abs(np.diff(peaks)) / np.diff(log.times_ns / 1e9) > 0.7) + 1
        assert [event.sweep for event in detect(ThesisDetector(), log).events] == wanted.tolist()
        total += len(wanted)
    assert total > 0


def test_ranges_are_the_axis_s_own() -> None:
    trace = detect(ThesisDetector(), series([echo(RANGE_M[40]), echo(RANGE_M[41])]))
    assert set(trace.range_m.tolist()) <= set(RANGE_M.tolist())
