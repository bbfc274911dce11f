"""Six settings fitted to 1,000 drives, by gradient and without: `python benches/run.py tuning`.

The thesis's pipeline (range compensation, soft-argmax in a window around the peak, a short filter over sweeps in place
of the plain difference, threshold), on a sensor that looks straight down from a slow car on a floor like a mirror:
there the range of a single sweep shows a step. All methods minimise one and the same cost, that of `jaxradar.tuning`.
"""

from __future__ import annotations

import dataclasses
import pickle
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from child import ask
from data import UnavailableError
from measure import figure, say, spread
from report import Row, Section
from settings import Settings

from jaxradar.matching import MatchWindow
from jaxradar.sim import CarMotion, StepUp, Surface, drive_seeds, simulate_batch
from jaxradar.suite.scenes import base_scene
from jaxradar.systems.step import FilteredRateDetector
from jaxradar.tuning import Costs, Examples, Plan, Space, examples_of

__all__ = ["COSTS", "DETECTOR", "NAMES", "measure", "plan", "start_of"]

FLOOR = Surface(slope=0.1, grain_db=-60.0, rms_mm=0.0)
HEIGHTS_M = (0.0, 0.01, 0.02, 0.03)  # 0: no step
DETECTOR = FilteredRateDetector(refine_compensated=True, filter=(0.0,) * 3)
NAMES = ("threshold_m_s", "exponent", "temperature", "filter")
COSTS = Costs(missed=1.0, false_alarm=3e-5, late=0.5)
MOST_EVALUATIONS = 500
GRADIENT, KEPT = "gradient, compiling", "gradient, programs kept"
NUMPY, JAX, GRID = "Nelder-Mead, NumPy", "Nelder-Mead, JAX", "grid, JAX"
MOST_S, MOST_GB, LEAST_RATIO = 60.0, 2.0, 10.0


def plan(seed: int) -> Plan:
    return Plan(seed=seed)


def drives(count: int, seed: int = 0) -> Examples:
    """A second each, at 300 Hz and 128 bins; with seeds for development."""
    random = np.random.default_rng(seed)
    base = base_scene(FLOOR, duration_s=1.0, vehicle=None)
    base = dataclasses.replace(base, mount=dataclasses.replace(base.mount, angle_deg=90.0))
    scenes = []
    for place in range(count):
        speed = random.uniform(0.33, 0.5)
        step = StepUp(at_m=speed * random.uniform(0.5, 0.8), height_m=HEIGHTS_M[place % len(HEIGHTS_M)])
        scenes.append(dataclasses.replace(base, motion=CarMotion(speed_m_s=speed), road=(step,)))
    made = []
    for low in range(0, count, 100):
        part = scenes[low : low + 100]
        made += [(one, one.sensors[0]) for one in simulate_batch(part, drive_seeds(seed + low, len(part)))]
    return examples_of(made, MatchWindow(0.25, 0.15))


def start_of(seed: int) -> np.ndarray:
    """Where all methods begin: a sensible detector, moved a little, in the fit's own coordinates."""
    sensible = FilteredRateDetector(
        refine_compensated=True, exponent=1.0, threshold_m_s=1.5, temperature=0.2, filter=(0.5,) * 3
    )
    return Space.of(DETECTOR, NAMES).vector(sensible) + 0.3 * np.random.default_rng(seed).normal(size=6)


def measure(settings: Settings) -> Section:
    count, seeds = (64, 1) if settings.quick else (1000, 3)
    title = f"6 settings fitted to {count} drives of 300 sweeps x 128 bins; {seeds} seeds, a process each"
    columns = ("method", "s", "range", "evaluations", "cost", "range", "MB", "s to equal", "/kept", "range")
    section = Section("tuning", title, columns)
    found: dict[str, list[dict[str, Any]]] = {one: [] for one in (GRADIENT, KEPT, NUMPY, JAX, GRID)}
    with tempfile.TemporaryDirectory(prefix="jaxradar-bench-") as folder:
        path = Path(folder) / "drives.pickle"
        say(f"simulating {count} drives")
        path.write_bytes(pickle.dumps(drives(count)))
        for seed in range(seeds):
            for method, held in found.items():
                if method == KEPT or (method == GRID and seed):
                    continue
                say(f"{method}, seed {seed}")
                most = 60 if settings.quick else MOST_EVALUATIONS
                try:
                    one = ask("tuning", path=str(path), method=method, seed=seed, most=most)
                    held.append(one)
                    if method == GRADIENT:
                        found[KEPT].append({**one, "seconds": one["again"], "trace": [(one["again"], one["cost"])]})
                except UnavailableError as why:
                    section.failed = True
                    section.notes.append(f"{method}: {why}")
    if not found[GRADIENT]:
        return section
    for method, held in found.items():
        if held:
            section.rows.append(_row(method, held, found[KEPT]))
    _judge(section, found, settings.quick)
    return section


def _row(method: str, held: list[dict[str, Any]], gradient: list[dict[str, Any]]) -> Row:
    seconds = spread(np.array([one["seconds"] for one in held]))
    costs = spread(np.array([one["cost"] for one in held]))
    pairs = list(zip(held, gradient, strict=False))
    reached = [_reached(one, other["cost"]) for one, other in pairs]
    ratios = np.array([at / other["seconds"] for (at, _), (_, other) in zip(reached, pairs, strict=True)])
    ratio = None if method == KEPT else spread(ratios)
    never = "" if all(ever for _, ever in reached) else "> "
    return Row(
        method,
        [
            method,
            figure(seconds.median),
            f"{figure(seconds.low)}..{figure(seconds.high)}",
            figure(float(np.median([one["evaluations"] for one in held]))),
            f"{costs.median:.4f}",
            f"{costs.low:.4f}..{costs.high:.4f}",
            f"{max(one['peak'] for one in held) / 1e6:.0f}",
            never + figure(float(np.median([at for at, _ in reached]))),
            "" if ratio is None else never + figure(ratio.median),
            "" if ratio is None else f"{figure(ratio.low)}..{figure(ratio.high)}",
        ],
        {"seconds": seconds.median, "cost": costs.median},
        ratio,
    )


def _reached(one: dict[str, Any], cost: float) -> tuple[float, bool]:
    """When the trace of a method came down to a cost (by 0.1 %, what NumPy rounds otherwise), and whether it did."""
    for seconds, value in one["trace"]:
        if value <= 1.001 * cost:
            return seconds, True
    return one["seconds"], False


def _judge(section: Section, found: dict[str, list[dict[str, Any]]], quick: bool) -> None:
    first = found[GRADIENT]
    section.notes.append(
        f"Asked: <= {MOST_S:.0f} s and <= {MOST_GB:.0f} GB with compiling, >= {LEAST_RATIO:.0f} times faster than "
        "Nelder-Mead on NumPy at equal cost. Seconds: from drives in memory to settings, compiling included; cost: on "
        "all drives, at the last temperature. Equal cost: that of the gradient of the same seed; > where it was never "
        "reached. All begin at the same detector, the gradient at three drawn ones too; /kept: over the gradient where "
        "its programs are there, as the command line keeps them from fit to fit. MB: the most that the process held."
    )
    if not quick and first:
        section.notes.append(
            f"The gradient took {max(one['seconds'] for one in first):.1f} s at most, "
            f"{max(one['peak'] for one in first) / 1e9:.2f} GB. Largest difference of a slope from central "
            f"differences, in float64, of the largest slope: {max(one['slope'] for one in first):.1e}."
        )
