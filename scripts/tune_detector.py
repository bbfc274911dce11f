"""A fit to edit: what is driven, the settings to move, what mistakes cost.

    python scripts/tune_detector.py mine.toml

Simulates drives over steps of several heights on two roads, and roads without a step of every kind, pulling away and
braking among them; fits six settings of the approach detector to them; prints what came out, how well the drives
determine it, and what it costs beside the settings that it began with; writes the detector's file.
"""

from __future__ import annotations

import dataclasses
import itertools
import sys
from pathlib import Path

import numpy as np

from jaxradar.sim import drive_seeds, simulate_batch
from jaxradar.suite import NEGATIVES, StepCell
from jaxradar.systems.step import ApproachDetector, DetectorFile, dump_detector
from jaxradar.tuning import Costs, Plan, examples_of, split, tune, uncertainty

ROADS = ("wet", "specular")
SPEEDS_KMH = (10.0, 20.0, 30.0, 40.0)
HEIGHTS_M = (0.01, 0.02, 0.03)
DRIVES = 10  # over each step
WITHOUT, WITHOUT_S = 60, 4.0  # drives of each kind without a step, and how long they last
SETTINGS = ("evidence", "tilt_far", "tilt_near", "look_m", "reference_s", "noise_share")
COSTS = Costs(missed=1.0, false_alarm=0.01, late=0.5)
SEED = 0


def main(output: Path) -> None:
    random = np.random.default_rng(SEED)
    cells = [StepCell(*one) for one in itertools.product(ROADS, SPEEDS_KMH, HEIGHTS_M)]
    without = [dataclasses.replace(kind, duration_s=WITHOUT_S) for kind in NEGATIVES]
    groups = [(cell.name, cell.scenes(DRIVES, random)) for cell in cells]
    groups += [(kind.name, kind.scenes(WITHOUT, random)) for kind in without]
    drives, kinds = [], []
    for place, (name, scenes) in enumerate(groups):
        drives += simulate_batch(scenes, drive_seeds(SEED + 1000 * place, len(scenes)))
        kinds += [name] * len(scenes)
    pairs = [(drive, drive.sensors[0]) for drive in drives]
    fitted_to, kept = (
        examples_of([pairs[place] for place in places]) for places in split(len(pairs), SEED, kinds=kinds)
    )

    start = ApproachDetector()
    tuned = tune(start, SETTINGS, fitted_to, kept, costs=COSTS, plan=Plan(seed=SEED))
    for one in uncertainty(tuned, start, fitted_to, COSTS):
        print(f"{one.name:24} {one.value:10.4g}  ± {one.sd:.2g}" + ("" if one.determined else "  (not determined)"))
    print(f"cost on drives kept for validation: {tuned.before:.4g} before, {tuned.after:.4g} after")
    provenance = {"tuned_by": "scripts/tune_detector.py", "drives": len(pairs), "seed": SEED, "cost": tuned.after}
    output.write_text(dump_detector(DetectorFile(tuned.detector, provenance=provenance)), encoding="utf-8")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(f"usage: {sys.argv[0]} DETECTOR.toml")
    main(Path(sys.argv[1]))
