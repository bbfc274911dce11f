"""The matching rule: its edges exactly, the rest against an oracle that tries every assignment."""

from __future__ import annotations

from itertools import combinations, permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxradar.drive import Channel, RoadStep
from jaxradar.matching import MatchWindow, match_steps, speed_at, summarise


def steps(*impacts: float) -> list[RoadStep]:
    return [RoadStep(impact) for impact in impacts]


def speed_channel(times_s: list[float], values: list[float]) -> Channel:
    return Channel(np.asarray(np.asarray(times_s) * 1e9, np.int64), np.asarray(values, np.float64))


@pytest.mark.parametrize(
    ("time_s", "hits", "false_alarms"),
    [
        (1.0, 1, 0),  # at the impact
        (1.000000001, 0, 1),  # a nanosecond behind it
        (0.75, 1, 0),  # a whole window before it
        (0.749999999, 0, 1),  # a nanosecond earlier
    ],
)
def test_both_ends_of_the_window_belong_to_it(time_s: float, hits: int, false_alarms: int) -> None:
    matching = match_steps([time_s], steps(1.0))
    assert (matching.hits, matching.misses, matching.false_alarms) == (hits, 1 - hits, false_alarms)


def test_decimal_seconds_are_compared_as_they_are_written() -> None:
    assert 0.55 - 0.3 > 0.25  # what float64 makes of it
    assert match_steps([0.3], steps(0.55)).lead_s == (0.25,)


def test_the_earliest_is_the_hit_and_later_ones_count_as_nothing() -> None:
    matching = match_steps([0.97, 0.9, 0.99, 0.2], steps(1.0))
    assert (matching.steps, matching.hit_by, matching.lead_s) == (tuple(steps(1.0)), (1,), (0.1,))
    assert matching.false.tolist() == [3]


def test_no_step_is_knowledge_and_no_detection_is_an_answer() -> None:
    assert match_steps([0.1, 0.2], []).false.tolist() == [0, 1]
    assert match_steps([], steps(2.0, 1.0)).misses == 2
    nothing = match_steps([], [])
    assert (nothing.hits, nothing.misses, nothing.false_alarms, nothing.steps) == (0, 0, 0, ())


def test_close_steps_share_no_detection() -> None:
    both = match_steps([0.95], steps(1.1, 1.0))
    assert both.steps == tuple(steps(1.0, 1.1))
    assert both.hit_by == (0, None)
    assert match_steps([0.95, 0.8], steps(1.0, 1.1)).hit_by == (1, 0)


@pytest.mark.parametrize(
    ("speed", "window_s"),
    [
        (None, 0.25),
        (speed_channel([], []), 0.25),
        (speed_channel([0, 10], [2.0, 2.0]), 0.5),
        (speed_channel([0, 10], [20.0, 20.0]), 0.25),
        (speed_channel([0, 4], [0.0, 4.0]), 1 / 3),  # between the samples, at the impact
        (speed_channel([4, 0], [4.0, 0.0]), 1 / 3),  # times that go back
        (speed_channel([0, 2, 4], [0.0, np.nan, 4.0]), 1 / 3),
        (speed_channel([0, 2.9], [1.0, 1.0]), 0.25),  # not recorded at the impact
        (speed_channel([0, 10], [0.0, 0.0]), 0.25),
        (speed_channel([0, 10], [-3.0, -3.0]), 0.25),
    ],
)
def test_the_window_follows_the_speed_at_the_impact(speed: Channel | None, window_s: float) -> None:
    assert MatchWindow().before(speed_at(speed, 3.0)) == pytest.approx(window_s)
    assert match_steps([3.0 - window_s + 1e-6], steps(3.0), speed=speed).hits == 1
    assert match_steps([3.0 - window_s - 1e-6], steps(3.0), speed=speed).hits == 0


