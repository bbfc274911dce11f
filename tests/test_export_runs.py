"""A compiled detector's file as a program: ended, damaged and without a place for its output, it says one sentence."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
import zipfile
from pathlib import Path
from typing import Any

import pytest
from live_samples import exported, wandering

from jaxradar.export import write_archive
from jaxradar.live.app import main as device_main
from jaxradar.live.artefact import HEADER, read_artefact
from jaxradar.logs import write_log
from jaxradar.motion import MOTION_FIELDS


@pytest.fixture
def log(tmp_path: Path) -> Path:
    write_log(wandering(), tmp_path / "log.drive")
    return tmp_path / "log.drive"


def command(file: Path, log: Path, *options: str) -> list[str]:
    return [sys.executable, "-I", str(file), "--source", "replay", str(log), *options]


def ended(file: Path, log: Path, *options: str, output: int | None = None) -> tuple[int, str, str]:
    """Status, output and errors."""
    ran = subprocess.run(
        command(file, log, *options),
        stdout=subprocess.PIPE if output is None else output,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
        timeout=120,
    )
    return ran.returncode, ran.stdout or "", ran.stderr


@pytest.mark.parametrize(("first", "second"), [(signal.SIGINT, signal.SIGINT), (signal.SIGTERM, signal.SIGINT)])
def test_of_two_signals_the_second_costs_nothing(first: int, second: int, log: Path) -> None:
    with subprocess.Popen(
        command(exported("thesis"), log, "--pace", "0.02"), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        said = process.stdout.readline()
        process.send_signal(first)
        process.send_signal(second)
        _, errors = process.communicate(timeout=60)
    assert "step 0.3" in said
    assert process.returncode in (128 + first, 128 + second)
    assert len(errors.splitlines()) == 1
    assert " sweeps in " in errors


def test_ctrl_c_before_the_first_sweep_shows_no_traceback(log: Path, tmp_path: Path) -> None:
    """While a log is opened: here one that never begins."""
    os.mkfifo(tmp_path / "late.csv")
    with subprocess.Popen(
        command(exported("thesis"), tmp_path / "late.csv"), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        time.sleep(2.0)  # Python has started; nothing is measured
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=60)
    assert process.returncode in (-signal.SIGINT, 128 + signal.SIGINT)
    assert "Traceback" not in errors


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no full device")
@pytest.mark.parametrize("options", [[], ["--json"]], ids=str)
def test_output_that_cannot_be_written_is_one_sentence(options: list[str], log: Path) -> None:
    with Path("/dev/full").open("w") as full:
        status, _, errors = ended(exported("thesis"), log, "--fast", *options, output=full.fileno())
    assert status == 1
    assert errors.splitlines()[-1] == "thesis.pyz: standard output: No space left on device."


def test_a_name_that_no_file_can_have(tmp_path: Path) -> None:
    status, output, errors = ended(exported("thesis"), tmp_path / ("a" * 300), "--fast")
    assert (status, output) == (1, "")
    assert errors.endswith("File name too long.\n")
    assert len(errors.splitlines()) == 1


def test_damaged_code_is_not_run(log: Path, tmp_path: Path) -> None:
    """Python itself does not notice: it compares no checksum of a module in an archive."""
    write_archive(tmp_path / "step.pyz", read_artefact(exported("thesis")))
    whole = (tmp_path / "step.pyz").read_bytes()
    begin, end = whole.index(b"jaxradar/__init__.py"), whole.index(b"PK\x01\x02")  # of the directory
    damage = random.Random(0)
    for _ in range(12):
        place = damage.randrange(begin, end)
        changed = whole[:place] + bytes([whole[place] ^ 1 << damage.randrange(8)]) + whole[place + 1 :]
        (tmp_path / "step.pyz").write_bytes(changed)
        status, output, errors = ended(tmp_path / "step.pyz", log, "--fast")
        assert (status, output, len(errors.splitlines())) == (2, "", 1), errors
        assert "is damaged" in errors


def test_ctrl_c_while_python_itself_ends_shows_no_traceback(log: Path) -> None:
    """Of `jaxradar live`, which has JAX to take down."""
    words = [
        "-m",
        "jaxradar",
        "live",
        "--source",
        "replay",
        str(log),
        "--fast",
        "--sweeps",
        "1",
        "--detector",
        "thesis",
    ]
    with subprocess.Popen([sys.executable, *words], stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        said = process.stderr.readline()
        time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        rest = process.stderr.read()
    assert said.startswith("1 sweeps in ")
    assert "Traceback" not in rest


def test_neither_a_device_nor_a_pipe_is_read_for_a_detector(log: Path, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.pyz")
    for file in (tmp_path / "pipe.pyz", Path("/dev/zero")):
        status, output, errors = ended(exported("thesis"), log, "--detector", str(file))
        assert (status, output) == (2, "")
        assert errors.endswith("is a device or a pipe; expected a file that `jaxradar export` made.\n")


@pytest.mark.parametrize(
    "changes", [{"state": [0.0]}, {"vectors": "float32"}, {"motion": list(MOTION_FIELDS)}], ids=str
)
def test_a_header_of_another_program_is_refused(
    changes: dict[str, Any], log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The program is whole and what its hash says, but takes other vectors."""
    write_archive(tmp_path / "step.pyz", read_artefact(exported("thesis")))
    with zipfile.ZipFile(tmp_path / "step.pyz") as archive:
        held = {name: archive.read(name) for name in archive.namelist()}
    held[HEADER] = json.dumps(json.loads(held[HEADER]) | changes).encode()
    file = tmp_path / "changed.pyz"
    with zipfile.ZipFile(file, "w") as archive:
        for name, content in held.items():
            archive.writestr(name, content)
    assert device_main(["--source", "replay", str(log), "--detector", str(file), "--fast"]) == 2
    said = capsys.readouterr()
    assert (said.out, len(said.err.splitlines())) == ("", 1)
    assert "does not take what its header says; export it again." in said.err
