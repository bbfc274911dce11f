"""`jaxradar frontier`: tables, JSON, pictures, and one sentence for what is wrong."""

from __future__ import annotations

import json
from pathlib import Path

import matplotlib.image
import pytest

from jaxradar.cli import main


def test_writes_json_and_pictures_and_prints_a_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["frontier", "speed", "-o", str(tmp_path / "new"), "--quick", "--rounds", "3", "--error", "0.3"]) == 0
    out, err = capsys.readouterr()
    assert "Range rate at the newest sweep" in out
    assert "Within the budget: " in out
    assert "* on the front" in out
    assert "measuring speed" in err
    held = json.loads((tmp_path / "new" / "speed.json").read_text())
    assert held["task"] == "speed"
    assert held["chosen"] in {point["candidate"] for point in held["results"][0]["points"]}
    picture = matplotlib.image.imread(tmp_path / "new" / "speed.png")
    assert picture.shape[1] == 1200
    assert picture[..., :3].std() > 0.05


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["rnage"], "no task `rnage` (did you mean `range`?)"),
        (["--error", "1"], "name the task"),
        (["range", "--error", "-1"], "expected a number > 0"),
        (["range", "--rounds", "2"], ">= 3"),
        (["speed", "--case", "nowhere"], "no case 'nowhere'"),
        (["--case", "white 20 dB"], "name the task"),
        (["speed", "--quick", "--rounds", "3", "--error", "1e-9"], "nobody meets the budget"),
    ],
)
def test_says_what_is_wrong(
    arguments: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["frontier", *arguments, "-o", str(tmp_path)]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert "Traceback" not in err


def test_needs_a_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["frontier", "speed"]) == 2
    (tmp_path / "file").write_text("")
    assert main(["frontier", "speed", "-o", str(tmp_path / "file")]) == 2
    assert "cannot be made" in capsys.readouterr().err
