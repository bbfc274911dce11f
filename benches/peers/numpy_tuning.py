"""The cost of `jaxradar.tuning` of a filtered range rate by hand in NumPy, float32, as someone without JAX would tune.

A log at a time into buffers that are used again, the logs shared out among threads: NumPy lets other threads run while
it works through an array.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from jaxradar.tuning import Costs, Examples

__all__ = ["NumpyCost"]

THREADS = 2
GROUP = 8  # logs looked at together: their sweeps, as floats, stay in the second-level cache


class NumpyCost:
    """Cost of the settings (threshold, exponent, temperature, filter...) on series without gaps, all of one length."""

    def __init__(self, examples: Examples, costs: Costs, half_width: int, before: int):
        self.examples, self.costs, self.half = examples, costs, half_width
        self.log_gain = np.log(2.0 * np.asarray(examples.batch.axis.range_m)).astype(np.float32)
        self.dt = examples.batch.dt.astype(np.float32)
        self.before = before
        count = examples.logs
        self.groups = [slice(low, min(low + GROUP, count)) for low in range(0, count, GROUP)]
        longest = np.where(examples.window, examples.lead_s, 0).max(axis=-1, keepdims=True)
        self.waited = np.where(examples.window, longest - examples.lead_s, 0).astype(np.float32)
        # Only some sweeps lie in a window: those from the first to the last of each group.
        self.spans = [_span(examples.window[group].any(axis=(0, 1))) for group in self.groups]
        self.steps, self.hours = float(examples.real.sum()), float(examples.hours.sum())
        self.evaluations = 0
        self.pool = ThreadPoolExecutor(THREADS)

    def __call__(self, settings: np.ndarray, decision_temperature: float) -> float:
        self.evaluations += 1
        threshold, exponent, temperature, *weights = (np.float32(one) for one in settings)
        gains = np.exp(exponent * self.log_gain)
        call = lambda place: self._group(  # noqa: E731
            place, gains, np.float32(1 / temperature), weights, threshold, np.float32(1 / decision_temperature)
        )
        missed, late, false = np.sum(list(self.pool.map(call, range(len(self.groups)))), axis=0)
        return float(
            (self.costs.missed * missed + self.costs.late * late) / self.steps
            + self.costs.false_alarm * false / self.hours
        )

    def _group(self, place: int, gains: np.ndarray, cold: np.float32, weights: list, threshold, sharpness) -> list:
        group = self.groups[place]
        batch = self.examples.batch
        sweeps = batch.sweeps[group]
        logs, count, bins = sweeps.shape
        selected = (sweeps * gains).argmax(axis=-1).reshape(-1)
        taps = 2 * self.half + 1
        start = np.clip(selected - self.half, 0, bins - taps)
        inside = start[:, None] + np.arange(taps)
        values = sweeps.reshape(-1).take(inside + (bins * np.arange(logs * count))[:, None]) * gains[inside]
        values *= cold / values.max(axis=-1, keepdims=True)
        values -= cold
        np.exp(values, out=values)
        sums = values @ np.stack([np.ones(taps), np.arange(taps)], axis=1).astype(np.float32)
        position = (start + sums[:, 1] / sums[:, 0]).astype(np.float32).reshape(logs, count)
        rise = np.diff(position, axis=1) * np.float32(batch.axis.bin_m)
        wait = self.dt[group, 1:]
        top, below = rise.copy(), wait.copy()
        for k, weight in enumerate(weights, 1):
            top[:, k:] += weight * rise[:, :-k]
            below[:, k:] += weight * wait[:, :-k]
        positive = below > 0
        statistic = np.abs(np.divide(top, below, out=np.zeros_like(top), where=positive))
        some = statistic > 0
        statistic[~some] = 1.0
        logit = (np.log(statistic) - np.log(threshold)) * sharpness
        logit[~some] = -1e4
        weight = np.zeros((logs, count), np.float32)
        weight[:, 1:] = 1.0 / (1.0 + np.exp(-np.maximum(logit, -80)))
        first, last = self.spans[place]
        if first == last:
            missed = late = 0.0
        else:
            window = self.examples.window[group, :, first:last]
            part = np.zeros((logs, last - first), np.float32)
            low = max(first, 1)
            near = logit[:, low - 1 : last - 1]
            part[:, low - first :] = -(np.maximum(near, 0) + np.log1p(np.exp(-np.abs(near))))
            quiet = np.where(window, part[:, None], np.float32(0))
            running = np.cumsum(quiet, axis=-1)
            seen_first = np.where(window, weight[:, None, first:last] * np.exp(running - quiet), 0)
            late = float((seen_first * self.waited[group, :, first:last]).sum())
            missed = float(np.exp(running[..., -1])[self.examples.real[group]].sum())
        false = float(weight[self.examples.false[group]].sum())
        return [missed, late, false]


def _span(held: np.ndarray) -> tuple[int, int]:
    places = np.flatnonzero(held)
    return (int(places[0]), int(places[-1]) + 1) if places.size else (0, 0)
