"""The demo's drive holds what its docstring says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from jaxradar.drive import RoadStep
from jaxradar.logs import read_log, write_log
from jaxradar.sim import DemoScene, demo_drive

STILL = DemoScene(fading=0.0, jitter_s=0.0, amplitude=30_000.0)


def echo_m(scene: DemoScene) -> np.ndarray:
    """Range of the echo by its centre of mass, no peak finder of the package."""
    series = demo_drive(1, scene).sensors[0]
    weight = np.maximum(series.sweeps.astype(np.float64) - 3000.0, 0.0)
    return (weight * series.range_m).sum(axis=1) / weight.sum(axis=1)


def test_the_same_seed_gives_the_same_drive_and_another_does_not() -> None:
    one, two, other = demo_drive(5).sensors[0], demo_drive(5).sensors[0], demo_drive(6).sensors[0]
    assert np.array_equal(one.sweeps, two.sweeps)
    assert np.array_equal(one.times_ns, two.times_ns)
    assert not np.array_equal(one.sweeps, other.sweeps)


def test_it_has_the_shape_of_a_lab_log() -> None:
    drive = demo_drive()
    (series,) = drive.sensors
    assert (series.sensor, series.sweeps.shape, series.sweeps.dtype) == (3, (200, 128), np.dtype(np.uint16))
    assert series.range_m[0] == 0.099768
    assert series.range_m[-1] == pytest.approx(0.099768 + 127 * 0.0070338)
    assert series.times_ns[0] == 0
    assert 0.6e-3 < np.std(np.diff(series.times_s)) / np.sqrt(2) < 1.4e-3  # two jitters of 1 ms in each difference
    assert (series.sweeps % 8 == 0).all()
    assert drive.truth is not None
    assert drive.truth.steps == (RoadStep(1.2, 0.04),)
    assert drive.mounting is not None
    assert (drive.mounting.height_m, drive.mounting.angle_deg, drive.mounting.front_wheel_m) == (0.35, 45.0, 0.15)


def test_the_noise_is_rayleigh_of_164_counts() -> None:
    far = demo_drive().sensors[0].sweeps[:, 80:].astype(np.float64)
    assert far.mean() == pytest.approx(164 * np.sqrt(np.pi / 2), rel=0.02)
    assert np.mean(far**2) == pytest.approx(2 * 164**2, rel=0.03)


def test_the_step_moves_the_echo_by_its_share_of_the_height_before_the_impact() -> None:
    echo = echo_m(STILL)
    times_s = demo_drive(1, STILL).sensors[0].times_s
    # Look-ahead 0.45 H and overhang 0.15 m less the 0.12 m by which a tyre of 0.2 m reaches ahead, at 30 km/h.
    assert STILL.impact_s - STILL.face_s == pytest.approx((0.15 + 0.1575 - 0.12) / (30 / 3.6))
    before = echo[times_s < STILL.face_s - 0.002]
    after = echo[(times_s > STILL.face_s + 0.006) & (times_s < STILL.impact_s)]
    assert before == pytest.approx(1.1 * 0.35, abs=0.5e-3)
    assert after == pytest.approx(1.1 * (0.35 - 0.04), abs=0.5e-3)
    assert echo[-1] == pytest.approx(1.1 * 0.35, abs=6e-3)  # the body has risen too, and sways still


def test_a_flat_road_has_no_step_and_no_bump() -> None:
    flat = demo_drive(0, DemoScene(step_m=0.0))
    assert flat.truth is not None
    assert flat.truth.steps == ()
    assert flat.motion.acceleration_m_s2 is not None
    assert np.abs(flat.motion.acceleration_m_s2.values).max() < 5


@pytest.mark.parametrize("seed", range(5))
def test_the_bump_passes_15_after_the_contact(seed: int) -> None:
    channel = demo_drive(seed, DemoScene(rate_hz=1000.0)).motion.acceleration_m_s2
    assert channel is not None
    first = channel.times_s[np.argmax(channel.values >= 15)]
    assert 0.014 <= first - 1.2 <= 0.022  # requirement 2A, over six parameter sets
    assert 16 <= channel.values.max() <= 21
    assert (channel.values % 1 == 0).all()


def test_it_goes_through_the_labs_format_unchanged(tmp_path: Path) -> None:
    drive = demo_drive(2)
    assert write_log(drive, tmp_path / "log") == []
    back = read_log(tmp_path / "log")
    assert np.array_equal(back.sensors[0].sweeps, drive.sensors[0].sweeps)
    assert np.array_equal(back.sensors[0].times_ns, drive.sensors[0].times_ns)
    assert (back.truth, back.mounting) == (drive.truth, drive.mounting)
    assert back.problems == ()


@pytest.mark.parametrize(
    ("argument", "value"),
    [
        ("duration_s", 0.0),
        ("rate_hz", -1.0),
        ("step_m", 0.2),
        ("step_m", -0.01),
        ("jitter_s", -1.0),
        ("speed_m_s", 0.0),
    ],
)
def test_a_scene_out_of_bounds_is_refused(argument: str, value: float) -> None:
    with pytest.raises(ValueError, match=rf"DemoScene\({argument}=\.\.\.\).*{value}"):
        DemoScene(**{argument: value})
