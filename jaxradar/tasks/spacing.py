"""How closely scatterers must stand on a simulated road."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from jaxradar.estimate.intervals import CONFIDENCE
from jaxradar.pareto import Candidate, Case, Data, Estimate, Program, Score, Task
from jaxradar.sim import RoadScene, drive_seeds, load_scene, simulate_batch

__all__ = ["ScattererSpacing"]

FINEST_M = 0.0015
SPACINGS_M = (0.1, 0.05, 0.025, 0.012, 0.006, 0.003)
REPEATS = 500
ECHO_LEVEL = 0.3  # bins with less than this share of the strongest are floor


class ScattererSpacing(Task):
    """The mean echo of a flat road, over many roads, against that of scatterers 1.5 mm apart: RMS over the bins of the
    echo, in % of it, where the spread from road to road is taken off (in the mean square). As few scatterers do not
    make speckle, the spread of single sweeps over their mean is compared too."""

    name = "spacing"
    title = "Simulated echo of a road against the spacing of its scatterers"
    item = "sweep"
    error_name = "echo error"
    unit = "%"

    def __init__(self, roads: int | None = None, seed: int = 0) -> None:
        self.roads, self.seed = roads, seed

    def cases(self, quick: bool = False) -> Sequence[Case]:
        roads = self.roads or (6 if quick else 48)
        names = ("flat-asphalt",) if quick else ("flat-asphalt", "flat-wet-asphalt", "flat-grass")
        return [self._case(name, roads) for name in names]

    def _case(self, name: str, roads: int) -> Case:
        scene = dataclasses.replace(load_scene(name), duration_s=1.0, effects=(), vehicle=None)
        return Case(
            name=name,
            draw=lambda: self._data(scene, roads),
            about=f"{roads} roads of {scene.radar.bins} bins, the car moving",
            conditions={"roads": roads},
        )

    def _data(self, scene: RoadScene, roads: int) -> Data:
        finest = dataclasses.replace(scene, spacing_m=FINEST_M)
        reference = _profiles(finest, drive_seeds(self.seed + 1, 2 * roads))
        return Data((scene, drive_seeds(self.seed, roads)), reference, roads * _sweeps(scene))

    def candidates(self, quick: bool = False) -> Sequence[Candidate]:
        usual = float(RoadScene().spacing_m)
        return [
            Candidate(
                f"{1e3 * spacing:g} mm", partial(_prepare, spacing), {"spacing_m": spacing}, default=spacing == usual
            )
            for spacing in (SPACINGS_M[0:5:2] if quick else SPACINGS_M)
        ]

    def score(self, data: Data, answer: Any, items: int) -> Score:
        level, spread = answer
        true_level, true_spread = data.truth
        if level.shape[1] != true_level.shape[1]:
            raise ValueError("the profiles have another number of bins than the reference.")
        random = np.random.default_rng(self.seed)
        echo = true_level.mean(axis=0) > ECHO_LEVEL * true_level.mean(axis=0).max()

        def drawn(of: Callable[[np.ndarray, np.ndarray], float]) -> Estimate:
            return _drawn(random, of, len(level), len(true_level))

        def share(ours: np.ndarray, reference: np.ndarray) -> float:
            return 100.0 * float(ours.mean() / reference.mean() - 1.0)

        return Score(
            _root(drawn(lambda a, b: _deviation(level[a], true_level[b], echo)), level, true_level, echo),
            {
                "level %": drawn(lambda a, b: share(level[a], true_level[b])),
                "speckle %": drawn(lambda a, b: share(spread[a], true_spread[b])),
            },
        )


def _deviation(level: np.ndarray, true_level: np.ndarray, echo: np.ndarray, chances: float = 2.0) -> float:
    """Mean square of the difference of two sets of mean profiles, without what chance alone makes of it; twice that in
    sets that were drawn again out of sets that chance had made."""
    expected = true_level.mean(axis=0)
    ratio = level.mean(axis=0) / expected - 1.0
    by_chance = level.var(axis=0, ddof=1) / len(level) + true_level.var(axis=0, ddof=1) / len(true_level)
    return float(np.mean((ratio**2 - chances * by_chance / expected**2)[echo]))


def _root(square: Estimate, level: np.ndarray, true_level: np.ndarray, echo: np.ndarray) -> Estimate:
    """In %; the value is that of the sets themselves."""
    value = _deviation(level, true_level, echo, 1.0)
    return Estimate(
        *(100.0 * float(np.sqrt(max(one, 0.0))) for one in (value, min(square.low, value), max(square.high, value)))
    )


def _drawn(random: np.random.Generator, of: Callable[..., float], count: int, others: int) -> Estimate:
    """A value with its bootstrap interval, by drawing roads again (Efron, Annals of Statistics 7, 1979)."""
    draws = ((random.integers(count, size=count), random.integers(others, size=others)) for _ in range(REPEATS))
    tail = 50.0 * (1.0 - CONFIDENCE)
    low, high = np.percentile([of(*draw) for draw in draws], (tail, 100.0 - tail))
    return Estimate(of(np.arange(count), np.arange(others)), float(low), float(high))


def _sweeps(scene: RoadScene) -> int:
    return len(simulate_batch([scene], [0])[0].sensors[0])


def _profiles(scene: RoadScene, seeds: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Of each road: the mean amplitude of each bin, and the spread over it of single sweeps at the strongest bin."""
    drives = simulate_batch([scene] * len(seeds), seeds)
    sweeps = [np.asarray(drive.sensors[0].sweeps, np.float64) for drive in drives]
    level = np.stack([one.mean(axis=0) for one in sweeps])
    top = int(np.argmax(level.mean(axis=0)))
    return level, np.stack([one[:, top].std() / level[:, top].mean() for one in sweeps])


def _prepare(spacing_m: float, data: Data) -> Program:
    scene, seeds = data.inputs
    spaced = dataclasses.replace(scene, spacing_m=spacing_m)
    return Program(lambda: _profiles(spaced, seeds), data.items)
