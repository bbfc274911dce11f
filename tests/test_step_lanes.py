"""Series of any length side by side: the same decisions as one by one, whoever goes along."""

from __future__ import annotations

import dataclasses
import json
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from step_samples import BINS, RANGE_M, echo

from jaxradar import ConfigError
from jaxradar.drive import SensorSeries, SweepFlag
from jaxradar.systems.step import (
    Decision,
    LabLiveDetector,
    RangeRateDetector,
    ShiftDetector,
    ThesisDetector,
    detect,
    detect_series,
    lanes,
)

FIELDS = tuple(field.name for field in dataclasses.fields(Decision))
DETECTORS: dict[str, Any] = {
    "thesis": ThesisDetector(),
    "lab-live": LabLiveDetector(nearest_m=0.35),
    "range-rate": RangeRateDetector(),
    "shift": ShiftDetector(cell_m=0.06),  # a third of the cells: a program of a second
}
LENGTHS = (1, 300, 0, 64, 257, 31, 1000, 2, 90)


def make(length: int, seed: int, bins: int = BINS, gaps: bool = True, dtype: Any = np.uint16) -> SensorSeries:
    """An echo that steps about over noise, with sweeps that failed, jittered times and saturation."""
    rng = np.random.default_rng([seed, length])
    axis = RANGE_M if bins == BINS else 0.2 + 0.5 / bins * np.arange(bins)
    places = 0.45 + np.cumsum(np.where(rng.random(length) < 0.03, rng.normal(0, 0.05, length), 0))
    rows = [echo(place, axis=axis) for place in np.clip(places, axis[3], axis[-4])]
    noise = rng.integers(0, 90, (length, bins))
    sweeps = (np.array(rows).reshape(length, bins) + noise).astype(dtype)
    flags = np.zeros(length, np.uint16)
    if gaps:
        flags[rng.random(length) < 0.05] = np.uint16(SweepFlag.NO_AMPLITUDES)
        flags[rng.random(length) < 0.02] |= np.uint16(SweepFlag.SATURATED)
    times = np.cumsum(rng.integers(2_000_000, 12_000_000, length)).astype(np.int64)
    return SensorSeries(1, times, sweeps, axis, flags)


def assert_as_alone(detector: Any, series: SensorSeries, found: dict[str, np.ndarray]) -> None:
    alone = detect(detector, series)
    for name in ("valid", "saturated", "statistic", "strength"):
        np.testing.assert_array_equal(found[name], getattr(alone, name), name)
    seen = alone.valid
    np.testing.assert_array_equal(found["range_m"][seen], alone.range_m[seen])
    assert np.flatnonzero(found["event"]).tolist() == [event.sweep for event in alone.events]


@pytest.mark.parametrize(
    ("name", "gaps"),
    [
        *(("thesis", True), ("lab-live", True)),
        *(
            pytest.param(*one, marks=pytest.mark.long)
            for one in (
                *(("shift", True), ("shift", False), ("thesis", False)),
                *(("range-rate", True), ("range-rate", False), ("lab-live", False)),
            )
        ),
    ],
)
def test_series_of_all_lengths_are_decided_as_alone(name: str, gaps: bool) -> None:
    detector = DETECTORS[name]
    held = [make(length, seed, gaps=gaps) for seed, length in enumerate(LENGTHS)]
    found = dict(detect_series(detector, held, FIELDS))
    assert sorted(found) == list(range(len(held)))
    for place, series in enumerate(held):
        assert_as_alone(detector, series, found[place])


@pytest.mark.parametrize("name", ["thesis", pytest.param("shift", marks=pytest.mark.long)])
def test_more_series_than_lanes_and_longer_than_a_chunk(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lanes, "LANES_BY_TIME", 3)
    monkeypatch.setattr(lanes, "LANES_BY_LOGS", 3)
    monkeypatch.setattr(lanes, "CHUNK_SWEEPS_BY_TIME", 3 * 16)
    monkeypatch.setattr(lanes, "CHUNK_SWEEPS_BY_LOGS", 3 * 16)
    detector = DETECTORS[name]
    held = [make(length, seed) for seed, length in enumerate((50, 16, 17, 15, 200, 1, 33, 48, 5, 90))]
    found = dict(detect_series(detector, held, FIELDS))
    for place, series in enumerate(held):
        assert_as_alone(detector, series, found[place])


def test_mixed_axes_and_dtypes_do_not_meet(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lanes, "LOOK_AHEAD", 4)
    kinds = [(BINS, np.uint16), (40, np.uint16), (BINS, np.float32), (40, np.uint16)]
    held = [make(60 + seed, seed, bins, dtype=dtype) for seed, (bins, dtype) in enumerate(kinds * 3)]
    found = dict(detect_series(ThesisDetector(), held, FIELDS))
    assert sorted(found) == list(range(len(held)))
    for place, series in enumerate(held):
        assert_as_alone(ThesisDetector(), series, found[place])


