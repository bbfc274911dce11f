"""A detector over one series and over padded batches of them, as pure functions; and over a log."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Shaped, UInt

from jaxradar._numerics import compiled, soft_exceeds
from jaxradar._types import Setting
from jaxradar.drive import Motion, SensorSeries, SweepFlag, kept_bins
from jaxradar.systems.step.blocks import check_shapes, in_blocks
from jaxradar.systems.step.config import Decision, MotionSample, RangeAxis, StepDetector
from jaxradar.systems.step.motion import check_motion, motion_at, no_motion, put_motion
from jaxradar.systems.step.result import StepEvent, StepTrace
from jaxradar.units import NANOSECONDS

__all__ = [
    "as_program",
    "detect",
    "event_weights",
    "precision",
    "run",
    "run_batch",
    "thin",
    "time_steps",
    "trace_of",
]

FEWEST_SWEEPS = 512


def time_steps(times_ns: Int[np.ndarray, " sweeps"]) -> Float[np.ndarray, " sweeps"]:
    """Seconds since the sweep before, 0 for the first: differenced in integers, so that a day's log loses nothing."""
    return np.diff(times_ns, prepend=times_ns[:1]) / NANOSECONDS


def precision(detector: StepDetector[Any, Any]) -> contextlib.AbstractContextManager[Any]:
    """The precision that a detector must run in; JAX's own setting otherwise. A context, never a global change."""
    return jax.enable_x64(True) if detector.float64 else contextlib.nullcontext()


def run(
    detector: StepDetector[Any, Any],
    axis: RangeAxis,
    sweeps: Shaped[Array | np.ndarray, "sweeps bins"],
    flags: UInt[Array | np.ndarray, " sweeps"],
    dt: Float[Array | np.ndarray, " sweeps"],
    motion: MotionSample | None = None,
) -> Decision:
    """All decisions on one series, each field of shape (sweeps,): pure, to be jit-compiled and differentiated.

    `dt` as from `time_steps`, `motion` as from `motion_at`. Call it inside `precision(detector)`.
    """
    moved = jax.tree.map(lambda field: field[None], motion)
    one = run_batch(detector, axis, sweeps[None], flags[None], dt[None], np.array([len(flags)]), motion=moved)
    return jax.tree.map(lambda field: field[0], one)


def run_batch(
    detector: StepDetector[Any, Any],
    axis: RangeAxis,
    sweeps: Shaped[Array | np.ndarray, "logs sweeps bins"],
    flags: UInt[Array | np.ndarray, "logs sweeps"],
    dt: Float[Array | np.ndarray, "logs sweeps"],
    lengths: Int[Array | np.ndarray, " logs"],
    motion: MotionSample | None = None,
    pick: Callable[[Decision], Any] = lambda decisions: decisions,
) -> Any:
    """All decisions on a batch of series of one range axis, each field (logs, sweeps); invalid beyond `lengths`.

    Goes through the batch in blocks of some thousand sweeps (of one whole log where that is longer and the detector is
    not `sequential`; at once where sweeps are long), so that temporaries stay a small share of the input; of each block
    only what `pick` makes of its decisions is kept: arrays whose first two axes are (logs, sweeps of the block).
    `motion`: as from `stack`, left out of the program where the detector does not use it.
    Pure, to be jit-compiled and differentiated; `detect_batch` is this, compiled. Call it inside
    `precision(detector)`. Raises `ValueError` in a precision that the detector does not take, and for shapes that do
    not fit each other.
    """
    if detector.float64 and not jax.config.jax_enable_x64:  # type: ignore[attr-defined]
        raise ValueError(
            f"the detector `{detector.name}` needs double precision; call it inside `precision(detector)`."
        )
    check_shapes(axis, sweeps, flags, dt, lengths)
    check_motion(motion, flags.shape)
    return in_blocks(
        detector,
        axis,
        pick,
        jnp.asarray(sweeps),
        jnp.asarray(flags),
        jnp.asarray(dt, jnp.result_type(float)),
        jnp.asarray(lengths).astype(jnp.int32),
        motion=jax.tree.map(as_program, motion) if detector.uses_motion else None,
    )


