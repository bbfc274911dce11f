"""A small exploration server: what Acconeer's answers over TCP, replaying a recorded drive, and the ways it can fail.

A message is one line of JSON with `payload_size`, then so many bytes; sweeps are little-endian uint16, those of all
sensors of a group one after the other. Written from what the maker's client (acconeer-exptool 7.18) sends and expects,
and from the `session_info` and `data_info` of real recordings.
"""

from __future__ import annotations

import contextlib
import importlib.util
import itertools
import json
import socket
import sys
import threading
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from jaxradar.drive import MAKERS_FLAGS, Drive, SensorSeries
from jaxradar.live import AcconeerSource, LiveSweep

RSS_VERSION = "a111-v2.15.5"
STEP_M = 0.000484
BINS = 1447

needs_client = pytest.mark.skipif(
    importlib.util.find_spec("acconeer") is None, reason="acconeer-exptool is not installed: jaxradar[acconeer]"
)


def recorded(sensors: tuple[int, ...] = (1, 3), sweeps: int = 12, bins: int = BINS, start_m: float = 0.1) -> Drive:
    """Noise over all 16 bits at 100 Hz, in range bins as the A111 has them."""
    rng = np.random.default_rng(5)
    axis = start_m + STEP_M * np.arange(bins)
    times = np.arange(sweeps, dtype=np.int64) * 10_000_000
    return Drive(
        tuple(
            SensorSeries(
                number,
                times,
                rng.integers(0, 65536, (sweeps, bins)).astype(np.uint16),
                axis,
                np.zeros(sweeps, np.uint16),
            )
            for number in sensors
        )
    )


def message(payload: bytes = b"", **header: Any) -> bytes:
    return json.dumps(header | {"payload_size": len(payload)}).encode() + b"\n" + payload


class ExplorationServer:
    """Serves one client after another on a port of its own, or on `port`, until the `with` block ends.

    - `drive`: sensors of one range axis, equally many sweeps each; sent `period_s` apart.
    - `answers`: in place of the server's own answer to a command, by its name: bytes, or None for no answer at all.
    - `ending`: what comes after the last sweep: bytes, after which the connection is closed, or None: silence.
    - `metadata`: keys of the answer to the set-up that are to be other, for each sensor.

    `commands`: all that clients have sent, in order.
    """

    def __init__(
        self,
        drive: Drive,
        *,
        period_s: float = 0.002,
        answers: Mapping[str, bytes | None] | None = None,
        ending: bytes | None = None,
        metadata: Mapping[int, Mapping[str, Any]] | None = None,
        port: int = 0,
    ) -> None:
        self.drive = drive
        self.period_s = period_s
        self.answers = answers or {}
        self.ending = ending
        self.metadata = metadata or {}
        self.commands: list[dict[str, Any]] = []
        self._over = threading.Event()
        self._stopped = threading.Event()
        self._listener = socket.create_server(("127.0.0.1", port))
        self.port: int = self._listener.getsockname()[1]
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def __enter__(self) -> ExplorationServer:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._stopped.set()
        self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self._thread.join(10)
        assert not self._thread.is_alive()

    def names(self) -> list[str]:
        return [command["cmd"] for command in self.commands]

    def _serve(self) -> None:
        while not self._over.is_set():
            try:
                client, _ = self._listener.accept()
            except OSError:
                return
            client.settimeout(5)
            with client, contextlib.suppress(OSError):  # the client may go at any time
                self._answer(client)

    def _answer(self, client: socket.socket) -> None:
        streamer: threading.Thread | None = None
        self._stopped.clear()
        with client.makefile("rb") as lines:
            for line in lines:
                command = json.loads(line)
                assert command["api_version"] == 3
                self.commands.append(command)
                name = command["cmd"]
                if name in self.answers:
                    client.sendall(self.answers[name] or b"")
                elif name == "get_system_info":
                    info = {"rss_version": RSS_VERSION, "sensor": "a111", "sensor_count": 4, "hw": "xc112"}
                    client.sendall(message(status="ok", system_info=info))
                elif name == "setup":
                    client.sendall(message(status="ok", metadata=[self._described(command)]))
                elif name == "start_streaming":
                    client.sendall(message(status="start"))
                    streamer = threading.Thread(target=self._stream, args=(client,), daemon=True)
                    streamer.start()
                elif name == "stop_streaming":
                    self._stopped.set()
                    if streamer is not None:
                        streamer.join(5)
                    client.sendall(message(status="stop"))
                else:
                    client.sendall(message(status="error", message="unknown command"))
        self._stopped.set()
        if streamer is not None:
            streamer.join(5)

    def _described(self, command: dict[str, Any]) -> list[dict[str, Any]]:
        axis = self.drive.sensors[0].range_m
        step_m = float(axis[1] - axis[0])
        said = {
            "start_m": float(axis[0]),
            "length_m": step_m * (len(axis) - 1),
            "data_length": len(axis),
            "step_length_m": step_m,
            "stitch_count": 0,
        }
        asked = [sensor["sensor_id"] for group in command["groups"] for sensor in group]
        return [said | dict(self.metadata.get(number, {})) for number in asked]

    def _stream(self, client: socket.socket) -> None:
        with contextlib.suppress(OSError):
            for i in range(len(self.drive.sensors[0])):
                if self._stopped.wait(self.period_s):
                    return
                infos = [
                    {key: bool(series.flags[i] & flag) for key, flag in MAKERS_FLAGS.items()}
                    for series in self.drive.sensors
                ]
                payload = b"".join(series.sweeps[i].astype("<u2").tobytes() for series in self.drive.sensors)
                client.sendall(message(payload, status="ok", result_info=[infos]))
            if self.ending is not None:
                client.sendall(self.ending)
                client.shutdown(socket.SHUT_WR)


def source(server: ExplorationServer, **settings: Any) -> AcconeerSource:
    """The server as a source that keeps all bins and loses patience soon."""
    return AcconeerSource("127.0.0.1", port=server.port, **{"bins": None, "timeout_s": 0.5} | settings)


def main() -> None:
    """One of sensor 1 as a process of its own: `python tests/exploration_server.py PORT SWEEPS PERIOD_S`."""
    with ExplorationServer(recorded((1,), sweeps=int(sys.argv[2])), port=int(sys.argv[1]), period_s=float(sys.argv[3])):
        print("ready", flush=True)
        sys.stdin.read()


def take(opened: AcconeerSource, count: int) -> list[LiveSweep]:
    return list(itertools.islice(opened, count))


if __name__ == "__main__":
    main()
