"""From a log of any length to as many points as a picture can show."""

from __future__ import annotations

import numpy as np

from jaxradar.drive import SensorSeries

__all__ = ["envelope_of", "grid", "runs"]


def grid(
    series: SensorSeries, columns: int = 1200, rows: int = 640
) -> tuple[np.ndarray, tuple[float, float, float, float]]:
    """Amplitudes on an even grid of range and time, (rows, columns) float32, with its (left, right, bottom, top).

    Each cell holds the sweep and the bin nearest to its centre, so that nothing is averaged away; NaN where no sweep
    is near (a gap), and where the sweep is invalid. No more sweeps are read than there are columns.
    """
    order = np.argsort(series.times_ns, kind="stable")
    times = series.times_s[order]
    start, stop = float(times[0]), float(times[-1])
    period = 1.0 / (series.sweep_rate_hz or 1.0)
    stop = max(stop, start + period)
    columns = max(2, min(columns, 8 * len(times)))
    width = (stop - start + period) / columns
    centres = start - period / 2 + (np.arange(columns) + 0.5) * width
    nearest = _nearest(times, centres)
    near = np.abs(times[nearest] - centres) <= max(0.75 * period, width)
    low, high, bin_m = float(series.range_m[0]), float(series.range_m[-1]), series.bin_m
    rows = min(rows, len(series.range_m))
    height = (high - low + bin_m) / rows
    bins = _nearest(series.range_m, low - bin_m / 2 + (np.arange(rows) + 0.5) * height)
    picked, place = np.unique(order[nearest], return_inverse=True)
    image = np.asarray(series.sweeps[picked], np.float32)[:, bins][place].T
    image[:, ~near | series.invalid[order[nearest]]] = np.nan
    edges = (start - period / 2, stop + period / 2, low - bin_m / 2, high + bin_m / 2)
    return image, edges


def _nearest(sorted_values: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    right = np.clip(np.searchsorted(sorted_values, wanted), 1, max(1, len(sorted_values) - 1))
    right = np.minimum(right, len(sorted_values) - 1)
    left = np.maximum(right - 1, 0)
    return np.where(wanted - sorted_values[left] <= sorted_values[right] - wanted, left, right)


def envelope_of(times: np.ndarray, values: np.ndarray, blocks: int = 1500) -> tuple[np.ndarray, np.ndarray]:
    """A line that looks like (times, values): itself if it is short, else the least and the greatest value of each of
    `blocks` pieces in the order in which they come. NaN where a whole piece is NaN."""
    count = len(values)
    if count <= 2 * blocks:
        return times, values
    size = -(-count // blocks)
    whole = np.full(size * blocks, np.nan)
    whole[:count] = values
    pieces = whole.reshape(blocks, size)
    empty = np.isnan(pieces).all(axis=1)
    low = np.where(np.isnan(pieces), np.inf, pieces).argmin(axis=1)
    high = np.where(np.isnan(pieces), -np.inf, pieces).argmax(axis=1)
    low[empty] = high[empty] = 0
    ends = np.sort(np.stack([low, high], axis=1), axis=1)
    places = np.minimum((ends + size * np.arange(blocks)[:, None]).ravel(), count - 1)
    return times[places], values[places]


def runs(mask: np.ndarray) -> list[tuple[int, int]]:
    """First and last index of each run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]])))
    return [(int(first), int(last) - 1) for first, last in zip(edges[::2], edges[1::2], strict=True)]
