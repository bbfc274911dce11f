"""Thresholds of the range-rate detectors from a rate of false alarms: in Python, on the command line, and counted."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from scipy import signal, stats
from step_samples import echo

from jaxradar.cli import main
from jaxradar.drive import Mounting
from jaxradar.systems.step import (
    ApproachDetector,
    DetectorFile,
    RangeAxis,
    RangeRateDetector,
    ThesisDetector,
    detect_batch,
    dump_detector,
    load_detector,
)

RATE_HZ, SD_M = 100.0, 1e-3
FINE_M = 0.35 + 0.001 * np.arange(101)


def events(detector: RangeRateDetector | ThesisDetector, ranges_m: np.ndarray) -> np.ndarray:
    """Whether each sweep is a detection; `ranges_m` of shape (logs, sweeps), rounded to 10 µm."""
    places, which = np.unique(np.rint(1e5 * ranges_m), return_inverse=True)
    echoes = np.stack([echo(1e-5 * place, 30_000.0, axis=FINE_M) for place in places])
    sweeps = echoes[which.reshape(ranges_m.shape)]
    logs, count = ranges_m.shape
    steps = np.full((logs, count), 1 / RATE_HZ)
    flags = np.zeros((logs, count), np.uint16)
    lengths = np.full(logs, count)
    return np.asarray(
        detect_batch(detector, RangeAxis.of(FINE_M), sweeps, flags, steps, lengths, fields=("event",))["event"]
    )


def agrees(hits: np.ndarray, probability: float) -> bool:
    low, high = stats.binomtest(int(hits.sum()), hits.size).proportion_ci(0.999, method="exact")
    return bool(low <= probability <= high)


@pytest.mark.parametrize("peak", [pytest.param("parabola", marks=pytest.mark.long), "soft-argmax"])
def test_noise_of_the_range_raises_as_many_alarms_as_asked_for(peak: str) -> None:
    ranges = 0.4 + np.random.default_rng(1).normal(0, SD_M, (1, 30_000))
    for every in (10, 30, 100):
        detector = RangeRateDetector.from_false_alarm_rate(
            3600 * RATE_HZ / every, rate_hz=RATE_HZ, sd_m=SD_M, peak=peak, exponent=0.0
        )
        # Every other difference: neighbouring ones share a sweep.
        assert agrees(events(detector, ranges)[0, 1::2], 1 / every)


def test_so_does_correlated_noise() -> None:
    rho = 0.7
    white = np.random.default_rng(2).normal(0, SD_M * np.sqrt(1 - rho**2), 30_000)
    ranges = 0.4 + signal.lfilter([1.0], [1.0, -rho], white)[None]
    detector = RangeRateDetector.from_false_alarm_rate(
        3600 * RATE_HZ / 30, rate_hz=RATE_HZ, sd_m=SD_M, correlation=rho, exponent=0.0
    )
    # Every tenth: what is left of the correlation is 3 %.
    assert agrees(events(detector, ranges)[0, 10::10], 1 / 30)


def test_ranges_on_a_grid_as_coarse_as_the_noise_are_not_what_theory_means() -> None:
    """Every change of bin is a jump by a bin, and the threshold is lower than that."""
    ranges = 0.4005 + np.random.default_rng(3).normal(0, 0.3e-3, (1, 4_000))
    detector = ThesisDetector.from_false_alarm_rate(3600 * RATE_HZ / 30, rate_hz=RATE_HZ, sd_m=0.3e-3)
    assert 0.5 < float(detector.threshold_m_s) / (0.001 * RATE_HZ) < 1
    assert np.mean(events(detector, ranges)) > 10 / 30


def test_the_requirements_table() -> None:
    for rate, wanted in ((50.0, 0.159), (100.0, 0.327), (200.0, 0.674), (300.0, 1.027)):
        detector = ThesisDetector.from_false_alarm_rate(rate_hz=rate, sd_m=0.4935e-3)
        assert float(detector.threshold) == pytest.approx(wanted, rel=4e-3)
    assert RangeRateDetector.from_false_alarm_rate(rate_hz=100.0, sd_m=1e-3, peak="parabola").peak == "parabola"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"sd_m": 0.0}, "`sd_m` must be above 0 and finite; got 0.0."),
        ({"sd_m": float("nan")}, "`sd_m` must be above 0"),
        ({"rate_hz": 0.0}, "`rate_hz` must be above 0"),
        ({"per_hour": 0.0}, "`per_hour` must be above 0 and below 360000"),
        ({"per_hour": 4e5}, "`per_hour` must be above 0 and below 360000"),
        ({"correlation": 1.0}, "`correlation` must be between -1 and 1"),
        ({"threshold_m_s": 0.7}, "`threshold_m_s` follows from the rate"),
        ({"sd_m": 100.0}, "(threshold_m_s=...)` must be between 0.0 and 1000.0 m/s"),
        ({"window_m": -1.0}, "(window_m=...)` must be between"),
    ],
)
def test_what_no_threshold_answers_is_refused(arguments: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        RangeRateDetector.from_false_alarm_rate(**{"rate_hz": 100.0, "sd_m": 1e-3, **arguments})


ASKED = ["--false-alarms-per-hour", "1", "--rate", "100", "--range-noise-mm", "0.4935"]


def test_the_command_prints_a_file_that_says_where_its_threshold_comes_from(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["config", "range-rate", *ASKED, "--noise-correlation", "0.5"]) == 0
    path = tmp_path / "mine.toml"
    path.write_text(capsys.readouterr().out, encoding="utf-8")
    read = load_detector(path)
    wanted = RangeRateDetector.from_false_alarm_rate(rate_hz=100.0, sd_m=0.4935e-3, correlation=0.5)
    assert float(read.detector.threshold) == float(wanted.threshold)
    assert read.provenance.pop("threshold_m_s").startswith("from theory")
    assert read.provenance == {
        "false_alarms_per_hour": 1.0,
        "rate_hz": 100.0,
        "range_noise_mm": 0.4935,
        "noise_correlation": 0.5,
    }


def test_the_bound_of_the_approach_needs_a_rate_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["config", "approach", *ASKED[:4]]) == 0
    path = tmp_path / "mine.toml"
    path.write_text(capsys.readouterr().out, encoding="utf-8")
    read = load_detector(path)
    assert float(read.detector.threshold) == float(ApproachDetector.from_false_alarm_rate(1.0, rate_hz=100.0).threshold)
    assert read.provenance["evidence"].startswith("from theory")


def test_all_else_in_a_file_stays(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "mine.toml"
    held = DetectorFile(RangeRateDetector(peak="parabola", exponent=1.0), Mounting(0.35, 45.0, None), {"data": "mine"})
    path.write_text(dump_detector(held), encoding="utf-8")
    assert main(["config", str(path), *ASKED]) == 0
    path.write_text(capsys.readouterr().out, encoding="utf-8")
    read = load_detector(path)
    assert read.mounting == held.mounting
    assert read.provenance["data"] == "mine"
    assert isinstance(read.detector, RangeRateDetector)
    assert (read.detector.peak, float(read.detector.exponent)) == ("parabola", 1.0)
    assert float(read.detector.threshold) == pytest.approx(0.327, rel=1e-3)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["default", *ASKED], "there is no theory of the false alarms of `default`; --false-alarms-per-hour is for "),
        (
            ["lab-live", *ASKED],
            "of `lab-live`; --false-alarms-per-hour is for thesis, ",
        ),
        (["thesis", *ASKED[:2]], "--false-alarms-per-hour needs --rate and --range-noise-mm."),
        (["approach", *ASKED[:2]], "--false-alarms-per-hour needs --rate."),
        (["approach", *ASKED], "--range-noise-mm says nothing of the false alarms of `approach`."),
        (["thesis", *ASKED[:4]], "--false-alarms-per-hour needs --range-noise-mm."),
        (["thesis", *ASKED[2:4]], "--rate says nothing without --false-alarms-per-hour."),
        (["thesis", "--noise-correlation", "0"], "--noise-correlation says nothing without --false-alarms-per-hour."),
        (["thesis", *ASKED, "--noise-correlation", "1"], "--noise-correlation must be between -1 and 1"),
        (["thesis", *ASKED[2:], "--false-alarms-per-hour", "4e5"], "-alarms-per-hour must be above 0 and below 360000"),
        (["thesis", *ASKED[2:], "--false-alarms-per-hour", "0"], "expected a number > 0, got '0'"),
        (["thesis", *ASKED[:4], "--range-noise-mm", "1e5"], "must be between 0.0 and 1000.0 m/s; got 6"),
    ],
)
def test_wrong_usage_is_one_sentence(arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["config", *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert message in captured.err
    assert len(captured.err.splitlines()) == 1
