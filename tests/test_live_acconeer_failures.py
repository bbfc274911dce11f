"""Settings that no A111 has, and servers that fail in every way that was thought of: each is one sentence."""

from __future__ import annotations

import itertools
import math
import re
import socket
import sys
import threading
from typing import Any

import pytest
from exploration_server import BINS, ExplorationServer, message, needs_client, recorded, source, take

from jaxradar._errors import ConfigError, JaxradarError, SourceError
from jaxradar.live import AcconeerSource
from jaxradar.live.acconeer_link import ExplorationLink

HEAD = message(b"\0" * 4 * BINS, status="ok", result_info=[[{}, {}]])
ENDINGS = {
    "hangs up": (b"", "has closed the connection"),
    "hangs up within a line": (HEAD[:20], "has closed the connection"),
    "hangs up within a sweep": (HEAD[:3000], "has closed the connection"),
    "falls silent": (None, "has not answered for 0.51 s"),
    "garbage": (b"\xff\x00garbage\n", "is not understood while streaming"),
    "no line": (b"x" * (1 << 21), "sends no lines"),
    "no object": (b"[1, 2]\n", "is not understood"),
    "huge": (b'{"status": "ok", "payload_size": 99999999999999}\n', "announces a sweep of 99999999999999 bytes"),
    "no size": (b'{"status": "ok"}\n', "is not understood"),
    "too few bins": (message(b"\0" * 40, status="ok", result_info=[[{}, {}]]), "sends 10 bins of 2 sensors"),
    "half a bin": (message(b"\0" * 41, status="ok", result_info=[[{}, {}]]), "is not understood"),
    "one sensor": (message(b"\0" * 4 * BINS, status="ok", result_info=[[{}]]), "of 1 sensors"),
    "no infos": (message(b"\0" * 4 * BINS, status="ok", result_info=[[1, 2]]), "is not understood"),
    "error": (message(status="error", message="sensor 3 is gone"), "answers `error` while streaming: sensor 3 is gone"),
    "end": (message(status="end"), "answers `end` while streaming: without a reason"),
}


@needs_client
@pytest.mark.parametrize(("ending", "sentence"), ENDINGS.values(), ids=ENDINGS)
def test_a_server_that_fails_while_streaming_is_one_sentence(ending: bytes | None, sentence: str) -> None:
    with ExplorationServer(recorded(sweeps=3), ending=ending) as server:
        with source(server) as opened:
            sweeps = iter(opened)
            assert len(list(itertools.islice(sweeps, 6))) == 6  # all that came before
            with pytest.raises(SourceError, match=re.escape(sentence)) as error:
                next(sweeps)
        assert_sentence(error.value, server)


def assert_sentence(error: Exception, server: ExplorationServer) -> None:
    text = str(error)
    assert f"127.0.0.1:{server.port}" in text
    assert "\n" not in text
    assert len(text) < 400
    assert text.endswith(".")


A121 = {"rss_version": "a121-v1.0.0", "sensor": "a121", "sensor_count": 1, "hw": "xe121"}
FLAT = {"start_m": 0.1, "length_m": 0.7, "step_length_m": 0.0, "data_length": 9}
ANSWERS: dict[str, tuple[dict[str, bytes | None], str]] = {
    "never": ({"get_version": None}, "has not answered for 0.5 s"),
    "never to the set-up": ({"setup": None}, "has not answered for 0.5 s"),
    "never to the start": ({"start_streaming": None}, "has not answered for 0.51 s"),
    "a web server": ({"get_version": b"HTTP/1.1 400 Bad Request\r\n\r\n"}, "is not understood"),
    "an A121": ({"get_system_info": message(status="ok", system_info=A121)}, "has an a121; expected an A111"),
    "refused": ({"setup": message(status="error", message="no sensor 3")}, "while setting it up: no sensor 3"),
    "no metadata": ({"setup": message(status="ok")}, "is not understood"),
    "no range": ({"setup": message(status="ok", metadata=[[{"start_m": 0.1}]])}, "does not say what range"),
    "no step": ({"setup": message(status="ok", metadata=[[FLAT]])}, "measures no range"),
    "NaN": ({"setup": message(status="ok", metadata=[[FLAT | {"start_m": math.nan}]])}, "measures no range"),
    "no start": ({"start_streaming": message(status="error", message="busy")}, "answers `error` while streaming: busy"),
}


@needs_client
@pytest.mark.parametrize(("answers", "sentence"), ANSWERS.values(), ids=ANSWERS)
def test_a_server_that_fails_before_is_one_sentence(answers: dict[str, bytes | None], sentence: str) -> None:
    with ExplorationServer(recorded(), answers=answers) as server:
        with pytest.raises(SourceError, match=re.escape(sentence)) as error, source(server) as opened:
            take(opened, 1)
        assert_sentence(error.value, server)


@needs_client
def test_nobody_there() -> None:
    with socket.create_server(("127.0.0.1", 0)) as closed:
        port = closed.getsockname()[1]
    with pytest.raises(SourceError, match=rf"no exploration server at 127.0.0.1:{port} \(connection refused\)"):
        AcconeerSource("127.0.0.1", port=port).open()


@needs_client
@pytest.mark.parametrize("settings", [{"length_m": 1.2}, {"start_m": 6.9}, {"rate_hz": 0.01}], ids=str)
def test_settings_that_the_client_refuses(settings: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match="the A111 cannot be set to"):
        AcconeerSource("127.0.0.1", **settings).open()


@pytest.mark.parametrize(
    "settings",
    [
        {"sensors": ()}, {"sensors": (1, 1)}, {"sensors": (0,)}, {"host": " "}, {"port": 0}, {"length_m": 0.0},
        {"length_m": math.nan}, {"start_m": math.inf}, {"rate_hz": 0.0}, {"running_average": 1.0}, {"bins": 1},
        {"profile": 6}, {"gain": 1.5}, {"averages": 64}, {"timeout_s": 0.0},
    ],
    ids=str,
)  # fmt: skip
def test_settings_that_no_sensor_has(settings: dict[str, Any]) -> None:
    (name,) = settings
    with pytest.raises(ConfigError, match=f"`{name}` is .*; expected"):
        AcconeerSource(**{"host": "localhost"} | settings)


def test_without_the_client_its_name_and_the_command_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.partition(".")[0] == "acconeer"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "acconeer", None)
    with pytest.raises(ConfigError, match=r"pip install 'acconeer-exptool>=7\.18,<8'"):
        AcconeerSource("localhost").open()


def test_the_link_keeps_one_deadline_for_a_message() -> None:
    """A server that dribbles is as late as one that is silent."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        link = ExplorationLink("127.0.0.1", listener.getsockname()[1], 0.3)
        link.connect()
        served, _ = listener.accept()
        over = threading.Event()

        def dribble() -> None:
            while not over.wait(0.05):
                served.sendall(b"x")

        thread = threading.Thread(target=dribble)
        thread.start()
        try:
            for receive in (lambda: link.recv_until(b"\n"), lambda: link.recv(1000)):
                with pytest.raises(JaxradarError, match=r"has not answered for 0\.3 s"):
                    receive()
        finally:
            over.set()
            thread.join()
            served.close()
            link.disconnect()
