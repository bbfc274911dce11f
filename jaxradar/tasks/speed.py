"""The radial speed of an echo, from its ranges at jittered times."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy import signal

from jaxradar._numerics import compiled
from jaxradar.pareto import Candidate, Case, Data, Program, Score, Task, estimation_score
from jaxradar.signal.differences import backward_difference, fitted_slope, three_point_difference

__all__ = ["RadialSpeed", "SpeedInputs"]

SWEEPS = 32
NOISE_M = 0.35e-3  # of a single sweep's range on standing asphalt at 45° (scripts/recorded_noise.py)
FASTEST_M_S = 6.0  # of the echo: cos 45° of 30 km/h
BENT_M_S2 = 60.0  # v² H²/r³, how fast the range rate of a corner changes at 30 km/h, 0.35 m up and 0.5 m away


@dataclass(frozen=True, eq=False)
class SpeedInputs:
    """(tracks, sweeps) ranges in metres, recorded intervals in seconds, and the interval that was asked for."""

    range_m: np.ndarray
    dt: np.ndarray
    nominal_s: float


class RadialSpeed(Task):
    """Range rate at the newest of 32 sweeps. Ranges r + v t + ½ a t² with v within 6 m/s and a within 60 m/s² either
    way, white noise of 0.35 mm, intervals with a normal jitter of so many percent. The bound takes all three as
    unknown, from all 32 sweeps: that of an estimator without bias, which a line through a bent track is not."""

    name = "speed"
    title = "Range rate at the newest sweep, from noisy ranges at jittered times"
    item = "sweep"
    error_name = "RMS error"
    unit = "m/s"

    def __init__(self, tracks: int | None = None, seed: int = 0) -> None:
        self.tracks, self.seed = tracks, seed

    def cases(self, quick: bool = False) -> Sequence[Case]:
        kinds = [(300.0, 0.1)] if quick else [(300.0, 0.1), (300.0, 0.0), (100.0, 0.1), (50.0, 0.1)]
        return [self._case(rate_hz, jitter, self.tracks or (4_000 if quick else 20_000)) for rate_hz, jitter in kinds]

    def _case(self, rate_hz: float, jitter: float, tracks: int) -> Case:
        return Case(
            name=f"{rate_hz:g} Hz, jitter {jitter:.0%}",
            draw=lambda: self._data(rate_hz, jitter, tracks),
            about=f"{rate_hz:g} sweeps/s, intervals {jitter:.0%} off, ranges {1e3 * NOISE_M:g} mm off",
            conditions={"rate_hz": rate_hz, "jitter": jitter},
            bound_name="Cramér-Rao, 32 sweeps",
        )

    def _data(self, rate_hz: float, jitter: float, tracks: int) -> Data:
        random = np.random.default_rng([self.seed, round(rate_hz), round(100 * jitter)])
        dt = np.maximum(1.0 + jitter * random.standard_normal((tracks, SWEEPS)), 0.2) / rate_hz
        # Backwards from the newest sweep, where the speed is asked for.
        time = np.concatenate([-np.cumsum(dt[:, :0:-1], axis=1)[:, ::-1], np.zeros((tracks, 1))], axis=1)
        speed = random.uniform(-FASTEST_M_S, FASTEST_M_S, tracks)
        bent = random.uniform(-BENT_M_S2, BENT_M_S2, tracks)
        clean = 0.5 + speed[:, None] * time + 0.5 * bent[:, None] * time**2
        ranges = clean + NOISE_M * random.standard_normal(clean.shape)
        jacobian = np.stack([np.ones_like(time), time, 0.5 * time**2], axis=2)
        variance = np.linalg.inv(np.swapaxes(jacobian, 1, 2) @ jacobian)[:, 1, 1].mean()
        inputs = SpeedInputs(ranges.astype(np.float32), dt.astype(np.float32), 1.0 / rate_hz)
        return Data(inputs, speed, tracks * SWEEPS, NOISE_M * float(np.sqrt(variance)))

    def candidates(self, quick: bool = False) -> Sequence[Candidate]:
        windows = (4, 8, 16) if quick else (3, 4, 6, 8, 12, 16, 24, 32)
        ways: dict[str, Callable[..., Any]] = {
            "difference": backward_difference,
            "three points": three_point_difference,
        }
        ways |= {f"line through {window}": partial(fitted_slope, window=window) for window in windows}
        ways |= {f"parabola through {window}": partial(fitted_slope, window=window, order=2) for window in windows[1:]}
        ours = [Candidate(name, partial(_prepare, way), {"way": name}) for name, way in ways.items()]
        # As the thesis's printout does: what the sensor was asked for, not what it did.
        nominal = Candidate(
            "difference, nominal interval", partial(_prepare, backward_difference, nominal=True), {"way": "difference"}
        )
        peers = {f"SciPy savgol_filter {window}": partial(_prepare_savgol, window) for window in (9, 17)}
        peers |= {"NumPy polyfit 16": partial(_prepare_polyfit, 16, 2)}
        others = [Candidate(name, prepare, {"way": name.split()[1]}, peer=True) for name, prepare in peers.items()]
        return [*ours, nominal, *others]

    def score(self, data: Data, answer: Any, items: int) -> Score:
        """Of the newest sweep of each track."""
        tracks = items // SWEEPS
        return estimation_score(np.asarray(answer)[:, -1], data.truth[:tracks], 1.0)


def _prepare(way: Callable[..., Any], data: Data, nominal: bool = False) -> Program:
    inputs: SpeedInputs = data.inputs
    ranges = jnp.asarray(inputs.range_m)
    dt = jnp.full_like(ranges, inputs.nominal_s) if nominal else jnp.asarray(inputs.dt)
    batch = compiled(jax.vmap(way))
    return Program(lambda: batch(ranges, dt), data.items)


def _prepare_savgol(window: int, data: Data) -> Program:
    """On even times, which is all it knows; its edge is a fit to the last window."""
    inputs: SpeedInputs = data.inputs

    def run(ranges: np.ndarray) -> np.ndarray:
        return np.asarray(signal.savgol_filter(ranges, window, 2, deriv=1, delta=inputs.nominal_s, mode="interp"))

    return Program(lambda: run(inputs.range_m), data.items)


def _prepare_polyfit(window: int, order: int, data: Data) -> Program:
    """One track after the other, on the recorded times; the newest sweep alone."""
    inputs: SpeedInputs = data.inputs
    tracks = min(500, len(inputs.range_m))

    def run(count: int) -> np.ndarray:
        slopes = []
        for ranges, dt in zip(inputs.range_m[:count], inputs.dt[:count], strict=True):
            time = np.cumsum(dt[-window:].astype(np.float64))
            slopes.append(np.polyfit(time - time[-1], ranges[-window:], order)[-2])
        return np.asarray(slopes)[:, None]

    # One answer a track, where the others give one for each sweep.
    return Program(lambda: run(tracks), tracks * SWEEPS, answers=tracks)
