"""What the benches hold the detectors against does the same work: a peer that decides otherwise tells nothing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live_samples import ready_drive

from jaxradar import SensorSeries, load_scene, simulate
from jaxradar.export.check import check_sweeps, reference
from jaxradar.live.detect import Step
from jaxradar.systems.step import DefaultDetector, RangeAxis, load_detector, time_steps
from jaxradar.systems.step.packed import DECISION_FIELDS, PackedStep

DETECTOR = load_detector("default").detector
# Of a field's largest value: of the statistic and the range all that rounding leaves.
MOST_OFF = {"range_m": 1e-5, "statistic": 1e-4, "strength": 1e-5, "impact_in_s": 1e-4, "speed_m_s": 1e-3}


@pytest.fixture
def peer(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(Path(__file__).resolve().parents[1] / "benches")
    from peers.numpy_step import NumpyDefault

    return NumpyDefault


def rows_of(series: SensorSeries) -> np.ndarray:
    return jittered(np.column_stack([series.sweeps, series.flags, time_steps(series.times_ns)]).astype(np.float32))


def jittered(rows: np.ndarray) -> np.ndarray:
    """At even times evidence comes to lie just between two places, and rounding says on which it is."""
    made = rows.copy()
    made[:, -1] *= np.random.default_rng(0).uniform(0.999, 1.001, len(rows))
    return made


def decided(step: Step, rows: np.ndarray) -> np.ndarray:
    found = []
    for row in rows:
        step.inputs[:] = row
        found.append(step.run())
    return np.array(found)


def assert_same(found: np.ndarray, wanted: np.ndarray, flips: int = 0) -> None:
    """All fields at valid sweeps. `flips`: of how many sweeps rounding may take another of two equal bins to look
    around."""
    assert found.shape == wanted.shape
    field = {name: (found[:, place], wanted[:, place]) for place, name in enumerate(DECISION_FIELDS)}
    valid = field["valid"][1] > 0
    for name in ("valid", "saturated", "event"):
        np.testing.assert_array_equal(*field[name], err_msg=name)
    for name, share in MOST_OFF.items():
        ours, theirs = (values[valid] for values in field[name])
        off = np.abs(ours - theirs) > share * np.abs(theirs).max()
        assert off.sum() <= (flips if name in ("range_m", "speed_m_s") else 0), (name, np.flatnonzero(off))


@pytest.mark.parametrize(
    ("scene", "events", "flips"), [("wet-road", True, 0), ("pulling-away", False, 4), ("lost-echo", True, 0)]
)
def test_numpy_decides_as_the_detector(peer: Any, scene: str, events: bool, flips: int) -> None:
    series = simulate(load_scene(scene), seed=1).sensors[0]
    assert len(series.range_m) == 128
    step = PackedStep(DETECTOR, RangeAxis.of(series.range_m))
    rows = rows_of(series)
    wanted = reference(step, rows)
    assert wanted[:, DECISION_FIELDS.index("event")].any() == events
    assert_same(decided(peer(DETECTOR, step.axis), rows), wanted, flips)


@pytest.mark.parametrize("level", [1.0, 0.3])
def test_numpy_decides_as_the_detector_whatever_befalls_a_sweep(peer: Any, level: float) -> None:
    """Silence, saturation, flags, gaps, clocks that stand or go back; and with a threshold that much passes."""
    detector = DETECTOR.with_threshold(level)
    one = ready_drive().sensors[0]
    step = PackedStep(detector, RangeAxis.of(one.range_m))
    first = peer(detector, step.axis)
    assert isinstance(first, Step)
    rows = np.concatenate([jittered(check_sweeps(step, None)), rows_of(one)])
    assert_same(decided(first.another(), rows), reference(step, rows), flips=2)


def test_sensors_share_no_state(peer: Any) -> None:
    axis = RangeAxis.of(ready_drive().sensors[0].range_m)
    rows = rows_of(ready_drive().sensors[0])[:150]
    one = peer(DETECTOR, axis)
    other = one.another()
    alone = decided(one.another(), rows)
    for row, wanted in zip(rows, alone, strict=True):
        for each in (one, other):
            each.inputs[:] = row
            np.testing.assert_array_equal(each.run(), wanted)


def test_numpy_takes_both_parts_or_none(peer: Any) -> None:
    axis = RangeAxis.of(ready_drive().sensors[0].range_m)
    with pytest.raises(ValueError, match="both of its parts"):
        peer(DefaultDetector(shift=None), axis)
