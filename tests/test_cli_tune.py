"""`jaxradar tune`: from logs with truth to a detector's file; and what it refuses."""

from __future__ import annotations

import dataclasses
import shutil
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
        (
            ["-o", "mine.toml", "--settings", "aproach.evidence"],
            "no setting `aproach.evidence` (did you mean `approach",
        ),
        (["-o", "mine.toml", "--settings", "approach.speeds"], "sets a shape or a choice, and has no slope"),
        (["-o", "mine.toml", "--detector", "filtered-rate", "--settings", "filter[9]"], "has 7 values, filter[0] to"),
        (["-o", "mine.toml", "--steps", "0"], "expected a whole number >= 1"),
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


def test_too_few_drives_and_drives_without_steps(
    drives: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = ["-o", str(tmp_path / "mine.toml")]
    assert main(["tune", str(drives / "0.drive"), *output]) == 2
    assert "expected 4 logs or more whose truth is known, with a step among them; got 1 with" in capsys.readouterr().err
    odd = [str(drives / f"{place}.drive") for place in (1, 3, 5)]
    base = load_scene("trial")
    flat = dataclasses.replace(base, duration_s=0.6, vehicle=None, effects=(), road=())
    for place, drive in enumerate(simulate_batch([flat] * 4, range(4))):
        write_drive(drive, tmp_path / f"flat-{place}.drive")
    level = [str(tmp_path / f"flat-{place}.drive") for place in range(4)]
    assert main(["tune", *level, *output]) == 2
    assert "got 4 with 0 steps" in capsys.readouterr().err
    # One drive with a step is either fitted to or kept, and there is none on the other side.
    assert main(["tune", odd[0], *level, *output]) == 2
    said = capsys.readouterr().err
    assert "there is no step to be seen in the" in said
    assert "bring more drives with steps." in said


def test_starts_that_stop_early_are_told(drives: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    asked = ["--detector", "range-rate", "--settings", "threshold_m_s", "--starts", "2", "--steps", "1"]
    assert main(["tune", str(drives), "-o", str(tmp_path / "mine.toml"), *asked]) == 0
    said = capsys.readouterr().out
    assert "of 2 starts stopped before they converged." in said
    assert "give --steps more." in said


def test_drives_that_are_all_the_same_still_end_in_a_file(
    drives: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for place in range(5):
        shutil.copytree(drives / "1.drive", tmp_path / f"{place}.drive")
    asked = ["--detector", "range-rate", "--settings", "threshold_m_s", "--starts", "2"]
    assert (
        main(
            ["tune", *(str(tmp_path / f"{place}.drive") for place in range(5)), "-o", str(tmp_path / "m.toml"), *asked]
        )
        == 0
    )
    assert load_detector(tmp_path / "m.toml").detector.name == "range-rate"
