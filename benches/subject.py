"""What is measured: jaxradar's detectors behind one small adapter, so that a change there is one line here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from data import TEMPERATURE, THRESHOLD_M_S, Batch, Outputs

from jaxradar._numerics import compiled
from jaxradar.drive import SensorSeries
from jaxradar.systems import step
from jaxradar.systems.step.batch import _batch  # the program that `detect_batch` hides

__all__ = ["GRADIENTS", "ROWS", "build", "check_default", "gradient", "loss", "place", "runner", "temp_bytes"]

FIELDS = ("range_m", "speed_m_s", "event")
# The rows of the report, and which of NumPy's estimators each does the work of.
ROWS: Mapping[str, str | None] = {
    "thesis": "argmax",
    "argmax": "argmax",
    "parabola": "parabola",
    "window": "window",
    "soft": "soft",
    "shift": None,
    "approach": None,
    "default": None,
}
GRADIENTS = ("window", "soft")
# How each is called in `RangeRateDetector`, and how many bins it looks at to either side of the selected one.
_PEAKS: Mapping[str, tuple[str, int]] = {
    "argmax": ("arg-max", 0),
    "parabola": ("parabola", 1),
    "window": ("soft-argmax", 4),
    "soft": ("soft-argmax over all bins", 0),
}
Arrays = tuple[Any, Any, Any, Any]


def build(row: str, range_m: np.ndarray, **tuned: Any) -> Any:
    """The detector of a row for a range axis, in whose bins its window is counted."""
    if row not in _PEAKS:
        return step.DETECTORS[row]()
    peak, half_width = _PEAKS[row]
    if half_width:
        tuned["window_m"] = 2 * half_width * step.RangeAxis.of(range_m).bin_m
    return step.RangeRateDetector(peak=peak, **tuned)


def place(detector: Any, batch: Batch, device: Any = None) -> Arrays:
    """Sweeps, flags, dt, lengths: NumPy's arrays as they are, or put on `device`."""
    arrays = (batch.sweeps, batch.flags, batch.dt if detector.float64 else batch.dt32, batch.lengths)
    if device is None:
        return arrays
    with step.precision(detector):
        placed: Arrays = jax.block_until_ready(jax.device_put(arrays, device))
    return placed


def runner(detector: Any, batch: Batch, arrays: Arrays) -> Callable[[], Outputs]:
    """A call that ends when its result is there."""
    axis = step.RangeAxis.of(batch.range_m)

    def run() -> Outputs:
        found = step.detect_batch(detector, axis, *arrays, fields=FIELDS)
        return Outputs(*jax.block_until_ready([found[field] for field in FIELDS]))

    return run


def temp_bytes(detector: Any, batch: Batch) -> int | None:
    """What the compiled program sets aside beside its inputs and outputs, if the compiler says so."""
    with step.precision(detector):
        # jit's own method, which a plain callable's type does not have
        lowered = _batch.lower(  # type: ignore[attr-defined]
            FIELDS, detector, step.RangeAxis.of(batch.range_m), *place(detector, batch)
        )
    analysis = lowered.compile().memory_analysis()
    return None if analysis is None else int(analysis.temp_size_in_bytes)


def check_default(detector: Any, batch: Batch, found: Outputs, logs: int) -> str:
    """Empty if a batch's first logs are decided as `jaxradar.detect` decides them one by one, else what differs."""
    for log in range(min(logs, batch.logs)):
        series = SensorSeries(0, batch.times_ns[log], batch.sweeps[log], batch.range_m, batch.flags[log])
        trace = step.detect(detector, series)
        events = np.zeros(len(series), bool)
        events[[event.sweep for event in trace.events]] = True
        if not np.array_equal(np.asarray(found.event[log]), events):
            return f"events of log {log} are not those of `detect`"
        off = np.abs(np.asarray(found.distance[log]) - trace.range_m)[trace.valid]
        # What is summed in another order may tip one sweep over an edge; the track comes back to it.
        if np.mean(off > 1e-4) > 1e-3:
            return f"ranges of log {log} are not those of `detect`, by up to {off.max():.2g} m"
    return ""


def loss(row: str, batch: Batch, target: Any, soft_m_s: float = 0.05) -> Callable[..., Any]:
    """Of three parameters (exponent, temperature, threshold): event weights that should be like `target`, little speed.

    `soft_m_s`: over how much speed a soft event rises from 0 to 1.
    """
    axis = step.RangeAxis.of(batch.range_m)
    # Raw amplitudes in the window would not hang on the exponent.
    shape = {"refine_compensated": True} if row == "window" else {}

    def value(parameters: Any, sweeps: Any, flags: Any, dt: Any, lengths: Any) -> Any:
        exponent, temperature, threshold = parameters
        detector = build(
            row, batch.range_m, exponent=exponent, temperature=temperature, threshold_m_s=threshold, **shape
        )
        decisions = step.run_batch(detector, axis, sweeps, flags, dt, lengths)
        weights = step.event_weights(detector, decisions, soft_m_s)
        return jnp.mean(weights * target) + 1e-3 * jnp.mean(jnp.abs(decisions.speed_m_s))

    return value


def gradient(row: str, batch: Batch, seed: int = 0) -> tuple[Callable[[], Any], Callable[[Any], float]]:
    """A call that gives value and gradient at the usual settings, and one that gives the value at any.

    In the precision that is set when this is called.
    """
    dtype = jnp.result_type(float)
    target = np.random.default_rng(seed).uniform(-1.0, 1.0, batch.flags.shape).astype(dtype)
    arrays = (batch.sweeps, batch.flags, batch.dt if dtype == np.float64 else batch.dt32, batch.lengths)
    function = loss(row, batch, target)
    both, alone = compiled(jax.value_and_grad(function)), compiled(function)
    usual = jnp.asarray([2.0, TEMPERATURE, THRESHOLD_M_S], dtype)
    return lambda: jax.block_until_ready(both(usual, *arrays)), lambda parameters: float(alone(parameters, *arrays))