def test_both_parts_of_the_window_are_settable() -> None:
    speed = speed_channel([0, 10], [4.0, 4.0])
    assert match_steps([2.0], steps(3.0), speed=speed, window=MatchWindow(metres=4.0)).lead_s == (1.0,)
    assert match_steps([2.0], steps(3.0), window=MatchWindow(seconds=1.0)).lead_s == (1.0,)
    assert match_steps([3.0], steps(3.0), window=MatchWindow(0.0, 0.0)).lead_s == (0.0,)
    with pytest.raises(ValueError, match=r"seconds.*-1"):
        MatchWindow(seconds=-1.0)
    with pytest.raises(ValueError, match=r"metres.*nan"):
        MatchWindow(metres=float("nan"))


def test_a_crawling_car_has_a_long_window_and_no_overflow() -> None:
    assert match_steps([1.0], steps(500.0), speed=speed_channel([0, 1000], [1e-12, 1e-12])).hits == 1


def test_steps_outside_the_part_are_left_out_and_what_warned_of_them_is_excused() -> None:
    matching = match_steps([0.9, 1.95, 1.5], steps(1.0, 2.0), start_s=0.5, stop_s=1.96)
    assert matching.steps == tuple(steps(1.0))
    assert matching.lead_s == (0.1,)
    assert matching.false.tolist() == [2]
    assert match_steps([], steps(1.0), start_s=1.0, stop_s=1.0).misses == 1


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), 1e300])
def test_times_must_be_finite(bad: float) -> None:
    with pytest.raises(ValueError, match="detections_s"):
        match_steps([bad], [])
    with pytest.raises(ValueError, match="impact_s"):
        match_steps([], steps(bad))


def most_hits(times: list[int], impacts: list[int], reach: int) -> int:
    """The largest number of steps that any one-to-one assignment hits, by trying all of them."""
    for count in range(min(len(times), len(impacts)), 0, -1):
        for chosen in combinations(impacts, count):
            for taken in permutations(times, count):
                if all(0 <= impact - time <= reach for impact, time in zip(chosen, taken, strict=True)):
                    return count
    return 0


@settings(max_examples=150, deadline=None)
@given(
    times=st.lists(st.integers(0, 60), max_size=4),
    impacts=st.lists(st.integers(0, 60), max_size=4),
    reach=st.integers(0, 25),
)
def test_against_an_oracle_that_tries_every_assignment(times: list[int], impacts: list[int], reach: int) -> None:
    found = match_steps(
        [time / 100 for time in times], steps(*(impact / 100 for impact in impacts)), window=MatchWindow(reach / 100, 0)
    )
    assert found.hits == most_hits(times, impacts, reach)
    assert found.hits + found.misses == len(impacts)
    near = [any(0 <= impact - time <= reach for impact in impacts) for time in times]
    assert found.false.tolist() == [index for index, close in enumerate(near) if not close]
    taken = [index for index in found.hit_by if index is not None]
    assert len(set(taken)) == len(taken)
    leads = [
        (round(step.impact_s * 100) - times[index]) / 100
        for step, index in zip(found.steps, found.hit_by, strict=True)
        if index is not None
    ]
    assert list(found.lead_s) == pytest.approx(leads, abs=1e-12)
    # The first step has the whole choice: it takes the earliest of its window.
    if found.steps and found.hit_by[0] is not None:
        first = min(impacts)
        assert times[found.hit_by[0]] == min(time for time in times if 0 <= first - time <= reach)


def test_summary_of_many() -> None:
    one, two = match_steps([0.9, 5.0], steps(1.0, 3.0)), match_steps([1.8], steps(2.0))
    total = summarise([(one, 10.0), (two, 2.0)])
    assert (total.series, total.hits, total.misses, total.false_alarms) == (2, 2, 1, 1)
    assert total.detection_rate == pytest.approx(2 / 3)
    assert total.false_alarms_per_hour == pytest.approx(300.0)
    assert total.median_lead_s == pytest.approx(0.15)
    nothing = summarise([])
    assert (nothing.detection_rate, nothing.false_alarms_per_hour, nothing.median_lead_s) == (None, None, None)
