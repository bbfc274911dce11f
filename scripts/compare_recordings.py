"""Standing recordings of real roads beside simulated ones, the scenes fitted to them by gradient.

    python scripts/compare_recordings.py DIR          # a folder of A111 recordings named SURFACE_0_ANGLE.h5

One radar for all (gain, width of the pulse), and for each surface its roughness and the sensor's height over it, at the
maximum of a quasi-likelihood: the mean profile of a recording is one draw of speckle, whose spread is proportional to
its mean (gamma deviance), with a few independent cells, and weak priors keep unseen parameters in place. Then each
recording is simulated at `PLACES` places, standing as long as the real one did, and described by the same numbers. A
real recording is one place: it should lie among them, and near their median.

Prints the fit and the table real | simulated, and with `--figure FILE` draws both profiles.
"""

from __future__ import annotations

import argparse
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
FLOOR_BINS = 200
WITHIN = 0.25

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
ASKED = ("asphalt", "wet-asphalt", "gravel")


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


def describe(series: SensorSeries) -> dict[str, float]:
    """What a standing recording is compared by; ranges in mm, amplitudes in counts."""
    sweeps, range_mm = np.asarray(series.sweeps, np.float64), 1e3 * series.range_m
    mean = sweeps.mean(axis=0)
    low = int(np.argmin(np.convolve(mean, np.ones(FLOOR_BINS), "valid")))
    quiet = slice(low, low + FLOOR_BINS)
    floor = mean[quiet].mean()
    noise = sweeps[:, quiet] - mean[quiet]
    power = np.mean(noise**2)
    apart = round(20.0 / (range_mm[1] - range_mm[0]))
    top = int(np.argmax(mean))
    above = mean - floor > 0.5 * (mean[top] - floor)
    left = top - int(np.argmin(above[top::-1])) if not above[: top + 1].all() else 0
    right = top + int(np.argmin(above[top:])) if not above[top:].all() else len(mean) - 1
    peaks = range_mm[np.argmax(sweeps, axis=1)]
    values = np.unique(series.sweeps)
    return {
        "floor mean, counts": floor,
        "floor sd, counts": float(np.sqrt(power)),
        "floor correlation, 20 mm": float(np.mean(noise[:, :-apart] * noise[:, apart:]) / power),
        "floor correlation, next sweep": float(np.mean(noise[1:] * noise[:-1]) / power),
        "echo amplitude, counts": float(mean[top]),
        "echo width, mm": float(range_mm[right] - range_mm[left]),
        "echo range, mm": float(range_mm[top]),
        "peak jitter, mm": float(np.std(np.diff(peaks)) / np.sqrt(2.0)),
        "plateau, bins": float(np.mean(np.sum(sweeps == sweeps.max(axis=1, keepdims=True), axis=1))),
        "quantisation, counts": float(np.diff(values).min()),
    }


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
        heights.append(1e-3 * describe(straight[0].series)["echo range, mm"] if straight else 0.34)
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


def fit_scenes(recordings: list[Recording], noise: float) -> tuple[Fit, float, float]:
    """The fit, and the deviance of each recording's cells before and after."""
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
    bins = radar.bins * COARSE
    measured = jnp.array(
        [one.series.sweeps[:, :bins].mean(axis=0).reshape(radar.bins, COARSE).mean(axis=1) for one in recordings]
    )
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

        def deviance(fit: Fit) -> Any:
            def profile(place: Any, angle: Any) -> Any:
                made = scene_of(fit, place, angle, scene, permittivity)
                return sim.render(plan, made, jax.random.key(3)).sweeps.mean(axis=0)

            wanted = jax.vmap(profile)(places, angles)
            ratio = measured / wanted
            return jnp.sum(ratio - 1.0 - jnp.log(ratio)) * (radar.bin_m / CELL_M)

        def loss(fit: Fit, _: Any) -> Any:
            priors = (
                (fit.fwhm / 0.3, fit.slope / 0.5, fit.grain / 0.8),
                ((fit.height_m - first.height_m) / 0.01,),
            )
            return deviance(fit) + 0.5 * sum(jnp.sum(one**2) for part in priors for one in part)

        found: Any = optx.minimise(loss, optx.BFGS(rtol=1e-4, atol=1e-4), first, max_steps=150, throw=False)
        before, after = (float(jax.jit(deviance)(one)) for one in (first, found.value))
        return jax.tree.map(np.asarray, found.value), before / len(recordings), after / len(recordings)


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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, metavar="DIR", help="with the recordings")
    parser.add_argument("--figure", type=Path, metavar="FILE", help="draw the profiles into this file")
    args = parser.parse_args()
    recordings = load(args.folder)
    surfaces = list(dict.fromkeys(one.surface for one in recordings))
    real = {one.name: describe(one.series) for one in recordings}
    # Rayleigh's mean is σ √(π/2), and no averaging changes a mean.
    noise = float(np.median([held["floor mean, counts"] for held in real.values()]) / np.sqrt(0.5 * np.pi))
    fit, before, after = fit_scenes(recordings, noise)
    print(f"noise {noise:.1f} counts, gain {1700 * np.exp(fit.gain):.0f} counts, pulse {45 * np.exp(fit.fwhm):.1f} mm;")
    print(f"deviance of a recording {before:.1f} before the fit, {after:.1f} after (cells: {0.6 / CELL_M:.0f})")
    for place, name in enumerate(surfaces):
        print(
            f"  {name:12} slope {SLOPE * np.exp(fit.slope[place]):.2f}, "
            f"grain {GRAIN_DB + 10 * fit.grain[place]:.1f} dB, "
            f"sensor {1e3 * fit.height_m[place]:.0f} mm above it"
        )
    print()
    drives = {one.name: simulated(one, fit, surfaces, noise) for one in recordings}
    made = {name: [describe(series) for series in held] for name, held in drives.items()}
    table(recordings, real, made)
    if args.figure:
        draw(recordings, drives, args.figure)


