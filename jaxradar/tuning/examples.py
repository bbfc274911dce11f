"""Drives with their truth as arrays: where a detection would hit which step, and where it would be a false alarm."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np

from jaxradar.drive import Drive, SensorSeries
from jaxradar.matching import MatchWindow, speed_at
from jaxradar.systems.step import SweepBatch, stack
from jaxradar.units import NANOSECONDS

__all__ = ["Examples", "examples_of", "split"]


class Examples(NamedTuple):
    """Series of one range axis.

    - `batch`: as `stack` makes it.
    - `window`: (logs, steps, sweeps) bool: a detection here may hit this step.
    - `lead_s`: (logs, steps, sweeps) float32, the time until its impact.
    - `real`: (logs, steps) bool: padding is no step.
    - `false`: (logs, sweeps) bool: a detection here is a false alarm.
    - `hours`: (logs,) float64.
    """

    batch: SweepBatch
    window: np.ndarray
    lead_s: np.ndarray
    real: np.ndarray
    false: np.ndarray
    hours: np.ndarray

    @property
    def logs(self) -> int:
        """How many there are."""
        return len(self.hours)

    def pick(self, logs: np.ndarray) -> Examples:
        """Those logs alone, in that order."""
        axis, *arrays = self.batch
        return Examples(
            SweepBatch(axis, *jax.tree.map(lambda one: one[logs], arrays)), *(one[logs] for one in self[1:])
        )


def examples_of(drives: Sequence[tuple[Drive, SensorSeries]], window: MatchWindow | None = None) -> Examples:
    """Series of drives whose truth is known, by the rule of `jaxradar.matching`.

    Raises `ValueError` for a drive without truth, and as `stack` does.
    """
    window = MatchWindow() if window is None else window
    for place, (drive, _) in enumerate(drives):
        if drive.truth is None:
            raise ValueError(f"`examples_of` takes drives whose truth is known; that of drive {place} is not.")
    batch = stack([series for _, series in drives], [drive.motion for drive, _ in drives])
    logs, sweeps = batch.flags.shape
    steps = max((len(drive.truth.steps) for drive, _ in drives if drive.truth is not None), default=0)
    inside = np.zeros((logs, max(steps, 1), sweeps), bool)
    lead = np.zeros(inside.shape, np.float32)
    real = np.zeros(inside.shape[:2], bool)
    false = np.zeros((logs, sweeps), bool)
    hours = np.zeros(logs)
    for log, (drive, series) in enumerate(drives):
        assert drive.truth is not None
        count = len(series)
        near = np.zeros(count, bool)
        for place, step in enumerate(sorted(drive.truth.steps, key=lambda one: one.impact_s)):
            before = np.int64(round(step.impact_s * NANOSECONDS)) - series.times_ns
            reach = min(window.before(speed_at(drive.motion.speed_m_s, step.impact_s)), 3.2e7)
            inside[log, place, :count] = (before >= 0) & (before <= round(reach * NANOSECONDS))
            lead[log, place, :count] = before / NANOSECONDS
            near |= inside[log, place, :count]
            real[log, place] = inside[log, place].any()
        false[log, :count] = ~near
        hours[log] = series.duration_s / 3600.0
    return Examples(batch, inside, lead, real, false, hours)


def split(
    count: int, seed: int = 0, share: float = 0.25, kinds: Sequence[object] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Places of so many drives, drawn: those to fit to, and the `share` kept for validation, one at least of each.

    `kinds`: of each drive, whether it holds a step for example; each kind is shared out by itself, so that one of two
    drives of a kind is on either side. Raises `ValueError` for fewer than two drives.
    """
    if count < 2:
        raise ValueError(f"`split` needs two drives; got {count}.")
    random = np.random.default_rng(seed)
    order = random.permutation(count)
    if kinds is None:
        kept = order[: min(max(1, round(share * count)), count - 1)]
    else:
        drawn = [[place for place in order if kinds[place] == kind] for kind in dict.fromkeys(kinds)]
        sizes = [min(max(1, round(share * len(one))), len(one) - 1) for one in drawn]
        kept = np.array([place for one, size in zip(drawn, sizes, strict=True) for place in one[:size]], np.int64)
        kept = kept if kept.size else order[:1]
    return np.setdiff1d(order, kept), np.sort(kept)
