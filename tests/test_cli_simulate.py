"""`simulate`: drives on the disk, the table of effects, wrong input."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from jaxradar.cli import main
from jaxradar.logs import read_log

SCENE = """\
format = 1
scene = "road"
duration_s = 0.3
[motion]
speed_m_s = 5.0
[vehicle]
[[road]]
element = "step-up"
at_m = 0.8
height_m = 0.04
[[effects]]
effect = "receiver-noise"
[[effects]]
effect = "rain"
[[effects]]
effect = "saturation"
[[effects]]
effect = "quantisation"
"""


@pytest.fixture
def scene(tmp_path: Path) -> str:
    path = tmp_path / "mine.toml"
    path.write_text(SCENE)
    return str(path)


@pytest.mark.long
def test_drives_are_the_same_bytes_for_the_same_seed(
    scene: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for folder, seed in (("a", 7), ("b", 7), ("c", 8)):
        assert main(["simulate", scene, "-o", str(tmp_path / folder), "-n", "2", "--seed", str(seed)]) == 0
    assert f"2 drives in {tmp_path / 'a'}" in capsys.readouterr().out
    names = sorted(str(path.relative_to(tmp_path / "a")) for path in (tmp_path / "a").rglob("*.*"))
    drive = ["3.csv", "gyro.csv", "truth.json"]
    assert names == [f"mine-{place:03}/{name}" for place in range(2) for name in drive]
    held = {folder: [(tmp_path / folder / name).read_bytes() for name in names] for folder in "abc"}
    assert held["a"] == held["b"]
    assert held["a"][0] != held["a"][3]
    assert held["a"][0] != held["c"][0]
    truth = json.loads((tmp_path / "a" / "mine-000" / "truth.json").read_text())
    (step,) = truth["steps"]
    # 0.8 m and the 0.15 m to the front axle, less the 0.12 m by which the tyre reaches ahead, at 5 m/s.
    assert step["impact_s"] == pytest.approx(0.83 / 5, abs=1e-3)
    assert len(step["wheels_s"]) == 4
    assert step["peak_m_s2"] > 10
    assert main(["evaluate", str(tmp_path / "a"), "--json", str(tmp_path / "found.json")]) == 0
    assert len((tmp_path / "found.json").read_text().splitlines()) >= 2


@pytest.mark.long
def test_binary_drives_hold_the_same(scene: str, tmp_path: Path) -> None:
    assert main(["simulate", scene, "-o", str(tmp_path), "--form", "drive"]) == 0
    assert main(["simulate", scene, "-o", str(tmp_path)]) == 0
    binary, text = read_log(tmp_path / "mine-000.drive"), read_log(tmp_path / "mine-000")
    assert (binary.sensors[0].sweeps == text.sensors[0].sweeps).all()
    assert binary.truth == text.truth
    # A drive that stands there is not written over unasked.
    assert main(["simulate", scene, "-o", str(tmp_path), "--form", "drive"]) == 1
    assert main(["simulate", scene, "-o", str(tmp_path), "--form", "drive", "--overwrite"]) == 0


@pytest.fixture
def rainy(tmp_path: Path) -> Path:
    path = tmp_path / "bare.toml"
    effects = [f'[[effects]]\neffect = "{name}"\n' for name in ("receiver-noise", "rain")]
    path.write_text('format = 1\nscene = "road"\nduration_s = 0.1\n' + "".join(effects))
    return path


@pytest.mark.long
def test_explain_says_what_matters(rainy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = rainy
    assert main(["simulate", str(path), "--explain", "--json"]) == 0
    table = json.loads(capsys.readouterr().out)
    assert {row["effect"]: row["kept"] for row in table["effects"]} == {"receiver-noise": True, "rain": False}
    assert all(row["why"] for row in table["effects"])
    assert table["bare"]["operations"] > 1e5  # some 200 scatterers, each in 50 places
    assert table["together"]["level_db"] < -40


@pytest.mark.long
def test_what_does_not_matter_is_left_out(rainy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", str(rainy), "--explain", "--significant", "-o", str(tmp_path / "out")]) == 0
    assert "rain: dropped" in capsys.readouterr().out
    assert (tmp_path / "out" / "bare-000" / "3.csv").exists()


def test_scenes_are_listed_and_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "--list"]) == 0
    assert "trial" in capsys.readouterr().out
    assert main(["simulate", "trial", "--print"]) == 0
    assert 'element = "step-up"' in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "wanted"),
    [
        ([], "expected a SCENE"),
        (["trial"], "expected --output DIR"),
        (["trail", "--explain"], "did you mean `trial`?"),
        (["trial", "-o", "x", "-n", "0"], "expected a whole number >= 1"),
        (["trial", "-o", "/proc/nowhere"], "cannot be made"),
        (["trial", "-o", "x", "--seed", str(2**63)], "--seed: expected a whole number <= 9223372036854775807"),
        (["trial", "-o", "x", "--seed", "9" * 5000], "--seed: expected a whole number"),
        (["trial", "-o", "x", "--seed", "-1"], "--seed: expected a whole number >= 0"),
    ],
)
def test_wrong_use_is_one_sentence(arguments: list[str], wanted: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", *arguments]) == 2
    said = capsys.readouterr().err
    assert wanted in said
    assert said.count("\n") == 1


def test_a_wrong_scene_file_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text('format = 1\nscene = "road"\n[[road]]\nelement = ["step-up"]\n')
    assert main(["simulate", str(path), "-o", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"jaxradar: {path}: `element` of [[road]] number 1 is ['step-up']")
    assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()
