"""Simulated numbers beside recorded ones: the thesis's table C.1, the floor of real recordings, real speckle."""

from __future__ import annotations

import numpy as np
import pytest
from log_samples import FIGURE_AXIS, FIGURE_ROWS, recordings

from jaxradar import sim
from jaxradar.logs import read_log

TABLES = 1000


def test_table_c1_has_the_models_mean_and_grid(capsys: pytest.CaptureFixture[str]) -> None:
    recorded = np.array(FIGURE_ROWS)[:, 1:]
    radar = sim.Radar(start_m=FIGURE_AXIS[0], bin_m=FIGURE_AXIS[1] - FIGURE_AXIS[0], bins=len(FIGURE_AXIS))
    scene = sim.RoadScene(
        duration_s=TABLES * len(recorded) / 100,
        radar=radar,
        surface=None,
        effects=(sim.ReceiverNoise(), sim.Quantisation()),
    )
    tables = sim.simulate(scene).sensors[0].sweeps.astype(float).reshape(TABLES, *recorded.shape)
    means, spreads = tables.mean(axis=(1, 2)), tables.std(axis=(1, 2), ddof=1)
    share = np.mean(spreads <= recorded.std(ddof=1))
    p = 2 * min(share, 1 - share)
    with capsys.disabled():
        print(
            f"\ntable C.1: mean {recorded.mean():.0f}, spread {recorded.std(ddof=1):.0f}; "
            f"model {means.mean():.0f} ± {means.std():.0f} and {spreads.mean():.0f} ± {spreads.std():.0f}; "
            f"two-sided p of the spread {p:.3f}"
        )
    assert abs(recorded.mean() - means.mean()) < 2 * means.std()
    assert (recorded % 8 == 0).all()
    assert (tables % 8 == 0).all()
    # The model's spread is larger than the table's; were it far larger, the model would have to go.
    assert p > 0.001


def test_the_floor_is_that_of_the_recordings() -> None:
    names = ("Asphalt_0_45", "Asphaltwet_0_45", "Roughgravel_0_45", "cement_0_45")
    real = np.array([floor(read_log(recordings("a111_road") / f"{name}.h5").sensors[0].sweeps) for name in names])
    scene = sim.RoadScene(
        duration_s=10.0,
        radar=sim.Radar(start_m=0.2, bin_m=0.000484, bins=1240, rate_hz=31.5),
        surface=None,
        effects=(
            sim.ReceiverNoise(sigma=real[:, 0].mean() / np.sqrt(np.pi / 2), width_m=0.0),
            sim.RangeSmoothing(),
            sim.RunningAverage(),
            sim.Quantisation(step=2),
        ),
    )
    made = floor(sim.simulate(scene).sensors[0].sweeps[30:])
    for column, value in enumerate(made):
        assert real[:, column].min() / 1.25 < value < real[:, column].max() * 1.25, (column, value, real)


def floor(sweeps: np.ndarray) -> tuple[float, ...]:
    """Mean, standard deviation, correlation over 20 mm and from sweep to sweep of the 200 quietest bins."""
    values = sweeps.astype(float)
    mean = values.mean(axis=0)
    low = int(np.argmin(np.convolve(mean, np.ones(200), "valid")))
    noise = (values - mean)[:, low : low + 200]
    power = np.mean(noise**2)
    return (
        float(mean[low : low + 200].mean()),
        float(np.sqrt(power)),
        float(np.mean(noise[:, :-41] * noise[:, 41:]) / power),
        float(np.mean(noise[:-1] * noise[1:]) / power),
    )


def test_a_moving_road_is_fully_developed_speckle_as_a_real_one_is() -> None:
    """The intensity of speckle has a standard deviation of its mean (Goodman, Speckle Phenomena in Optics, 3.2)."""
    import h5py

    with h5py.File(recordings("a121_acconeer") / "surface_velocity_default.h5") as file:
        frames = file["sessions/session_0/group_0/entry_0/result/frame"][...]
    real = frames["real"].astype(float) ** 2 + frames["imag"].astype(float) ** 2
    scene = sim.RoadScene(duration_s=10.0)
    made = np.square(sim.simulate(scene).sensors[0].sweeps[:, 40:60], dtype=float)
    for intensity in (real.reshape(-1, 4), made):
        contrast = intensity.std(axis=0) / intensity.mean(axis=0)
        assert contrast == pytest.approx(1.0, abs=0.15), contrast
