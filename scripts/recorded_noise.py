"""The noise of a standing A111: how it is correlated along range, and how far a range jumps from sweep to sweep.

    python scripts/recorded_noise.py DIR

DIR holds recordings in Acconeer's HDF5 form whose names end in the angle of incidence (`Asphalt_0_45.h5`). First the
autocorrelation of the floor, from differences of neighbouring sweeps, with the model that `jaxradar.tasks` draws noise
from. Then, for each recording, the jitter of a single sweep's range (standard deviation of first differences over √2,
which does not see a slow drift) by the largest bin and by the default detector, at full resolution and without any
smoothing over sweeps, with the plain standard deviation beside it. Exits with 1 if the default's jitter at 45° is above
0.35 mm on asphalt or 0.8 mm on grass, or cannot be told, as one of these two recordings is not there.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import jax
import numpy as np

from jaxradar import SensorSeries, read_log
from jaxradar._numerics import compiled
from jaxradar.systems.step import RangeAxis, ShiftDetector
from jaxradar.tasks.noise import recorded_covariance

FLOOR_FROM_ECHO = 300  # bins between the echo and what counts as floor
LEAST_FLOOR = 240
LEAST_FLOORS = 2  # recordings: one has no standard error
MOVING = "demo1"
LAGS = (0, 1, 2, 5, 10, 20, 30, 40, 60, 80, 100, 120)
MOST_MM = {"Asphalt_0_45": 0.35, "grass_0_45": 0.8}


def floor_of(sweeps: np.ndarray) -> np.ndarray:
    """Differences of neighbouring sweeps over √2, in the bins far from the echo; empty if there are too few."""
    top = int(np.argmax(sweeps.mean(axis=0)))
    before, after = slice(0, max(top - FLOOR_FROM_ECHO, 0)), slice(top + FLOOR_FROM_ECHO, sweeps.shape[1])
    kept = max((before, after), key=lambda one: one.stop - one.start)
    if kept.stop - kept.start < LEAST_FLOOR:
        return np.empty((0, 0))
    return np.diff(sweeps[:, kept].astype(np.float64), axis=0) / np.sqrt(2.0)


def autocorrelation(noise: np.ndarray) -> np.ndarray:
    square = np.mean(noise**2)
    return np.array([np.mean(noise[:, : noise.shape[1] - lag] * noise[:, lag:]) / square for lag in LAGS])


def floors(held: dict[str, SensorSeries]) -> list[np.ndarray]:
    """Of the recordings at 30 to 60°, those that are long enough."""
    some = [floor_of(np.asarray(one.sweeps)) for name, one in held.items() if name.endswith(("30", "45", "60"))]
    return [noise for noise in some if noise.size]


def print_floor(held: dict[str, SensorSeries], floors: list[np.ndarray]) -> None:
    found = np.array([autocorrelation(noise) for noise in floors])
    bin_m = RangeAxis.of(next(iter(held.values())).range_m).bin_m
    model = recorded_covariance(max(LAGS) + 1, bin_m)[0]
    print(f"Autocorrelation of the floor along range, mean and standard error of {len(found)} recordings at 30 to 60°:")
    for place, lag in enumerate(LAGS):
        mean, error = found[:, place].mean(), found[:, place].std(ddof=1) / np.sqrt(len(found))
        print(f"  {1e3 * lag * bin_m:6.2f} mm  {mean:7.4f} ± {error:.4f}   model {model[lag]:7.4f}")


def jitter_mm(range_m: np.ndarray) -> float:
    return 1e3 * float(np.std(np.diff(range_m)) / np.sqrt(2.0))


def single_sweep_ranges(held: dict[str, SensorSeries]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """In metres, of each recording: by the largest bin, and by the default detector where that is valid."""
    observe = compiled(jax.vmap(ShiftDetector().observe, in_axes=(None, 0, 0)))
    ranges = {}
    for name, one in held.items():
        sweeps = np.asarray(one.sweeps)
        seen = observe(RangeAxis.of(one.range_m), sweeps, one.flags)
        refined = np.asarray(seen.range_m, np.float64)[np.asarray(seen.valid)]
        ranges[name] = one.range_m[np.argmax(sweeps, axis=1)], refined
    return ranges


def print_jitter(ranges: dict[str, tuple[np.ndarray, np.ndarray]]) -> bool:
    """Whether all is as asked for."""
    fine = True
    print("\nRange of a single sweep, mm: jitter (sd of first differences / √2) and plain standard deviation")
    print(f"  {'recording':24} {'arg-max':>16} {'default':>16}")
    for name, (largest, refined) in ranges.items():
        cells = [f"{jitter_mm(r):6.2f} {1e3 * np.std(r):8.2f}" for r in (largest, refined)]
        most = MOST_MM.get(name)
        verdict = ""
        if most is not None:
            met = jitter_mm(refined) <= most
            fine &= met
            verdict = f"  {jitter_mm(refined):.3f}, at most {most:g}: {'reached' if met else 'MISSED'}"
        print(f"  {name:24} {cells[0]:>16} {cells[1]:>16}{verdict}")
    return fine


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", metavar="DIR", help="folder of recordings")
    folder = Path(parser.parse_args().folder)
    paths = {path.stem: path for path in sorted(folder.glob("*.h5")) if path.stem != MOVING}
    missing = [f"{name}.h5" for name in MOST_MM if name not in paths]
    if missing:
        print(f"{folder}: expected {' and '.join(missing)}, whose jitter is judged; not found.", file=sys.stderr)
        return 1
    held = {name: read_log(path).sensors[0] for name, path in paths.items()}
    long = floors(held)
    if len(long) < LEAST_FLOORS:
        print(
            f"{folder}: expected {LEAST_FLOORS} recordings or more at 30 to 60° with a floor of {LEAST_FLOOR} bins; "
            f"found {len(long)}.",
            file=sys.stderr,
        )
        return 1
    print_floor(held, long)
    return 0 if print_jitter(single_sweep_ranges(held)) else 1


if __name__ == "__main__":
    sys.exit(main())
