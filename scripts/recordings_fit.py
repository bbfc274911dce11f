"""Scenes fitted to standing recordings of real roads by gradient; used by `compare_recordings.py`, which says how.

`Recording`s are loaded, `fit_scenes` finds what they have in common and what each surface is, `simulated` makes each of
them again at many places.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx

from jaxradar import sim
from jaxradar.drive import SensorSeries
from jaxradar.logs import read_log

PLACES = 40
COARSE = 8  # bins in one, for the fit
FIT_SWEEPS = 64  # of which each sees another part of the road
CELL_M = 0.06  # of a profile, independent of the next
SHAPE = 5.0  # of the gamma distribution of a smoothed profile over places: 1/0.45², measured on simulated ones

# Recording, surface: the angle of incidence ends the name, so that the mount's angle to the road is 90° less that.
RECORDINGS = {
    "Asphalt_0": "asphalt",
    "Asphaltwet_0": "wet-asphalt",
    "Roughgravel_0": "gravel",
    "cement_0": "cement",
    "grass_0": "grass",
    "water_0": "water",
}
GAIN_COUNTS, FWHM_M, SLOPE, GRAIN_DB = 1700.0, 0.045, 0.3, -18.0  # where the fit begins


@dataclasses.dataclass(frozen=True)
class Recording:
    """A real one. `incidence_deg`: of the line of sight, from the vertical."""

    name: str
    surface: str
    incidence_deg: float
    series: SensorSeries


@dataclasses.dataclass(frozen=True)
class Fit:
    """What is fitted: gain, pulse and slopes as logarithms of factors of the values below, heights in metres, grain in
    units of 10 dB from the value below."""

    gain: Any
    fwhm: Any
    height_m: Any
    slope: Any
    grain: Any


jax.tree_util.register_dataclass(Fit, ["gain", "fwhm", "height_m", "slope", "grain"], [])


def load(folder: Path) -> list[Recording]:
    """The recordings at whole angles, in order of surface and angle."""
    found = []
    for path in sorted(folder.glob("*.h5")):
        surface, _, angle = path.stem.rpartition("_")
        if surface in RECORDINGS and angle.isdigit():
            found.append(Recording(path.stem, RECORDINGS[surface], float(angle), read_log(path).sensors[0]))
    if not found:
        raise SystemExit(f"{folder}: no recordings named like Asphalt_0_45.h5.")
    return sorted(found, key=lambda one: (list(RECORDINGS.values()).index(one.surface), one.incidence_deg))


def recorder(series: SensorSeries, bins_in_one: int = 1) -> sim.Radar:
    """The radar as it was set for a recording."""
    bin_m = float(series.range_m[1] - series.range_m[0])
    return sim.Radar(
        start_m=float(series.range_m[0]) + 0.5 * (bins_in_one - 1) * bin_m,
        bin_m=bin_m * bins_in_one,
        bins=len(series.range_m) // bins_in_one,
        rate_hz=round(1.0 / float(np.median(np.diff(series.times_s))), 2),
    )


def start_of(recordings: list[Recording]) -> Fit:
    """Where the fit begins; heights: the range of the strongest echo at normal incidence, .34 m without one."""
    surfaces = list(dict.fromkeys(one.surface for one in recordings))
    heights = []
    for surface in surfaces:
        straight = [one for one in recordings if one.surface == surface and one.incidence_deg == 0.0]
        series = straight[0].series if straight else None
        heights.append(0.34 if series is None else float(series.range_m[np.argmax(series.sweeps.mean(axis=0))]))
    zero = np.zeros(len(surfaces))
    return Fit(np.zeros(()), np.zeros(()), np.array(heights), zero, zero)


def scene_of(fit: Fit, place: Any, incidence_deg: Any, scene: sim.RoadScene, permittivity: Any) -> sim.RoadScene:
    """A recording's scene; `place`: of its surface in the fit."""
    return dataclasses.replace(
        scene,
        radar=dataclasses.replace(
            scene.radar, fwhm_m=FWHM_M * jnp.exp(fit.fwhm), gain_counts=GAIN_COUNTS * jnp.exp(fit.gain)
        ),
        mount=sim.Mount(height_m=fit.height_m[place], angle_deg=90.0 - incidence_deg),
        surface=sim.Surface(
            permittivity=permittivity[place],
            slope=SLOPE * jnp.exp(fit.slope[place]),
            grain_db=GRAIN_DB + 10.0 * fit.grain[place],
        ),
    )


