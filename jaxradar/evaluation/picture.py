"""A series reduced to what a page of thousands can show."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from jaxradar.drive import SensorSeries
from jaxradar.evaluation.records import Picture

__all__ = ["picture_of"]

COLUMNS = 160
MAP_COLUMNS = 80
MAP_ROWS = 32
_BRIGHTEST = 99.9  # percentile that is white: single saturated sweeps do not darken the rest


def picture_of(series: SensorSeries, found: Mapping[str, np.ndarray]) -> Picture:
    """The picture of a series with the `range_m`, `speed_m_s`, `statistic`, `valid` and `event` that were found in it.

    Columns are of equal numbers of sweeps, which are of equal time as far as the sweep rate is.
    """
    count = len(series)
    times = series.times_ns
    starts = np.unique(np.arange(COLUMNS) * count // COLUMNS) if count else np.zeros(0, int)
    return Picture(
        start_s=float(times[0]) / 1e9 if count else 0.0,
        stop_s=float(times[-1]) / 1e9 if count else 0.0,
        range_m=_span(found["range_m"], found["valid"], starts),
        speed_m_s=_span(found["speed_m_s"], found["valid"], starts),
        statistic=_reduced(np.maximum, found["statistic"], starts).astype(np.float32),
        event=_reduced(np.logical_or, found["event"], starts).astype(bool),
        amplitude=_map(series),
        near_m=float(series.range_m[0]),
        far_m=float(series.range_m[-1]),
    )


def _span(values: np.ndarray, valid: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Least and greatest of the valid in each column, NaN where there is none."""
    least = _reduced(np.minimum, np.where(valid, values, np.inf), starts)
    most = _reduced(np.maximum, np.where(valid, values, -np.inf), starts)
    span = np.stack([least, most])
    return np.where(np.isfinite(span), span, np.nan).astype(np.float32)


def _reduced(how: np.ufunc, values: np.ndarray, starts: np.ndarray) -> np.ndarray:
    return how.reduceat(values, starts) if len(starts) else np.zeros(0, np.float32)


def _map(series: SensorSeries) -> np.ndarray:
    """Of every so many sweeps one, averaged over bins: what lies between is not read."""
    count, bins = series.sweeps.shape
    kept = np.unique(np.arange(MAP_COLUMNS) * count // MAP_COLUMNS) if count else np.zeros(0, int)
    rows = np.unique(np.arange(MAP_ROWS) * bins // MAP_ROWS)
    # A row at a time: picked all at once, a memory map would be gone through by single numbers.
    sweeps = np.stack([series.sweeps[at] for at in kept]) if len(kept) else np.zeros((0, bins), np.float32)
    whole = np.nan_to_num(sweeps.astype(np.float32), nan=0.0, posinf=0.0, neginf=0.0)
    cells = np.add.reduceat(whole, rows, axis=1) / np.diff(rows, append=bins)
    top = np.percentile(cells, _BRIGHTEST) if cells.size else 0.0
    share = np.sqrt(np.clip(cells / top, 0.0, 1.0)) if top > 0 else np.zeros_like(cells)
    return np.ascontiguousarray(np.rint(255 * share).astype(np.uint8).T)
