"""Every fault is safe at once, and a step is told again when it is over; the board is a process of its own."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest
from board import Board, frames, until

from jaxradar._errors import ConfigError, SourceError
from jaxradar.drive import SweepFlag
from jaxradar.live.artefact import DECISION, Header
from jaxradar.live.board import Fault
from jaxradar.live.detect import LiveDecision, LiveDetector
from jaxradar.live.feed import MOST_WAITING
from jaxradar.live.run import Listener, Moment, run
from jaxradar.live.sweeps import LiveSweep, Source
from jaxradar.live.tally import Tally
from jaxradar.live.telling import Telling
from jaxradar.live.wires import Framed, Nucleo

PERIOD_S = 0.02
BINS = 4
HEADER = Header(
    *("none", "", 0.5, "speed", "m/s", (0.1, 0.2, 0.3, 0.4), "uint16", "float64", (0.0,), (), DECISION),
    *("host", "jax", (), {}),
)
EVENT_AT = 5


class Once:
    """Detects at one sweep."""

    def __init__(self) -> None:
        self.inputs = np.zeros(BINS + 2)
        self._count = 0

    def run(self) -> np.ndarray:
        self._count += 1
        return np.array([0.3, 0.0, 1.0, 1.0, 0.0, 1.0, 0.0, self._count == EVENT_AT])

    def another(self) -> Once:
        return Once()


Plan = dict[int, Callable[[LiveSweep], LiveSweep]]


class Sensor(Source):
    """Sweeps each period, of which `plan` makes something else, or waits or raises, at some places; `gone`: so many
    attempts to open it again fail."""

    def __init__(self, count: int, plan: Plan, gone: int = 0) -> None:
        self._count, self._plan, self._gone = count, plan, gone
        self._place = self._opened = 0
        self._closed = threading.Event()
        self.axis = np.array(HEADER.range_m)

    range_m = property(lambda self: self.axis)
    sensors = property(lambda self: (1,))
    missed = property(lambda self: 0)
    period_s = property(lambda self: PERIOD_S)

    def open(self) -> None:
        self._opened += 1
        if 1 < self._opened <= 1 + self._gone:
            raise SourceError("nobody answers.")

    def close(self) -> None:
        self._closed.set()

    def __iter__(self) -> Iterator[LiveSweep]:
        self._closed.clear()
        begin = time.monotonic_ns()
        while self._place < self._count:
            if self._closed.wait(PERIOD_S):
                return
            place, self._place = self._place, self._place + 1
            made = LiveSweep(1, time.monotonic_ns() - begin, np.ones(BINS, np.uint16), 0)
            yield self._plan.get(place, lambda live: live)(made)


class Watching(Listener):
    """Writes down when each round was, and its faults."""

    def __init__(self) -> None:
        self.rounds: list[tuple[int, Fault]] = []
        self.lost_at: list[int] = []

    def hear(self, live: LiveSweep, decision: LiveDecision, moment: Moment) -> None:
        self.rounds.append((time.monotonic_ns(), moment.faults))

    def idle(self, moment: Moment) -> None:
        self.rounds.append((time.monotonic_ns(), moment.faults))

    def lost(self, why: str) -> None:
        self.lost_at.append(time.monotonic_ns())


def wait(seconds: float) -> Callable[[LiveSweep], LiveSweep]:
    def made(live: LiveSweep) -> LiveSweep:
        time.sleep(seconds)
        return live._replace(time_ns=live.time_ns + round(1e9 * seconds))

    return made


def fail(live: LiveSweep) -> LiveSweep:
    raise SourceError("lost the connection.")


def flag(one: SweepFlag) -> Callable[[LiveSweep], LiveSweep]:
    return lambda live: live._replace(flags=int(one))


def shorter(live: LiveSweep) -> LiveSweep:
    return live._replace(sweep=live.sweep[:-1])


FAULTS: dict[str, tuple[Callable[[LiveSweep], LiveSweep], Fault]] = {
    "silent": (wait(0.5), Fault.SENSOR_SILENT),
    "lost and back": (fail, Fault.SENSOR_LOST),
    "missed data": (flag(SweepFlag.MISSED_DATA), Fault.NO_DATA),
    "communication error": (flag(SweepFlag.COMMUNICATION_ERROR), Fault.NO_DATA),
    "wrong length": (shorter, Fault.WRONG_LENGTH),
}


def told(
    tmp_path: Path, sensor: Sensor, listeners: Sequence[Listener] = (), *, kind: str = "nucleo"
) -> list[tuple[int, bytes]]:
    """When the board heard what."""
    with Board(tmp_path / "board", kind, tmp_path / "bytes") as board:
        telling = Telling(str(tmp_path / "board"), Nucleo() if kind == "nucleo" else Framed(), hold_s=1000.0)
        with sensor:
            run(sensor, LiveDetector(HEADER, Once()), [telling, *listeners], again=True)
        time.sleep(0.1)
        return board.heard()


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_safe_at_once_and_over_when_it_is_over(name: str, tmp_path: Path) -> None:
    plan, fault = FAULTS[name]
    sensor, watching = Sensor(40, {20: plan}, gone=1 if name == "lost and back" else 0), Watching()
    heard = told(tmp_path, sensor, [watching])
    sent = b"".join(content for _, content in heard)
    assert fault in {one for _, faults in watching.rounds for one in faults}
    assert len(sent) == len(watching.rounds) + 1
    # A byte each round: 1 from the detection on, but where there is a fault; and 0 at the end.
    detected = next(place for place, byte in enumerate(sent) if byte)
    assert [byte == 1 for byte in sent[detected:-1]] == [not faults for _, faults in watching.rounds[detected:]]
    assert sent[-1] == 0
    over = max(place for place, (_, faults) in enumerate(watching.rounds) if fault in faults)
    assert 1 in sent[over + 1 : -1]


def test_silence_is_safe_within_a_period_of_the_sweep_that_does_not_come(tmp_path: Path) -> None:
    """As the loop has it; how long a busy machine keeps the loop from its core is not the loop's."""
    sensor, watching = Sensor(40, {20: wait(0.5)}), Watching()
    told(tmp_path, sensor, [watching])
    places = [place for place, (_, faults) in enumerate(watching.rounds) if Fault.SENSOR_SILENT in faults]
    assert len(places) >= 0.5 * 0.5 / PERIOD_S  # and again each period
    first = places[0]
    after_s = (watching.rounds[first][0] - watching.rounds[first - 1][0]) / 1e9
    assert after_s >= 1.4 * PERIOD_S
    assert after_s <= 2.0 * PERIOD_S + 0.2


