"""Other people's ways to the range of an echo: NumPy, SciPy, and the maker's own detector where it is installed."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import optimize, signal

from jaxradar.pareto import Candidate, Data, Program
from jaxradar.signal.pulses import SIGMA_PER_FWHM

if TYPE_CHECKING:
    from jaxradar.tasks.echo import EchoInputs

__all__ = ["peer_candidates"]

# From sweeps and the known width, both in bins, to positions in bins.
Way = Callable[[np.ndarray, float], np.ndarray]


def arg_max(sweeps: np.ndarray, fwhm: float) -> np.ndarray:
    """`np.argmax`."""
    return np.argmax(sweeps, axis=1)


def arg_max_parabola(sweeps: np.ndarray, fwhm: float) -> np.ndarray:
    """... and the vertex of the parabola through three bins."""
    return _vertices(sweeps, np.argmax(sweeps, axis=1))


def pulse_fit(sweeps: np.ndarray, fwhm: float) -> np.ndarray:
    """... and one Newton step on the logarithm of the correlation with the pulse: `PulseFit` in NumPy."""
    half, sigma = max(1, round(1.1 * fwhm)), SIGMA_PER_FWHM * fwhm
    near = np.clip(np.argmax(sweeps, axis=1), half, sweeps.shape[1] - half - 1)
    offset = np.arange(-half, half + 1) / sigma
    weight = np.exp(-0.5 * offset**2)
    windows = np.lib.stride_tricks.sliding_window_view(sweeps, 2 * half + 1, axis=1)
    taps = windows[np.arange(len(sweeps)), near - half]
    moments = taps @ np.stack([weight, weight * offset, weight * (offset**2 - 1.0)], axis=1).astype(sweeps.dtype)
    with np.errstate(divide="ignore", invalid="ignore"):
        rise = moments[:, 1] / moments[:, 0]
        step = -rise / (moments[:, 2] / moments[:, 0] - rise**2)
    return near + sigma * np.clip(np.nan_to_num(step), -0.5 / SIGMA_PER_FWHM, 0.5 / SIGMA_PER_FWHM)


def matched_filter(sweeps: np.ndarray, fwhm: float) -> np.ndarray:
    """`scipy.signal.fftconvolve` with the pulse, arg-max, parabola."""
    reach = np.arange(-round(1.5 * fwhm), round(1.5 * fwhm) + 1)
    pulse = np.exp(-0.5 * (reach / (SIGMA_PER_FWHM * fwhm)) ** 2).astype(sweeps.dtype)
    filtered = signal.fftconvolve(sweeps, pulse[None], mode="same", axes=1)
    return _vertices(filtered, np.argmax(filtered, axis=1))


def find_peaks(sweeps: np.ndarray, fwhm: float) -> np.ndarray:
    """`scipy.signal.find_peaks` at least half as high as the largest bin, the highest of them, parabola."""
    tops = np.empty(len(sweeps), np.int64)
    for row, sweep in enumerate(sweeps):
        most = sweep.max()
        peaks, found = signal.find_peaks(sweep, height=0.5 * most)
        tops[row] = peaks[np.argmax(found["peak_heights"])] if peaks.size else np.argmax(sweep)
    return _vertices(sweeps, tops)


def curve_fit(sweeps: np.ndarray, fwhm: float) -> np.ndarray:
    """`scipy.optimize.curve_fit` of height and place of a pulse of the known width, to all bins."""
    bins, sigma = np.arange(sweeps.shape[1], dtype=np.float64), SIGMA_PER_FWHM * fwhm

    def pulse(at: np.ndarray, height: float, place: float) -> np.ndarray:
        return height * np.exp(-0.5 * ((at - place) / sigma) ** 2)

    def slopes(at: np.ndarray, height: float, place: float) -> np.ndarray:
        one = pulse(at, 1.0, place)
        return np.stack([one, height * one * (at - place) / sigma**2], axis=1)

    places = np.empty(len(sweeps))
    for row, sweep in enumerate(sweeps):
        first = (float(sweep.max()), float(np.argmax(sweep)))
        places[row] = optimize.curve_fit(pulse, bins, sweep, first, jac=slopes, maxfev=200)[0][1]
    return places


def _vertices(sweeps: np.ndarray, tops: np.ndarray) -> np.ndarray:
    inner = np.clip(tops, 1, sweeps.shape[1] - 2)
    left, middle, right = (np.take_along_axis(sweeps, inner[:, None] + k, axis=1)[:, 0] for k in (-1, 0, 1))
    curvature = left - 2.0 * middle + right
    offset = np.where(curvature < 0, 0.5 * (left - right) / np.where(curvature < 0, curvature, -1.0), 0.0)
    return inner + np.clip(offset, -1.0, 1.0)


def peer_candidates() -> Sequence[Candidate]:
    """Those that go sweep by sweep are given fewer sweeps."""
    ways: list[tuple[str, Way, int | None]] = [
        ("NumPy arg-max", arg_max, None),
        ("NumPy parabola", arg_max_parabola, None),
        ("NumPy pulse fit", pulse_fit, None),
        ("SciPy matched filter", matched_filter, None),
        ("SciPy find_peaks", find_peaks, 500),
        ("SciPy curve_fit", curve_fit, 100),
    ]
    found = [Candidate(name, partial(_prepare, way, most), {"estimator": name}, peer=True) for name, way, most in ways]
    if importlib.util.find_spec("acconeer") is not None:
        found.append(Candidate("Acconeer distance detector", _prepare_acconeer, {"estimator": "Acconeer"}, peer=True))
    return found


def _prepare(way: Way, most: int | None, data: Data) -> Program:
    inputs: EchoInputs = data.inputs
    count = data.items if most is None else min(most, data.items)
    sweeps, one = inputs.sweeps[:count], inputs.sweeps[data.items // 2][None]
    return Program(lambda: inputs.bin_m * way(sweeps, inputs.fwhm), count, lambda: inputs.bin_m * way(one, inputs.fwhm))


def _prepare_acconeer(data: Data) -> Program:
    """`acconeer-exptool`'s A111 distance detector with its default settings, fixed threshold, no averaging; where it
    finds no peak its answer is the middle of the window. Raises `ImportError` if it cannot be loaded."""
    inputs: EchoInputs = data.inputs
    count = min(100, data.items)
    bins, first_m = inputs.sweeps.shape[1], 0.2  # it refuses ranges that its sensor does not have
    length_m = inputs.bin_m * (bins - 1)
    a111: Any = importlib.import_module("acconeer.exptool.a111")
    theirs: Any = importlib.import_module("acconeer.exptool.a111.algo.distance_detector")
    sensor = a111.EnvelopeServiceConfig()
    sensor.range_interval, sensor.update_rate, sensor.running_average_factor = [first_m, first_m + length_m], 300.0, 0.0
    session = {"data_length": bins, "range_start_m": first_m, "range_length_m": length_m}
    settings = theirs.ProcessingConfiguration()
    settings.threshold_type = settings.ThresholdType.FIXED
    settings.nbr_average = 1
    settings.peak_sorting_type = settings.PeakSorting.STRONGEST
    counts = np.clip(np.rint(inputs.sweeps[:count]), 0, 65535).astype(np.uint16)

    def run(sweeps: np.ndarray) -> np.ndarray:
        processor = theirs.Processor(sensor, settings, session)
        with np.errstate(invalid="ignore"):
            found = [processor.process(sweep, None)["found_peaks"] for sweep in sweeps]
        at = [float(processor.r[peaks[0]]) - first_m if peaks else 0.5 * length_m for peaks in found]
        return np.asarray(at)

    return Program(lambda: run(counts), count, lambda: run(counts[:1]))