def table(
    recordings: list[Recording], real: dict[str, dict[str, float]], made: dict[str, list[dict[str, float]]]
) -> None:
    """Each number: real, simulated (median, and 5 to 95 % of the places), their ratio, and how they agree."""
    print(f"{'':34}{'real':>9}{'simulated':>11}{'5..95 % of places':>20}{'ratio':>8}")
    agree = {True: 0, False: 0}
    for one in recordings:
        if one.surface not in ASKED or one.incidence_deg not in (0.0, 45.0):
            continue
        rows = {key: (real[one.name][key], [held[key] for held in made[one.name]]) for key in real[one.name]}
        straight = next((other.name for other in recordings if other.surface == one.surface), one.name)
        if one.incidence_deg == 45.0:
            key = "echo range, mm"
            rows["R45/R0"] = _ratio(key, real, made, one.name, straight)
        print(f"{one.surface}, {one.incidence_deg:.0f}°")
        for key, (value, places) in rows.items():
            middle, low, high = np.median(places), *np.percentile(places, [5, 95])
            near = bool(abs(middle / value - 1.0) <= WITHIN)
            among = low <= value <= high
            agree[near] += 1
            word = "" if near else "one of the places" if among else "OUTSIDE"
            print(f"  {key:32}{value:9.4g}{middle:11.4g}{f'{low:.4g} .. {high:.4g}':>20}{middle / value:8.2f}  {word}")
    print(f"\n{agree[True]} of {sum(agree.values())} medians within {WITHIN:.0%} of the recording.")
    print("\nR45/R0 of every surface that was recorded at both: real, simulated median, 5 .. 95 %")
    upright = {one.surface: one.name for one in recordings if one.incidence_deg == 0.0}
    for one in recordings:
        if one.incidence_deg == 45.0 and one.surface in upright:
            value, places = _ratio("echo range, mm", real, made, one.name, upright[one.surface])
            low, middle, high = np.percentile(places, [5, 50, 95])
            print(f"  {one.surface:12}{value:8.3f}{middle:8.3f}   {low:.3f} .. {high:.3f}")


def _ratio(
    key: str, real: dict[str, dict[str, float]], made: dict[str, list[dict[str, float]]], one: str, other: str
) -> tuple[float, list[float]]:
    """Of two recordings of one surface, and of the same places simulated."""
    return real[one][key] / real[other][key], [a[key] / b[key] for a, b in zip(made[one], made[other], strict=True)]


def draw(recordings: list[Recording], drives: dict[str, list[SensorSeries]], target: Path) -> None:
    """Profiles of the asked surfaces at 0 and 45°: the recording's over those of the places."""
    import matplotlib.pyplot as plt

    chosen = [one for one in recordings if one.surface in ASKED and one.incidence_deg in (0.0, 45.0)]
    figure, axes = plt.subplots(2, 3, figsize=(9, 4.6), sharex=True, layout="constrained")
    for one, axis in zip(sorted(chosen, key=lambda one: one.incidence_deg), axes.flat, strict=True):
        means = np.stack([series.sweeps.mean(axis=0) for series in drives[one.name]])
        low, middle, high = np.percentile(means, [5, 50, 95], axis=0)
        axis.fill_between(one.series.range_m, low, high, color="#56B4E9", alpha=0.4, label="simulated, 5 to 95 %")
        axis.plot(one.series.range_m, middle, color="#0072B2", lw=1, label="simulated, median")
        axis.plot(one.series.range_m, one.series.sweeps.mean(axis=0), color="#D55E00", lw=1.4, label="recorded")
        axis.set_title(f"{one.surface}, {one.incidence_deg:.0f}° from the vertical", fontsize=9)
        axis.set_ylim(0)
    axes[0, 0].legend(fontsize=7)
    for axis in axes[:, 0]:
        axis.set_ylabel("amplitude (counts)")
    for axis in axes[1]:
        axis.set_xlabel("slant range (m)")
    figure.suptitle("Each recording lies among the simulated places of its surface", fontsize=10)
    figure.savefig(target, dpi=130)


if __name__ == "__main__":
    main()
