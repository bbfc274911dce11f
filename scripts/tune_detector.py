"""A fit to edit: drives out of a scene, the settings to move, what mistakes cost.

    python scripts/tune_detector.py mine.toml

Simulates drives over steps of several heights on a wet road, and without a step; fits six settings of the default
detector to them; prints what came out and how well the drives determine it; writes the detector's file.
"""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

from jaxradar.sim import SURFACES, StepUp, drive_seeds, load_scene, simulate_batch
from jaxradar.systems.step import DefaultDetector, DetectorFile, dump_detector
from jaxradar.tuning import Costs, Plan, examples_of, split, tune, uncertainty

DRIVES = 200
HEIGHTS_M = (0.0, 0.01, 0.02, 0.04)  # 0 is a road without a step
SETTINGS = tuple(
    f"approach.{name}" for name in ("evidence", "tilt_far", "tilt_near", "look_m", "reference_s", "noise_share")
)
COSTS = Costs(missed=1.0, false_alarm=0.01, late=0.5)
SEED = 0


def main(output: Path) -> None:
    base = dataclasses.replace(load_scene("trial"), surface=SURFACES["wet-asphalt"], duration_s=1.4)
    scenes = [
        dataclasses.replace(base, road=(StepUp(at_m=9.0, height_m=height),))
        for _ in range(DRIVES // len(HEIGHTS_M))
        for height in HEIGHTS_M
    ]
    drives = simulate_batch(scenes, drive_seeds(SEED, len(scenes)))
    pairs = [(drive, drive.sensors[0]) for drive in drives]
    fitted_to, kept = (examples_of([pairs[place] for place in places]) for places in split(len(pairs), SEED))

    start = DefaultDetector()
    tuned = tune(start, SETTINGS, fitted_to, kept, costs=COSTS, plan=Plan(seed=SEED))
    for one in uncertainty(tuned, start, fitted_to, COSTS):
        print(f"{one.name:24} {one.value:10.4g}  ± {one.sd:.2g}" + ("" if one.determined else "  (not determined)"))
    print(f"cost on drives kept for validation: {tuned.before:.4g} before, {tuned.after:.4g} after")
    provenance = {"tuned_by": "scripts/tune_detector.py", "drives": DRIVES, "seed": SEED, "cost": tuned.after}
    output.write_text(dump_detector(DetectorFile(tuned.detector, provenance=provenance)), encoding="utf-8")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(f"usage: {sys.argv[0]} DETECTOR.toml")
    main(Path(sys.argv[1]))
