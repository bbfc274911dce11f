"""A recorded drive as a source: order, times, pace."""

from __future__ import annotations

import math
import signal
import threading
import time
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from log_samples import drives, sample_drive

from jaxradar._errors import ConfigError
from jaxradar.drive import Drive, SensorSeries, SweepFlag
from jaxradar.live import Replay, Source

AXIS = np.array([0.1, 0.2, 0.3])


def series(sensor: int, times_ms: list[float], axis: np.ndarray = AXIS) -> SensorSeries:
    times = np.rint(np.array(times_ms) * 1e6).astype(np.int64)
    sweeps = np.arange(len(times) * len(axis), dtype=np.uint16).reshape(-1, len(axis))
    return SensorSeries(sensor, times, sweeps, axis, np.zeros(len(times), np.uint16))


def order(*parts: SensorSeries) -> list[tuple[int, float]]:
    with Replay(Drive(parts), pace=None) as replay:
        return [(sweep.sensor, sweep.time_ns / 1e6) for sweep in replay]


def taken(replay: Source) -> list[float]:
    """When each sweep came, in milliseconds since iteration began."""
    before = time.monotonic()
    return [1e3 * (time.monotonic() - before) for _ in replay]


def test_a_source_as_the_protocol_has_it() -> None:
    source: Source = Replay(sample_drive(), pace=None)
    with source:
        sweeps = list(source)
        assert source.sensors == (1, 3)
        np.testing.assert_array_equal(source.range_m, sample_drive().sensors[0].range_m)
    assert [(type(sweep.time_ns), type(sweep.flags)) for sweep in sweeps] == [(int, int)] * 10
    assert list(source) == []  # closed


@settings(max_examples=60, deadline=None)
@given(drive=drives())
def test_every_sweep_of_a_sensor_comes_once_in_its_order(drive: Drive) -> None:
    for part in drive.sensors:
        with Replay(drive, pace=None, sensors=(part.sensor,)) as replay:
            found = list(replay)
        assert [sweep.time_ns for sweep in found] == part.times_ns.tolist()
        assert [sweep.flags for sweep in found] == part.flags.tolist()
        assert {sweep.sweep.dtype for sweep in found} <= {part.sweeps.dtype}
        for sweep, row in zip(found, part.sweeps, strict=True):
            np.testing.assert_array_equal(sweep.sweep, row)
        assert replay.missed == sum(bool(flag & SweepFlag.MISSED_DATA) for flag in part.flags.tolist())


def test_sensors_are_interleaved_by_recorded_time() -> None:
    found = order(series(1, [0, 10, 20, 30]), series(3, [0, 5, 20, 40]))
    assert found == [(1, 0), (3, 0), (3, 5), (1, 10), (1, 20), (3, 20), (1, 30), (3, 40)]


def test_times_that_stand_still_or_go_back_stay_in_their_order() -> None:
    found = order(series(1, [0, 10, 10, 5, 15]), series(3, [0, 10, 20]))
    assert [time for sensor, time in found if sensor == 1] == [0, 10, 10, 5, 15]
    assert [time for sensor, time in found if sensor == 3] == [0, 10, 20]
    both = order(series(1, [0, 10, 0, 10]), series(3, [1, 11, 1, 11]))  # a counter that wrapped
    assert both == [(1, 0), (3, 1), (1, 10), (1, 0), (1, 10), (3, 11), (3, 1), (3, 11)]


def test_its_own_pace_and_twice_as_fast() -> None:
    drive = Drive((series(1, [0, 50, 100, 450]), series(3, [25, 125, 600])))
    for pace in (1.0, 2.0):
        with Replay(drive, pace) as replay:
            came = np.array(taken(replay))
        due = np.array([0, 25, 50, 100, 125, 450, 600]) / pace
        assert (came >= due).all()
        assert came[-1] < due[-1] + 300  # a machine that is busy; and twice as fast is no less than that


