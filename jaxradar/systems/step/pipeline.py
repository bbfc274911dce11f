"""A detector over whole series and padded batches of them: the same `observe` and `track` everywhere."""

from __future__ import annotations

import contextlib
import dataclasses
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Shaped, UInt

from jaxradar._errors import ConfigError
from jaxradar._numerics import compiled, soft_exceeds
from jaxradar._toml import nearest
from jaxradar._types import Setting
from jaxradar.drive import NANOSECONDS, Motion, SensorSeries, SweepFlag
from jaxradar.systems.step.config import Decision, RangeAxis, StepDetector
from jaxradar.systems.step.result import StepEvent, StepTrace

FEWEST_LOGS = 64  # a thread's share, below which its vectors are not filled
# Sweeps in a block: what is made of them stays in the processor's cache, and a block's loops outweigh their starts.
BLOCK_BY_LOGS = 32768
BLOCK_BY_TIME = 4096

__all__ = ["detect", "detect_batch", "event_weights", "precision", "run", "run_batch", "thin", "time_steps"]


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
) -> Decision:
    """All decisions on one series, each field of shape (sweeps,): pure, to be jit-compiled and differentiated.

    `dt` as from `time_steps`. Call it inside `precision(detector)`.
    """
    one = run_batch(detector, axis, sweeps[None], flags[None], dt[None], np.array([len(flags)]))
    return jax.tree.map(lambda field: field[0], one)


def run_batch(
    detector: StepDetector[Any, Any],
    axis: RangeAxis,
    sweeps: Shaped[Array | np.ndarray, "logs sweeps bins"],
    flags: UInt[Array | np.ndarray, "logs sweeps"],
    dt: Float[Array | np.ndarray, "logs sweeps"],
    lengths: Int[Array | np.ndarray, " logs"],
    pick: Callable[[Decision], Any] = lambda decisions: decisions,
) -> Any:
    """All decisions on a batch of series of one range axis, each field (logs, sweeps); invalid beyond `lengths`.

    Goes through the batch in blocks of some thousand sweeps, so that no temporary grows with the batch; of each,
    only what `pick` makes of its decisions is kept. Pure, to be jit-compiled and differentiated; call it inside
    `precision(detector)`. `detect_batch` is this, compiled.
    """
    block = partial(_block, detector, axis, pick)
    start = partial(_initial, detector, axis)
    inputs = (jnp.asarray(sweeps), jnp.asarray(flags), jnp.asarray(dt, jnp.result_type(float)), jnp.asarray(lengths))
    return (_by_time if detector.sequential else _by_logs)(block, start, *inputs)


def _block(
    detector: StepDetector[Any, Any],
    axis: RangeAxis,
    pick: Callable[[Decision], Any],
    state: Any,
    sweeps: Callable[[], Array],
    flags: Array,
    dt: Array,
    left: Array,
) -> tuple[Any, Any]:
    """One block, of which the first `left` sweeps of each log are real."""
    beyond = jnp.arange(flags.shape[1]) >= left[:, None]
    flags = jnp.where(beyond, flags | np.uint16(SweepFlag.NO_AMPLITUDES), flags).astype(jnp.uint16)
    state, decisions = detector.follow(axis, state, sweeps, flags, dt)
    return state, pick(decisions)


def _initial(detector: StepDetector[Any, Any], axis: RangeAxis, logs: int) -> Any:
    return jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (logs, *jnp.shape(leaf))), detector.init(axis))


def _part(count: int, wanted: int) -> int:
    """The largest divisor of `count` that is not above `wanted`, or `wanted` if all of them are far smaller."""
    wanted = max(1, min(count, wanted))
    divisor = next(one for one in range(wanted, 0, -1) if count % one == 0)
    return divisor if 2 * divisor >= wanted else wanted


