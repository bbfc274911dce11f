"""`info`, `convert` and `label`: what a log holds, in another form, and truth out of its acceleration."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from log_samples import trial_drive

from jaxradar.cli import main
from jaxradar.drive import Channel, Drive, Motion, Mounting, RoadStep, SensorSeries, SweepFlag, Truth
from jaxradar.labels import propose_steps
from jaxradar.logs import read_log, write_log


def channel(times_s: list[float], values: list[float]) -> Channel:
    return Channel(np.rint(np.array(times_s) * 1e9).astype(np.int64), np.array(values, np.float64))


def impacts(acceleration: Channel, **settings: float) -> list[float]:
    return [step.impact_s for step in propose_steps(acceleration, **settings)]


def small() -> Drive:
    times = np.array([0, 10, 20, 20, 50], np.int64) * 1_000_000
    sweeps = np.array([[8, 16, 24], [0, 0, 0], [40, 65535, 8], [8, 8, 8], [16, 8, 8]], np.uint16)
    flags = np.array([0, SweepFlag.NO_AMPLITUDES, SweepFlag.SATURATED, 0, 0], np.uint16)
    return Drive(
        sensors=(SensorSeries(1, times, sweeps, np.array([0.1, 0.2, 0.3]), flags, {"profile": 2}),),
        motion=Motion(speed_m_s=channel([0.0, 0.05], [2.0, 3.0])),
        mounting=Mounting(height_m=0.35),
        truth=Truth((RoadStep(0.04, 0.03),)),
        started_at_ns=1_600_000_000 * 10**9,
    )


def test_info_says_what_a_log_holds(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_log(small(), tmp_path / "small.drive")
    assert main(["info", "--json", str(tmp_path)]) == 0
    (said,) = map(json.loads, capsys.readouterr().out.splitlines())
    (sensor,) = said["sensors"]
    assert said["started_at"] == "2020-09-13T12:26:40+00:00"
    assert (sensor["sweeps"], sensor["duration_s"], sensor["times_not_increasing"]) == (5, 0.05, 1)
    assert sensor["sweep_rate_hz"] == pytest.approx(100)
    assert sensor["interval_sd_s"] == pytest.approx(np.std([0.01, 0.01, 0.03]))
    assert sensor["longest_interval_s"] == pytest.approx(0.03)
    assert (sensor["bins"], sensor["range_start_m"], sensor["range_stop_m"]) == (3, 0.1, 0.3)
    assert sensor["bin_m"] == pytest.approx(0.1)
    assert (sensor["amplitude_least"], sensor["amplitude_greatest"]) == (8, 65535)
    assert (sensor["invalid_sweeps"], sensor["flags"]["saturated"], sensor["flags"]["no_amplitudes"]) == (1, 1, 1)
    assert sensor["spec"] == {"profile": 2}
    assert said["motion"]["speed_m_s"] == {"samples": 2, "least": 2.0, "greatest": 3.0}
    assert said["motion"]["acceleration_m_s2"] is None
    unknown = {"wheels_s": None, "peak_m_s2": None, "hard_s": None, "at_m": None}
    assert said["truth"] == [{"impact_s": 0.04, "height_m": 0.03, **unknown}]
    assert main(["info", str(tmp_path / "small.drive")]) == 0
    text = capsys.readouterr().out
    for part in (
        "5 sweeps in 0.050 s, 100.00 Hz",
        "3 range bins, 0.1000 to 0.3000 m, 100.000 mm a bin",
        "amplitudes 8 to 65535 counts, uint16",
        "invalid sweeps: 1 (flags: saturated 1, no_amplitudes 1)",
        "stand still or go back: 1",
        "profile = 2",
        "speed_m_s: 2 samples, 2 to 3 m/s",
        "height_m 0.35",
        "impact_s 0.04, height_m 0.03",
    ):
        assert part in text


def test_info_of_a_log_that_says_little_and_of_one_that_fails(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    few = small().sensors[0]
    none = replace(few, times_ns=few.times_ns[:0], sweeps=few.sweeps[:0], flags=few.flags[:0])
    write_log(Drive(sensors=(none,)), tmp_path / "none.drive")
    (tmp_path / "bad.csv").write_text("no log")
    assert main(["info", "--json", str(tmp_path / "none.drive"), str(tmp_path / "bad.csv")]) == 1
    out, err = capsys.readouterr()
    good, bad = map(json.loads, out.splitlines())
    assert good["sensors"][0]["amplitude_least"] is None
    assert (good["truth"], good["mounting"], good["started_at"]) == (None, None, None)
    assert list(bad) == ["path", "error"]
    assert bad["error"] in err
    assert main(["info", str(tmp_path / "none.drive")]) == 0
    text = capsys.readouterr().out
    assert "0 sweeps in 0.000 s, no rate" in text
    assert "truth       not known" in text
    assert "motion      not recorded" in text


def test_convert_there_and_back(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    there, back = tmp_path / "log.drive", tmp_path / "back"
    write_log(trial_drive(), tmp_path / "log")
    assert main(["convert", str(tmp_path / "log"), str(there)]) == 0
    assert main(["convert", str(there), str(back)]) == 0
    assert capsys.readouterr() == (f"{there}\n{back}\n", "")
    for name in ("3.csv", "gyro.csv", "truth.json"):
        assert (back / name).read_bytes() == (tmp_path / "log" / name).read_bytes()


def test_convert_says_what_is_lost_and_overwrites_only_when_asked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_log(small(), tmp_path / "small.drive")
    target = tmp_path / "out"
    assert main(["convert", str(tmp_path / "small.drive"), str(target)]) == 0
    out, err = capsys.readouterr()
    assert out == f"{target}\n"
    assert "date of the recording" in err
    assert "profile" in err
    assert main(["convert", str(tmp_path / "small.drive"), str(target)]) == 1
    assert "exists already" in capsys.readouterr().err
    assert main(["convert", str(tmp_path / "small.drive"), str(target), "--overwrite"]) == 0
    (target / "notes.txt").write_text("mine")
    assert main(["convert", str(tmp_path / "small.drive"), str(target), "--overwrite"]) == 1
    assert (target / "notes.txt").read_text() == "mine"
    capsys.readouterr()
    for wrong in (["convert", "absent", str(tmp_path / "new")], ["convert", str(target), str(tmp_path / "new.h5")]):
        assert main(wrong) == 1
        out, err = capsys.readouterr()
        assert out == ""
        assert wrong[-1 if "absent" not in wrong else 1] in err.splitlines()[-1]


def test_the_impact_is_the_first_sample_at_the_threshold_less_the_delay() -> None:
    bump = channel([0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6], [0, 0, 14.9, 15.0, 40.0, 0, 0])
    assert impacts(bump) == [0.282]
    assert impacts(bump, threshold_m_s2=14.0, delay_s=0.0) == [0.2]
    assert impacts(bump, threshold_m_s2=40.1) == []


@pytest.mark.parametrize("offset", [0.0, 9.81, -9.81])
@pytest.mark.parametrize("sign", [1, -1])
def test_gravity_and_the_direction_of_the_axis_do_not_matter(offset: float, sign: int) -> None:
    values = offset + sign * np.array([0, 1, 0, -1, 16, -5, 1, 0, 0], float)
    assert impacts(channel(list(np.arange(9) / 10), list(values))) == [0.382]


def test_one_bump_is_one_step_until_it_has_been_quiet() -> None:
    times = [0.0, 1.0, 1.1, 1.5, 2.0, 2.6, 3.0, 4.0, 5.0, 6.0, 7.0]
    values = [0, 20, 0, -20, 20, 20, 0, 0, 0, 0, 0]
    assert impacts(channel(times, values), delay_s=0.0) == [1.0, 2.6]
    assert impacts(channel(times, values), delay_s=0.0, hold_off_s=0.6) == [1.0]
    assert impacts(channel(times, values), delay_s=0.0, hold_off_s=0.0) == [1.0, 1.5, 2.0, 2.6]


def test_samples_that_are_no_numbers_and_times_that_go_back() -> None:
    assert impacts(channel([0, 2, 1, 3, 4], [0, 20, np.nan, 0, 0]), delay_s=0.0) == [2.0]
    assert impacts(channel([3, 1, 2, 0, 0.5], [20, 20, 0, 0, 0]), delay_s=0.0) == [1.0, 3.0]
    assert impacts(channel([], [])) == []
    assert impacts(channel([0, 1], [np.nan, np.nan])) == []


@pytest.mark.parametrize("name", ["threshold_m_s2", "delay_s", "hold_off_s"])
def test_settings_out_of_bounds_are_refused(name: str) -> None:
    with pytest.raises(ValueError, match=rf"{name}=\.\.\.\).*-1"):
        propose_steps(channel([], []), **{name: -1.0})
    with pytest.raises(ValueError, match="nan"):
        propose_steps(channel([], []), **{name: float("nan")})


@settings(max_examples=100, deadline=None)
@given(bumps=st.lists(st.integers(0, 200), unique=True, max_size=12), hold_off=st.integers(0, 30))
def test_labels_against_a_loop(bumps: list[int], hold_off: int) -> None:
    values = np.zeros(1000)
    values[bumps] = 20.0
    wanted: list[float] = []
    last = None
    for bump in sorted(bumps):
        if last is None or bump - last > hold_off:
            wanted.append(bump / 100)
        last = bump
    found = impacts(channel(list(np.arange(1000) / 100), list(values)), delay_s=0.0, hold_off_s=hold_off / 100)
    assert found == pytest.approx(wanted)


def test_label_writes_truth_that_is_read_with_the_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / "log"
    write_log(replace(trial_drive(), truth=None), log)
    (log / "truth.json").unlink()
    assert main(["label", str(log)]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert str(log / "truth.json") in out
    truth = read_log(log).truth
    assert truth is not None
    (step,) = truth.steps
    assert step.impact_s == pytest.approx(1.2, abs=0.012)
    assert f"{step.impact_s:.3f} s" in out
    assert main(["label", str(log), "--acceleration", "30", "--overwrite"]) == 0
    assert read_log(log).truth == Truth()
    assert "none" in capsys.readouterr().out


def test_label_keeps_what_is_there_and_the_mounting(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drive = trial_drive()
    for name in ("log", "log.drive"):
        log = tmp_path / name
        write_log(drive, log)
        assert main(["label", str(log)]) == 1
        assert len(capsys.readouterr().err.splitlines()) == 1
        assert read_log(log).truth == drive.truth
        assert main(["label", str(log), "--overwrite"]) == 0
        after = read_log(log)
        assert after.truth is not None
        assert after.truth.steps[0].height_m is None
        assert after.mounting == drive.mounting
        assert np.array_equal(after.sensors[0].sweeps, drive.sensors[0].sweeps)
        assert after.problems == ()
    assert main(["label", str(tmp_path / "log.drive"), "-o", str(tmp_path / "mine.json")]) == 0
    assert list(json.loads((tmp_path / "mine.json").read_text())) == ["steps", "mounting"]


def test_label_needs_acceleration(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_log(small(), tmp_path / "small.drive")
    assert main(["label", str(tmp_path / "small.drive")]) == 1
    assert capsys.readouterr() == (
        "",
        f"jaxradar: {tmp_path / 'small.drive'}: holds no acceleration to propose steps from.\n",
    )
