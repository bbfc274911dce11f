"""Compiled detectors on recordings of real roads, sweep by sweep, against the whole recording at once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from live_samples import RECORDED_M, compiled_detector, exported, taken, wanted

from jaxradar import read_log
from jaxradar.drive import Drive
from jaxradar.live.detect import LiveDecision
from jaxradar.systems.step import detect, thin

ULPS = 4.0
# Of the largest.
TOLERANCE = 1e-5


def differing(name: str, path: Path) -> tuple[int, int, list[LiveDecision]]:
    """Of one recording: sweeps that differ with the statistic within 4 ulp of the threshold, sweeps that differ
    otherwise, and all decisions."""
    detector = wanted(name)
    series = thin(read_log(path).sensors[0], 128)
    header, live = compiled_detector(exported(name))
    header.check_axis(series.range_m)
    found = taken(live, Drive((series,)))[series.sensor]
    trace = detect(detector, series)
    events = np.isin(np.arange(len(series)), [event.sweep for event in trace.events])
    flags = np.array([(one.valid, one.saturated, one.event) for one in found])
    differ = (flags != np.column_stack([trace.valid, trace.saturated, events])).any(axis=1)
    near = np.zeros(len(series), bool)
    for name in ("range_m", "statistic"):
        numbers = np.array([getattr(one, name) for one in found])
        values = np.where(trace.valid, getattr(trace, name), numbers)
        differ |= np.abs(numbers - values) > TOLERANCE * max(np.abs(values).max(), 1e-9)
        if name == "statistic":
            near = np.abs(values - header.threshold) <= ULPS * np.spacing(np.float32(header.threshold))
    return int((differ & near).sum()), int((differ & ~near).sum()), found


@pytest.mark.parametrize("name", ["demo1", "grass_0_60"])
def test_two_recordings_sweep_by_sweep(name: str, road_recordings: dict[str, Path]) -> None:
    near, other, found = differing("recorded-filtered-rate", road_recordings[name])
    assert (near, other) == (0, 0)
    assert len(found) > 100
    assert sum(one.valid for one in found) > 0.8 * len(found)


@pytest.mark.long
@pytest.mark.parametrize("detector", ["recorded-filtered-rate", "recorded-default"])
def test_all_recordings_sweep_by_sweep(detector: str, road_recordings: dict[str, Path]) -> None:
    """At most one sweep of each hundred lies so near the threshold that rounding decides; none differs otherwise."""
    assert RECORDED_M.shape == (128,)
    counts = {name: differing(detector, path)[:2] for name, path in road_recordings.items()}
    sweeps = sum(len(read_log(path).sensors[0]) for path in road_recordings.values())
    print(counts, sweeps)
    assert sum(near for near, _ in counts.values()) <= 0.01 * sweeps
    assert {name: other for name, (_, other) in counts.items() if other} == {}
