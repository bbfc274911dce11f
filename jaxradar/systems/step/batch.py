"""Batches of recorded sweeps at the speed of memory: `run_batch`, compiled, on all cores."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Shaped, UInt

from jaxradar._machine import cores
from jaxradar._numerics import compiled
from jaxradar.systems.step.blocks import check_fields, check_shapes
from jaxradar.systems.step.config import Decision, MotionSample, RangeAxis, StepDetector
from jaxradar.systems.step.motion import check_motion
from jaxradar.systems.step.pipeline import precision, run_batch

FEWEST_LOGS = 64  # a thread's share, below which its vectors are not filled

__all__ = ["detect_batch"]


def detect_batch(
    detector: StepDetector[Any, Any],
    axis: RangeAxis,
    sweeps: Shaped[Array | np.ndarray, "logs sweeps bins"],
    flags: UInt[Array | np.ndarray, "logs sweeps"],
    dt: Float[Array | np.ndarray, "logs sweeps"],
    lengths: Int[Array | np.ndarray, " logs"],
    motion: MotionSample | None = None,
    fields: tuple[str, ...] = ("range_m", "speed_m_s", "valid", "event"),
) -> dict[str, Array]:
    """Those `fields` of the `Decision`s on a batch, each (logs, sweeps); what is not asked for is not computed.

    `sweeps`: counts as recorded, `flags`: `SweepFlag`s (a saturated sweep is known by its flag alone), `dt` as from
    `time_steps`, `lengths`: how many sweeps of each log are real; the others come out invalid. `motion`: as from
    `stack`, for a detector that uses it. Floats are given out in single precision. NumPy arrays that begin at a
    multiple of 64 bytes, and files mapped into memory, enter as they are, without a copy. The first call for each shape
    compiles. On a CPU the logs are shared out among threads where a detector is `sequential`. The call ends when all is
    done.

    Raises `ConfigError` for an unknown field, `ValueError` for shapes that do not fit each other.
    """
    check_fields(fields)
    inputs = (sweeps, flags, dt, lengths)
    check_shapes(axis, *inputs)
    check_motion(motion, flags.shape)
    moved = motion if detector.uses_motion else None
    double = detector.float64 or jax.config.jax_enable_x64  # type: ignore[attr-defined]
    call = partial(_in_precision, double, tuple(fields), detector, axis)
    threads = _threads(detector, len(lengths))
    if threads == 1:
        return call(*inputs, moved)
    host = jax.tree.map(np.asarray, (*inputs, moved))
    ends = [len(lengths) * part // threads for part in range(threads + 1)]
    with ThreadPoolExecutor(threads) as pool:
        found = pool.map(lambda low, high: call(*jax.tree.map(lambda one: one[low:high], host)), ends, ends[1:])
        parts = list(found)
    return {name: jnp.concatenate([part[name] for part in parts]) for name in parts[0]}


def _threads(detector: StepDetector[Any, Any], logs: int) -> int:
    """Going through time is one thread's work, so each gets some of the logs; other loops fill all cores themselves."""
    if not detector.sequential or jax.default_backend() != "cpu":
        return 1
    return max(1, min(cores(), logs // FEWEST_LOGS))


def _in_precision(double: bool, fields: tuple[str, ...], detector: StepDetector[Any, Any], *arguments: Any) -> Any:
    # A context of JAX belongs to one thread: each enters it again.
    with jax.enable_x64(double), precision(detector):
        # Waited for: an array that entered without a copy may be overwritten by its owner afterwards.
        return jax.block_until_ready(_batch(fields, detector, *arguments))


def _run_fields(
    fields: tuple[str, ...],
    detector: StepDetector[Any, Any],
    axis: RangeAxis,
    sweeps: Array,
    flags: Array,
    dt: Array,
    lengths: Array,
    motion: MotionSample | None = None,
) -> Any:
    def pick(decisions: Decision) -> dict[str, Array]:
        return {name: _to_single(getattr(decisions, name)) for name in fields}

    return run_batch(detector, axis, sweeps, flags, dt, lengths, motion, pick)


def _to_single(field: Array) -> Array:
    # The decisions were made in the detector's own precision; what is given out fits the sensor's.
    return field.astype(jnp.float32) if jnp.issubdtype(field.dtype, jnp.floating) else field


_batch = compiled(_run_fields, static_argnums=0)
