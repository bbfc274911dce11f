"""An A111 behind the maker's own client: simulated by the client, and by a server that speaks its protocol over TCP."""

from __future__ import annotations

import math
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from exploration_server import BINS, STEP_M, ExplorationServer, message, needs_client, recorded, source, take

from jaxradar import read_log
from jaxradar._errors import ConfigError
from jaxradar.drive import SweepFlag
from jaxradar.live import AcconeerSource, ActualRange, Source


@needs_client
@pytest.mark.parametrize("sensors", [(1,), (1, 3), (2, 3, 4)], ids=str)
def test_every_sweep_arrives_bit_for_bit(sensors: tuple[int, ...]) -> None:
    drive = recorded(sensors)
    with ExplorationServer(drive) as server, source(server, sensors=sensors) as opened:
        found = take(opened, 12 * len(sensors))
        assert opened.sensors == sensors
        np.testing.assert_allclose(opened.range_m, drive.sensors[0].range_m, rtol=0, atol=1e-12)
    assert [sweep.sensor for sweep in found] == list(sensors) * 12
    for number in sensors:
        got = np.stack([sweep.sweep for sweep in found if sweep.sensor == number])
        assert got.dtype == np.uint16
        np.testing.assert_array_equal(got, drive.series(number).sweeps)
    assert opened.problems == ()
    assert opened.missed == 0


@needs_client
def test_a_road_recording_comes_through_as_it_was_recorded(road_recordings: dict[str, Path]) -> None:
    drive = read_log(road_recordings["cement_0_45"])
    (part,) = drive.sensors
    said = {"length_m": 0.6, "step_length_m": 0.000484}  # as in its `session_info`: the step is rounded
    with (
        ExplorationServer(drive, metadata={1: said}) as server,
        source(server, sensors=(1,), start_m=0.2, length_m=0.6) as opened,
    ):
        found = take(opened, len(part))
        np.testing.assert_allclose(opened.range_m, np.linspace(0.2, 0.8, 1240), rtol=0, atol=1e-12)
        assert opened.problems == ()
    np.testing.assert_array_equal([sweep.sweep for sweep in found], part.sweeps)
    assert [sweep.flags for sweep in found] == part.flags.tolist()


@needs_client
def test_the_server_is_asked_for_the_labs_settings() -> None:
    with ExplorationServer(recorded()) as server:
        with source(server) as opened:
            take(opened, 2)
        names = server.names()
    (setup,) = [command for command in server.commands if command["cmd"] == "setup"]
    assert names[-3:] == ["setup", "start_streaming", "stop_streaming"]
    assert (setup["update_rate"], setup["repetition_mode"]) == (100.0, "streaming")
    assert [group["sensor_id"] for group in setup["groups"][0]] == [1, 3]
    for group in setup["groups"][0]:
        assert group["service"] == "envelope"
        config = group["config"]
        assert config["range_start"] == 0.1
        assert math.isclose(config["range_length"], 0.7)
        assert config["running_average_factor"] == 0.0
        assert (config["profile"], config["gain"], config["hw_accelerated_average_samples"]) == (2, 0.5, 10)


