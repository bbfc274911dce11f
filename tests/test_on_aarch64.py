"""A compiled detector does on 64-bit ARM, as QEMU computes it, what it does here; and the script that says so."""

from __future__ import annotations

import json
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parents[1] / "scripts" / "on_aarch64.py"
EVENT = {"sensor": 3, "sweep": 330, "range_m": 0.884, "statistic": 1.31, "impact_in_s": None}


@pytest.fixture(scope="module")
def script() -> dict:
    return runpy.run_path(str(SCRIPT))


@pytest.mark.long
def test_the_default_detector_runs_on_the_raspberry_pi_3_s_processor(script, tmp_path: Path) -> None:
    pytest.importorskip("iree.compiler")
    done = subprocess.run([sys.executable, SCRIPT, tmp_path], capture_output=True, text=True, timeout=2400, check=False)
    if done.returncode == script["NOT_TRIED"]:  # no QEMU, no debootstrap or no network
        pytest.skip(done.stderr.strip())
    assert done.returncode == 0, done.stdout + done.stderr
    assert "On the ARM: aarch64 3.11." in done.stdout
    assert "Detections: 1 here, 1 on the ARM, equal\n" in done.stdout
    assert "Decisions on single sweeps: 600 here, 600 on the ARM, equal" in done.stdout


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"sweep": 331}, "number 0: sweep is 330 here and 331 on the ARM."),
        ({"range_m": 0.884 * (1 + 2e-5)}, "range_m is 0.884 here"),
        ({"statistic": float("nan")}, "statistic is 1.31 here and nan on the ARM."),
        ({"impact_in_s": 0.1}, "impact_in_s is None here and 0.1 on the ARM."),
        ({"more": 1}, "more is None here and 1 on the ARM."),
    ],
)
def test_what_differs_is_said(script, changed: dict, words: str) -> None:
    found = script["differences"]([EVENT], [EVENT | changed], {})
    assert len(found) == 1
    assert words in found[0]


def test_what_agrees_within_the_tolerance_is_equal(script) -> None:
    assert script["differences"]([EVENT], [EVENT | {"range_m": 0.884 * (1 + 0.9e-5)}], {}) == []
    small = [{"statistic": 1e-7}]
    assert len(script["differences"](small, [{"statistic": 2e-7}], {})) == 1
    assert script["differences"](small, [{"statistic": 2e-7}], script["largest"]([*small, {"statistic": -1.0}])) == []


def test_a_detection_too_few_is_a_difference(script) -> None:
    assert script["differences"]([EVENT], [], {}) == ["1 here and 0 on the ARM."]


def test_lines_are_told_apart_by_their_kind(script) -> None:
    text = "\n".join(json.dumps(record) for record in ({"event": EVENT}, {"summary": {"sweeps": 3}}))
    assert script["lines"](text, "event") == [EVENT]


@pytest.mark.parametrize("missing", ["qemu-aarch64-static", "debootstrap"])
def test_a_missing_tool_is_one_sentence(script, missing: str, tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(shutil, "which", lambda name, path=None: None if name.startswith(missing[:4]) else name)
    monkeypatch.setattr(sys, "argv", [str(SCRIPT), str(tmp_path / "arm")])
    assert script["main"]() == script["NOT_TRIED"]
    captured = capsys.readouterr()
    assert captured.out == ""
    assert f"{missing} is missing; on Debian and Ubuntu `sudo apt install" in captured.err
    assert len(captured.err.splitlines()) == 1


def test_a_mirror_that_does_not_answer_is_one_sentence(script, tmp_path: Path, monkeypatch, capsys) -> None:
    tool = tmp_path / "debootstrap"
    tool.write_text("#!/bin/sh\necho 'E: Failed getting release file'\nexit 1\n")
    tool.chmod(0o755)
    monkeypatch.setattr(shutil, "which", lambda name, path=None: str(tool))
    monkeypatch.setattr(sys, "argv", [str(SCRIPT), str(tmp_path / "arm"), "--mirror", "http://mirror.invalid"])
    assert script["main"]() == script["NOT_TRIED"]
    assert capsys.readouterr().err.endswith(
        "Debian's packages from http://mirror.invalid could not be had: debootstrap ended with status 1: "
        "E: Failed getting release file\n"
    )
