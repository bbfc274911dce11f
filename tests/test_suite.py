"""The detection suite: what it drives, how it scores, and its command."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest

from jaxradar.cli import main
from jaxradar.drive import SensorSeries
from jaxradar.sim import CarMotion, Radar, simulate_batch
from jaxradar.suite import (
    NEGATIVES,
    ROADS,
    Found,
    StepCell,
    found_in_time,
    grid,
    ideal_observer,
    measure_recordings,
    measure_step,
    recorded_record,
    threshold_at,
    variations,
)
from jaxradar.suite.scenes import base_scene, lead_allowed_s
from jaxradar.systems.step import ApproachDetector, DefaultDetector, LabLiveDetector, ThesisDetector, dump_detector


def test_a_cell_s_drives_meet_their_step_after_detectors_have_settled() -> None:
    cell = StepCell("wet", 30.0, 0.03)
    scenes = cell.scenes(4, np.random.default_rng(0))
    for drive in simulate_batch(scenes, range(4)):
        (step,) = drive.truth.steps  # type: ignore[union-attr]
        assert step.height_m == pytest.approx(0.03)
        assert 0.7 < step.impact_s < drive.sensors[0].times_s[-1]
    assert len({float(scene.road[0].at_m) for scene in scenes}) == 4


def test_what_geometry_allows() -> None:
    """(overhang + H − L)/v with L = √(2 · .2 · .04 − .04²) (requirements, 2A)."""
    (scene,) = StepCell("wet", 30.0, 0.04).scenes(1, np.random.default_rng(0))
    assert lead_allowed_s(scene, 10.0, 0.04) == pytest.approx((0.15 + 0.35 - math.sqrt(0.0144)) / 10.0, rel=1e-6)
    assert lead_allowed_s(scene, 10.0, -0.04) == pytest.approx(0.05)


def test_cells_have_names_of_their_own() -> None:
    cells = [*grid(), *variations()]
    assert len({cell.name for cell in cells}) == len(cells) == 160 + 39
    assert sum(one.share for one in NEGATIVES) == pytest.approx(1.0)


def test_in_time_is_a_share_of_the_lead() -> None:
    none = np.full(3, np.nan)
    found = Found(np.array([0.05, 0.03, np.nan]), np.full(3, 0.05), np.zeros(3), none, np.zeros(3, int))
    np.testing.assert_array_equal(found.in_time, [True, False, False])


def test_the_threshold_of_one_alarm_an_hour() -> None:
    tops = np.arange(100.0)
    threshold = threshold_at(tops, 3.0)
    assert threshold == 96.0
    assert (tops > threshold).sum() == 3
    assert threshold_at(tops, 0.5) == math.inf
    assert threshold_at(tops, 100.0) == 0.0


@pytest.fixture(scope="module")
def standing() -> list[SensorSeries]:
    """3.4 s at 31.5 sweeps/s over wet asphalt, as the public recordings are."""
    scene = base_scene(ROADS["wet"], radar=Radar(rate_hz=31.5), motion=CarMotion(speed_m_s=0.0), duration_s=3.4)
    return [drive.sensors[0] for drive in simulate_batch([scene] * 3, [1, 2, 3])]


def test_nothing_is_raised_where_nothing_moves_and_steps_put_in_are_found(standing: list[SensorSeries]) -> None:
    said: list[float] = []
    detectors = {"default": DefaultDetector(), "lab-live": LabLiveDetector()}
    found = measure_recordings(detectors, standing, lambda what, share: said.append(share))
    assert found["default"].alarms == {None: 0, 100.0: 0, 300.0: 0}
    assert found["default"].seconds[None] == pytest.approx(3 * 3.4, rel=0.02)
    assert found["default"].seconds[300.0] == pytest.approx(3 * 107 / 300.0, rel=0.02)
    assert found["default"].injected[100.0, 0.08].value > 0.7
    assert found["default"].injected[100.0, 0.08].low < 0.5  # three recordings say little
    assert {share.value for share in found["lab-live"].injected.values()} == {0.0}
    assert said == sorted(said)
    assert said[-1] == 1.0
    held = json.loads(json.dumps(recorded_record(found["default"]), allow_nan=False))
    assert [one["alarms"] for one in held["alarms"]] == [0, 0, 0]


def test_into_a_short_recording_no_step_is_put(standing: list[SensorSeries]) -> None:
    short = dataclasses.replace(
        standing[0], times_ns=standing[0].times_ns[:60], sweeps=standing[0].sweeps[:60], flags=standing[0].flags[:60]
    )
    found = measure_recordings({"lab-live": LabLiveDetector()}, [short])["lab-live"]
    assert found.injected == {}
    assert found.alarms == {None: 0, 100.0: 0, 300.0: 0}


def test_nothing_put_in_is_not_found(standing: list[SensorSeries]) -> None:
    assert found_in_time(DefaultDetector(), standing[0], 0.0, 0.335, "scaled", 100.0) == 0.0


def test_two_detectors_whose_pictures_would_have_one_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = [tmp_path / "a" / "mine.toml", tmp_path / "b" / "mine.toml"]
    for name in names:
        name.parent.mkdir()
        name.write_text(dump_detector("approach"), encoding="utf-8")
    arguments = [f"--detector={name}" for name in names]
    assert main(["bench-detection", "-o", str(tmp_path / "out"), *arguments]) == 2
    assert "would have one name" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_place_without_recordings_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench-detection", "-o", str(tmp_path / "out"), "--standing", str(tmp_path)]) == 2
    assert str(tmp_path) in capsys.readouterr().err


@pytest.mark.long
def test_a_wet_step_is_seen_and_the_thesis_alarms_all_the_time() -> None:
    cell = StepCell("wet", 30.0, 0.03)
    found = measure_step(cell, {"approach": ApproachDetector(), "thesis": ThesisDetector()}, 24)
    assert found["approach"].in_time.all()
    assert not found["approach"].false.any()
    assert found["thesis"].false.min() > 50
    error = found["approach"].expected_s - found["approach"].lead_s
    assert np.median(np.abs(error)) < 0.03


@pytest.mark.long
def test_who_knows_all_sees_wet_steps_and_none_of_dry_asphalt() -> None:
    assert ideal_observer(StepCell("wet", 30.0, 0.02), 40).share.value == 1.0
    assert ideal_observer(StepCell("diffuse", 30.0, 0.03), 40).share.high < 0.3


@pytest.mark.long
def test_the_command_writes_figures_and_tables(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench-detection", "-o", str(tmp_path), "--quick", "--drives", "2", "--hours", "0.02"]) == 0
    said = capsys.readouterr().out
    assert "False alarms an hour" in said
    assert "wet, 30 km/h" in said
    held = json.loads((tmp_path / "detection.json").read_text())
    assert set(held["quiet"]) == {"default", "thesis"}
    for name in ("heights-default.png", "heights-thesis.png", "roc.png"):
        assert (tmp_path / name).stat().st_size > 10_000