@needs_client
def test_bins_are_thinned_as_the_lab_does() -> None:
    drive = recorded()
    with ExplorationServer(drive) as server, source(server, bins=128) as opened:
        (sweep,) = take(opened, 1)
        kept = [BINS * i // 128 for i in range(128)]
        np.testing.assert_array_equal(sweep.sweep, drive.series(1).sweeps[0, kept])
        np.testing.assert_allclose(opened.range_m, [0.1 + STEP_M * i for i in kept], rtol=0, atol=1e-12)


@needs_client
def test_more_bins_than_there_are_is_refused() -> None:
    with ExplorationServer(recorded()) as server:
        with pytest.raises(ConfigError, match="cannot thin 1447 range bins to 1500"), source(server, bins=1500):
            pass
        with source(server) as opened:  # the failure has left nothing behind
            assert len(take(opened, 4)) == 4


@needs_client
def test_one_stamp_for_all_sensors_of_a_message_by_the_hosts_clock() -> None:
    with ExplorationServer(recorded(), period_s=0.01) as server, source(server) as opened:
        before = time.monotonic_ns()
        found = take(opened, 24)
        took_ns = time.monotonic_ns() - before
    stamps = np.array([sweep.time_ns for sweep in found]).reshape(-1, 2)
    assert all(type(sweep.time_ns) is int for sweep in found)
    assert stamps[0, 0] == 0
    np.testing.assert_array_equal(stamps[:, 0], stamps[:, 1])
    assert (np.diff(stamps[:, 0]) > 0).all()
    assert 10 * 11_000_000 * 0.5 < stamps[-1, 0] < took_ns


@needs_client
def test_what_the_server_says_of_a_sweep_becomes_its_flags() -> None:
    drive = recorded()
    said = [0, SweepFlag.SATURATED, SweepFlag.MISSED_DATA, SweepFlag.QUALITY_WARNING, SweepFlag.COMMUNICATION_ERROR]
    said.append(SweepFlag.MISSED_DATA | SweepFlag.SATURATED)
    drive.series(1).flags[:6] = said
    drive.series(3).flags[3] = SweepFlag.MISSED_DATA
    with ExplorationServer(drive) as server, source(server) as opened:
        found = take(opened, 24)
        assert opened.missed == 3
        opened.close()
        opened.open()
        assert opened.missed == 0
    assert [sweep.flags for sweep in found if sweep.sensor == 1] == [*map(int, said), *[0] * 6]
    assert [sweep.flags for sweep in found if sweep.sensor == 3] == [0, 0, 0, int(SweepFlag.MISSED_DATA), *[0] * 8]


@needs_client
def test_a_message_without_amplitudes_is_a_flagged_sweep_of_zeros() -> None:
    ending = message(status="ok", result_info=[[{"sensor_comm_error": True}, {}]])
    with ExplorationServer(recorded(sweeps=1), ending=ending) as server, source(server) as opened:
        found = take(opened, 4)
    assert [sweep.flags for sweep in found] == [0, 0, 24, 16]
    assert not found[2].sweep.any()


@needs_client
@pytest.mark.parametrize(
    ("start_m", "bins", "told"),
    [(0.1 + 0.4 * STEP_M, BINS, False), (0.1 + 0.6 * STEP_M, BINS, True), (0.06, BINS, True), (0.1, 1240, True)],
)
def test_another_range_than_asked_for_is_told(start_m: float, bins: int, told: bool) -> None:
    drive = recorded(bins=bins, start_m=start_m)
    with ExplorationServer(drive) as server, source(server) as opened:
        assert opened.actual == pytest.approx(ActualRange(start_m, (bins - 1) * STEP_M, STEP_M))
        np.testing.assert_allclose(opened.range_m, drive.sensors[0].range_m, rtol=0, atol=1e-12)
        assert len(opened.problems) == told
        if told:
            assert re.search(r"measures from .* m; asked for was 0.1 to 0.8 m\.$", opened.problems[0])


@needs_client
def test_a_sensor_of_another_range_than_the_first_is_told() -> None:
    with ExplorationServer(recorded(), metadata={3: {"start_m": 0.103}}) as server, source(server) as opened:
        (problem,) = opened.problems
        assert "sensor 3 measures from 0.103 m" in problem


@needs_client
@pytest.mark.parametrize("silent", [False, True])
def test_close_from_another_thread_ends_iteration_soon(silent: bool) -> None:
    drive = recorded(sweeps=3 if silent else 2000)
    with ExplorationServer(drive, period_s=0.02) as server:
        opened = source(server, timeout_s=30.0)
        with opened:
            threading.Timer(0.2, opened.close).start()
            before = time.monotonic()
            count = len(list(opened))
            assert time.monotonic() - before < 5
            assert 0 < count < 100
        with opened:  # and again
            assert len(take(opened, 2)) == 2


@needs_client
def test_close_from_a_signal_handler_ends_a_wait_for_a_silent_server() -> None:
    with ExplorationServer(recorded(sweeps=3)) as server, source(server, timeout_s=30.0) as opened:
        old = signal.signal(signal.SIGALRM, lambda *_: opened.close())
        try:
            signal.setitimer(signal.ITIMER_REAL, 0.2)
            before = time.monotonic()
            assert len(list(opened)) == 6
            assert time.monotonic() - before < 5
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, old)


@needs_client
def test_close_between_sweeps_stops_the_server_in_good_order() -> None:
    with ExplorationServer(recorded(sweeps=500)) as server:
        with source(server) as opened:
            for _ in opened:
                opened.close()
        opened.close()
        assert server.names()[-1] == "stop_streaming"


@needs_client
def test_closed_at_one_sensors_sweep_the_other_sensors_does_not_come() -> None:
    """Both are of one message."""
    with ExplorationServer(recorded(sweeps=500)) as server, source(server) as opened:
        found = []
        for sweep in opened:
            found.append(sweep)
            if len(found) == 3:
                opened.close()
        assert len(found) == 3


@needs_client
def test_iteration_needs_an_open_source() -> None:
    with ExplorationServer(recorded()) as server:
        closed = source(server)
        assert isinstance(closed, Source)
        with pytest.raises(ValueError, match="must be opened"):
            iter(closed)
        assert closed.range_m.shape == (0,)
        with closed, pytest.raises(ValueError, match="open already"):
            closed.open()


@needs_client
@pytest.mark.parametrize("sensors", [(1,), (1, 3)], ids=str)
def test_the_clients_own_simulated_sensor(sensors: tuple[int, ...]) -> None:
    with AcconeerSource("", sensors, mock=True) as opened:
        found = take(opened, 10 * len(sensors))
        assert opened.range_m.shape == (128,)
        assert opened.problems == ()
        echo_m = opened.range_m[np.argmax(found[0].sweep)]
    assert [sweep.sensor for sweep in found] == list(sensors) * 10
    assert {(sweep.sweep.shape, sweep.sweep.dtype, sweep.flags) for sweep in found} == {((128,), np.dtype("u2"), 0)}
    assert abs(echo_m - (0.45 - 0.05 * (len(sensors) - 1))) < 0.01  # where the client's `EnvelopeMocker` puts it


@needs_client
def test_a_rate_that_the_simulated_sensor_cannot_keep_misses_sweeps() -> None:
    with AcconeerSource("", (1,), rate_hz=300, mock=True) as opened:
        assert [sweep.flags for sweep in take(opened, 3)] == [SweepFlag.MISSED_DATA] * 3
        assert opened.missed == 3


def test_importing_the_package_needs_numpy_alone() -> None:
    code = "import sys, jaxradar.live; print(*{name.partition('.')[0] for name in sys.modules})"
    root = Path(__file__).parents[1]
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=root)
    others = set(done.stdout.split()) - set(sys.stdlib_module_names)
    assert {name for name in others if not name.startswith(("_", "site"))} <= {"jaxradar", "numpy"}
