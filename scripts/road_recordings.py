"""What the detectors do on standing recordings of real roads, and on the same with steps put in.

    python scripts/road_recordings.py DIR          # a folder of A111 recordings named SURFACE_…_ANGLE.h5

Prints, in this order: the thesis's alarms beside those of a plain NumPy script; the largest statistic of the shift
detector on each recording as a share of its threshold, at the recording's own rate and with its times rewritten to
100 and 300 Hz, with all bins and thinned to 128; where it finds no echo in `demo1`; and the share of injected steps
that each detector finds over height. The recordings are split by order of name: settings were chosen on every other
one ("chosen"), the rest ("held out") is reported apart; both hold the same kinds of surface.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from jaxradar.drive import SensorSeries
from jaxradar.logs import read_log
from jaxradar.sim.inject import retimed
from jaxradar.suite.recordings import FORMS, Form, found_in_time
from jaxradar.systems.step import ShiftDetector, StepDetector, detect, load_detector, thin

HEIGHTS_M = (0.0, 0.005, 0.010, 0.015, 0.020, 0.030, 0.040, 0.060, 0.080)
OTHER_HEIGHT_M = 0.335  # of the sensor, where a surface has no recording at 0°


def numpy_thesis(sweeps: np.ndarray, range_m: np.ndarray, times_s: np.ndarray) -> int:
    """The rule of the thesis in five lines of NumPy, float64."""
    peaks = range_m[np.argmax(sweeps * (2 * range_m) ** 2, axis=1)]
    steps = np.diff(times_s)
    moving = steps > 0
    return int(np.sum(np.abs(np.diff(peaks)[moving] / steps[moving]) > 0.7))


def sensor_heights(recordings: dict[str, SensorSeries]) -> dict[str, float]:
    """Height of the sensor over each recording's surface: the range of the strongest mean echo at 0°."""
    surfaces = {}
    for name, series in recordings.items():
        if name.endswith("_0_0"):
            surfaces[name.split("_")[0]] = float(series.range_m[np.argmax(series.sweeps.mean(axis=0))])
    return {name: surfaces.get(name.split("_")[0], OTHER_HEIGHT_M) for name in recordings}


def detection_rates(
    detector: StepDetector,
    recordings: dict[str, SensorSeries],
    heights: dict[str, float],
    form: Form,
    rate: float,
    bins: int | None,
) -> dict[float, dict[str, float]]:
    """For each height of step and each recording, the share of injected steps that the detector finds in time."""
    return {
        height_m: {
            name: found_in_time(detector, series, height_m, heights[name], form, rate, bins)
            for name, series in recordings.items()
        }
        for height_m in HEIGHTS_M
    }


def wilson(successes: float, trials: int) -> tuple[float, float]:
    """95 % confidence interval of a share (Wilson, J. Am. Stat. Assoc. 22, 1927)."""
    z, share = 1.96, successes / trials
    centre = (share + z * z / (2 * trials)) / (1 + z * z / trials)
    half = z / (1 + z * z / trials) * np.sqrt(share * (1 - share) / trials + z * z / (4 * trials**2))
    return max(0.0, centre - half), min(1.0, centre + half)


def print_standing(recordings: dict[str, SensorSeries], moving: SensorSeries | None, chosen: set[str]) -> bool:
    thesis, default = load_detector("thesis").detector, load_detector("default").detector
    bare = ShiftDetector(least_shift_m=0.0)
    good = True
    print(
        "Standing recordings: alarms of the thesis's rule at 128 bins (NumPy's in brackets), and the largest statistic"
    )
    print(
        "of `shift` in percent of its threshold, all bins / 128 bins, with the alarms of `default` where there are any."
    )
    print(
        "So that nothing hides, `shift` has no least shift and waits for no stillness here: the evidence alone has to"
    )
    print("stay below.")
    print(f"{'':17}{'':9}{'thesis':>10}{'own rate':>14}{'100 Hz':>14}{'300 Hz':>14}")
    total = [0, 0]
    for name, series in recordings.items():
        small = thin(series, 128)
        ours, plain = len(detect(thesis, small).events), numpy_thesis(small.sweeps, small.range_m, small.times_s)
        total[0] += ours
        total[1] += plain
        good &= ours == plain
        cells = []
        for rate in (None, 100.0, 300.0):
            shares, alarms = [], 0
            for one in (series, small):
                timed = retimed(one, rate) if rate else one
                trace = detect(bare, timed)
                shares.append(100 * trace.statistic.max() / trace.threshold)
                alarms += len(detect(default, timed).events)
            good &= alarms == 0
            cells.append(" / ".join(f"{share:3.0f}" for share in shares) + (f" ({alarms}!)" if alarms else ""))
        half = "chosen" if name in chosen else "held out"
        print(f"{name:17}{half:9}{f'{ours} ({plain})':>10}" + "".join(f"{cell:>14}" for cell in cells))
    if moving is not None:
        small = thin(moving, 128)
        ours, plain = len(detect(thesis, small).events), numpy_thesis(small.sweeps, small.range_m, small.times_s)
        good &= ours == plain
        print(f"{'demo1':17}{'moves':9}{f'{ours} ({plain})':>10}")
    print(f"Standing, together {total[0]} alarms of the thesis's rule, {total[1]} of the plain script.\n")
    return good


