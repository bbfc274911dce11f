"""Drives and log texts that the tests of readers and writers share."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from jaxradar.drive import Channel, Drive, Motion, Mounting, RoadStep, SensorSeries, SweepFlag, Truth

# Figure C.1 of the thesis: what its table shows, in the bytes that its program writes.
FIGURE_AXIS = (0.099768, 0.106802, 0.113836, 0.12087, 0.127904, 0.134937)
FIGURE_ROWS = (
    (0, 128, 104, 168, 304, 272, 272),
    (0.012, 272, 336, 104, 96, 192, 216),
    (0.02, 56, 144, 296, 304, 144, 232),
    (0.03, 120, 192, 144, 112, 280, 296),
    (0.04, 120, 120, 96, 112, 184, 136),
    (0.05, 184, 264, 168, 184, 264, 312),
    (0.06, 256, 232, 16, 128, 240, 296),
    (0.07, 208, 368, 192, 120, 176, 264),
    (0.08, 168, 168, 144, 168, 208, 248),
    (0.09, 200, 280, 200, 168, 144, 144),
    (0.1, 168, 272, 256, 232, 232, 160),
    (0.11, 256, 528, 272, 80, 152, 176),
    (0.131, 336, 472, 368, 208, 80, 144),
)


def lab_text(axis: Any, rows: Any) -> str:
    """The lab's bytes: `,%f` for each bin, then `\\n%f` and `,%lf` for each sweep, and no line end."""
    header = "".join(f",{metres:f}" for metres in axis)
    return header + "".join("\n" + ",".join(f"{value:f}" for value in row) for row in rows)


FIGURE_TEXT = lab_text(FIGURE_AXIS, FIGURE_ROWS)


@functools.cache
def trial_drive(seed: int = 0) -> Drive:
    """The thesis's trial as simulated: 600 sweeps, one step, acceleration."""
    from jaxradar.sim import load_scene, simulate  # brings JAX, which most readers' tests do without

    return simulate(load_scene("trial"), seed)


def recordings(folder: str) -> Path:
    """A folder of the real recordings, which lie beside the repository; skips the test where they do not."""
    path = Path(__file__).resolve().parents[2] / "shared" / "data" / folder
    if not path.is_dir():
        pytest.skip(f"the real recordings of {folder} are not on this machine")
    return path


def assert_series_equal(left: SensorSeries, right: SensorSeries) -> None:
    assert left.sensor == right.sensor
    for name in ("times_ns", "sweeps", "range_m", "flags"):
        np.testing.assert_array_equal(getattr(left, name), getattr(right, name), err_msg=name)
    assert left.sweeps.dtype == right.sweeps.dtype
    assert left.spec == right.spec


def assert_drives_equal(left: Drive, right: Drive) -> None:
    """Every field, to the bit."""
    assert [series.sensor for series in left.sensors] == [series.sensor for series in right.sensors]
    for one, other in zip(left.sensors, right.sensors, strict=True):
        assert_series_equal(one, other)
    for name, channel in vars(left.motion).items():
        wanted = getattr(right.motion, name)
        assert (channel is None) == (wanted is None), name
        if channel is not None:
            np.testing.assert_array_equal(channel.times_ns, wanted.times_ns)
            np.testing.assert_array_equal(channel.values.view(np.int64), wanted.values.view(np.int64))
    for name in ("mounting", "truth", "started_at_ns", "clock_start_ns", "problems"):
        assert getattr(left, name) == getattr(right, name), name


def sample_drive(sweeps: int = 5, bins: int = 4, *, sensors: tuple[int, ...] = (1, 3)) -> Drive:
    """Two sensors, all channels, everything that a drive can say."""
    rng = np.random.default_rng(7)
    times = np.arange(sweeps, dtype=np.int64) * 10_000_000
    flags = np.zeros(sweeps, np.uint16)
    flags[-1:] = SweepFlag.QUALITY_WARNING
    axis = 0.099768 + np.arange(bins) * 0.007034
    return Drive(
        sensors=tuple(
            SensorSeries(
                number,
                times + number * 1000 - sensors[0] * 1000,
                rng.integers(0, 3000, (sweeps, bins)).astype(np.uint16),
                axis,
                flags,
                {"profile": "PROFILE_2", "sensor": [number]},
            )
            for number in sensors
        ),
        motion=Motion(
            acceleration_m_s2=Channel(times, np.round(rng.normal(0, 9, sweeps))),
            speed_m_s=Channel(times[::2].copy(), rng.normal(8, 1, len(times[::2]))),
        ),
        mounting=Mounting(height_m=0.35, angle_deg=45.0),
        truth=Truth((RoadStep(0.02, 0.03), RoadStep(0.04))),
        started_at_ns=1_632_137_110_123_456_789,
        clock_start_ns=20_000_000,
        problems=("One thing was mended.",),
    )


@st.composite
def drives(draw: st.DrawFn) -> Drive:
    """Any drive that the data model allows."""
    finite = st.floats(allow_nan=False, allow_infinity=False)
    sensors = []
    for number in draw(st.lists(st.integers(0, 9), min_size=1, max_size=3, unique=True)):
        count, bins = draw(st.integers(0, 6)), draw(st.integers(2, 9))
        dtype = draw(st.sampled_from([np.uint16, np.float32, np.float64]))
        axis = sorted(draw(st.sets(st.floats(0, 30), min_size=bins, max_size=bins)))
        sensors.append(
            SensorSeries(
                number,
                draw(hnp.arrays(np.int64, count)),
                draw(hnp.arrays(dtype, (count, bins))),
                np.array(axis, np.float64),
                draw(hnp.arrays(np.uint16, count)),
                draw(st.dictionaries(st.text(max_size=4), finite | st.text(max_size=4) | st.none(), max_size=2)),
            )
        )
    channels = {}
    for name in draw(st.sets(st.sampled_from(["acceleration_m_s2", "yaw_rate_rad_s", "speed_m_s"]))):
        count = draw(st.integers(0, 5))
        channels[name] = Channel(draw(hnp.arrays(np.int64, count)), draw(hnp.arrays(np.float64, count)))
    steps = st.lists(st.builds(RoadStep, st.floats(-9e9, 9e9), st.none() | finite), max_size=3)
    return Drive(
        tuple(sensors),
        Motion(**channels),
        draw(st.none() | st.builds(Mounting, st.none() | finite, st.none() | finite, st.none() | finite)),
        draw(st.none() | steps.map(lambda found: Truth(tuple(found)))),
        draw(st.none() | st.integers(0, 2**62)),
        draw(st.integers(-(2**62), 2**62)),
        tuple(draw(st.lists(st.text(max_size=20), max_size=2))),
    )
