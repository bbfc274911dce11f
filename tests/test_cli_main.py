"""What all commands share: help, usage errors, exit statuses, a closed pipe, Ctrl-C."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from jaxradar.cli import evaluate, main
from jaxradar.cli._output import _tenths

COMMANDS = [
    *(
        "demo",
        "info",
        "view",
        "import",
        "evaluate",
        "label",
        "calibrate",
        "simulate",
        "tune",
        "frontier",
        "bench-detection",
    ),
    *("export", "live", "convert", "config"),
]


def said(capsys: pytest.CaptureFixture[str]) -> tuple[str, str]:
    captured = capsys.readouterr()
    return captured.out, captured.err


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_help_with_an_example(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([command, "--help"]) == 0
    out, err = said(capsys)
    assert err == ""
    assert f"example:\n  jaxradar {command}" in out
    assert max(map(len, out.splitlines())) <= 80


def test_help_lists_the_commands(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    out, _ = said(capsys)
    assert [line.split()[0] for line in out.split("COMMAND\n")[1].splitlines() if re.match(r" {4}\S", line)] == COMMANDS


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    import jaxradar

    assert main(["--version"]) == 0
    assert said(capsys)[0] == f"jaxradar {jaxradar.__version__}\n"


@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        ([], "COMMAND"),
        (["evalute", "x"], "'evalute'"),
        (["evaluate"], "PATH"),
        (["evaluate", "x", "--detektor", "thesis"], "--detektor"),
        (["evaluate", "x", "--det", "thesis"], "--det"),
        (["evaluate", "x", "--sensor", "-1"], "'-1'"),
        (["evaluate", "x", "--sensor", "one"], "'one'"),
        (["evaluate", "x", "--thin", "1"], "'1'"),
        (["evaluate", "x", "--window", "-0.1"], "'-0.1'"),
        (["evaluate", "x", "--start", "nan"], "'nan'"),
        (["evaluate", "x", "--start", "5", "--stop", "3"], "--start 5"),
        (["evaluate", "x", "--detector", "thesys"], "did you mean `thesis`?"),
        (["evaluate", "x", "--detector", "absent.toml"], "absent.toml"),
        (["view", "x", "--detector", "defualt"], "did you mean `default`?"),
        (["view", "x", "--start", "5", "--stop", "3"], "--stop 3"),
        (["label", "x", "--acceleration", "0"], "'0'"),
        (
            ["config", "lab"],
            "expected thesis, lab-live, range-rate, filtered-rate, shift, approach, innovation, default",
        ),
        (["convert", "x", "x"], "same log"),
    ],
)
def test_wrong_usage_is_one_sentence_and_status_2(
    arguments: list[str], names: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    out, err = said(capsys)
    assert out == ""
    assert len(err.splitlines()) == 1
    assert names in err
    assert "Traceback" not in err


@pytest.mark.parametrize("command", ["info", "view", "evaluate", "label"])
def test_a_missing_log_is_one_sentence_and_status_1(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([command, str(tmp_path / "absent")]) == 1
    _, err = said(capsys)
    assert err == f"jaxradar: {tmp_path / 'absent'}: cannot be read: No such file or directory.\n"


@pytest.mark.parametrize("command", ["info", "view", "evaluate"])
def test_a_folder_without_logs_is_said_so(command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "notes.txt").write_text("nothing here")
    assert main([command, str(tmp_path)]) == 1
    _, err = said(capsys)
    assert len(err.splitlines()) == 1
    assert str(tmp_path) in err
    assert "logs" in err


def test_ctrl_c_ends_with_130_and_one_line(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(evaluate, "check_part", interrupted)
    assert main(["evaluate", "x"]) == 130
    assert said(capsys) == ("", "jaxradar: stopped.\n")


def test_a_closed_pipe_is_quiet() -> None:
    reader = subprocess.Popen(
        [sys.executable, "-c", "import sys; sys.stdin.close()"], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL
    )
    reader.wait()
    writer = subprocess.run(
        [sys.executable, "-m", "jaxradar", "config", "thesis"], stdout=reader.stdin, stderr=subprocess.PIPE, check=False
    )
    assert (writer.returncode, writer.stderr) == (141, b"")


@pytest.mark.parametrize("name", ["thesis", "lab-live", "default"])
def test_config_prints_a_file_that_can_be_used(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from jaxradar.systems.step import load_detector

    assert main(["config", name]) == 0
    text, _ = said(capsys)
    (tmp_path / "mine.toml").write_text(text)
    assert load_detector(tmp_path / "mine.toml").detector.name == name
    assert main(["config", str(tmp_path / "mine.toml")]) == 0
    assert said(capsys)[0] == text


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
@pytest.mark.parametrize("arguments", [["config", "thesis"], ["--help"], ["--version"]], ids=" ".join)
@pytest.mark.parametrize("buffered", ["", "1"], ids=["buffered", "unbuffered"])
def test_a_full_disk_behind_the_output_is_one_sentence(arguments: list[str], buffered: str) -> None:
    """`argparse` itself keeps quiet about its help where nothing is buffered."""
    if buffered and arguments == ["--help"]:
        pytest.skip("argparse drops the error")
    with Path("/dev/full").open("w") as full:
        ran = subprocess.run(
            [sys.executable, "-m", "jaxradar", *arguments],
            stdout=full,
            stderr=subprocess.PIPE,
            check=False,
            env={"PYTHONUNBUFFERED": buffered},
        )
    assert (ran.returncode, ran.stderr) == (1, b"jaxradar: standard output: No space left on device.\n")


@pytest.mark.parametrize("closed", [1, 2])
def test_a_stream_that_the_caller_closed(closed: int) -> None:
    """An error must not go to standard output for want of another place."""
    command = f"{sys.executable} -m jaxradar config {'thesis' if closed == 1 else 'lab'} {closed}>&-"
    ran = subprocess.run(command, shell=True, capture_output=True, check=False)
    assert (ran.returncode, ran.stdout, ran.stderr) == (0 if closed == 1 else 2, b"", b"")


def test_ctrl_c_leaves_the_process_at_once() -> None:
    """A compilation that was broken off crashes the interpreter when it takes its modules apart."""
    program = (
        "import atexit, os, sys; from jaxradar.cli import evaluate, main\n"
        "def interrupted(*_): raise KeyboardInterrupt\n"
        "evaluate.check_part = interrupted; atexit.register(os.abort)\n"
        "sys.argv = ['jaxradar', 'evaluate', 'x']; sys.exit(main())"
    )
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, check=False)
    assert (ran.returncode, ran.stdout, ran.stderr) == (130, b"", b"jaxradar: stopped.\n")


def test_long_work_says_each_tenth_off_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    told = _tenths("driving", quiet_s=0.0)
    for share in (0.05, 0.11, 0.12, 0.31, 1.0):
        told("a cell", share)
    assert capsys.readouterr().err.splitlines() == [f"jaxradar: driving: {tenth} %, a cell" for tenth in (10, 30, 100)]
    _tenths("driving")("a cell", 0.5)
    assert capsys.readouterr().err == ""