def print_lost_echo(series: SensorSeries) -> bool:
    good = True
    for one in (series, thin(series, 128)):
        trace = detect(load_detector("default").detector, one)
        lost = trace.times_s[~trace.valid]
        inside = (trace.times_s > 6.3) & (trace.times_s < 7.6)
        far = np.nansum(trace.range_m > 0.79)
        print(
            f"demo1, {len(one.range_m)} bins: {lost.size} sweeps invalid, from {lost.min():.2f} to {lost.max():.2f} s; "
            f"of those between 6.3 and 7.6 s {100 * np.mean(~trace.valid[inside]):.0f} %; {far} placed beyond 0.79 m; "
            f"{len(trace.events)} detections" + "".join(f", {e.time_s:.2f} s" for e in trace.events)
        )
        good &= bool((~trace.valid[inside]).all()) and far == 0
    print()
    return good


def print_injected(recordings: dict[str, SensorSeries], chosen: set[str]) -> bool:
    heights = sensor_heights(recordings)
    good = True
    print(
        "Share of injected steps found 0 to 40 ms after the first displaced sweep, 0.1 s into a log, in percent, over"
    )
    print('height in mm (at 0 mm nothing is put in: what a detector "finds" there are false alarms in those 40 ms);')
    print("last columns: pooled over 20 mm and more, on the recordings that settings were chosen on and on the others,")
    print(
        "with the 95 % interval of both together, in which each recording counts once: what is found in a recording at"
    )
    print("one height or place is likely found in it at another.")
    head = "".join(f"{1e3 * height:>5.0f}" for height in HEIGHTS_M)
    print(f"{'detector':10}{'form':8}{'Hz':>4}{'bins':>6} {head}   chosen  held out       95 %")
    for name in ("default", "thesis"):
        detector = load_detector(name).detector
        for form in FORMS:
            for rate in (100.0, 300.0):
                for bins in (None, 128):
                    found = detection_rates(detector, recordings, heights, form, rate, bins)
                    shares = [100 * np.mean(list(found[height].values())) for height in HEIGHTS_M]
                    tall = [found[height] for height in HEIGHTS_M if height >= 0.02]
                    halves = [
                        np.mean([share for one in tall for key, share in one.items() if (key in chosen) == half])
                        for half in (True, False)
                    ]
                    trials = len(recordings)
                    pooled = float(np.mean([share for one in tall for share in one.values()]))
                    low, high = wilson(pooled * trials, trials)
                    cells = "".join(f"{share:5.0f}" for share in shares)
                    pools = "".join(f"{100 * half:9.1f}" for half in halves)
                    where = f"{name:10}{form:8}{rate:4.0f}{bins or 'all':>6} "
                    print(f"{where}{cells}{pools}   {100 * low:.1f}–{100 * high:.1f}", flush=True)
                    good &= name != "default" or pooled >= 0.95
    return good


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    files = sorted(parser.parse_args().folder.glob("*.h5"))
    if not files:
        parser.error("expected a folder that holds *.h5 recordings")
    recordings = {file.stem: read_log(file).sensors[0] for file in files}
    moving = recordings.pop("demo1", None)
    chosen = set(list(recordings)[::2])
    good = print_standing(recordings, moving, chosen)
    if moving is not None:
        good &= print_lost_echo(moving)
    good &= print_injected(recordings, chosen)
    print("\nAll as asked for." if good else "\nNot all as asked for.")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