def coarse(sweeps: np.ndarray) -> np.ndarray:
    """Mean profile of sweeps, `COARSE` bins in one."""
    bins = sweeps.shape[1] // COARSE
    return sweeps[:, : bins * COARSE].mean(axis=0).reshape(bins, COARSE).mean(axis=1)


def deviance(measured: Any, wanted: Any, bin_m: float) -> Any:
    """Gamma deviance of profiles from what was wanted, as if a cell were one number; over the last axis."""
    ratio = measured / wanted
    return 2.0 * SHAPE * jnp.sum(ratio - 1.0 - jnp.log(ratio), axis=-1) * (bin_m / CELL_M)


def fit_scenes(recordings: list[Recording], noise: float) -> tuple[Fit, np.ndarray]:
    """The fit, and the mean profile of each recording under it. Says so if the search did not end at a maximum."""
    radar = recorder(recordings[0].series, COARSE)
    scene = sim.RoadScene(
        duration_s=FIT_SWEEPS / radar.rate_hz,
        radar=radar,
        motion=sim.CarMotion(speed_m_s=0.3 * radar.rate_hz),
        effects=(sim.ReceiverNoise(sigma=noise, width_m=0.0), sim.RangeSmoothing()),
    )
    surfaces = list(dict.fromkeys(one.surface for one in recordings))
    permittivity = jnp.array([float(sim.SURFACES[name].permittivity) for name in surfaces])
    places = jnp.array([surfaces.index(one.surface) for one in recordings])
    angles = jnp.array([one.incidence_deg for one in recordings])
    measured = jnp.array([coarse(one.series.sweeps) for one in recordings])
    with jax.enable_x64(True):
        first = jax.tree.map(jnp.asarray, start_of(recordings))
        # One plan for all that may come: heights and pulses at both ends of what is likely.
        ends = [
            dataclasses.replace(
                scene,
                mount=sim.Mount(height_m=height),
                radar=dataclasses.replace(scene.radar, fwhm_m=fwhm),
            )
            for height in (0.25, 0.45)
            for fwhm in (0.03, 0.07)
        ]
        plan = sim.plan_scene(jax.tree.map(lambda *leaves: np.stack(leaves), *ends))

        def profiles(fit: Fit) -> Any:
            def profile(place: Any, angle: Any) -> Any:
                made = scene_of(fit, place, angle, scene, permittivity)
                return sim.render(plan, made, jax.random.key(3)).sweeps.mean(axis=0)

            return jax.vmap(profile)(places, angles)

        def loss(fit: Fit, _: Any) -> Any:
            priors = (fit.fwhm / 0.3, fit.slope / 0.5, fit.grain / 0.8, (fit.height_m - first.height_m) / 0.01)
            misfit = jnp.sum(deviance(measured, profiles(fit), radar.bin_m))
            return 0.5 * (misfit + sum(jnp.sum(one**2) for one in priors))

        found: Any = optx.minimise(loss, optx.BFGS(rtol=1e-4, atol=1e-4), first, max_steps=300, throw=False)
        if found.result != optx.RESULTS.successful:
            slope = jax.tree.leaves(jax.jit(jax.grad(loss))(found.value, None))
            largest = max(float(jnp.max(jnp.abs(one))) for one in slope)
            print(f"The search ended before its tolerance was met; largest slope of the loss {largest:.2g}.")
        return jax.tree.map(np.asarray, found.value), np.asarray(jax.jit(profiles)(found.value))


def simulated(one: Recording, fit: Fit, surfaces: list[str], noise: float) -> list[SensorSeries]:
    """A recording as simulated at `PLACES` places."""
    permittivity = np.array([float(sim.SURFACES[name].permittivity) for name in surfaces])
    radar = recorder(one.series)
    scene = sim.RoadScene(
        duration_s=len(one.series) / radar.rate_hz,
        radar=radar,
        motion=sim.CarMotion(speed_m_s=0.0),
        effects=(
            sim.ReceiverNoise(sigma=noise, width_m=0.0),
            sim.RangeSmoothing(),
            sim.RunningAverage(),
            sim.Saturation(),
            sim.Quantisation(step=2),
        ),
    )
    made = scene_of(fit, surfaces.index(one.surface), one.incidence_deg, scene, permittivity)
    return [drive.sensors[0] for drive in sim.simulate_batch([made] * PLACES, range(PLACES))]
