"""What happens to the whole program in a car: killed, a disk that fills up, a clock set back, a compiled detector
exchanged for a damaged one; in processes of their own."""

from __future__ import annotations

import fcntl
import json
import os
import pty
import re
import select
import shutil
import signal
import socket
import struct
import subprocess
import sys
import termios
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from board import Board, frames, until
from live_samples import exported
from test_live_recorder import drives
from test_live_service import command, log, ran, summary

from jaxradar.drivefile import read_drive
from jaxradar.live.board import Fault

__all__ = ["log"]  # a fixture

HERE = str(Path(__file__).parent)
SOAK = Path(__file__).parents[1] / "benches" / "soak.py"


@pytest.mark.parametrize("kills", [pytest.param(200, marks=pytest.mark.long), 3])
def test_killed_at_any_moment_with_all_of_it_running(kills: int, log: Path, tmp_path: Path) -> None:
    """By SIGKILL: what is on the disk is the log as it was, from its first sweep on and without a gap, up to the sweep
    of which the board was told last but for the one or two that were just coming; each line of the event log is
    whole; and the next start finds nothing in its way."""
    random = np.random.default_rng(kills)
    (one,) = read_drive(log).sensors
    records, events = tmp_path / "records", tmp_path / "events"
    lost = []
    with Board(tmp_path / "board", "nucleo", tmp_path / "bytes") as board:
        options = ["--link", "nucleo", "--port", str(tmp_path / "board"), "--record", str(records)]
        for _ in range(kills):
            before = len(board.bytes())
            child = subprocess.Popen(
                [*command(log, *options), "--events", str(events)], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
            )
            until(lambda before=before: len(board.bytes()) > before)
            time.sleep(random.random() * 0.5)
            child.send_signal(signal.SIGKILL)
            child.communicate()
            time.sleep(0.02)
            told = len(board.bytes()) - before
            found = drives(records)
            assert len(found) <= 1
            kept = sum(len(drive.sensors[0]) for drive in found)
            for drive in found:
                np.testing.assert_array_equal(drive.sensors[0].sweeps, one.sweeps[:kept])
                np.testing.assert_array_equal(drive.sensors[0].times_ns, one.times_ns[:kept])
            lost.append(told - kept)
            shutil.rmtree(records, ignore_errors=True)
    assert np.median(lost) <= 2
    assert max(lost) <= 20  # a tenth of a second or two, on a machine that is busy just then
    kinds = [key for line in events.read_text().splitlines() for key in json.loads(line)]
    assert kinds.count("begin") == kills
    assert "end" not in kinds
    assert ran(log, *options, "--fast").returncode == 0


TMPFS = """
import json, os, subprocess, sys, threading, time
from pathlib import Path
sys.path.insert(0, {tests!r})
from test_live_recorder import drives
folder, command = Path({folder!r}), {command!r}
subprocess.run(["mount", "-t", "tmpfs", "-o", "size=128k", "none", str(folder)], check=True)
(folder / "other").write_bytes(bytes(100_000))
child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
time.sleep({room_after})
(folder / "other").unlink()
out, errors = child.communicate()
found = [len(drive.sensors[0]) for drive in drives(folder)]
times = [drive.sensors[0].times_ns.tolist() for drive in drives(folder)]
print(json.dumps({{"out": out, "errors": errors, "status": child.returncode, "kept": found, "times": times}}))
"""