def test_a_rare_axis_waits_no_longer_than_it_may(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lanes, "LOOK_AHEAD", 4)
    monkeypatch.setattr(lanes, "LONGEST_WAIT", 8)
    monkeypatch.setattr(lanes, "LANES_BY_LOGS", 2)
    monkeypatch.setattr(lanes, "MOST_RESULTS", 1)
    read: list[int] = []

    def series() -> Iterator[SensorSeries]:
        for seed in range(200):
            read.append(seed)
            yield make(30, seed, 40 if seed == 5 else BINS)

    for place, _ in detect_series(ThesisDetector(), series(), FIELDS):
        if place == 5:
            assert len(read) < 60
            break
    else:
        raise AssertionError("the rare one never came")


def test_what_goes_along_changes_nothing() -> None:
    one = make(300, 1)
    (alone,) = (found for _, found in detect_series(DETECTORS["shift"], [one], FIELDS))
    among = dict(detect_series(DETECTORS["shift"], [make(90, 5), one, make(500, 6)], FIELDS))[1]
    for name in FIELDS:
        np.testing.assert_array_equal(alone[name], among[name], name)


def test_fields_that_are_asked_for() -> None:
    (found,) = (found for _, found in detect_series(ThesisDetector(), [make(20, 0)], ("event",)))
    assert list(found) == ["event"]
    assert found["event"].dtype == bool
    with pytest.raises(ConfigError, match="unknown field `evnt` \\(did you mean `event`"):
        next(detect_series(ThesisDetector(), [make(20, 0)], ("evnt",)))


def test_nothing_in_nothing_out() -> None:
    assert list(detect_series(ThesisDetector(), [])) == []
    (found,) = (found for _, found in detect_series(ThesisDetector(), [make(0, 0)]))
    assert all(len(values) == 0 for values in found.values())


def test_what_was_read_before_an_error_is_given_out() -> None:
    def source() -> Iterator[SensorSeries]:
        yield make(100, 1)
        yield make(40, 2)
        raise OSError("the disk is gone")

    places = []
    with pytest.raises(OSError, match="the disk is gone"):
        for place, _ in detect_series(ThesisDetector(), source()):
            places.append(place)
    assert sorted(places) == [0, 1]


def test_an_error_of_the_detector_is_raised_and_nothing_is_left_running() -> None:
    class Broken(ThesisDetector):
        def observe(self, *arguments: Any) -> Any:
            raise ArithmeticError("no")

    before = threading.active_count()
    with pytest.raises(ArithmeticError):
        list(detect_series(Broken(), [make(30, seed) for seed in range(5)]))
    assert threading.active_count() == before


def test_who_stops_early_leaves_nothing_running() -> None:
    read = []

    def source() -> Iterator[SensorSeries]:
        for seed in range(5000):
            read.append(seed)
            yield make(3, seed)

    before = threading.active_count()
    found = detect_series(ThesisDetector(), source())
    next(found)
    found.close()
    assert threading.active_count() == before
    assert len(read) < 5000


def test_what_lies_in_memory_is_not_read_far_ahead(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lanes, "LOOK_AHEAD_BYTES", 3 * 100 * BINS * 2)
    monkeypatch.setattr(lanes, "LANES_BY_LOGS", 2)
    held = most = 0

    def source() -> Iterator[SensorSeries]:
        nonlocal held, most
        for seed in range(40):
            held += 1
            most = max(most, held)
            yield make(100, seed)

    for _ in detect_series(ThesisDetector(), source()):
        held -= 1
    assert held == 0
    assert most < 30


_TWO_DEVICES = """
import json, sys
sys.path.insert(0, "tests")
import jax, numpy as np
from test_step_lanes import DETECTORS, FIELDS, make
from jaxradar.systems.step import detect_series, lanes
used = set()
begin = lanes._Lanes._begin
def seen(self, *arguments):
    used.add(self.device.id)
    return begin(self, *arguments)
lanes._Lanes._begin = seen
held = [make(200 + seed, seed) for seed in range(300)]
found = dict(detect_series(DETECTORS[sys.argv[1]], held, FIELDS))
sums = [float(np.sum(found[place][name])) for place in range(len(held)) for name in FIELDS]
print(json.dumps([len(jax.local_devices()), sorted(used), sums]))
"""


@pytest.mark.parametrize("name", ["thesis", pytest.param("shift", marks=pytest.mark.long)])
def test_two_devices_share_the_work(name: str) -> None:
    def ran(flags: str) -> Any:
        environment = {**os.environ, "XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu"}
        done = subprocess.run(
            [sys.executable, "-c", _TWO_DEVICES, name], env=environment, capture_output=True, text=True, check=True
        )
        return json.loads(done.stdout)

    one, two = ran(""), ran("--xla_force_host_platform_device_count=2")
    assert (one[0], two[0]) == (1, 2)
    assert two[1] == [0, 1]
    assert two[2] == one[2]
