"""Drives made, looked at by every detector and forgotten again; what is kept of each are a few numbers."""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

import numpy as np

from jaxradar.drive import Drive
from jaxradar.matching import MatchWindow, match_steps, speed_at
from jaxradar.sim import RoadScene, held_out_seeds, simulate_each
from jaxradar.suite.scenes import Negative, StepCell, lead_allowed_s
from jaxradar.systems.step import StepDetector, SweepBatch, detect_batch, stack

__all__ = ["Found", "Quiet", "measure_negative", "measure_step", "threshold_at"]

TOGETHER = 256  # drives that are looked at together
BLOCK_S = 0.5  # of a road without a step: exceedances within it count as one
SETTLED_S = 0.5
IN_TIME = 0.8  # share of what geometry allows
FIELDS = ("statistic", "event", "impact_in_s")
Detectors = Mapping[str, StepDetector[Any, Any]]
Progress = Callable[[int], None]


@dataclass(frozen=True, eq=False)
class Found:
    """Of one detector over one cell, each (drives,), NaN where there is none.

    - `lead_s`: from the detection to the impact; `allowed_s`: what geometry allows.
    - `top`: the largest statistic as long as a detection would have been in time, `IN_TIME` of what is allowed.
    - `expected_s`: until the impact, as the detector predicted it when it detected.
    - `false`: false alarms.
    """

    lead_s: np.ndarray
    allowed_s: np.ndarray
    top: np.ndarray
    expected_s: np.ndarray
    false: np.ndarray

    @property
    def in_time(self) -> np.ndarray:
        """Whether each was seen with a lead of `IN_TIME` of what geometry allows."""
        return np.nan_to_num(self.lead_s, nan=-1.0) >= IN_TIME * self.allowed_s


@dataclass(frozen=True, eq=False)
class Quiet:
    """Of one detector over roads without a step: detections, hours, and the largest statistic of each half second once
    detectors have settled, `settled_hours` together."""

    events: int
    drives_with: int
    drives: int
    hours: float
    settled_hours: float = 0.0
    tops: np.ndarray = field(default_factory=lambda: np.zeros(0))


def measure_step(
    cell: StepCell,
    detectors: Detectors,
    count: int,
    seed: int = 0,
    told: Progress = lambda done: None,
    seeds: Callable[[int, int], list[int]] = held_out_seeds,
) -> dict[str, Found]:
    """What each detector finds in `count` drives of a cell; `told` hears how many are done."""
    parts: dict[str, list[Found]] = {name: [] for name in detectors}
    done = 0
    for drives in _batches(cell.name, cell.scenes, count, seed, seeds):
        scenes, made = zip(*drives, strict=True)
        batch = _stacked(made, detectors)
        for name, detector in detectors.items():
            decided = detect_batch(detector, *batch, fields=FIELDS)
            found = {key: np.asarray(one) for key, one in decided.items()}
            parts[name].append(_found(found, scenes, made, float(cell.height_m)))
        done += len(made)
        told(done)
    return {name: _joined(held) for name, held in parts.items()}


def measure_negative(
    negative: Negative,
    detectors: Detectors,
    count: int,
    seed: int = 0,
    told: Progress = lambda done: None,
    seeds: Callable[[int, int], list[int]] = held_out_seeds,
) -> dict[str, Quiet]:
    """What each detector raises in `count` drives without a step."""
    events, with_any = dict.fromkeys(detectors, 0), dict.fromkeys(detectors, 0)
    tops: dict[str, list[np.ndarray]] = {name: [] for name in detectors}
    done, hours, settled_hours = 0, 0.0, 0.0
    for drives in _batches(negative.name, negative.scenes, count, seed, seeds):
        made = [drive for _, drive in drives]
        batch = _stacked(made, detectors)
        times = _times(made)
        settled = times >= SETTLED_S
        block = np.where(settled, (np.where(settled, times - SETTLED_S, 0.0) / BLOCK_S).astype(int), -1)
        for name, detector in detectors.items():
            decided = detect_batch(detector, *batch, fields=FIELDS[:2])
            found = {key: np.asarray(one) for key, one in decided.items()}
            events[name] += int(found["event"].sum())
            with_any[name] += int(found["event"].any(axis=1).sum())
            of_block = [
                np.where(block == one, found["statistic"], 0.0).max(axis=1) for one in range(int(block.max()) + 1)
            ]
            tops[name].append(np.concatenate(of_block))
        durations = np.array([drive.sensors[0].duration_s for drive in made])
        hours += float(durations.sum()) / 3600.0
        settled_hours += float(np.maximum(durations - SETTLED_S, 0.0).sum()) / 3600.0
        done += len(made)
        told(done)
    return {
        name: Quiet(events[name], with_any[name], done, hours, settled_hours, np.concatenate(tops[name]))
        for name in detectors
    }


