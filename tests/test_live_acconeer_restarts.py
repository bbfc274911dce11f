"""An exploration server that falls silent, is killed and started again, under the maker's client; the board hears."""

from __future__ import annotations

import dataclasses
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import exploration_server
import pytest
from board import Board
from exploration_server import needs_client
from test_live_faults import BINS, HEADER, Once, Watching

from jaxradar.live import AcconeerSource
from jaxradar.live.board import Fault
from jaxradar.live.detect import LiveDetector
from jaxradar.live.run import run
from jaxradar.live.telling import Telling
from jaxradar.live.wires import Nucleo

RATE_HZ = 100.0


class Server:
    """The process; a second on the same port is the same server started again."""

    def __init__(self, port: int) -> None:
        command = [sys.executable, exploration_server.__file__, str(port), "2000", str(1.0 / RATE_HZ)]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        assert self.process.stdout.readline() == "ready\n"

    def kill(self) -> None:
        self.process.kill()
        self.process.communicate()


@pytest.fixture
def port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        return int(taken.getsockname()[1])


@needs_client
def test_it_is_silent_then_killed_then_started_again(port: int, tmp_path: Path) -> None:
    server, watching = Server(port), Watching()
    sensor = AcconeerSource("127.0.0.1", port=port, rate_hz=RATE_HZ, sensors=(1,), bins=BINS, timeout_s=1.0)
    over = threading.Event()

    def weather() -> None:
        time.sleep(0.5)
        server.process.send_signal(signal.SIGSTOP)
        time.sleep(0.3)
        server.process.send_signal(signal.SIGCONT)
        time.sleep(0.5)
        server.kill()
        time.sleep(0.8)
        again = Server(port)
        time.sleep(1.5)
        over.set()
        time.sleep(0.5)
        again.kill()

    with Board(tmp_path / "board", "nucleo", tmp_path / "bytes") as board, sensor:
        header = dataclasses.replace(HEADER, range_m=tuple(sensor.range_m.tolist()))
        telling = Telling(str(tmp_path / "board"), Nucleo(), hold_s=1000.0)
        other = threading.Thread(target=weather)
        other.start()
        tally = run(sensor, LiveDetector(header, Once()), [telling, watching], again=True, stop=over.is_set)
        other.join()
        time.sleep(0.1)
        sent = board.bytes()
    assert tally.reopened == 1
    assert len(watching.lost_at) >= 1
    assert len(sent) == len(watching.rounds) + 1
    detected = next(place for place, byte in enumerate(sent) if byte)
    assert [byte == 1 for byte in sent[detected:-1]] == [not faults for _, faults in watching.rounds[detected:]]
    kinds = [faults for _, faults in watching.rounds]
    silent = [place for place, faults in enumerate(kinds) if faults == Fault.SENSOR_SILENT]
    lost = [place for place, faults in enumerate(kinds) if Fault.SENSOR_LOST in faults]
    assert len(silent) >= 15  # each period of 0.3 s, on a machine that may be busy
    assert min(lost) > min(silent)
    assert len(lost) >= 40
    assert not any(kinds[-20:])  # it came back