def _by_logs(block: Callable[..., Any], start: Callable[[int], Any], *inputs: Array) -> Any:
    """A few logs at a time, each from its first sweep to its last."""
    logs, sweeps = inputs[1].shape
    part = _part(logs, BLOCK_BY_LOGS // sweeps)
    groups = logs // part

    def one(group: Any) -> Any:
        sweeps, *rest = group
        return block(start(sweeps.shape[0]), lambda: sweeps, *rest)[1]

    if groups == 1:
        return one(inputs)
    head = tuple(values[: groups * part].reshape(groups, part, *values.shape[1:]) for values in inputs)
    done = jax.tree.map(lambda leaf: leaf.reshape(groups * part, *leaf.shape[2:]), jax.lax.map(one, head))
    if groups * part == logs:
        return done
    rest = one([values[groups * part :] for values in inputs])
    return jax.tree.map(lambda a, b: jnp.concatenate([a, b]), done, rest)


def _by_time(block: Callable[..., Any], start: Callable[[int], Any], *inputs: Array) -> Any:
    """All logs side by side, a few sweeps at a time."""
    *columns, lengths = inputs
    logs, sweeps = columns[1].shape
    part = _part(sweeps, BLOCK_BY_TIME // logs)
    blocks = sweeps // part

    def one(state: Any, first: Any) -> Any:
        cut = [partial(jax.lax.dynamic_slice_in_dim, values, first, part, 1) for values in columns]
        return block(state, cut[0], cut[1](), cut[2](), lengths - first)

    state, done = jax.lax.scan(one, start(logs), part * jnp.arange(blocks, dtype=lengths.dtype))
    done = jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 0, 1).reshape(logs, blocks * part), done)
    if blocks * part == sweeps:
        return done
    rest = [values[:, blocks * part :] for values in columns]
    ending = block(state, lambda: rest[0], *rest[1:], lengths - blocks * part)[1]
    return jax.tree.map(lambda a, b: jnp.concatenate([a, b], axis=1), done, ending)


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


def _chosen(fields: tuple[str, ...], detector: StepDetector[Any, Any], axis: RangeAxis, *inputs: Array) -> Any:
    sweeps, flags, dt, lengths = inputs

    def pick(decisions: Decision) -> dict[str, Array]:
        return {name: _single(getattr(decisions, name)) for name in fields}

    return run_batch(detector, axis, sweeps, flags, dt, lengths, pick)


def _single(field: Array) -> Array:
    # The decisions were made in the detector's own precision; what is given out fits the sensor's.
    return field.astype(jnp.float32) if jnp.issubdtype(field.dtype, jnp.floating) else field


_batch = compiled(_chosen, static_argnums=0)