def test_frames_name_the_fault(tmp_path: Path) -> None:
    sensor = Sensor(30, {15: flag(SweepFlag.NO_AMPLITUDES), 20: shorter})
    sent = frames(b"".join(content for _, content in told(tmp_path, sensor, kind="framed")))
    named = [Fault(frame.faults) for frame in sent]
    assert Fault.NO_DATA in {one for faults in named for one in faults}
    assert Fault.WRONG_LENGTH in {one for faults in named for one in faults}
    assert named[-1] == Fault.STOPPING
    assert all(not frame.event for frame in sent if frame.faults)
    assert {frame.event for frame in sent} == {0, 1}


def test_a_source_that_fails_ends_the_run_where_that_is_wanted() -> None:
    sensor = Sensor(40, {20: fail})
    with sensor, pytest.raises(SourceError, match="lost the connection"):
        run(sensor, LiveDetector(HEADER, Once()), [])


def test_another_axis_after_it_came_back_ends_the_run() -> None:
    sensor = Sensor(40, {})

    def other(live: LiveSweep) -> LiveSweep:
        sensor.axis = np.array(HEADER.range_m) + 0.1
        raise SourceError("restarted.")

    sensor._plan[10] = other
    with sensor, pytest.raises(ConfigError, match="came back with another range axis"):
        run(sensor, LiveDetector(HEADER, Once()), [], again=True)


def test_times_go_on_across_a_restart() -> None:
    sensor, times = Sensor(30, {15: fail}, gone=1), []

    class Timing(Listener):
        def hear(self, live: LiveSweep, decision: LiveDecision, moment: Moment) -> None:
            times.append(live.time_ns)

    with sensor:
        tally = run(sensor, LiveDetector(HEADER, Once()), [Timing()], again=True)
    steps = np.diff(times) / 1e9
    assert (steps > 0).all()
    assert steps[14] > 0.4  # the pause before it is opened again
    assert (tally.reopened, tally.sweeps) == (1, 29)