def test_a_disk_that_fills_up_and_has_room_again(log: Path, tmp_path: Path) -> None:
    """A small file system of its own: the recorder says so, the board hears of it and of steps all the same, and when
    there is room again a new drive begins."""
    alone = ["unshare", "--user", "--map-root-user", "--mount"]
    if shutil.which("unshare") is None or subprocess.run([*alone, "true"], check=False, capture_output=True).returncode:
        pytest.skip("no namespaces here, in which a small file system could be mounted")
    folder = tmp_path / "small"
    folder.mkdir()
    with Board(tmp_path / "board", "framed", tmp_path / "bytes") as board:
        options = ["--link", "framed", "--port", str(tmp_path / "board"), "--record", str(folder), "--json"]
        code = TMPFS.format(
            tests=HERE, folder=str(folder), command=command(log, *options, "--pace", "0.3"), room_after=5.0
        )
        held = subprocess.run([*alone, sys.executable, "-c", code], capture_output=True, text=True, check=False)
        sent = board.bytes()
    assert held.returncode == 0, held.stderr
    found = json.loads(held.stdout)
    assert found["status"] == 0, found["errors"]
    assert "No space left on device" in found["errors"]
    assert "recording again" in found["errors"]
    assert "Traceback" not in found["errors"]
    recorded = summary(found["out"])["recorded"]
    assert isinstance(recorded, dict)
    assert sum(found["kept"]) == recorded["sweeps"] > 0
    assert recorded["dropped"] > 0
    assert recorded["sweeps"] + recorded["dropped"] == summary(found["out"])["sweeps"]
    assert len(found["times"]) >= 2
    (one,) = read_drive(log).sensors
    first, last = found["times"][0], found["times"][-1]
    assert first == one.times_ns[: len(first)].tolist()  # each drive's times begin with its first sweep
    assert np.diff(last).tolist() == np.diff(one.times_ns[-len(last) :]).tolist()
    flags = [Fault.RECORDER in Fault(frame.faults) for frame in frames(sent)]
    assert 0 < sum(flags) < len(flags)


CLOCK = """
import time
begun, set_back, true_ns, true_s = time.monotonic(), 3600.0, time.time_ns, time.time
def back():
    return set_back if time.monotonic() - begun > {after} else 0.0
time.time_ns = lambda: true_ns() - int(back() * 1e9)
time.time = lambda: true_s() - back()
"""


def test_a_clock_set_back_by_an_hour(log: Path, tmp_path: Path) -> None:
    """Sweeps, deadlines and the board go by a clock that only goes on; names of drives do not collide."""
    (tmp_path / "sitecustomize.py").write_text(CLOCK.format(after=1.5))
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])}
    options = ["--record", str(tmp_path / "records"), "--rotate-min", "0.005", "--json", "--pace", "0.5"]
    found = ran(log, *options, env=environment)
    assert found.returncode == 0, found.stderr
    count = summary(found.stdout)
    (one,) = read_drive(log).sensors
    names = [path.name for path in (tmp_path / "records").iterdir()]
    assert len({re.sub(r":?-?\d\d-\d\dZ.*", "", name) for name in names}) == 2  # two hours are in the names
    parts = [read_drive(path) for path in (tmp_path / "records").iterdir()]
    assert count["sweeps"] == len(one)
    assert sum(len(part.sensors[0]) for part in parts) == len(one)
    again = ran(log, "--json", "--fast")
    assert found.stdout.splitlines()[:-1] == again.stdout.splitlines()[:-1]


def test_a_compiled_detector_exchanged_for_a_damaged_one(log: Path, tmp_path: Path) -> None:
    """What runs goes on with what it has read; what starts then says what is wrong, in one sentence, and touches
    neither the board's line nor the folder."""
    archive = tmp_path / "step.pyz"
    shutil.copy(exported("filtered-rate"), archive)
    options = ["--source", "replay", str(log), "--json", "--record", str(tmp_path / "records")]
    child = subprocess.Popen([sys.executable, str(archive), *options], stdout=subprocess.PIPE, text=True)
    until(lambda: (tmp_path / "records").exists() and any((tmp_path / "records").glob("*Z.drive")))
    content = bytearray(archive.read_bytes())
    middle = content.find(b"step.vmfb") + 2000
    content[middle : middle + 64] = bytes(64)
    fresh = archive.with_suffix(".new")
    fresh.write_bytes(content)
    fresh.replace(archive)
    out, _ = child.communicate(timeout=60)
    assert child.returncode == 0
    again = ran(log, "--json", "--fast")
    assert out.splitlines()[:-1] == again.stdout.splitlines()[:-1]
    shutil.rmtree(tmp_path / "records")
    for start in (
        [sys.executable, str(archive)],
        [sys.executable, "-m", "jaxradar", "live", "--detector", str(archive)],
    ):
        damaged = subprocess.run([*start, *options], capture_output=True, text=True, check=False, timeout=60)
        assert damaged.returncode == 2
        assert len(damaged.stderr.splitlines()) == 1
        assert "step.pyz" in damaged.stderr
        assert not (tmp_path / "records").exists()


