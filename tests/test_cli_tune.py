"""`jaxradar tune`: from logs with truth to a detector's file; and what it refuses."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from jaxradar.cli import main
from jaxradar.drivefile import write_drive
from jaxradar.sim import StepUp, load_scene, simulate_batch
from jaxradar.systems.step import load_detector


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("drives")
    base = dataclasses.replace(load_scene("trial"), duration_s=0.6, vehicle=None, effects=())
    scenes = [dataclasses.replace(base, road=(StepUp(at_m=4.0, height_m=0.05 * (place % 2)),)) for place in range(8)]
    for place, drive in enumerate(simulate_batch(scenes, range(8))):
        write_drive(drive, folder / f"{place}.drive")
    return folder


def test_a_fit_from_the_shell(drives: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = tmp_path / "mine.toml"
    report = tmp_path / "fit"
    asked = ["--detector", "range-rate", "--settings", "threshold_m_s", "--starts", "2", "--report", str(report)]
    assert main(["tune", str(drives), "-o", str(output), *asked]) == 0
    said = capsys.readouterr().out
    assert "threshold_m_s" in said
    assert "Cost on the drives kept for validation" in said
    made = load_detector(output)
    assert made.detector.name == "range-rate"
    assert made.provenance["drives"] == 6
    assert made.provenance["cost_after"] <= made.provenance["cost_before"]
    assert (report / "fit.png").stat().st_size > 10_000
    assert (report / "fit.json").is_file()


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["-o", "mine.txt"], "must end with .toml"),
        (["-o", "mine.toml", "--settings", "treshold"], "has no setting `treshold`"),
        (["-o", "mine.toml", "--detector", "lab-live"], "say which --settings of `lab-live` are to be moved"),
        (["-o", "mine.toml", "--missed", "0", "--false-alarm", "0", "--late", "0"], "one cost must be above 0"),
        (["-o", "mine.toml", "--sensor", "9"], "has no sensor 9"),
    ],
)
def test_refused_in_one_sentence(
    options: list[str],
    sentence: str,
    drives: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["tune", str(drives), *options]) == 2
    said = capsys.readouterr().err
    assert sentence in said
    assert "Traceback" not in said
    assert not list(tmp_path.glob("mine.*"))