def test_a_source_that_opens_and_fails_at_once_is_not_asked_again_and_again() -> None:
    """The pause grows as for one that does not open."""
    sensor, begun_s = Sensor(40, dict.fromkeys(range(40), fail)), time.monotonic()
    with sensor:
        tally = run(sensor, LiveDetector(HEADER, Once()), [], again=True, stop=lambda: time.monotonic() > begun_s + 2.0)
    assert 1 <= tally.reopened <= 3  # after 0.5 s, 1 s, 2 s


def test_a_loop_that_is_held_up_drops_the_oldest_and_says_late() -> None:
    count, held_at, behind = 200, 4, MOST_WAITING + 30
    came: list[int] = []
    decided: list[int] = []
    late: list[bool] = []

    class Slow(Listener):
        def came(self, live: LiveSweep) -> None:  # who records hears of all
            came.append(live.time_ns)

        def hear(self, live: LiveSweep, decision: LiveDecision, moment: Moment) -> None:
            decided.append(live.time_ns)
            late.append(Fault.LATE in moment.faults)
            if len(decided) == held_at:
                until(lambda: len(came) >= came.index(live.time_ns) + behind)

    class Quick(Sensor):
        period_s = property(lambda self: 0.002)

        def __iter__(self) -> Iterator[LiveSweep]:
            for place in range(count):
                time.sleep(0.002)
                yield LiveSweep(1, 2_000_000 * place, np.ones(BINS, np.uint16), 0)

    sensor = Quick(0, {})
    with sensor:
        tally = run(sensor, LiveDetector(HEADER, Once()), [Slow()])
    assert came == [2_000_000 * place for place in range(count)]
    assert tally.sweeps + tally.dropped == count
    assert tally.dropped >= behind - MOST_WAITING - 2  # one that waits to be put, and one in hand
    assert decided == sorted(set(decided))
    assert decided[held_at] - decided[held_at - 1] > 2_000_000 * (behind - MOST_WAITING - 2)  # those next to it went
    assert decided[-1] == came[-1]
    assert late[held_at]
    assert tally.late == sum(late)


def test_the_board_knows_when_the_recorder_fails_and_is_told_of_steps_all_the_same(tmp_path: Path) -> None:
    class Failing(Listener):
        fault = Fault.RECORDER

    sensor = Sensor(20, {})
    sent = frames(b"".join(content for _, content in told(tmp_path, sensor, [Failing()], kind="framed")))
    assert {frame.faults & Fault.RECORDER for frame in sent[:-1]} == {Fault.RECORDER}
    detected = next(place for place, frame in enumerate(sent) if frame.event)
    assert [frame.event == 1 for frame in sent[detected:]] == [
        frame.faults == Fault.RECORDER for frame in sent[detected:]
    ]


def test_the_board_is_safe_before_anything_else_is_waited_for(tmp_path: Path) -> None:
    """A source that hangs and a disk that is slow may take the end of a run seconds."""

    class Hanging(Sensor):
        def __iter__(self) -> Iterator[LiveSweep]:
            yield from super().__iter__()
            time.sleep(1.5)

    class SlowDisk(Listener):
        def end(self, tally: Tally) -> None:
            time.sleep(1.0)

    class Ending(Listener):
        def over(self) -> None:
            ended.append(time.monotonic_ns())

    ended: list[int] = []
    rounds = iter(range(1000))
    with Board(tmp_path / "board", "nucleo", tmp_path / "bytes") as board:
        telling, sensor = Telling(str(tmp_path / "board"), Nucleo(), hold_s=1000.0), Hanging(1000, {})
        with sensor:
            run(sensor, LiveDetector(HEADER, Once()), [telling, SlowDisk(), Ending()], stop=lambda: next(rounds) >= 20)
        took_s = (time.monotonic_ns() - ended[0]) / 1e9
        heard = board.heard()
        sent = board.bytes()
    assert sent[-2:] == b"\x01\x00"
    assert took_s > 2.0
    assert (heard[-1][0] - ended[0]) / 1e9 < 1.0


def test_a_source_that_fails_unforeseen_when_it_is_opened_again_ends_the_run() -> None:
    class Odd(Sensor):
        def open(self) -> None:
            super().open()
            if self._opened > 1:
                raise RuntimeError("an odd answer")

    sensor, begun_s = Odd(40, {3: fail}), time.monotonic()
    with sensor, pytest.raises(SourceError, match="odd answer"):
        run(sensor, LiveDetector(HEADER, Once()), [], again=True, stop=lambda: time.monotonic() > begun_s + 10)
