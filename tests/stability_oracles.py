"""What the signal processing should say, in NumPy and float64; shares no code with the package.

An answer that rounding decides (which of equal bins) comes as all answers that would do: an array with one axis more.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

Answer = dict[str, Any]
# Likelihoods and correlations that agree so far are equal as far as float32 can tell.
EQUAL = 2e-6


def finite(values: np.ndarray) -> np.ndarray:
    return np.where(np.isfinite(values), values, 0.0)


def window(values: np.ndarray, centre: int, half_width: int | None) -> tuple[int, np.ndarray]:
    if half_width is None or 2 * half_width + 1 >= len(values):
        return 0, values
    start = min(max(centre - half_width, 0), len(values) - 2 * half_width - 1)
    return start, values[start : start + 2 * half_width + 1]


def in_window(sweep: np.ndarray, near: int | None, half_width: int | None, locate: Any) -> Answer:
    values = finite(sweep)
    start, taps = window(values, int(np.argmax(values)) if near is None else near, half_width)
    found = bool(taps.max() > 0)
    position = start + np.asarray(locate(taps)) if found else 0.0
    return {"position": position, "amplitude": taps.max(), "found": found}


def plateau_middle(taps: np.ndarray) -> float:
    first = last = int(np.argmax(taps))
    while last + 1 < len(taps) and taps[last + 1] == taps[first]:
        last += 1
    return 0.5 * (first + last)


def arg_max(sweep: np.ndarray, near: int | None = None, half_width: int | None = None) -> Answer:
    return in_window(sweep, near, half_width, plateau_middle)


def parabola(sweep: np.ndarray, near: int | None = None, reach: int = 1) -> Answer:
    values = finite(sweep)
    reach = min(reach, (len(values) - 1) // 2)
    top = plateau_middle(values) if near is None else float(near)
    start, taps = window(values, round(top) if near is None else near, reach)  # ties to even in both
    found = bool(taps.max() > 0)
    position = top
    if found and reach:
        steps = np.arange(-reach, reach + 1.0)
        curvature, slope, _ = np.linalg.lstsq(np.vander(steps, 3), taps, rcond=None)[0]
        if curvature < -1e-6 * taps.max() and abs(slope / (2 * curvature)) <= reach:
            position = start + reach - slope / (2 * curvature)
    return {"position": position if found else 0.0, "amplitude": taps.max(), "found": found}


def soft_mean(
    values: np.ndarray, temperature: float, log_gain: np.ndarray | None = None, exponent: float = 0.0
) -> float:
    compensated = finite(values) if log_gain is None else finite(values) * np.exp(exponent * log_gain)
    if compensated.max() <= 0:
        return 0.5 * (len(values) - 1)
    weights = np.exp((compensated / compensated.max() - 1.0) / temperature)
    return float(np.sum(weights * np.arange(len(values))) / np.sum(weights))


def soft_argmax(
    sweep: np.ndarray, temperature: float, near: int | None = None, half_width: int | None = None
) -> Answer:
    return in_window(sweep, near, half_width, lambda taps: soft_mean(taps, temperature))


def gaussian(offset: np.ndarray, fwhm: float) -> np.ndarray:
    return 2.0 ** (-((2.0 * np.asarray(offset) / fwhm) ** 2))


def matched_places(taps: np.ndarray, fwhm: float, steps: int = 2, equal: float = EQUAL) -> np.ndarray:
    """The bin of the largest likelihood on the grid, then Newton steps of at most a bin on log c − ½ log e.

    Derivatives are differences of the likelihood itself.
    """
    bins, size = np.arange(len(taps), dtype=np.float64), len(taps)
    radius = math.ceil(1.5 * fwhm)
    scaled = taps / taps.max()
    near = np.abs(bins[:, None] - bins) <= radius
    pulses = np.where(near, gaussian(bins[:, None] - bins, fwhm), 0.0)
    likelihood = pulses @ scaled / np.sqrt(np.sum(pulses**2, axis=1))

    def log_likelihood(place: float) -> float:
        pulse = gaussian(bins - place, fwhm)
        return math.log(max(float(pulse @ scaled), 1e-300)) - 0.5 * math.log(float(pulse @ pulse))

    places = []
    for place in map(float, np.flatnonzero(likelihood >= likelihood.max() * (1 - equal))):
        for _ in range(steps):
            low, here, high = (log_likelihood(place + shift) for shift in (-1e-3, 0.0, 1e-3))
            slope, bend = (high - low) / 2e-3, (high - 2 * here + low) / 1e-6
            place += float(np.clip(-slope / bend, -1, 1)) if bend < 0 else 0.0
        places.append(float(np.clip(place, 0, size - 1)))
    return np.array(places)


def matched_filter(
    sweep: np.ndarray, fwhm: float, near: int | None = None, half_width: int | None = None, equal: float = EQUAL
) -> Answer:
    return in_window(sweep, near, half_width, lambda taps: matched_places(taps, fwhm, equal=equal))


def strongest_cell(cells: np.ndarray, level: float = 0.0) -> Answer:
    """The three neighbours that hold most, and the largest of them; each trio that would do."""
    ends = np.pad(cells, 1, mode="edge")
    means = (ends[:-2] + cells + ends[2:]) / 3
    over, places = np.maximum(means - level, 0), []
    for middle in np.flatnonzero(over >= over.max() * (1 - EQUAL)):
        # The first of equals, but the middle before either side.
        options = sorted((middle, middle - 1, middle + 1), key=lambda one: -cells[min(max(one, 0), len(cells) - 1)])
        top = min(max(options[0], 0), len(cells) - 1)
        inside = 0 < top < len(cells) - 1  # a cell at an end has one neighbour, and so no vertex
        places.append(top + 0.5 + (vertex(*cells[top - 1 : top + 2])["offset"] if inside else 0.0))
        if inside and straight(*cells[top - 1 : top + 2]):
            places.append(top + 0.5)
    return {"place": np.array(places), "strength": over.max()}


def pulse_fit(sweep: np.ndarray, fwhm: float, near: int | None, half_width: int, search: int) -> Answer:
    """One Newton step on the logarithm of the correlation, from each bin that would do to begin with."""
    values, begin = finite(sweep), [near]
    if near is None:
        width = min(search | 1, max(1, (len(values) // 3 - 1) | 1))
        sums = np.convolve(values, np.ones(width), "valid")
        unknown = np.convolve(~np.isfinite(np.asarray(sweep, np.float64)), np.ones(width), "valid") > 0
        sums = np.where(unknown, 0.0, sums)  # a sum over what is no number does not count
        begin = [int(one) + width // 2 for one in np.flatnonzero(sums >= sums.max() - EQUAL * abs(sums.max()))]
    answers = [_one_step(values, fwhm, at, half_width) for at in begin]
    return answers[0] | {"position": np.array([one["position"] for one in answers])}


def _one_step(values: np.ndarray, fwhm: float, near: int, half_width: int) -> Answer:
    half = min(half_width, (len(values) - 1) // 2)
    sigma = fwhm / math.sqrt(8 * math.log(2))

    start = min(max(near - half, 0), len(values) - 2 * half - 1)

    def locate(taps: np.ndarray) -> float:
        offset = (np.arange(len(taps)) - half) / sigma
        match = taps / taps.max() * np.exp(-0.5 * offset**2)
        most, top = match.sum(), float(half)
        if most > 0:
            rise = (match * offset).sum() / most
            bend = (match * (offset**2 - 1)).sum() / most - rise**2
            top = half - sigma * rise / bend if bend < 0 else top
        low, high = near - start - 0.5 * fwhm, near - start + 0.5 * fwhm
        return float(np.clip(top, max(low, 0.0), min(high, len(taps) - 1.0)))

    return in_window(values[start : start + 2 * half + 1], None, None, lambda taps: start + locate(taps))


def straight(left: float, middle: float, right: float) -> bool:
    """Whether in single precision three lie on a line but for their rounding: with or without a vertex will do."""
    size = abs(left) + abs(middle) + abs(right)
    return bool(abs(left - 2 * middle + right) <= 5 * np.finfo(np.float32).eps * size)


def vertex(left: float, middle: float, right: float) -> Answer:
    bend = left - 2 * middle + right
    offset = min(max(0.5 * (left - right) / bend, -0.5), 0.5) if bend < 0 else 0.0
    return {"offset": offset, "height": middle - 0.25 * (left - right) * offset}


def noise_floor(cells: np.ndarray) -> Answer:
    quiet = cells <= cells.mean() * (1 + 1e-12)
    steps = np.diff(cells)[quiet[1:] & quiet[:-1]]
    return {
        "level": cells[quiet].mean() if quiet.any() else 0.0,
        "scatter": math.sqrt(0.5 * np.mean(steps**2)) if len(steps) else 0.0,
    }


def correlations(profile: np.ndarray, reference: np.ndarray, reach: int) -> np.ndarray:
    count, norms = len(profile), np.linalg.norm(profile) * np.linalg.norm(reference)
    found = np.zeros(2 * reach + 1)
    for lag in range(-reach, reach + 1):
        products = [profile[i] * reference[i - lag] for i in range(count) if 0 <= i - lag < count]
        found[lag + reach] = sum(products) / norms if norms else 0.0
    return found


def profile_shift(profile: np.ndarray, reference: np.ndarray, reach: int, noise: float = 0.03) -> Answer:
    found = correlations(profile, reference, reach)
    padded = np.pad(found, 1)
    cells, heights = [], []
    for best in np.flatnonzero(found >= found.max() * (1 - EQUAL)):
        three = padded[best : best + 3]
        if three[0] > 0 and three[2] > 0:
            fit = vertex(*np.log(three))
            cells.append(best - reach + fit["offset"])
            heights.append(math.exp(fit["height"]))
        else:
            cells.append(float(best - reach))
            heights.append(three[1])
    sine = lambda c: np.sqrt(1.0 - np.minimum(c, 1.0) ** 2 + noise**2)  # noqa: E731
    return {
        "cells": np.array(cells) if found.max() > 0 else 0.0,
        "unexplained_still": float(sine(found[reach])),
        "unexplained_moved": np.array([sine(height) for height in heights]),
    }


def sigmoid(margin: float) -> float:
    return 0.5 * (1.0 + math.tanh(0.5 * margin))


# Slopes of a track: values at uneven times.


def backward_difference(values: np.ndarray, dt: np.ndarray) -> np.ndarray:
    known = np.where(dt > 0, dt, np.inf)
    return np.append(0.0, np.diff(values)) / known


def three_point_difference(values: np.ndarray, dt: np.ndarray) -> np.ndarray:
    slopes = backward_difference(values, dt)
    found = slopes.copy()
    for i in range(2, len(values)):
        if dt[i] > 0 and dt[i - 1] > 0:
            found[i] = slopes[i] + dt[i] * (slopes[i] - slopes[i - 1]) / (dt[i] + dt[i - 1])
    return found


def fitted_slope(values: np.ndarray, dt: np.ndarray, window: int, order: int) -> np.ndarray:
    found = np.zeros(len(values))
    for i in range(len(values)):
        first = max(0, i - window + 1)
        time = -np.append(np.cumsum(dt[i:first:-1])[::-1], 0.0)
        longest = np.abs(time).max()
        if longest == 0:
            continue
        shape = np.vander(time / longest, 3)
        line = shape[:, 1:]
        bent = shape[:, 0] - line @ np.linalg.lstsq(line, shape[:, 0], rcond=None)[0]
        parabola = order == 2 and len(time) > 2 and bent @ bent > 1e-6
        fit = np.linalg.lstsq(shape if parabola else line, values[first : i + 1] - values[i], rcond=None)[0]
        found[i] = fit[-2] / longest
    return found
