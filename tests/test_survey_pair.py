"""Two sensors side by side: the angle of an edge and the contacts of the wheels from traces made by hand, and rolls."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from step_samples import series

from jaxradar._errors import ConfigError
from jaxradar.sim import drive_seeds
from jaxradar.suite import ObliqueCell, measure_oblique, oblique_grid, oblique_total
from jaxradar.suite.oblique import Oblique
from jaxradar.survey import SensorPair, detect_pair, pair_events
from jaxradar.systems.step import ApproachDetector, DefaultDetector, StepEvent, StepTrace, ThesisDetector

APPROACH = ApproachDetector()
HEIGHT, WHEEL = 0.35, 0.05  # how far the front tyre's contact lies behind the sensor
TIMES = np.arange(0.0, 2.0, 1.0 / 300.0)


def trace(ahead_m: np.ndarray, closing_m_s: float, events: tuple[float, ...], sensor: int = 1) -> StepTrace:
    """A corner seen from 0.9 to 0.3 m ahead, detected at these distances."""
    range_m = np.sqrt(HEIGHT**2 + np.maximum(ahead_m, 0.0) ** 2)
    seen = (ahead_m < 0.9) & (ahead_m > 0.3)
    until = np.where(seen, (ahead_m + WHEEL) / closing_m_s, 0.0)
    rate = np.where(seen, -closing_m_s * ahead_m / range_m, 0.0)
    found = []
    for at in events:
        sweep = int(np.argmax(ahead_m <= at))
        found.append(StepEvent(TIMES[sweep], range_m[sweep], 1.0, 20.0, 16.5, sweep, float(until[sweep]) or None))
    yes = np.ones(len(TIMES), bool)
    return StepTrace(
        sensor, TIMES, range_m, rate, range_m, range_m, until, yes, ~yes, 16.5, "evidence", "nats", tuple(found)
    )


@pytest.mark.parametrize("known", [False, True])
@pytest.mark.parametrize("angle_deg", [-40.0, 0.0, 25.0])
@pytest.mark.parametrize("speed_m_s", [3.0, 9.0])
def test_angle_and_wheels_are_those_of_geometry(angle_deg: float, speed_m_s: float, known: bool) -> None:
    angle, pair = math.radians(angle_deg), SensorPair(first_m=0.5, second_m=-0.4)
    left = 6.0 - speed_m_s * TIMES  # of the way, in the middle
    ahead = [(left - y * math.tan(angle)) * math.cos(angle) for y in (0.5, -0.4)]
    traces = [trace(one, speed_m_s * math.cos(angle), (0.6,)) for one in ahead]
    (event,) = pair_events(traces, traces, APPROACH, pair, speed_m_s=speed_m_s if known else None)
    assert event.place == (0 if angle_deg >= 0 else 1)
    assert event.time_s == min(one.events[0].time_s for one in traces)
    assert event.followed_s == max(one.events[0].time_s for one in traces)
    assert event.angle_deg == pytest.approx(angle_deg, abs=0.5)
    assert event.speed_m_s == pytest.approx(speed_m_s, rel=0.01)
    wheels = [(6.0 - y * math.tan(angle) + WHEEL) / speed_m_s for y in (0.5, -0.5)]
    assert event.wheels_s == pytest.approx(wheels, abs=0.015 / speed_m_s * 3.0)


def test_the_earliest_alarms_and_a_second_step_is_another() -> None:
    left = np.where(TIMES < 1.0, 4.0 - 5.0 * TIMES, 9.0 - 5.0 * TIMES)
    first, second = trace(left, 5.0, (0.7,)), trace(left, 5.0, (0.5,), 2)
    later = dataclasses.replace(first.events[0], time_s=1.65, sweep=495)
    first = dataclasses.replace(first, events=(*first.events, later))
    events = pair_events([first, second], [first, second], APPROACH, SensorPair())
    assert [one.place for one in events] == [0, 0]
    assert events[0].followed_s == second.events[0].time_s
    assert events[1].followed_s is None
    assert events[1].angle_deg is None


@pytest.mark.parametrize(("sign", "is_roll"), [(-1.0, True), (1.0, False)])
def test_what_moves_the_ranges_opposite_is_a_roll(sign: float, is_roll: bool) -> None:
    """The left sensor rises by 10 mm, the right one falls as much, or rises too: 20 mm over 0.7 m are 1.64°."""
    no = np.zeros(len(TIMES))
    made = []
    for move, events in ((0.01, (1.2,)), (0.01 * sign, ())):
        range_m = np.where(TIMES > 1.1, 0.35 + move, 0.35)
        found = tuple(StepEvent(at, 0.36, 1.0, 20.0, 16.5, int(300 * at)) for at in events)
        valid = no == 0
        made.append(StepTrace(1, TIMES, range_m, no, no, no, no, valid, ~valid, 16.5, "evidence", "nats", found))
    (event,) = pair_events(made, made, APPROACH, SensorPair())
    assert event.is_roll is is_roll
    assert event.roll_deg == pytest.approx(math.degrees(0.02 / 0.7) if is_roll else 0.0, abs=1e-6)


def test_wrong_input_is_refused() -> None:
    with pytest.raises(ValueError, match=r"two lateral places; got 0\.3 m for both"):
        SensorPair(first_m=0.3, second_m=0.3)
    one = series(np.full((40, 128), 100, np.uint16))
    with pytest.raises(ConfigError, match="`thesis` does not"):
        detect_pair(ThesisDetector(), [one, one])
    with pytest.raises(ConfigError, match="`default` does not"):
        detect_pair(DefaultDetector(approach=None), [one, one])
    with pytest.raises(ValueError, match="got 1"):
        detect_pair(DefaultDetector(), [one])
    late = dataclasses.replace(one, times_ns=one.times_ns + 10**11)
    with pytest.raises(ConfigError, match="share no time"):
        detect_pair(ApproachDetector(), [one, late])
    assert detect_pair(ApproachDetector(), [one, one]) == ()


def test_counts_of_what_is_recovered() -> None:
    none = np.full((4, 2), np.nan)
    one, two = np.array([0.05, 0.03, -0.01, np.nan]), np.array([0.05, 0.05, 0.02, 0.05])
    found = Oblique(one, two, np.full(4, 0.05), none[:, 0], none)
    record = oblique_total([found, found]).record()
    counted = ("drives", "late", "told_late", "told_late_recovered", "after", "never", "recovered", "pair_after")
    assert [record[name] for name in counted] == [8, 6, 4, 2, 4, 2, 4, 0]
    assert record["recovered_share"]["value"] == pytest.approx(2 / 3)
    assert len({cell.name for cell in oblique_grid()}) == 36


@pytest.mark.long
def test_two_sensors_recover_what_one_reports_too_late() -> None:
    cell = ObliqueCell("specular", 20.0, 0.02, 20.0)
    found = measure_oblique(cell, DefaultDetector(), 16, seeds=drive_seeds)
    assert found.late.sum() >= 5
    assert found.recovered.sum() >= 0.7 * found.late.sum()
    assert np.nanmedian(np.abs(found.angle_error_deg)) < 8.0
