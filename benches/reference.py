"""The pipeline once more in NumPy and float64, sharing no code with what is measured, and the check against it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from data import TEMPERATURE, THRESHOLD_M_S, Batch, Outputs

__all__ = ["Expected", "check", "expected"]

# Two bins whose compensated amplitudes lie closer than this share: float32 may rightly take either (its own step is
# 6e-8, and a product of two rounded factors errs by up to three of them).
NEAR_TIE = 5e-7
MOST_METRES = 3e-6  # float32 metres are 6e-8 apart; exponentials in float32 move a mean by another few 1e-7
MOST_M_S = 2.0 * MOST_METRES * 300.0 * 2.0  # two distances, at twice the mean rate


@dataclass(frozen=True, eq=False)
class Expected:
    """Of the first logs of a batch: the outputs in float64, and where float32 may choose another bin."""

    outputs: Outputs
    near_tie: np.ndarray


def _soft_mean(amplitudes: np.ndarray) -> np.ndarray:
    bins = np.arange(amplitudes.shape[-1])
    weights = np.exp((amplitudes / amplitudes.max(axis=-1, keepdims=True) - 1.0) / TEMPERATURE)
    return np.average(np.broadcast_to(bins, weights.shape), axis=-1, weights=weights)


def _positions(estimator: str, raw: np.ndarray, range_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions in bins of sweeps (n, bins) float64, and which of them hang on a near-tie."""
    compensated = raw * (2.0 * range_m) ** 2
    selected = np.argmax(compensated, axis=1)
    two = np.partition(compensated, -2, axis=1)[:, -2:]
    near_tie = two[:, 0] > two[:, 1] * (1.0 - NEAR_TIE)
    rows = np.arange(len(raw))
    if estimator == "argmax":
        return selected.astype(float), near_tie
    if estimator == "parabola":
        centre = np.clip(selected, 1, raw.shape[1] - 2)
        left, middle, right = raw[rows, centre - 1], raw[rows, centre], raw[rows, centre + 1]
        curvature = left - 2.0 * middle + right
        with np.errstate(divide="ignore", invalid="ignore"):
            offset = np.where(curvature < 0, 0.5 * (left - right) / curvature, 0.0)
        # A vertex beyond the taps is none: the selected bin stands.
        return np.where((curvature < 0) & (np.abs(offset) <= 1.0), centre + offset, selected), near_tie
    if estimator == "window":
        start = np.clip(selected - 4, 0, raw.shape[1] - 9)
        taps = np.stack([raw[rows, start + tap] for tap in range(9)], axis=1)
        return start + _soft_mean(taps), near_tie
    if estimator == "soft":
        return _soft_mean(compensated), np.zeros_like(near_tie)
    raise ValueError(f"no estimator is called {estimator!r}.")


def expected(batch: Batch, estimator: str, logs: int) -> Expected:
    """What the pipeline should give for the first `logs` logs."""
    logs = min(logs, batch.logs)
    shape = (logs, batch.sweeps.shape[1])
    raw = batch.sweeps[:logs].reshape(-1, batch.bins).astype(np.float64)
    position, near_tie = _positions(estimator, raw, batch.range_m)
    distance = np.interp(position, np.arange(batch.bins), batch.range_m).reshape(shape)
    speed = np.zeros(shape)
    speed[:, 1:] = np.diff(distance, axis=1) / batch.dt[:logs, 1:]
    return Expected(Outputs(distance, speed, np.abs(speed) > THRESHOLD_M_S), near_tie.reshape(shape))


def check(found: Outputs, wanted: Expected) -> str:
    """Empty if `found` is right, else what is wrong with it, in a few words."""
    logs = len(wanted.near_tie)
    distance, speed, event = (np.asarray(values)[:logs] for values in found)
    if distance.shape != wanted.near_tie.shape:
        return f"shape {distance.shape} instead of {wanted.near_tie.shape}"
    off = ~(np.abs(distance - wanted.outputs.distance) <= MOST_METRES)
    if np.any(off & ~wanted.near_tie):
        worst = np.nanmax(np.abs(distance - wanted.outputs.distance)[~wanted.near_tie])
        return f"{np.mean(off & ~wanted.near_tie):.2g} of the distances are off, by up to {worst:.2g} m"
    # A sweep that rightly chose the other bin of a tie changes its own speed and the next one's.
    excused = off.copy()
    excused[:, 1:] |= off[:, :-1]
    wrong = ~(np.abs(speed - wanted.outputs.speed) <= MOST_M_S) & ~excused
    if np.any(wrong):
        worst = np.nanmax(np.abs(speed - wanted.outputs.speed)[~excused])
        return f"{np.mean(wrong):.2g} of the speeds are off, by up to {worst:.2g} m/s"
    close = np.abs(np.abs(wanted.outputs.speed) - THRESHOLD_M_S) <= MOST_M_S
    if np.any((event.astype(bool) != wanted.outputs.event) & ~close & ~excused):
        return "events differ"
    return ""
