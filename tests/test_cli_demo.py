"""`demo` and `view`: figures from nothing, and from a log."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from log_samples import sample_drive, trial_drive

from jaxradar.cli import main
from jaxradar.logs import read_log, write_log

PNG = b"\x89PNG"


@pytest.mark.long  # README's first command is this, once
def test_the_demo_needs_nothing_and_can_be_run_again(tmp_path: Path) -> None:
    twice = "from jaxradar.cli import main; status = main(['demo']); print('again'); exit(status or main(['demo']))"
    ran = subprocess.run([sys.executable, "-c", twice], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert (ran.returncode, ran.stderr) == (0, "")
    first, second = ran.stdout.split("again\n")
    assert first == second
    folder = tmp_path / "jaxradar-demo"
    assert sorted(path.name for path in folder.iterdir()) == [
        "default.png",
        "log",
        "scene.toml",
        "sweeps.png",
        "thesis.png",
    ]
    assert all(path.read_bytes().startswith(PNG) for path in folder.glob("*.png"))
    assert sorted(path.name for path in (folder / "log").iterdir()) == ["3.csv", "gyro.csv", "truth.json"]
    truth = read_log(folder / "log").truth
    assert truth is not None
    assert [step.impact_s for step in truth.steps] == pytest.approx([1.2], abs=2e-3)
    rows = {line.split()[0]: line.split() for line in first.splitlines() if line.startswith(("thesis ", "default "))}
    # The rule of the thesis cries all the time; the default detector sees the step in time.
    assert int(rows["thesis"][4]) > 100
    assert rows["default"][1:3] == ["3", "600"]
    assert rows["default"][4:8] == ["1", "1", "0", "0"]
    assert 60 < int(rows["default"][8]) <= 130
    assert "a hit is luck" in first
    for path in ("log", "thesis.png", "default.png", "sweeps.png"):
        assert f"jaxradar-demo/{path}\n" in first
    assert max(map(len, first.splitlines())) <= 80


@pytest.mark.long
def test_another_demo_takes_the_place_of_the_first(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["demo", "-o", str(tmp_path), "--scene", "flat-asphalt"]) == 0
    assert "alarms of the thesis's rule for 0 steps" in capsys.readouterr().out
    assert main(["demo", "-o", str(tmp_path), "--seed", "1"]) == 0
    assert "A front tyre meets 40 mm" in capsys.readouterr().out


def test_the_demo_leaves_a_strange_folder_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "log").mkdir()
    (tmp_path / "log" / "diary.txt").write_text("mine")
    assert main(["demo", "-o", str(tmp_path)]) == 1
    assert "left alone" in capsys.readouterr().err
    assert [path.name for path in tmp_path.rglob("*")] == ["log", "diary.txt"]
    (tmp_path / "file").write_text("")
    assert main(["demo", "-o", str(tmp_path / "file")]) == 2


def test_the_demo_leaves_a_recording_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_log(sample_drive(), tmp_path / "log")
    before = (tmp_path / "log" / "3.csv").read_bytes()
    assert main(["demo", "-o", str(tmp_path)]) == 1
    assert "left alone" in capsys.readouterr().err
    assert (tmp_path / "log" / "3.csv").read_bytes() == before


@pytest.mark.long
def test_view_draws_each_sensor_and_says_where(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_log(trial_drive(), tmp_path / "log")
    arguments = ["view", str(tmp_path / "log"), "-o", str(tmp_path / "f"), "--detector", "thesis", "--stop", "1"]
    assert main(arguments) == 0
    out, err = capsys.readouterr()
    assert err == ""
    written = [Path(line) for line in out.splitlines()]
    assert written == [tmp_path / "f" / "log-sensor3.png", tmp_path / "f" / "log-sensor3-sweeps.png"]
    assert all(path.read_bytes().startswith(PNG) for path in written)


def test_view_takes_one_log_and_a_sensor_that_it_has(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("one", "two"):
        write_log(trial_drive(), tmp_path / name)
    assert main(["view", str(tmp_path), "--detector", "thesis"]) == 1
    assert "holds 2 logs; expected one" in capsys.readouterr().err
    for wrong in (["--sensor", "1"], ["--start", "2.5"], ["--thin", "129"], ["-o", str(tmp_path / "one" / "3.csv")]):
        assert main(["view", str(tmp_path / "one"), "--detector", "thesis", *wrong]) == 2
        out, err = capsys.readouterr()
        assert (out, len(err.splitlines())) == ("", 1)