def detect_batch(
    detector: StepDetector[Any, Any],
    axis: RangeAxis,
    sweeps: Shaped[Array | np.ndarray, "logs sweeps bins"],
    flags: UInt[Array | np.ndarray, "logs sweeps"],
    dt: Float[Array | np.ndarray, "logs sweeps"],
    lengths: Int[Array | np.ndarray, " logs"],
    fields: tuple[str, ...] = ("range_m", "speed_m_s", "valid", "event"),
) -> dict[str, Array]:
    """`run_batch`, compiled, giving only those `fields` of the `Decision`s: what is not asked for is not computed.

    Aligned NumPy arrays (64 bytes) and memory-mapped files enter as they are, without a copy. The first call for
    each shape compiles. Floats are given out in single precision. Returns before the result is there, as JAX does:
    `jax.block_until_ready` waits for it.
    Raises `ConfigError` for an unknown field.
    """
    known = [field.name for field in dataclasses.fields(Decision)]
    for name in fields:
        if name not in known:
            raise ConfigError(f"unknown field `{name}`{nearest(name, known)}; expected {', '.join(known)}.")
    run_part = partial(_batch_part, tuple(fields), detector, axis)
    inputs = (sweeps, flags, dt, lengths)
    workers = _workers(detector, len(lengths))
    if workers == 1:
        return run_part(*inputs)
    # Going through time is one thread's work: a few logs for each.
    host = [np.asarray(values) for values in inputs]
    ends = [len(lengths) * part // workers for part in range(workers + 1)]
    with ThreadPoolExecutor(workers) as pool:
        parts = pool.map(
            lambda low, high: jax.block_until_ready(run_part(*(values[low:high] for values in host))), ends, ends[1:]
        )
        return {name: jnp.concatenate(one) for name, one in _transposed(list(parts)).items()}


def _batch_part(fields: tuple[str, ...], detector: StepDetector[Any, Any], *arguments: Any) -> dict[str, Array]:
    with precision(detector):
        return _batch(fields, detector, *arguments)


def _workers(detector: StepDetector[Any, Any], logs: int) -> int:
    if not detector.sequential or jax.default_backend() != "cpu":
        return 1
    return max(1, min(len(os.sched_getaffinity(0)), logs // FEWEST_LOGS))


def _transposed(parts: list[dict[str, Array]]) -> dict[str, list[Array]]:
    return {name: [part[name] for part in parts] for name in parts[0]}


def _padded_length(count: int) -> int:
    """The next length of 1, 1.25, 1.5 or 1.75 times a power of two, 64 or more: few programs, little padding."""
    quarter = (1 << (max(count, 64) - 1).bit_length()) // 8
    return -(-max(count, 64) // quarter) * quarter


def detect(detector: StepDetector[Any, Any], series: SensorSeries, motion: Motion | None = None) -> StepTrace:
    """Find the road steps in one series of sweeps.

    `motion` is for detectors that use it; none of the present ones does.
    """
    count, padded = len(series), _padded_length(len(series))
    with precision(detector):
        decisions = _run(
            detector,
            RangeAxis.of(series.range_m),
            np.pad(series.sweeps, ((0, padded - count), (0, 0))),
            np.pad(series.flags, (0, padded - count), constant_values=int(SweepFlag.NO_AMPLITUDES)),
            np.pad(time_steps(series.times_ns), (0, padded - count)),
        )
        host = {
            field.name: np.asarray(getattr(decisions, field.name))[:count] for field in dataclasses.fields(Decision)
        }
    return _trace(detector, series, host)


def _trace(detector: StepDetector[Any, Any], series: SensorSeries, host: dict[str, np.ndarray]) -> StepTrace:
    times_s = series.times_s
    threshold = float(detector.threshold)
    events = tuple(
        StepEvent(
            time_s=float(times_s[i]),
            range_m=float(host["range_m"][i]),
            strength=float(host["strength"][i]),
            statistic=float(host["statistic"][i]),
            threshold=threshold,
            sweep=int(i),
        )
        for i in np.flatnonzero(host["event"])
    )
    valid = host["valid"]
    return StepTrace(
        sensor=series.sensor,
        times_s=times_s,
        range_m=np.where(valid, host["range_m"], np.nan),
        speed_m_s=np.where(valid, host["speed_m_s"], np.nan),
        strength=host["strength"],
        statistic=host["statistic"],
        valid=valid,
        saturated=host["saturated"],
        threshold=threshold,
        statistic_name=detector.statistic_name,
        statistic_unit=detector.statistic_unit,
        events=events,
    )


def thin(series: SensorSeries, bins: int) -> SensorSeries:
    """Every n-th bin as the lab's program keeps them: out[i] = data[len·i // bins] (thesis, appendix C.1, line 243).

    No anti-alias filter, as there. Raises `ConfigError` unless 2 <= bins <= the log's own.
    """
    have = len(series.range_m)
    if not 2 <= bins <= have:
        raise ConfigError(f"cannot thin {have} range bins to {bins}; expected a number from 2 to {have}.")
    kept = have * np.arange(bins) // bins
    return dataclasses.replace(series, sweeps=np.asarray(series.sweeps)[:, kept], range_m=series.range_m[kept])
