"""How well the height of a step is known, by one who knows when its edge passes and by one who was told by a detector;
and the bound: what the leading edge of a speckled echo can tell of its shift."""

from __future__ import annotations

import dataclasses
import math
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from scipy import linalg

from jaxradar._errors import ConfigError
from jaxradar.drive import Drive, Motion
from jaxradar.estimate.intervals import Estimate, percentile, proportion
from jaxradar.matching import MatchWindow
from jaxradar.signal.pulses import SIGMA_PER_FWHM
from jaxradar.sim import RoadScene, held_out_seeds, simulate_each
from jaxradar.suite.scenes import ROADS, StepCell
from jaxradar.survey.ground import Beam, Ground, strip_patches, strips_of
from jaxradar.survey.height import HeightFinder, StepHeight, step_height
from jaxradar.survey.pair import corner_detector
from jaxradar.systems.step import StepDetector, detect
from jaxradar.systems.step.result import StepEvent

__all__ = ["HEIGHTS_M", "HeightErrors", "height_bound_m", "heights_grid", "measure_heights"]

HEIGHTS_M = (0.01, 0.02, 0.03, 0.05, 0.08)
SPEEDS_KMH = (10.0, 20.0, 30.0, 40.0)
LATER_S = 0.3
ONE_SIGMA = 100.0 * math.erf(math.sqrt(0.5))  # percent


@dataclass(frozen=True, eq=False)
class HeightErrors:
    """Of one cell, each (drives,): `error_m`, found minus true, and the standard deviation that was said, NaN where no
    height was found."""

    error_m: np.ndarray
    sd_m: np.ndarray

    @property
    def found(self) -> Estimate:
        """Share of the drives in which there is a height."""
        return proportion(int(np.isfinite(self.error_m).sum()), len(self.error_m))

    @property
    def median_m(self) -> Estimate:
        return self._of(50.0, self.error_m)

    @property
    def usual_m(self) -> Estimate:
        """What 68 % of the errors are not beyond."""
        return self._of(ONE_SIGMA, np.abs(self.error_m))

    @property
    def honest(self) -> Estimate:
        """Share of the errors within what was said; 68 % is honest."""
        some = np.isfinite(self.error_m)
        if not some.any():
            return Estimate(math.nan, math.nan, math.nan)
        return proportion(int((np.abs(self.error_m[some]) < self.sd_m[some]).sum()), int(some.sum()))

    def record(self) -> dict[str, Any]:
        """As JSON knows it; metres."""
        said = self.sd_m[np.isfinite(self.sd_m)]
        return {
            "drives": len(self.error_m),
            **{name: dataclasses.asdict(getattr(self, name)) for name in ("found", "median_m", "usual_m", "honest")},
            "said_m": float(np.median(said)) if said.size else None,
        }

    @staticmethod
    def _of(percent: float, values: np.ndarray) -> Estimate:
        some = values[np.isfinite(values)]
        return percentile(some, percent) if some.size else Estimate(math.nan, math.nan, math.nan)


def heights_grid(roads: Sequence[str] = tuple(ROADS)) -> Iterator[StepCell]:
    """Steps up of 10 to 80 mm at 10 to 40 km/h."""
    return (StepCell(road, speed, height) for road in roads for speed in SPEEDS_KMH for height in HEIGHTS_M)


def measure_heights(
    cell: StepCell,
    detector: StepDetector[Any, Any] | None,
    count: int,
    seed: int = 0,
    *,
    finder: HeightFinder | None = None,
    measured: bool = True,
    told: Callable[[int], None] = lambda done: None,
    seeds: Callable[[int, int], list[int]] = held_out_seeds,
) -> HeightErrors:
    """Errors of `step_height` in `count` drives of a cell, the car's speed being recorded.

    `detector`: whose first event within a step's window says when the impact is; None for one who knows when the edge
    passes. `measured`: whether the body's acceleration is recorded too. `told` hears how many drives are done.
    """
    drawn = seeds(zlib.crc32(cell.name.encode()) ^ seed, count + 1)
    random = np.random.default_rng(drawn[-1])
    scenes = [dataclasses.replace(one, duration_s=one.duration_s + LATER_S) for one in cell.scenes(count, random)]
    rows = []
    for scene, drive in zip(scenes, simulate_each(scenes, drawn[:-1]), strict=True):
        motion = drive.motion if measured else Motion(speed_m_s=drive.motion.speed_m_s)
        found = _found(scene, drive, detector, finder, motion)
        rows.append((math.nan, math.nan) if found is None else (found.height_m - cell.height_m, found.sd_m))
        told(len(rows))
    error, sd = np.array(rows, float).T
    return HeightErrors(error, sd)


def _found(
    scene: RoadScene,
    drive: Drive,
    detector: StepDetector[Any, Any] | None,
    finder: HeightFinder | None,
    motion: Motion,
) -> StepHeight | None:
    assert drive.truth is not None
    series, speed = drive.sensors[0], float(scene.motion.speed_m_s)
    try:
        if detector is None:
            at = float(scene.road[0].at_m) / speed
            return step_height(series, StepEvent(at, 0.0, 0.0, 0.0, 0.0, 0), finder, motion=motion, passes_s=at)
        impact = drive.truth.steps[0].impact_s
        begin = impact - MatchWindow().before(speed)
        event = next((one for one in detect(detector, series, motion).events if begin <= one.time_s <= impact), None)
        if event is None:
            return None
        return step_height(series, event, finder, motion=motion, approach=corner_detector(detector))
    except ConfigError:
        return None


def height_bound_m(ground: Ground, looks: float, beam: Beam | None = None, bin_m: float = 0.007) -> float:
    """Least standard deviation of an unbiased height out of so many independent sweeps before, all known, and after it.

    The field in the bins is complex Gaussian of covariance C = ∫ q(ρ) p(r − ρ) p(r' − ρ) dρ + noise, q the road's power
    over slant range; of a parameter of it a sweep says tr(C⁻¹ C' C⁻¹ C') (Kay, Estimation Theory, section
    15.7). The envelope, which is what is recorded, says no more than the field.
    """
    beam = beam or Beam()
    height = float(ground.height_m)
    range_m = np.arange(height - 0.12, height + 0.3, 2.0 * bin_m)

    strips = strips_of(beam, float(range_m[-1]))

    def covariance(height_m: float) -> np.ndarray:
        patches = strip_patches(beam, ground, jnp.asarray(height_m), strips)
        ranges, powers = (np.asarray(one, float).ravel() for one in patches)
        pulses = np.exp(-0.5 * ((ranges[:, None] - range_m) / (SIGMA_PER_FWHM * float(beam.fwhm_m))) ** 2)
        field = (pulses * powers[:, None]).T @ pulses
        noise = math.exp(float(ground.log_noise))
        # As the receiver's filter makes it, neighbouring bins share it.
        apart = np.subtract.outer(range_m, range_m)
        return np.asarray(field + noise * (np.exp(-((apart / 0.034) ** 2)) + 1e-3 * np.eye(len(range_m))))

    step = 1e-4
    middle = covariance(height)
    slope = (covariance(height + step) - covariance(height - step)) / (2.0 * step)
    share = linalg.solve(middle, slope, assume_a="pos")
    return 1.0 / math.sqrt(looks * float(np.trace(share @ share)))