def test_a_late_consumer_gets_what_is_due_and_delays_nothing() -> None:
    with Replay(Drive((series(1, list(range(0, 1001, 50))),))) as replay:
        sweeps = iter(replay)
        next(sweeps)
        time.sleep(1.0)
        woken = time.monotonic()
        assert len(list(sweeps)) == 20
        assert time.monotonic() - woken < 0.6  # 1 s if waiting began anew


def test_times_that_go_back_are_due_at_once_and_a_clock_set_anew_counts_on() -> None:
    with Replay(Drive((series(1, [0, 50, 50, 20, 1050]),))) as replay:
        came = taken(replay)
    assert came[4] >= 1050
    assert came[3] < 1050  # at once; the machine may be busy
    with Replay(Drive((series(1, [0, 5000, 0, 50, 100]),)), pace=50.0) as replay:
        came = taken(replay)
    assert came[1] >= 100
    assert came[4] >= 102


def test_no_busy_wait() -> None:
    with Replay(Drive((series(1, [0, 400]),))) as replay:
        before = time.thread_time()
        list(replay)
        assert time.thread_time() - before < 0.05


def test_a_pace_so_slow_that_no_number_holds_the_time_waits_until_closed() -> None:
    """A subnormal pace: 10 ms take 1e322 s."""
    with Replay(Drive((series(1, [0, 10]),)), pace=1e-320) as replay:
        timer = threading.Timer(0.2, replay.close)
        timer.start()
        assert len(taken(replay)) == 1
        timer.join()


@pytest.mark.parametrize("pace", [1.0, None])
def test_close_from_another_thread_wakes_it(pace: float | None) -> None:
    times = [0, 3_600_000] if pace else [*range(2_000_000)]
    with Replay(Drive((series(1, times),)), pace) as replay:
        threading.Timer(0.1, replay.close).start()
        before = time.monotonic()
        count = sum(1 for _ in replay)
        assert time.monotonic() - before < 5
    assert 1 <= count < len(times)
    replay.close()


def test_close_from_a_signal_handler_wakes_it() -> None:
    replay = Replay(Drive((series(1, [0, 3_600_000]),)))
    old = signal.signal(signal.SIGALRM, lambda *_: replay.close())
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.1)
        with replay:
            assert len(list(replay)) == 1
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, old)


def test_it_begins_anew_when_opened_again() -> None:
    replay = Replay(sample_drive(), pace=None)
    with pytest.raises(ValueError, match="must be opened"):
        iter(replay)
    for _ in range(2):
        with replay:
            assert len(list(replay)) == 10


DIFFERENT = Drive((series(1, [0, 1]), series(3, [0]), series(4, [0, 1, 2], AXIS + 0.01)))


@pytest.mark.parametrize(
    ("drive", "settings", "sentence"),
    [
        (DIFFERENT, {}, r"sensors 1 and 4 have different range axes \(3 bins from 0\.1 to 0\.3 m and .*pick sensors"),
        (DIFFERENT, {"sensors": (2,)}, "no sensor 2; expected some of 1, 3, 4"),
        (DIFFERENT, {"sensors": ()}, "no sensor is picked"),
        (Drive(()), {}, "has no sensor"),
        *[(sample_drive(), {"pace": pace}, "cannot be replayed at pace") for pace in (0.0, -1.0, math.nan, math.inf)],
    ],
)
def test_what_cannot_be_replayed(drive: Drive, settings: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ConfigError, match=sentence):
        Replay(drive, **settings)


def test_sensors_of_one_axis_are_picked_from_several() -> None:
    assert Replay(DIFFERENT, sensors=(3, 1)).sensors == (1, 3)
    with Replay(DIFFERENT, None, sensors=[4]) as replay:
        assert [sweep.sensor for sweep in replay] == [4, 4, 4]
        assert replay.range_m[0] == pytest.approx(0.11)