def shown(child: subprocess.Popen[bytes], master: int, seconds: float = 60.0) -> str:
    """What a program writes to its terminal until it ends."""
    content, end = b"", time.monotonic() + seconds
    while time.monotonic() < end:
        ready, _, _ = select.select([master], [], [], 0.1)
        if not ready:
            if child.poll() is not None:
                break
            continue
        try:
            content += os.read(master, 4096)
        except OSError:  # closed at the other end
            break
    return content.decode()


@pytest.mark.parametrize(("quiet", "columns"), [(False, 150), (False, 60), (True, 150)])
def test_the_display_on_a_terminal(quiet: bool, columns: int, log: Path, tmp_path: Path) -> None:
    """One line, written over; with a board that is gone in the middle, which it says, and says when it is back."""
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
    place = tmp_path / "board"
    board = Board(place, "nucleo")
    options = ["--link", "nucleo", "--port", str(place), "--record", str(tmp_path / "records"), "--pace", "0.5"]
    child = subprocess.Popen([*command(log, *options), *(["--quiet"] if quiet else [])], stdout=slave, stderr=slave)
    os.close(slave)

    def unplug() -> None:
        until(lambda: (tmp_path / "records").exists() and any((tmp_path / "records").glob("*Z.drive")))
        board.kill()
        time.sleep(0.5)
        nonlocal again
        again = Board(place, "nucleo")

    again = board
    other = threading.Thread(target=unplug)
    other.start()
    text = shown(child, master)
    other.join()
    again.kill()
    os.close(master)
    assert child.wait(20) == 0
    parts = [re.sub(r"\x1b\[\w*", "", part).strip() for part in re.split(r"[\r\n]+", text)]
    lines = [part for part in parts if re.match(r"\d+\.\d s ", part)]
    assert any("Trying again" in part for part in parts)
    assert any("the board is there" in part for part in parts)
    assert any("sensor 3: step" in part for part in parts)
    if quiet:
        assert lines == []
        return
    assert len(lines) >= 5
    assert "all well" in lines[-1]
    assert max(map(len, lines)) < columns
    if columns == 150:
        assert any("board away" in line for line in lines)
        assert all(" m/s" in line and "recorded" in line and " of " in line for line in lines[1:])


def test_a_stopped_program_no_longer_tells_the_watchdog_that_it_is_alive(log: Path, tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.settimeout(20)
        environment = {**os.environ, "NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "200000"}
        child = subprocess.Popen(
            command(log, "--pace", "0.1"), env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        try:
            while not manager.recv(4096).startswith(b"WATCHDOG=1"):
                pass
            child.send_signal(signal.SIGSTOP)
            time.sleep(0.1)
            manager.settimeout(0.5)
            with pytest.raises(TimeoutError):
                while manager.recv(4096):
                    pass
            child.send_signal(signal.SIGCONT)
            manager.settimeout(20)
            assert manager.recv(4096).startswith(b"WATCHDOG=1")
        finally:
            child.kill()
            child.wait()


@pytest.mark.parametrize("sweeps", [pytest.param(3_000_000, marks=pytest.mark.long), 40_000])
def test_memory_does_not_grow(sweeps: int, log: Path, tmp_path: Path) -> None:
    """As fast as it goes, with a board and the recorder, from a tenth of the sweeps on; 3 million are 3 h at 300 Hz."""
    with Board(tmp_path / "board", "nucleo"):
        arguments = [log, exported("filtered-rate"), tmp_path / "board", tmp_path / "records", sweeps]
        found = subprocess.run(
            [sys.executable, str(SOAK), *map(str, arguments)], capture_output=True, text=True, check=False
        )
    assert found.returncode == 0, found.stderr
    record = json.loads(found.stdout)
    assert record["tally"]["sweeps"] == record["tally"]["recorded"]["sweeps"] == sweeps
    assert record["tally"]["recorded"]["dropped"] == 0
    assert record["late_kb"] - record["early_kb"] <= 1000
