"""`jaxradar live` as it runs in a car: board, recorder, faults, signals, systemd, each in a process of its own."""

from __future__ import annotations

import dataclasses
import itertools
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from board import Board, frames, until
from live_samples import exported, ready_drive
from test_live_rules import transcribed

from jaxradar.drive import Drive
from jaxradar.drivefile import read_drive, write_drive
from jaxradar.live.board import Fault

PROGRAM = [sys.executable, "-m", "jaxradar", "live", "--source", "replay"]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("log") / "ready.drive"
    write_drive(ready_drive(), path)
    return path


def command(log: Path, *options: str) -> list[str]:
    return [*PROGRAM, str(log), "--detector", str(exported("filtered-rate")), *options]


def ran(log: Path, *options: str, **more: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command(log, *options), capture_output=True, text=True, check=False, timeout=60, **more)  # type: ignore[call-overload, no-any-return]


def summary(text: str) -> dict[str, object]:
    found = json.loads(text.splitlines()[-1])["summary"]
    assert isinstance(found, dict)
    return found


def told(content: bytes) -> list[tuple[int, int]]:
    """Runs of equal bytes: which, and how many."""
    cuts = [0, *(np.flatnonzero(np.diff(np.frombuffer(content, np.uint8))) + 1).tolist(), len(content)]
    return [(content[low], high - low) for low, high in itertools.pairwise(cuts)]


def test_a_board_is_told_and_all_is_recorded(log: Path, tmp_path: Path) -> None:
    (one,) = read_drive(log).sensors
    with Board(tmp_path / "board", "nucleo", tmp_path / "bytes") as board:
        found = ran(
            log,
            *("--link", "nucleo", "--port", str(tmp_path / "board"), "--record", str(tmp_path / "records")),
            *("--events", str(tmp_path / "events"), "--json", "--hold", "0.05"),
        )
        time.sleep(0.2)
        sent = board.bytes()
    assert found.returncode == 0, found.stderr
    count = summary(found.stdout)
    period_s = float(np.median(np.diff(one.times_ns))) / 1e9
    assert len(sent) == len(one) + 1 + int(str(count["silent"]))
    runs = told(sent)
    assert runs[0][0] == runs[-1][0] == 0
    assert sum(length for byte, length in runs if byte == 1) >= 0.5 * 0.05 / period_s
    assert {byte for byte, _ in runs} == {0, 1}
    (record,) = (tmp_path / "records").iterdir()
    again = read_drive(record)
    np.testing.assert_array_equal(again.sensors[0].sweeps, one.sweeps)
    np.testing.assert_array_equal(again.sensors[0].flags, one.flags)
    np.testing.assert_array_equal(again.sensors[0].times_ns, one.times_ns)
    assert again.motion.acceleration_m_s2 is not None
    assert set(again.motion.acceleration_m_s2.values.tolist()) == {9.0}
    assert again.problems == ()
    lines = [json.loads(line) for line in (tmp_path / "events").read_text().splitlines()]
    printed = [json.loads(line)["event"] for line in found.stdout.splitlines()[:-1]]
    assert [line["event"] for line in lines if "event" in line] == printed
    assert list(lines[0])[1] == "begin"
    assert list(lines[-1])[1] == "end"
    # What was recorded is a log like any other: the same detections.
    repeated = ran(record, "--json", "--fast")
    assert [json.loads(line)["event"] for line in repeated.stdout.splitlines()[:-1]] == printed


def test_frames_carry_the_detection_and_its_end(log: Path, tmp_path: Path) -> None:
    with Board(tmp_path / "board", "framed", tmp_path / "bytes") as board:
        found = ran(log, "--link", "framed", "--port", str(tmp_path / "board"), "--json")
        time.sleep(0.2)
        sent = frames(board.bytes())
    assert found.returncode == 0, found.stderr
    events = len(found.stdout.splitlines()) - 1
    assert events >= 1
    numbers = [frame.number for frame in sent]
    assert numbers == sorted(numbers)
    assert numbers[-1] == events
    assert any(frame.event for frame in sent)
    assert (sent[-1].faults, sent[-1].event) == (Fault.STOPPING, 0)


def test_without_a_board_it_runs_and_says_so(log: Path, tmp_path: Path) -> None:
    found = ran(log, "--link", "nucleo", "--port", str(tmp_path / "nothing"), "--json", "--pace", "5")
    assert found.returncode == 0
    board = summary(found.stdout)["board"]
    assert isinstance(board, dict)
    assert (board["told"], board["opened"]) == (0, 0)
    assert board["dropped"] > 100
    assert "cannot be opened (No such file or directory)" in found.stderr


