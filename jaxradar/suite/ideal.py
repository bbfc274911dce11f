"""The bound that no detector of envelopes passes: one who knows where the step is, how fast the car goes, and how
bright the corner is.

For each place of the step's foot it knows the root mean square of the road's echo in that range cell, and what the
corner adds, both as measured on drives of its own. Road and noise together are complex Gaussian, so that amplitudes are
Rayleigh distributed without a corner and Rice distributed with one: the logarithm of the likelihood ratio of a sweep is
−K + ln I₀(2 √K a), a over the root mean square, K the corner's power over that (Rice, Bell System Technical Journal 23,
1944). Its sum over all sweeps until it is too late is the best that can be said of them, if the speckle of one sweep
says nothing of that in the next.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from scipy.special import i0e, ndtri

from jaxradar.drive import Drive
from jaxradar.estimate.intervals import Estimate, proportion
from jaxradar.sim import RoadScene, drive_seeds, simulate_each
from jaxradar.suite.run import IN_TIME
from jaxradar.suite.scenes import StepCell, lead_allowed_s

__all__ = ["Ideal", "ideal_observer"]

PLACE_M = 0.04
FARTHEST_M = 0.92
RESOLUTION_M = 0.07  # of the road: steps so far apart are two


@dataclass(frozen=True)
class Ideal:
    """Share of steps seen in time by one who knows all but whether there is one, at so many false alarms an hour;
    `nats` is the mean of what the sweeps say, `threshold` what they must."""

    share: Estimate
    nats: float
    threshold: float


def ideal_observer(cell: StepCell, count: int, seed: int = 0, per_hour: float = 1.0) -> Ideal:
    """Of `count` drives of a cell with a step up, as many to learn from, and as many of the same roads without it."""
    random = np.random.default_rng([seed, 1])
    scenes = cell.scenes(2 * count, random)
    seeds = drive_seeds(seed, 2 * count)
    over = _on_track(scenes, list(simulate_each(scenes, seeds)), cell.height_m)
    plain = [dataclasses.replace(scene, road=()) for scene in scenes]
    without = _on_track(scenes, list(simulate_each(plain, seeds)), cell.height_m)
    places = round(FARTHEST_M / PLACE_M)
    power = np.array([_mean_square(without[:count], place) for place in range(places)])
    with_step = np.array([_mean_square(over[:count], place) for place in range(places)])
    ratio = np.maximum(with_step / power - 1.0, 0.0)
    said = np.array([_log_ratio(one, power, ratio) for one in over[count:]])
    nothing = np.array([_log_ratio(one, power, ratio) for one in without[count:]])
    tests = 3600.0 * cell.speed_kmh / 3.6 / RESOLUTION_M
    threshold = _threshold(said, nothing, per_hour / tests)
    return Ideal(proportion(int((said > threshold).sum()), count), float(said.mean()), threshold)


Track = tuple[np.ndarray, np.ndarray]  # places, and the amplitudes there


def _on_track(scenes: list[RoadScene], drives: list[Drive], height_m: float) -> list[Track]:
    """Amplitude of each sweep at the slant range of the foot of the step, until a detection would be too late."""
    found = []
    for scene, drive in zip(scenes, drives, strict=True):
        series = drive.sensors[0]
        speed = float(scene.motion.speed_m_s)
        ahead = float(scene.road[0].at_m) - speed * series.times_s
        seen_m = lead_allowed_s(scene, speed, height_m) * speed  # of the way, from the line of sight to the impact
        touches_m = float(scene.mount.height_m) - seen_m  # ahead of the sensor's foot, at the impact
        use = (ahead < FARTHEST_M) & (ahead - touches_m >= IN_TIME * seen_m)
        range_m = np.hypot(ahead[use], float(scene.mount.height_m))
        rows = np.asarray(series.sweeps)[use].astype(float)
        amplitude = np.array([np.interp(one, series.range_m, row) for one, row in zip(range_m, rows, strict=True)])
        found.append((np.floor(ahead[use] / PLACE_M).astype(int), amplitude))
    return found


def _mean_square(tracks: list[Track], place: int) -> float:
    held = np.concatenate([amplitude[places == place] for places, amplitude in tracks])
    return float(np.mean(held**2)) if held.size else 1.0


def _log_ratio(track: Track, power: np.ndarray, ratio: np.ndarray) -> float:
    places, amplitude = track
    argument = 2.0 * np.sqrt(ratio[places] * amplitude**2 / power[places])
    return float(np.sum(-ratio[places] + np.log(i0e(argument)) + argument))


def _threshold(said: np.ndarray, nothing: np.ndarray, probability: float) -> float:
    """That the sum exceeds with this probability where there is no step: P₀(Λ > t) = E₁[e^−Λ; Λ > t] (importance
    sampling by the drives with a step), or as a Gaussian of the drives without one has it, whichever is lower: a bound
    must not be too low."""
    order = np.sort(said)[::-1]
    tail = np.cumsum(np.exp(-order)) / len(said)
    beyond = int(np.searchsorted(tail, probability))
    # Where all that was drawn together is not as probable as that, any of it is beyond.
    sampled = math.inf if not beyond else float(order[beyond]) if beyond < len(order) else -math.inf
    if sampled == -math.inf:
        sampled = min(float(np.nextafter(order[-1], -math.inf)), -math.log(probability))
    gaussian = float(nothing.mean() - ndtri(probability) * nothing.std())
    return min(sampled, gaussian)
