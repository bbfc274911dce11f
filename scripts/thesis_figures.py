"""The four figures of the thesis's results, simulated, and what the simulation says about their causes.

    python scripts/thesis_figures.py -o FILE.png

The thesis (R. Sato, 2020, section 6) reports: two detections, about 50 ms before the body feels 15 m/s² (figures 6.1
and 6.2); an alarm when pulling away, where no step is (6.3); after a curve a step of 33 m/s² that is detected only
after the impact (6.4). Here: the lead over heights for two range cells, the alarms of both detectors in each scene, and
the same scenes with one cause taken away at a time. Rates are means over `DRIVES` drives with 95 % intervals. Last, how
often the default detector finds the trial's step, over the first `TRIALS` drives of `jaxradar simulate`.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from jaxradar import sim
from jaxradar.drive import Drive
from jaxradar.matching import MatchWindow, match_steps, summarise
from jaxradar.sim.road.drives import HARD_M_S2
from jaxradar.systems.step import RangeRateDetector, StepDetector, detect, load_detector
from jaxradar.units import NANOSECONDS

DRIVES, STUDENT = 20, 2.093
TRIALS = 200
PARTS = 4
ROADS = 48  # over whose speckle the mean echo is taken


def drives_of(scene: sim.RoadScene, count: int = DRIVES) -> list[Drive]:
    return sim.simulate_batch([scene] * count, range(count))


def with_effects(scene: sim.RoadScene, *more: sim.RoadEffect, without: tuple[type, ...] = ()) -> sim.RoadScene:
    kept = tuple(one for one in scene.effects if not isinstance(one, without))
    return dataclasses.replace(scene, effects=(*more, *kept))


def calm(scene: sim.RoadScene, sigma: float = 50.0) -> sim.RoadScene:
    """The scene on a floor that is nearly a mirror, with little noise and much averaging: an echo that stays put."""
    smooth = dataclasses.replace(scene, surface=sim.Surface(slope=0.05, grain_db=-30.0, rms_mm=0.1))
    less = (sim.ReceiverNoise(sigma=sigma), sim.RunningAverage(0.9))
    return with_effects(smooth, *less, without=(sim.ReceiverNoise, sim.RunningAverage))


def interval(rates: list[float], each_s: float) -> str:
    """Mean of rates, each over `each_s`, and half the 95 % interval of it (Student's t of 19 degrees of freedom); for
    none at all the rate that would show one with 95 % (Poisson)."""
    if not any(rates):
        return f"< {-math.log(0.05) / (len(rates) * each_s):.1f}"
    return f"{np.mean(rates):.1f} ± {STUDENT * np.std(rates, ddof=1) / math.sqrt(len(rates)):.1f}"


def alarms(detector: StepDetector, drives: list[Drive], start_s: float, stop_s: float) -> list[float]:
    """Alarms a second between two moments, of each drive."""
    counts = []
    for drive in drives:
        events = detect(detector, drive.sensors[0]).events
        counts.append(sum(start_s <= one.time_s < stop_s for one in events) / (stop_s - start_s))
    return counts


def higher(scene: sim.RoadScene, height_m: float) -> sim.RoadScene:
    """The scene with another height of its one step."""
    (element,) = scene.road
    assert isinstance(element, sim.StepUp)
    return dataclasses.replace(scene, road=(dataclasses.replace(element, height_m=height_m),))


def sight_s(scene: sim.RoadScene, part: int = 0) -> tuple[float, float]:
    """When the step shows, over one `part` of the roads that there are: in the strongest echo, whose mean over many
    roads has then moved half of its way from r to r (1 − h/H); and in the cell at √2 H, which the echo of the step's
    face then crosses."""
    (element,) = scene.road
    height, sensor = float(element.step_m), float(scene.mount.height_m)
    fine = dataclasses.replace(scene, effects=(), radar=dataclasses.replace(scene.radar, rate_hz=1000.0))
    drives = sim.simulate_batch([fine] * ROADS, range(ROADS * part, ROADS * (part + 1)))
    (step,) = drives[0].truth.steps if drives[0].truth is not None else ()
    series = drives[0].sensors[0]
    mean = np.mean([np.square(drive.sensors[0].sweeps, dtype=np.float64) for drive in drives], axis=0)
    # The corner's ridge is narrow and far out; the road's own echo is what lies within 15 cm of the strongest.
    before = series.times_s < step.impact_s - 0.15
    top = series.range_m[np.argmax(mean[before].mean(axis=0))]
    near = np.abs(series.range_m - top) < 0.15
    weight = mean[:, near] * (mean[:, near] > 0.5 * mean[:, near].max(axis=1, keepdims=True))
    centre = (weight * series.range_m[near]).sum(axis=1) / weight.sum(axis=1)
    rest = np.median(centre[before])
    moved = centre < rest * (1.0 - 0.5 * height / sensor)
    late = moved & (series.times_s > step.impact_s - 0.1)
    cell = np.argmin(np.abs(series.range_m - math.sqrt(2.0) * sensor))
    window = (series.times_s > step.impact_s - 0.12) & (series.times_s < step.impact_s)
    crossing = series.times_s[window][np.argmax(mean[window, cell])]
    return float(series.times_s[np.argmax(late)]) if late.any() else math.nan, float(crossing)


def beneath_s(scene: sim.RoadScene, look_ahead: float = 0.45) -> float:
    """When the middle of the step's edge is `look_ahead` times the sensor's height before its foot, at even speed."""
    ahead = float(scene.road[0].at_m) - look_ahead * float(scene.mount.height_m)
    return ahead / float(scene.motion.speed_m_s)


def lead_table() -> None:
    """Lead to the contact and to 15 m/s², for steps of 35 to 60 mm at 30 km/h."""
    trial = sim.load_scene("trial")
    print("Lead at 30 km/h in ms, without a detector's own delay (the thesis reports about 50 to 15 m/s²)")
    print(f"(± half the range over {PARTS} sets of {ROADS} roads)")
    print("                     strongest echo           cell at √2 H")
    print("  height  hard after  contact  15 m/s²      contact  15 m/s²     body's peak")
    for height in (0.035, 0.040, 0.045, 0.050, 0.055, 0.060):
        scene = higher(trial, height)
        (step,) = sim.simulate(scene).truth.steps  # type: ignore[union-attr]
        assert step.hard_s is not None
        seen = np.array([sight_s(scene, part) for part in range(PARTS)])
        leads = [1e3 * (until - seen.mean(axis=0)[cell]) for cell in (0, 1) for until in (step.impact_s, step.hard_s)]
        spread = 1e3 * np.ptp(seen, axis=0) / 2
        print(
            f"  {1e3 * height:3.0f} mm{1e3 * (step.hard_s - step.impact_s):9.0f} ms"
            f"{leads[0]:9.0f}{leads[1]:9.0f} ± {spread[0]:.0f}{leads[2]:8.0f}{leads[3]:9.0f} ± {spread[1]:.0f}"
            f"{step.peak_m_s2:12.1f} m/s²"
        )
    low, high = 0.005, 0.1
    while high - low > 1e-5:
        middle = 0.5 * (low + high)
        scene = higher(trial, middle)
        (step,) = sim.simulate(scene).truth.steps  # type: ignore[union-attr]
        low, high = (low, middle) if step.peak_m_s2 is not None and step.peak_m_s2 >= HARD_M_S2 else (middle, high)
    print(f"  The body's 15 m/s² begin at a step of {1e3 * high:.1f} mm.\n")


def even_road_table(thesis: StepDetector, default: StepDetector) -> None:
    """What keeps the rule quiet on an even road: the thesis's figure 6.1 shows two alarms in about a second."""
    even = dataclasses.replace(sim.load_scene("trial"), road=())
    quiet = sim.ReceiverNoise(sigma=50.0)
    variants = {
        "asphalt": even,
        "asphalt, noise of 50 counts": with_effects(even, quiet, without=(sim.ReceiverNoise,)),
        "asphalt, running average 0.7": with_effects(even, sim.RunningAverage()),
        "asphalt, running average 0.9": with_effects(even, sim.RunningAverage(0.9)),
        "mirror-like (slope 0.05), noise 50": with_effects(calm(even), without=(sim.RunningAverage,)),
        "mirror-like, noise 50, average 0.9": calm(even),
    }
    print("Alarms a second on an even road at 30 km/h, 300 sweeps a second")
    for name, scene in variants.items():
        drives = drives_of(scene)
        rates = [interval(alarms(one, drives, 0.2, 2.0), 1.8) for one in (thesis, default)]
        print(f"  {name:36} thesis {rates[0]:>14}   default {rates[1]:>12}")
    print()


def still_echo_table(thesis: StepDetector) -> None:
    """Whether the rule sees the step where the echo stays put; the corner hangs on the antenna's polarisation."""
    print("The trial on the mirror-like floor: first alarm of the thesis's rule in the 0.2 s before the contact")
    for polarisation in ("vertical", "horizontal"):
        scene = calm(sim.load_scene("trial"))
        scene = dataclasses.replace(scene, radar=dataclasses.replace(scene.radar, polarisation=polarisation))
        first = []
        for drive in drives_of(scene):
            (step,) = drive.truth.steps  # type: ignore[union-attr]
            leads = [step.impact_s - one.time_s for one in detect(thesis, drive.sensors[0]).events]
            first += [1e3 * max(one for one in leads if 0 < one < 0.2)] if any(0 < one < 0.2 for one in leads) else []
        median = f", median {np.median(first):.0f} ms before it" if first else ""
        print(f"  electric field {polarisation:10}: in {len(first)} of {DRIVES} drives{median}")
    print()


def pulling_away_table(thesis: StepDetector) -> None:
    """The alarm of figure 6.3: noise, one bin of quantisation, or the lever arm?"""
    scene = sim.load_scene("pulling-away")
    low_noise = calm(scene, 20.0)
    rigid = with_effects(dataclasses.replace(low_noise, vehicle=None), without=(sim.Accelerometer,))
    between_bins = RangeRateDetector(peak="parabola")
    print("Pulling away at 2 m/s² from 0.5 s: alarms a second of the thesis's rule, and of the same with a peak")
    print("between bins, standing (0.1 to 0.5 s) and pulling away (0.5 to 1.5 s)")
    for name, one in (
        ("asphalt, as in the scene", scene),
        ("asphalt, averaged (0.9)", with_effects(scene, sim.RunningAverage(0.9))),
        ("mirror-like and averaged: echo at rest", low_noise),
        ("the same without springs: no pitch", rigid),
    ):
        drives = drives_of(one)
        row = [
            interval(alarms(detector, drives, *span), span[1] - span[0])
            for detector in (thesis, between_bins)
            for span in ((0.1, 0.5), (0.5, 1.5))
        ]
        print(f"  {name:40} largest bin {row[0]:>12} {row[1]:>14}   parabola {row[2]:>12} {row[3]:>14}")
    print()


def oblique_table() -> None:
    """The miss of figure 6.4: how much earlier the outer wheel is there, and what the bend itself does."""
    scene = sim.load_scene("oblique-after-curve")
    print("After a curve, 60 mm at 5.5 m/s: lead in ms to the first wheel's contact, noise-free mean over roads")
    print("  angle of the step   strongest echo   cell at √2 H   geometry (0.45 H)")
    straight = dataclasses.replace(scene.motion, curve=None)
    for degrees, motion in ((0.0, scene.motion), (0.0, straight), *((one, scene.motion) for one in (15.0, 25.0, 38.0))):
        element = dataclasses.replace(scene.road[0], oblique_deg=degrees)
        one = dataclasses.replace(scene, road=(element,), motion=motion)
        (step,) = sim.simulate(one).truth.steps  # type: ignore[union-attr]
        seen = [1e3 * (step.impact_s - moment) for moment in sight_s(one)]
        geometry = 1e3 * (step.impact_s - beneath_s(one))
        note = "  (without the curve)" if motion.curve is None else ""
        print(f"  {degrees:8.0f}°{seen[0]:22.0f}{seen[1]:15.0f}{geometry:16.0f}{note}")
    print()


def found_table(detectors: tuple[StepDetector, ...]) -> None:
    """How often the step of the trial is found in time, and what else is found."""
    window = MatchWindow(0.12, 0.0)
    print(f"Steps found in {TRIALS} drives each (± 95 % interval)")
    print("                             found 0 to 120 ms before contact   by luck   median lead   other alarms")
    for name in ("trial-wet", "trial-averaged", "trial"):
        scene = sim.load_scene(name)
        drives = sim.simulate_batch([scene] * TRIALS, sim.drive_seeds(0, TRIALS))
        for detector in detectors:
            outcomes = []
            for drive in drives:
                series = drive.sensors[0]
                times = [one.time_s for one in detect(detector, series).events]
                steps = drive.truth.steps  # type: ignore[union-attr]
                found = match_steps(times, steps, window=window)
                outcomes.append((found, float(np.ptp(series.times_ns)) / NANOSECONDS))
            summary = summarise(outcomes)
            share, lead = summary.detection_rate or 0.0, summary.median_lead_s or math.nan
            rate = summary.false_alarms / summary.duration_s
            luck = 1.0 - math.exp(-rate * window.seconds)  # were alarms to come at any moment alike
            half = 1.96 * math.sqrt(share * (1.0 - share) / TRIALS)
            print(
                f"  {name:16}{detector.name:10}{100 * share:13.0f} ± {100 * half:.0f} %{100 * luck:22.0f} %"
                f"{1e3 * lead:11.0f} ms{rate:11.1f} a second"
            )
    print()


def draw(thesis: StepDetector, default: StepDetector, target: Path) -> None:
    """The four figures from one drive each."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 2, figsize=(11, 6.4), layout="constrained")
    trial = sim.simulate(sim.load_scene("trial-averaged"))
    step = trial.truth.steps[0]  # type: ignore[union-attr]
    around = (step.impact_s - 0.6, step.impact_s + 0.2)
    axis = axes[0, 0]
    for drive, colour, name in (
        (trial, "#999999", "asphalt: speckle"),
        (sim.simulate(calm(sim.load_scene("trial"))), "#0072B2", "mirror-like floor, averaged"),
    ):
        series = drive.sensors[0]
        axis.plot(series.times_s, detect(thesis, series).statistic, color=colour, lw=0.9, label=name)
    axis.axhline(0.7, color="k", ls="--", lw=1, label="threshold 0.7 m/s")
    axis.axvline(step.impact_s, color="#D55E00", ls=":", lw=1.8, label="first wheel's contact")
    title = "6.1: not reproduced. On asphalt speckle alarms always;\na still echo moves only with the wheel on the step"
    axis.set_title(title, fontsize=9)
    axis.set(ylabel="|range rate| (m/s)", xlim=around, ylim=(0, 30))
    axis.legend(fontsize=7, loc="upper left")

    _accelerations(
        axes[0, 1],
        sim.simulate(sim.load_scene("trial-wet"), seed=0),
        default,
        "6.2: on wet asphalt `default` sees the step\nbefore the body feels 15 m/s²",
        around,
    )
    _accelerations(
        axes[1, 0],
        sim.simulate(calm(sim.load_scene("pulling-away"), 20.0)),
        thesis,
        "6.3: pulling away pitches the car: each range bin\nthat the still echo crosses is an alarm",
        (0.0, 1.5),
    )
    bend = sim.simulate(with_effects(sim.load_scene("oblique-after-curve"), sim.RunningAverage()))
    met = bend.truth.steps[0]  # type: ignore[union-attr]
    _accelerations(
        axes[1, 1],
        bend,
        default,
        "6.4: at 25° the outer wheel is there before the\nechoes in front of the radar have moved",
        (met.impact_s - 0.5, met.impact_s + 0.3),
    )
    for axis in axes[1]:
        axis.set_xlabel("time since the first sweep (s)")
    figure.savefig(target, dpi=110)


def _accelerations(axis, drive: Drive, detector: StepDetector, title: str, span: tuple[float, float]) -> None:  # type: ignore[no-untyped-def]
    channel = drive.motion.acceleration_m_s2
    assert channel is not None
    axis.plot(channel.times_s, channel.values, color="k", lw=0.9)
    for height in (-HARD_M_S2, HARD_M_S2):
        axis.axhline(height, color="k", ls="--", lw=0.7)
    events = [one.time_s for one in detect(detector, drive.sensors[0]).events if span[0] <= one.time_s <= span[1]]
    for number, moment in enumerate(events):
        axis.axvline(moment, color="#0072B2", lw=0.8, alpha=0.7, label="alarm" if number == 0 else None)
    for step in drive.truth.steps if drive.truth is not None else ():
        axis.axvline(step.impact_s, color="#D55E00", ls=":", lw=1.8, label="first wheel's contact")
    axis.set_title(title, fontsize=9)
    axis.set(ylabel="body (m/s²)", xlim=span)
    axis.legend(fontsize=7, loc="lower left")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", help="draw the four figures into this file")
    args = parser.parse_args()
    thesis, default = (load_detector(name).detector for name in ("thesis", "default"))
    tables: tuple[Callable[[], None], ...] = (
        lead_table,
        lambda: even_road_table(thesis, default),
        lambda: still_echo_table(thesis),
        lambda: pulling_away_table(thesis),
        oblique_table,
        lambda: found_table((default, load_detector("shift").detector)),
    )
    for table in tables:
        table()
    if args.output:
        draw(thesis, default, args.output)


if __name__ == "__main__":
    main()
