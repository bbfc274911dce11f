"""Standing recordings of real roads beside simulated ones, the scenes fitted to them by gradient.

    python scripts/compare_recordings.py DIR          # a folder of A111 recordings named SURFACE_0_ANGLE.h5

One radar for all (gain, width of the pulse), and for each surface its roughness and the sensor's height over it, at the
maximum of a quasi-likelihood: the mean profile of a recording is one draw of speckle, whose spread is a share of its
mean (gamma deviance; McCullagh and Nelder, Generalized Linear Models, chapter 8), with a few independent cells, and
weak priors keep unseen parameters in place. Then each recording is simulated at `PLACES` places, standing as long as
the real one did, and described by the same numbers. A real recording is one place: it should lie among them, and near
their median.

Prints the fit with its deviance beside that of the simulated places, and the table real | simulated; with `--figure
FILE` draws both profiles.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from recordings_fit import (
    COARSE,
    FWHM_M,
    GAIN_COUNTS,
    GRAIN_DB,
    SLOPE,
    Recording,
    coarse,
    deviance,
    fit_scenes,
    load,
    simulated,
)

from jaxradar.drive import SensorSeries

FLOOR_BINS = 200
WITHIN = 0.25
# Rows that agree by construction: the noise is taken from the floors, the rounding is put in.
GIVEN = ("floor mean, counts", "quantisation, counts")
ASKED = ("asphalt", "wet-asphalt", "gravel")


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
    fit, wanted = fit_scenes(recordings, noise)
    gain, pulse = GAIN_COUNTS * np.exp(fit.gain), 1e3 * FWHM_M * np.exp(fit.fwhm)
    print(f"noise {noise:.1f} counts, gain {gain:.0f} counts, pulse {pulse:.1f} mm")
    for place, name in enumerate(surfaces):
        print(
            f"  {name:12} slope {SLOPE * np.exp(fit.slope[place]):.2f}, "
            f"grain {GRAIN_DB + 10 * fit.grain[place]:.1f} dB, "
            f"sensor {1e3 * fit.height_m[place]:.0f} mm above it"
        )
    print()
    drives = {one.name: simulated(one, fit, surfaces, noise) for one in recordings}
    fits_table(recordings, drives, wanted)
    made = {name: [describe(series) for series in held] for name, held in drives.items()}
    table(recordings, real, made)
    if args.figure:
        draw(recordings, drives, args.figure)


def fits_table(recordings: list[Recording], drives: dict[str, list[SensorSeries]], wanted: np.ndarray) -> None:
    """How far each profile is from the fit, beside how far simulated ones are, and how much of it lies among them."""
    print("                      deviance: real   simulated 5..95 %   bins within the places' 5..95 %, near the echo")
    for one, mean in zip(recordings, wanted, strict=True):
        bin_m = COARSE * float(one.series.range_m[1] - one.series.range_m[0])
        real, places = coarse(one.series.sweeps), np.stack([coarse(series.sweeps) for series in drives[one.name]])
        low, high = np.percentile(np.asarray(deviance(places, mean, bin_m)), [5, 95])
        least, middle, most = np.percentile(places, [5, 50, 95], axis=0)
        inside = (least <= real) & (real <= most)
        near = middle > 2.0 * middle.min()
        print(
            f"  {one.name:20}{float(deviance(real, mean, bin_m)):14.1f}{f'{low:.1f} .. {high:.1f}':>20}"
            f"{inside.mean():12.0%}{inside[near].mean():8.0%}"
        )
    print()


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
            if key not in GIVEN:
                agree[near] += 1
            word = "as put in" if key in GIVEN else "" if near else "one of the places" if among else "OUTSIDE"
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
    figure.suptitle("Recorded profiles over those of 40 simulated places of the same surface", fontsize=10)
    figure.savefig(target, dpi=130)


if __name__ == "__main__":
    main()