def test_systemd_is_told_that_it_is_ready_alive_and_stopping(log: Path, tmp_path: Path) -> None:
    place = tmp_path / "notify"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(place))
        manager.settimeout(20)
        environment = {**os.environ, "NOTIFY_SOCKET": str(place), "WATCHDOG_USEC": "200000"}
        child = subprocess.Popen(
            command(log), env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        assert child.stderr is not None
        assert manager.recv(4096).startswith(b"READY=1\nSTATUS=")
        assert manager.recv(4096).startswith(b"WATCHDOG=1\nSTATUS=")
        child.send_signal(signal.SIGTERM)
        last = b""
        while last != b"STOPPING=1":
            last = manager.recv(4096)
        assert child.wait(20) == 128 + signal.SIGTERM
        assert "sweeps in" in child.stderr.read()
        child.stderr.close()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_a_signal_leaves_a_safe_board_and_a_sealed_record(number: signal.Signals, log: Path, tmp_path: Path) -> None:
    """While a step is told: the last byte takes it back."""
    options = ["--link", "nucleo", "--port", str(tmp_path / "board"), "--hold", "1000", "--pace", "0.5"]
    with Board(tmp_path / "board", "nucleo", tmp_path / "bytes") as board:
        child = subprocess.Popen(
            command(log, *options, "--record", str(tmp_path / "records")),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        until(lambda: len(board.bytes()) >= 30 and board.bytes()[-1] == 1)
        child.send_signal(number)
        _, errors = child.communicate(timeout=20)
        assert child.returncode == 128 + number
        until(lambda: board.bytes()[-1] == 0)
    assert "Traceback" not in errors
    (record,) = (tmp_path / "records").iterdir()
    drive = read_drive(record)
    assert drive.problems == ()
    assert len(drive.sensors[0]) >= 15  # a busy machine has bytes without a sweep among those 30


def test_the_unit_runs_this_very_command(log: Path, tmp_path: Path) -> None:
    found = ran(log, "--record", "dir with blanks", "--print-unit", cwd=tmp_path)
    assert found.returncode == 0
    lines = found.stdout.splitlines()
    (line,) = [line for line in lines if line.startswith("ExecStart=")]
    assert line.endswith('--record "dir with blanks"')
    assert "--print-unit" not in line
    assert f"WorkingDirectory={tmp_path}" in lines
    assert "Type=notify" in lines
    assert "SuccessExitStatus=129 130 143" in lines
    assert "StartLimitIntervalSec=0" in lines[: lines.index("[Service]")]  # where systemd looks for it


def test_the_unit_is_one_that_systemd_takes(log: Path, tmp_path: Path) -> None:
    if shutil.which("systemd-analyze") is None:
        pytest.skip("systemd is not installed")
    (tmp_path / "radar.service").write_text(ran(log, "--record", "100 % $HOME", "--print-unit", cwd=tmp_path).stdout)
    found = subprocess.run(
        ["systemd-analyze", "verify", str(tmp_path / "radar.service")], capture_output=True, text=True, check=False
    )
    assert found.returncode == 0, found.stderr
    assert "radar.service" not in found.stderr  # nor is a line of it passed over


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--port", "/dev/ttyACM0"], "--port goes with --link"),
        (["--rotate-min", "3", "--print-unit"], "--rotate-min goes with --record"),
        (["--rotate-mb", "3"], "--rotate-mb goes with --record"),
        (["--link", "framed", "--count", "2"], "--count goes with --link nucleo"),
        (["--link", "nucleo", "--rule", "distance", "--hold", "1"], "--hold is of detections"),
        (["--print-unit", "--rotate-mb", "3"], "--rotate-mb goes with --record"),
        (["--record", ""], "--record is empty"),
        (["--record", "/proc/nowhere"], "/proc/nowhere: cannot be made a folder for drives"),
        (["--events", "/proc/nowhere/log"], "/proc/nowhere/log: cannot be written"),
    ],
)
def test_options_that_do_not_go_together(options: list[str], sentence: str, log: Path) -> None:
    found = ran(log, *options)
    assert found.returncode == 2
    assert sentence in found.stderr
    assert len(found.stderr.splitlines()) == 1


@pytest.mark.parametrize("rule", ["distance", "distance-mended"])
def test_the_lab_s_rule_byte_for_byte(rule: str, tmp_path: Path) -> None:
    """Over a drive whose strongest echo is nearer than 0.15 m now and then, faint or equal to another; as fast as it
    goes, for a byte that is safe because a sweep is late would differ."""
    (one,) = ready_drive().sensors
    random = np.random.default_rng(0)
    sweeps = random.integers(0, 900, one.sweeps.shape).astype(np.uint16)
    places = random.integers(0, 40, len(one))
    sweeps[np.arange(len(one)), places] = random.integers(900, 1200, len(one))
    sweeps[::7] = np.minimum(sweeps[::7], 800)
    sweeps[::5, 30] = sweeps[::5].max(axis=1)
    drive = Drive((dataclasses.replace(one, sweeps=sweeps, flags=np.zeros_like(one.flags)),))
    write_drive(drive, tmp_path / "near.drive")
    length_m = (one.range_m[-1] - one.range_m[0]) * len(one.range_m) / (len(one.range_m) - 1)
    wanted = bytes(transcribed(sweeps, [0] * len(one), one.range_m[0], length_m, rule == "distance"))
    assert 0 < sum(wanted) < len(wanted)
    with Board(tmp_path / "board", "nucleo", tmp_path / "bytes") as board:
        found = ran(
            tmp_path / "near.drive",
            *("--link", "nucleo", "--port", str(tmp_path / "board"), "--rule", rule, "--json", "--fast"),
        )
        time.sleep(0.2)
        sent = board.bytes()
    assert found.returncode == 0, found.stderr
    assert sent == wanted + b"\x00"


def test_an_output_on_a_full_disk_is_told_at_the_end_and_the_board_all_the_while(log: Path, tmp_path: Path) -> None:
    with Board(tmp_path / "board", "nucleo", tmp_path / "bytes") as board, Path("/dev/full").open("w") as full:
        options = ["--link", "nucleo", "--port", str(tmp_path / "board"), "--events", "/dev/full"]
        found = subprocess.run(
            command(log, *options), stdout=full, stderr=subprocess.PIPE, text=True, check=False, timeout=60
        )
        time.sleep(0.2)
        sent = board.bytes()
    assert found.returncode == 1
    assert len(sent) > len(read_drive(log).sensors[0])
    assert "lines of the event log were not taken by the disk" in found.stderr
    assert "standard output: No space left on device" in found.stderr