def _batches(
    name: str,
    scenes_of: Callable[[int, np.random.Generator], list[RoadScene]],
    count: int,
    seed: int,
    seeds: Callable[[int, int], list[int]],
) -> Iterator[list[tuple[RoadScene, Drive]]]:
    own = zlib.crc32(name.encode()) ^ seed
    drawn = seeds(own, count + 1)
    scenes = scenes_of(count, np.random.default_rng(drawn[-1]))
    drives = zip(scenes, simulate_each(scenes, drawn[:-1]), strict=True)
    while held := list(islice(drives, TOGETHER)):
        yield held


def _stacked(drives: Sequence[Drive], detectors: Detectors) -> SweepBatch:
    """The first sensor of each drive, with its motion if any of the detectors uses that."""
    moves = any(one.uses_motion for one in detectors.values())
    return stack([drive.sensors[0] for drive in drives], [drive.motion for drive in drives] if moves else None)


def _times(drives: Sequence[Drive]) -> np.ndarray:
    """(drives, sweeps) seconds, NaN beyond the end of a drive."""
    longest = max(len(drive.sensors[0]) for drive in drives)
    times = np.full((len(drives), longest), np.nan)
    for place, drive in enumerate(drives):
        times[place, : len(drive.sensors[0])] = drive.sensors[0].times_s
    return times


def _found(
    found: Mapping[str, np.ndarray], scenes: Sequence[RoadScene], drives: Sequence[Drive], height_m: float
) -> Found:
    rows: list[tuple[float, float, float, float, int]] = []
    for place, (scene, drive) in enumerate(zip(scenes, drives, strict=True)):
        assert drive.truth is not None
        times = drive.sensors[0].times_s
        events = np.flatnonzero(found["event"][place, : len(times)])
        matching = match_steps(times[events], drive.truth.steps, speed=drive.motion.speed_m_s)
        (step,) = matching.steps
        speed = speed_at(drive.motion.speed_m_s, step.impact_s) or float(scene.motion.speed_m_s)
        allowed = lead_allowed_s(scene, speed, height_m)
        before = step.impact_s - times
        in_time = (before >= IN_TIME * allowed) & (before <= MatchWindow().before(speed))
        top = float(np.max(found["statistic"][place, : len(times)], where=in_time, initial=0.0))
        lead = expected = math.nan
        if matching.hits:
            (lead,), (hit,) = matching.lead_s, matching.hit_by
            expected = float(found["impact_in_s"][place, events[hit]]) or math.nan
        rows.append((lead, allowed, top, expected, matching.false_alarms))
    columns = zip(*rows, strict=True)
    return Found(*(np.array(list(one)) for one in columns))


def _joined(parts: Iterable[Found]) -> Found:
    held = list(parts)
    return Found(*(np.concatenate([getattr(one, name) for one in held]) for name in Found.__dataclass_fields__))


def threshold_at(tops: np.ndarray, hours: float, per_hour: float = 1.0) -> float:
    """The least threshold that no more half seconds an hour exceed; infinite where there is not time enough to say."""
    most = math.floor(per_hour * hours)
    if most < 1:
        return math.inf
    return float(np.sort(tops)[-most - 1]) if most < len(tops) else 0.0
