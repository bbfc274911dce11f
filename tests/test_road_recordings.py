"""What is said of real roads, printed and checked by scripts: the whole of README's, and the jitter of the noise."""

from __future__ import annotations

import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from jaxradar import read_log

SCRIPT = Path(__file__).resolve().parents[1] / "scripts" / "road_recordings.py"
NOISE_SCRIPT = SCRIPT.with_name("recorded_noise.py")


@pytest.fixture(scope="module")
def noise_script() -> dict:
    return runpy.run_path(str(NOISE_SCRIPT))


@pytest.mark.long
def test_the_script_finds_all_as_asked_for(road_recordings) -> None:
    folder = next(iter(road_recordings.values())).parent
    done = subprocess.run([sys.executable, SCRIPT, folder], capture_output=True, text=True, timeout=1200, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.endswith("\nAll as asked for.\n")
    assert "Standing, together 27 alarms of the thesis's rule, 27 of the plain script." in done.stdout


def test_a_folder_without_recordings_is_refused(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, SCRIPT, tmp_path], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 2
    assert "expected a folder that holds *.h5 recordings" in done.stderr
    assert "Traceback" not in done.stderr


def test_the_default_s_jitter_on_asphalt_and_on_grass(noise_script, road_recordings, capsys) -> None:
    assert noise_script["MOST_MM"] == {"Asphalt_0_45": 0.35, "grass_0_45": 0.8}
    held = {name: read_log(road_recordings[name]).sensors[0] for name in noise_script["MOST_MM"]}
    ranges = noise_script["single_sweep_ranges"](held)
    for name, most_mm in noise_script["MOST_MM"].items():
        largest, refined = ranges[name]
        assert refined.size > 0.9 * largest.size
        assert 0 < noise_script["jitter_mm"](refined) <= most_mm
    assert noise_script["print_jitter"](ranges)
    assert capsys.readouterr().out.count("reached") == 2


def test_a_jitter_above_what_is_asked_for_is_missed(noise_script, capsys) -> None:
    coarse = np.random.default_rng(1).normal(0.4, 1e-3, 500)
    assert not noise_script["print_jitter"]({"Asphalt_0_45": (coarse, coarse)})
    assert "at most 0.35: MISSED" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("there", "named"),
    [
        ((), "Asphalt_0_45.h5 and grass_0_45.h5,"),
        (("cement_0_45.h5", "demo1.h5"), "Asphalt_0_45.h5 and grass_0_45.h5,"),
        (("Asphalt_0_45.h5",), "expected grass_0_45.h5,"),
    ],
)
def test_no_jitter_is_judged_without_its_recording(
    noise_script, there: tuple[str, ...], named: str, tmp_path: Path, monkeypatch, capsys
) -> None:
    for name in there:
        (tmp_path / name).touch()
    monkeypatch.setattr(sys, "argv", [str(NOISE_SCRIPT), str(tmp_path)])
    assert noise_script["main"]() == 1
    captured = capsys.readouterr()
    assert captured.out == ""
    assert named in captured.err
    assert len(captured.err.splitlines()) == 1


def test_too_short_a_floor_is_one_sentence(noise_script, road_recordings, tmp_path: Path, monkeypatch, capsys) -> None:
    for name in noise_script["MOST_MM"]:
        (tmp_path / f"{name}.h5").symlink_to(road_recordings[name])
    monkeypatch.setattr(sys, "argv", [str(NOISE_SCRIPT), str(tmp_path)])
    monkeypatch.setitem(noise_script["main"].__globals__, "LEAST_FLOOR", 10**6)
    assert noise_script["main"]() == 1
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "with a floor of 1000000 bins; found 0." in captured.err
    assert len(captured.err.splitlines()) == 1