def as_program(field: Any) -> Array:
    """In the program's precision."""
    field = jnp.asarray(field)
    return field.astype(jnp.result_type(float)) if jnp.issubdtype(field.dtype, jnp.floating) else field


def event_weights(
    detector: StepDetector[Any, Any], decisions: Decision, temperature: Setting
) -> Float[Array, "*batch sweeps"]:
    """How far each sweep is a detection, between 0 and 1, for what needs a gradient with respect to the threshold.

    `decisions` as from `run` or `run_batch`, `temperature` in the unit of the statistic. As it falls to 0 this tends to
    statistic > threshold; what a detector asks for beyond that (hysteresis, refractory time) is not in it.
    """
    soft = soft_exceeds(decisions.statistic, detector.threshold, temperature)
    return jnp.where(decisions.valid, soft, 0.0)


_run = compiled(run)


def _padded_length(count: int) -> int:
    """The next length of 1, 1.25, 1.5 or 1.75 times a power of two, `FEWEST_SWEEPS` or more: few programs, which take
    seconds to compile, and little padding, which takes milliseconds."""
    quarter = (1 << (max(count, FEWEST_SWEEPS) - 1).bit_length()) // 8
    return -(-max(count, FEWEST_SWEEPS) // quarter) * quarter


def detect(detector: StepDetector[Any, Any], series: SensorSeries, motion: Motion | None = None) -> StepTrace:
    """Find the road steps in one series of sweeps.

    `motion`: of the drive, for a detector that uses it.
    """
    count, padded = len(series), _padded_length(len(series))
    moved = None
    if detector.uses_motion and motion is not None:
        moved = no_motion((1, padded))
        put_motion(moved, 0, motion_at(motion, series.times_ns), 0, count)
        moved = jax.tree.map(lambda field: field[0], moved)
    with precision(detector):
        decisions = _run(
            detector,
            RangeAxis.of(series.range_m),
            np.pad(series.sweeps, ((0, padded - count), (0, 0))),
            np.pad(series.flags, (0, padded - count), constant_values=int(SweepFlag.NO_AMPLITUDES)),
            np.pad(time_steps(series.times_ns), (0, padded - count)),
            moved,
        )
        host = {
            field.name: np.asarray(getattr(decisions, field.name))[:count] for field in dataclasses.fields(Decision)
        }
    return trace_of(detector, series, host)


def _events_of(
    detector: StepDetector[Any, Any], series: SensorSeries, found: Mapping[str, np.ndarray]
) -> tuple[StepEvent, ...]:
    """The detections among decisions on a series: `event`, `range_m`, `strength` and `statistic`, each (sweeps,)."""
    threshold = float(detector.threshold)
    return tuple(
        StepEvent(
            time_s=float(series.times_ns[i] / NANOSECONDS),
            range_m=float(found["range_m"][i]),
            strength=float(found["strength"][i]),
            statistic=float(found["statistic"][i]),
            threshold=threshold,
            sweep=int(i),
            impact_in_s=float(found["impact_in_s"][i]) or None,
        )
        for i in np.flatnonzero(found["event"])
    )


def trace_of(detector: StepDetector[Any, Any], series: SensorSeries, host: Mapping[str, np.ndarray]) -> StepTrace:
    """All fields of the decisions on a series, each (sweeps,), as a trace."""
    times_s = series.times_s
    valid = host["valid"]
    return StepTrace(
        sensor=series.sensor,
        times_s=times_s,
        range_m=np.where(valid, host["range_m"], np.nan),
        speed_m_s=np.where(valid, host["speed_m_s"], np.nan),
        strength=host["strength"],
        statistic=host["statistic"],
        impact_in_s=host["impact_in_s"],
        valid=valid,
        saturated=host["saturated"],
        threshold=float(detector.threshold),
        statistic_name=detector.statistic_name,
        statistic_unit=detector.statistic_unit,
        events=_events_of(detector, series, host),
    )


def thin(series: SensorSeries, bins: int) -> SensorSeries:
    """Every n-th bin as the lab's program keeps them: `jaxradar.drive.kept_bins`.

    Raises `ConfigError` unless 2 <= bins <= the log's own.
    """
    kept = kept_bins(len(series.range_m), bins)
    return dataclasses.replace(series, sweeps=np.asarray(series.sweeps)[:, kept], range_m=series.range_m[kept])
