"""A detector over live sweeps: sensors of their own, sweeps that do not fit, clocks that do not run, and the count."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from live_samples import assert_as_detected, eager, live_detector, ready_drive, taken, through, wandering

from jaxradar._errors import ConfigError, SourceError
from jaxradar.drive import Drive, SweepFlag
from jaxradar.export import JaxStep
from jaxradar.live import LiveSweep, Replay
from jaxradar.live import tally as counting
from jaxradar.live.artefact import DECISION, DIGITS, Header
from jaxradar.live.detect import LiveDecision, LiveDetector, Step
from jaxradar.live.printed import event_record
from jaxradar.live.run import Listener, Moment, run
from jaxradar.live.tally import Tally
from jaxradar.motion import Motion
from jaxradar.systems.step import detect
from jaxradar.systems.step.packed import DECISION_FIELDS
from jaxradar.units import NANOSECONDS


class Echoing:
    """A step that says what it was given: strongest bin, flags, elapsed time, and how many sweeps before."""

    def __init__(self, bins: int) -> None:
        self.inputs = np.zeros(bins + 2)
        self.count = 0.0

    def run(self) -> np.ndarray:
        *sweep, flags, elapsed = self.inputs
        self.count += 1
        return np.array([np.argmax(sweep), max(sweep), flags, elapsed, self.count, 1.0, 0.0, self.count == 3])

    def another(self) -> Echoing:
        return Echoing(len(self.inputs) - 2)


HEADER = Header(
    "none", "", 0.5, "speed", "m/s", (0.1, 0.2, 0.3), "uint16", "float64", (0.0,), (), DECISION, "host", "jax", (), {}
)


def echoing() -> LiveDetector:
    return LiveDetector(HEADER, Echoing(3))


def sweep(sensor: int = 1, time_ns: int = 0, values: Any = (1, 2, 3), flags: int = 0) -> LiveSweep:
    return LiveSweep(sensor, time_ns, np.array(values, np.uint16), flags)


def test_what_is_a_step() -> None:
    assert isinstance(Echoing(3), Step)
    assert isinstance(JaxStep(lambda *given: given, np.zeros(1), 3), Step)
    assert not isinstance(HEADER, Step)


@pytest.mark.parametrize("name", ["thesis", "filtered-rate"])
def test_each_sensor_has_a_state_of_its_own(name: str) -> None:
    """Together as each alone, and as over the whole series."""
    drive = wandering((1, 2, 3))
    detector = eager(name, drive.sensors[0])
    found = taken(live_detector(detector, drive.sensors[0]), drive)
    for one in drive.sensors:
        trace = detect(detector, one)
        assert trace.events
        assert_as_detected(found[one.sensor], trace)
        alone = taken(live_detector(detector, one), Drive((one,)))
        assert alone[one.sensor] == found[one.sensor]
    assert len({tuple(one.event for one in found[number]) for number in (1, 2, 3)}) == 3


@settings(max_examples=50, deadline=None)
@given(sensors=st.lists(st.integers(0, 4), max_size=30), gap=st.integers(-(10**9), 10**9))
def test_places_and_times_are_counted_for_each_sensor(sensors: list[int], gap: int) -> None:
    detector = echoing()
    before: dict[int, list[int]] = {}
    for place, sensor in enumerate(sensors):
        found = detector.take(sweep(sensor, place * gap))
        own = before.setdefault(sensor, [])
        assert (found.sensor, found.place, found.time_ns) == (sensor, len(own), place * gap)
        assert found.impact_in_s == len(own) + 1
        assert found.statistic == (place * gap - (own[-1] if own else place * gap)) / NANOSECONDS
        own.append(place * gap)
    assert detector.misfits == 0


@pytest.mark.parametrize("values", [(), (1,), (1, 2), (1, 2, 3, 4), ((1, 2, 3),)], ids=str)
def test_a_sweep_of_a_wrong_length_has_no_amplitudes(values: Any) -> None:
    detector = echoing()
    detector.take(sweep(values=(7, 8, 9)))
    found = detector.take(sweep(time_ns=5 * NANOSECONDS, values=values, flags=int(SweepFlag.QUALITY_WARNING)))
    assert detector.misfits == 1
    assert found.speed_m_s == 0  # nothing is left of the sweep before
    assert found.strength == SweepFlag.NO_AMPLITUDES | SweepFlag.QUALITY_WARNING
    assert (found.statistic, found.place) == (5.0, 1)
    assert detector.take(sweep(values=(1, 9, 3))).range_m == 1
    assert detector.misfits == 1


@pytest.mark.parametrize("name", ["thesis", "filtered-rate"])
def test_a_misfit_is_as_a_sweep_that_was_not_read(name: str) -> None:
    """In both forms that a source may give it; what follows is as if it had been flagged in a log."""
    one = ready_drive().sensors[0]
    flags = one.flags.copy()
    flags[[20, 21, 70]] |= np.uint16(SweepFlag.NO_AMPLITUDES)
    flagged = dataclasses.replace(one, flags=flags)
    detector = eager(name, one)
    live = live_detector(detector, one)
    with Replay(Drive((one,)), pace=None) as source:
        sweeps = [
            each._replace(sweep=each.sweep[:-1]) if place in (20, 21, 70) else each for place, each in enumerate(source)
        ]
    assert_as_detected(through(live, sweeps), detect(detector, flagged))
    assert live.misfits == 3


@pytest.mark.parametrize("name", ["thesis", "lab-live", "filtered-rate"])
def test_times_that_stand_still_or_go_back(name: str) -> None:
    """Nothing is ever no number, and the decision is the one over the whole series."""
    one = wandering((1,)).sensors[0]
    times = one.times_ns.copy()
    times[20:25] = times[20]
    times[30:40] -= 2 * NANOSECONDS
    times[60:] += 3600 * NANOSECONDS
    odd = dataclasses.replace(one, times_ns=times)
    detector = eager(name, one)
    found = taken(live_detector(detector, odd), Drive((odd,)))[1]
    assert np.isfinite([number for each in found for number in each[3:8]]).all()
    assert_as_detected(found, detect(detector, odd))


def test_motion_goes_with_the_sweeps_of_a_replayed_drive() -> None:
    """Where it was recorded and the detector uses it, as over the whole series; else nothing is known of it."""
    drive = ready_drive()
    one = drive.sensors[0]
    detector = eager("innovation", one)
    moved, still = (detect(detector, one, motion) for motion in (drive.motion, Motion()))
    assert not np.allclose(moved.statistic, still.statistic)
    with Replay(drive, pace=None) as source:
        assert source.tells_motion
    assert_as_detected(taken(live_detector(detector, one), drive)[one.sensor], moved)
    unknown = dataclasses.replace(drive, motion=Motion())
    with Replay(unknown, pace=None) as source:
        assert not source.tells_motion
    assert_as_detected(taken(live_detector(detector, one), unknown)[one.sensor], still)


def test_decisions_of_other_fields_are_refused() -> None:
    assert LiveDecision._fields[3:] == DECISION == DECISION_FIELDS
    with pytest.raises(ValueError, match="expected decisions of range_m, speed_m_s"):
        LiveDetector(dataclasses.replace(HEADER, decision=DECISION[::-1]), Echoing(3))


@pytest.mark.parametrize(
    ("axis", "fits"),
    [
        ((0.1, 0.2, 0.3), True),
        ((0.1, 0.2, 0.3 + 0.9 * DIGITS), True),
        ((0.1, 0.2, 0.3 + 2 * DIGITS), False),
        ((0.1, 0.2), False),
        ((0.1, 0.2, 0.3, 0.4), False),
    ],
)
def test_a_range_axis_is_the_same_to_a_thousandth_of_a_millimetre(axis: tuple[float, ...], fits: bool) -> None:
    if fits:
        HEADER.check_axis(np.array(axis))
        return
    with pytest.raises(ConfigError, match=r"the sweeps have \d bins from 0\.1 to .*, and the detector .* 3 bins from"):
        HEADER.check_axis(np.array(axis))


@pytest.mark.parametrize("held", ["uint16", "float32", "float64"])
@pytest.mark.parametrize("given", ["uint16", "float32", "float64"])
def test_a_fraction_is_not_cut_off(held: str, given: str) -> None:
    header = dataclasses.replace(HEADER, sweeps=held)
    if held != "uint16" or given == "uint16":
        header.check_amplitudes(np.dtype(given))
        return
    with pytest.raises(ConfigError, match=f"amplitudes are {given}, and the detector is compiled for uint16"):
        header.check_amplitudes(np.dtype(given))


def decision(event: bool = False, impact: float = 0.0) -> LiveDecision:
    return LiveDecision(3, 7, 1_500_000_000, 0.4, -0.2, 900.0, 0.8, impact, True, False, event)


def test_the_tally_counts() -> None:
    tally = Tally()
    assert tally.record() == {
        "sweeps": 0, "invalid": 0, "events": 0, "missed": 0, "misfits": 0, "late": 0, "silent": 0, "dropped": 0,
        "reopened": 0, "duration_s": 0.0, "processor_share": 0.0,
        "took_us": dict.fromkeys(("median", "p99", "p99.9", "most"), 0.0),
    }  # fmt: skip
    flags = [0, SweepFlag.MISSED_DATA, SweepFlag.SATURATED, SweepFlag.NO_AMPLITUDES, SweepFlag.QUALITY_WARNING]
    for place, flag in enumerate(flags):
        tally.add(sweep(time_ns=(place + 2) * NANOSECONDS, flags=int(flag)), decision(place == 2), 1000 * (place + 1))
    assert (tally.sweeps, tally.invalid, tally.events) == (5, 2, 1)
    assert tally.record()["duration_s"] == 4.0
    assert tally.took.us(0.5) == 3.0
    assert tally.took.us(1.0) == 5.0
    json.dumps(tally.record(), allow_nan=False)


def test_the_tally_keeps_the_last_durations(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(counting, "KEPT", 4)
    tally = Tally()
    for took in range(1, 8):
        tally.add(sweep(), decision(), 1000 * took)
    assert (tally.took.us(0.0), tally.took.us(1.0)) == (4.0, 7.0)
    assert tally.sweeps == 7


def test_a_record_of_a_detection() -> None:
    record = event_record(decision(True), 0.5)
    assert record == {
        "sensor": 3, "sweep": 7, "time_s": 1.5, "range_m": 0.4, "strength": 900.0, "statistic": 0.8, "threshold": 0.5,
        "impact_in_s": None,
    }  # fmt: skip
    assert event_record(decision(True, 0.25), 0.5)["impact_in_s"] == 0.25


class Given(Replay):
    """A source of sweeps as they are, which may fail after the last."""

    def __init__(self, sweeps: list[LiveSweep], error: Exception | None = None) -> None:
        self.sweeps, self.error = sweeps, error

    range_m = property(lambda self: np.array(HEADER.range_m))
    period_s = property(lambda self: None)
    dtype = property(lambda self: np.dtype(np.uint16))
    missed = property(lambda self: 7)

    def close(self) -> None:
        pass

    def __iter__(self) -> Iterator[LiveSweep]:
        yield from self.sweeps
        if self.error is not None:
            raise self.error


class Noting(Listener):
    """Writes down what it hears, under its name, in a list that it shares."""

    def __init__(self, notes: list[tuple[Any, ...]], name: str = "", fails: str = "") -> None:
        self.notes, self.name, self.fails = notes, name, fails

    def _note(self, what: str, *more: Any) -> None:
        self.notes.append((self.name + what, *more))
        if what == self.fails:
            raise SourceError(f"no {what}.")

    def begin(self, source: Any, header: Header, problems: Any) -> None:
        self._note("begin", tuple(problems))

    def hear(self, live: LiveSweep, decision: LiveDecision, moment: Moment) -> None:
        self._note("hear", live.time_ns, decision.time_ns)

    def end(self, tally: Tally) -> None:
        self._note("end", tally.sweeps, tally.missed)


def eight() -> list[LiveSweep]:
    return [sweep(number % 2, number) for number in range(8)]


def test_every_decision_is_heard_in_order() -> None:
    heard: list[LiveDecision] = []

    class Keeping(Listener):
        def hear(self, live: LiveSweep, decision: LiveDecision, moment: Moment) -> None:
            heard.append(decision)

    tally = run(Given(eight()), echoing(), [Keeping()])
    assert [one.time_ns for one in heard] == list(range(8))
    assert [one.event for one in heard] == [False] * 4 + [True] * 2 + [False] * 2
    assert (tally.sweeps, tally.events, tally.invalid, tally.missed) == (8, 2, 0, 7)


def test_listeners_begin_in_order_and_end_the_other_way_round() -> None:
    notes: list[tuple[Any, ...]] = []
    run(Given(eight()), echoing(), [Noting(notes, "a "), Noting(notes, "b ")], most=1)
    assert notes == [
        ("a begin", ()), ("b begin", ()), ("a hear", 0, 0), ("b hear", 0, 0), ("b end", 1, 7), ("a end", 1, 7),
    ]  # fmt: skip


@pytest.mark.parametrize(("fails", "ends", "swept"), [("begin", [], 0), ("hear", ["a end", "b end"], 1)])
def test_who_has_begun_hears_the_end_whatever_fails(fails: str, ends: list[str], swept: int) -> None:
    notes: list[tuple[Any, ...]] = []
    with pytest.raises(SourceError, match=f"no {fails}"):
        run(Given(eight()), echoing(), [Noting(notes, "a ", fails), Noting(notes, "b ")])
    assert sorted(note[0] for note in notes if "end" in note[0]) == ends
    assert all(note[1] == swept for note in notes if "end" in note[0])


def test_a_source_that_fails_ends_the_run_and_the_count_is_told() -> None:
    notes: list[tuple[Any, ...]] = []
    with pytest.raises(SourceError, match="silent"):
        run(Given(eight(), SourceError("the server is silent.")), echoing(), [Noting(notes)])
    assert notes[-1] == ("end", 8, 7)


def test_sweeps_that_do_not_fit_are_refused_before_anyone_listens() -> None:
    notes: list[tuple[Any, ...]] = []
    detector = LiveDetector(dataclasses.replace(HEADER, range_m=(0.1, 0.2, 0.4)), Echoing(3))
    with pytest.raises(ConfigError, match=r"compiled for 3 bins from 0\.1 to 0\.4 m"):
        run(Given(eight()), detector, [Noting(notes)])
    assert notes == []
