"""Height and angle of a sensor out of a flat road: the mean profile against an oracle, fits of simulated roads."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxradar
from jaxradar._errors import ConfigError
from jaxradar.cli import main
from jaxradar.drive import Drive, SensorSeries
from jaxradar.sim import CarMotion, Mount, simulate
from jaxradar.suite.scenes import ROADS, base_scene
from jaxradar.survey import Beam, Ground, calibrate
from jaxradar.survey.ground import ground_profile, strips_of
from jaxradar.systems.step import DefaultDetector, load_detector

RANGE_M = np.arange(0.107, 0.98, 0.014)
WET = Ground(0.35, math.radians(45.0), math.log(0.21), 8.0, 5.0, 9.0)


def plain_profile(ground: Ground, range_m: np.ndarray) -> np.ndarray:
    """The same integral over the road, patch by patch, in float64."""
    h, down, log_slope, log_facets, log_grain, log_noise = (float(one) for one in ground)
    x, y = np.meshgrid(np.arange(-0.6, 1.2, 0.004) + 0.002, (np.arange(120) + 0.5) / 240.0, indexing="ij")
    r = np.sqrt(x**2 + y**2 + h**2)
    cosine = h / r
    tan2 = (1.0 - cosine**2) / cosine**2
    echo = np.exp(log_facets) * np.exp(-tan2 / (2.0 * math.exp(log_slope) ** 2)) / cosine**4
    echo = echo + np.exp(log_grain) * cosine**2
    vertical = np.degrees(np.arctan2(h, x) - down) / 55.0
    lateral = np.degrees(np.arctan2(y, np.hypot(x, h))) / 80.0
    power = echo * 4.0 ** (-4.0 * (vertical**2 + lateral**2)) * r**-4.0 * 0.004 * (2.0 / 240.0)
    sigma = 0.06 / (2.0 * math.sqrt(2.0 * math.log(2.0)))
    return np.array([np.sum(power * np.exp(-(((r - one) / sigma) ** 2))) for one in range_m]) + math.exp(log_noise)


@pytest.mark.parametrize("slope", [0.1, 0.21, 0.7])
def test_the_mean_profile_is_the_integral_over_the_road(slope: float) -> None:
    ground = WET._replace(log_slope=math.log(slope))
    found = ground_profile(Beam(), Ground(*map(jnp.asarray, ground)), strips_of(Beam(), 0.98), RANGE_M)
    np.testing.assert_allclose(found, plain_profile(ground, RANGE_M), rtol=0.03)


def test_the_profile_s_gradient_is_that_of_differences() -> None:
    with jax.enable_x64(True):
        strips = strips_of(Beam(), 0.98)
        total = lambda values: jnp.sum(jnp.log(ground_profile(Beam(), Ground(*values), strips, RANGE_M)))  # noqa: E731
        values = jnp.asarray(WET)
        slope = jax.grad(total)(values)
        for place in range(len(values)):
            step = jnp.zeros(len(values)).at[place].set(1e-5)
            wanted = (total(values + step) - total(values - step)) / 2e-5
            assert float(slope[place]) == pytest.approx(float(wanted), rel=1e-4, abs=1e-4)


def speckle(ground: Ground, sweeps: int, standing: bool = False) -> SensorSeries:
    """Sweeps whose field is complex Gaussian, with the covariance of the road's patches and the receiver's noise."""
    random = np.random.default_rng(1)
    h, down, log_slope, log_facets, log_grain, log_noise = (float(one) for one in ground)
    x, y = np.meshgrid(np.arange(-0.6, 1.1, 0.01) + 0.005, (np.arange(60) + 0.5) / 120.0, indexing="ij")
    r = np.sqrt(x**2 + y**2 + h**2).ravel()
    cosine = h / r
    echo = np.exp(log_facets - 0.5 * (1.0 / cosine**2 - 1.0) / math.exp(log_slope) ** 2) / cosine**4
    echo += np.exp(log_grain) * cosine**2
    vertical = np.degrees(np.arctan2(h, x.ravel()) - down) / 55.0
    lateral = np.degrees(np.arctan2(y.ravel(), np.hypot(x.ravel(), h))) / 80.0
    power = echo * 4.0 ** (-4.0 * (vertical**2 + lateral**2)) * r**-4.0 * 0.01 * (2.0 / 120.0)
    axis = 0.1 + 0.007 * np.arange(128)
    pulses = np.exp(-0.5 * ((r[:, None] - axis) / (0.06 / 2.3548)) ** 2)
    root = np.linalg.cholesky((pulses * power[:, None]).T @ pulses + 1e-6 * power.max() * np.eye(128))
    draw = lambda count: (random.normal(size=(2, count, 128)) * math.sqrt(0.5)).astype(float)  # noqa: E731
    field = draw(1 if standing else sweeps) @ root.T + math.exp(0.5 * log_noise) * draw(sweeps)
    envelope = np.sqrt(np.sum(field**2, axis=0)).astype(np.float32)
    times = (np.arange(sweeps) * 10_000_000 // 3).astype(np.int64)
    return SensorSeries(3, times, envelope, axis, np.zeros(sweeps, np.uint16))


@pytest.mark.parametrize(("height_m", "angle_deg"), [(0.27, 38.0), (0.42, 52.0)])
def test_height_and_angle_of_speckle_are_found(height_m: float, angle_deg: float) -> None:
    truth = WET._replace(height_m=height_m, down_rad=math.radians(angle_deg), log_facets=14.0, log_grain=11.0)
    found = calibrate(speckle(truth, 300))
    assert found.determined
    assert found.height_m == pytest.approx(height_m, abs=3.0 * found.height_sd_m)
    assert found.angle_deg == pytest.approx(angle_deg, abs=3.0 * found.angle_sd_deg)
    assert found.height_sd_m < 0.004
    assert found.misfit < 3.0


def test_who_stands_knows_less() -> None:
    """One speckle pattern, however often it is seen."""
    truth = WET._replace(log_facets=14.0, log_grain=11.0)
    standing, moving = calibrate(speckle(truth, 300, standing=True)), calibrate(speckle(truth, 300))
    assert standing.height_sd_m > 2.0 * moving.height_sd_m
    assert standing.angle_sd_deg > 2.0 * moving.angle_sd_deg
    assert standing.height_m == pytest.approx(0.35, abs=3.0 * standing.height_sd_m)


@pytest.mark.long
@pytest.mark.parametrize(
    ("road", "height_m", "angle_deg"), [("wet", 0.25, 35.0), ("diffuse", 0.35, 55.0), ("rough", 0.35, 45.0)]
)
def test_a_simulated_sensor_is_found(road: str, height_m: float, angle_deg: float) -> None:
    mount = Mount(height_m=height_m, angle_deg=angle_deg)
    scene = base_scene(ROADS[road], mount=mount, motion=CarMotion(speed_m_s=8.0), duration_s=2.0)
    found = calibrate(simulate(scene, 3).sensors[0])
    assert found.height_m == pytest.approx(height_m, abs=4.0 * found.height_sd_m)
    assert found.angle_deg == pytest.approx(angle_deg, abs=4.0 * found.angle_sd_deg)


def test_what_cannot_be_calibrated_is_refused() -> None:
    series = speckle(WET, 60)
    few = dataclasses.replace(series, times_ns=series.times_ns[:9], sweeps=series.sweeps[:9], flags=series.flags[:9])
    with pytest.raises(ConfigError, match="at least 48 sweeps with data; sensor 3 has 9"):
        calibrate(few)
    noise = np.random.default_rng(0).rayleigh(150.0, series.sweeps.shape).astype(np.float32)
    with pytest.raises(ConfigError, match="shows no echo of a road"):
        calibrate(dataclasses.replace(series, sweeps=noise))
    with pytest.raises(ConfigError, match="shows no echo of a road"):
        calibrate(dataclasses.replace(series, sweeps=np.zeros_like(noise)))


def test_the_command_says_what_to_paste(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drive = Drive(sensors=(speckle(WET._replace(log_facets=14.0, log_grain=11.0), 300),))
    path = tmp_path / "flat.drive"
    jaxradar.write_log(drive, path)
    assert main(["calibrate", str(path)]) == 0
    said = capsys.readouterr().out
    told = tmp_path / "told.toml"
    told.write_text(f'format = 1\ndetector = "default"\n{said}', encoding="utf-8")
    file = load_detector(told)
    assert file.mounting is not None
    assert file.mounting.height_m == pytest.approx(0.35, abs=0.01)
    assert isinstance(file.detector, DefaultDetector)
    assert float(file.detector.approach.height_m) == pytest.approx(file.mounting.height_m)  # type: ignore[union-attr]
    mine = tmp_path / "mine.toml"
    assert main(["calibrate", str(path), "-o", str(mine), "--detector", "approach"]) == 0
    capsys.readouterr()
    assert float(load_detector(mine).detector.height_m) == pytest.approx(file.mounting.height_m, abs=1e-4)
    assert load_detector(mine).provenance["calibrated_on"].endswith("flat.drive, sensor 3")
    assert main(["calibrate", str(path), "-o", str(path)]) == 2
    assert "overwrite the log" in capsys.readouterr().err
    assert main(["calibrate", str(path), "--json", "--stop", "0.8"]) == 0
    (line,) = capsys.readouterr().out.splitlines()
    assert json.loads(line)["height_m"] == pytest.approx(0.35, abs=0.01)
    assert main(["calibrate", str(path), "--stop", "0.1"]) == 1
    assert "at least 48 sweeps" in capsys.readouterr().err
    assert main(["calibrate", str(path), "--sensor", "9"]) == 1
    assert "has no sensor 9" in capsys.readouterr().err
