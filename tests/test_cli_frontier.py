"""`jaxradar frontier`: tables, JSON, pictures, and one sentence for what is wrong."""

from __future__ import annotations

import json
from pathlib import Path

import matplotlib.image
import pytest

from jaxradar import pareto
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
    picture = matplotlib.image.imread(tmp_path / "new" / "speed-300-hz-jitter-10-percent.png")
    assert picture.shape[1] == 1200
    assert picture[..., :3].std() > 0.05


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["rnage"], "no task `rnage` (did you mean `range`?)"),
        (["all", "--error", "1"], "name the task"),
        (["range", "--error", "-1"], "expected a number > 0"),
        (["range", "--rounds", "2"], ">= 3"),
        (["speed", "--case", "nowhere"], "no case 'nowhere'"),
        (["all", "--case", "white 20 dB"], "name the task"),
    ],
)
def test_says_what_is_wrong(
    arguments: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["frontier", *arguments, "-o", str(tmp_path)]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert "Traceback" not in err


def test_an_unmet_budget_loses_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    case = pareto.Case("case", lambda: pareto.Data(None, None, 1), "numbers")
    spread = pareto.Spread(1e-8, 0.9e-8, 1.1e-8)
    point = pareto.Point("only", {}, True, False, 1, pareto.Score(pareto.Estimate(2.0, 1.9, 2.1)), spread, None, 0.0)
    results = (pareto.CaseResult(case, None, (point,), {}),)
    found = pareto.Frontier("speed", "Speed", "sweep", "error", "m/s", "time", "s", True, 3, {}, results)
    monkeypatch.setattr(pareto, "measure", lambda *_, **__: found)
    assert main(["frontier", "speed", "-o", str(tmp_path), "--error", "1e-9"]) == 1
    assert "nobody meets the budget" in capsys.readouterr().out
    assert main(["frontier", "speed", "-o", str(tmp_path), "--error", "1e-9", "--json"]) == 1
    out, err = capsys.readouterr()
    assert "nobody meets the budget" in err
    assert json.loads(out)[0]["results"][0]["points"][0]["candidate"] == "only"
    assert (tmp_path / "speed-case.png").exists()
    assert "chosen" not in json.loads((tmp_path / "speed.json").read_text())


def test_lists_the_cases(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["frontier", "--list"]) == 0
    out = capsys.readouterr().out
    assert '"recorded 40 dB": a pulse of 66 mm in noise as recorded' in out
    assert '"flat-grass"' in out


def test_needs_a_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["frontier", "speed"]) == 2
    (tmp_path / "file").write_text("")
    assert main(["frontier", "speed", "-o", str(tmp_path / "file")]) == 2
    assert "cannot be made" in capsys.readouterr().err
