"""A compiled program held against JAX, sweep by sweep."""

from __future__ import annotations

import jax
import numpy as np

from jaxradar._numerics import reductions
from jaxradar.drive import FULL_SCALE, SweepFlag
from jaxradar.live.program import Program
from jaxradar.systems.step import precision
from jaxradar.systems.step.packed import DECISION_FIELDS, PackedStep

__all__ = ["check_sweeps", "differing", "reference"]

SWEEPS = 600  # made, and as many of a sample
RATE_HZ = 300.0
TOLERANCE = 1e-4


def check_sweeps(step: PackedStep, sample: np.ndarray | None, seed: int = 0) -> np.ndarray:
    """(sweeps, inputs): an echo that stands, wanders, jumps, closes in, fades and saturates in speckle and noise, with
    gaps, missed sweeps and silence among them; then the sample."""
    random = np.random.default_rng(seed)
    range_m = np.asarray(step.axis.range_m)
    span = range_m[-1] - range_m[0]
    time_s = np.arange(SWEEPS) / RATE_HZ
    place = range_m[0] + span * (0.5 + 0.02 * np.sin(9.0 * time_s) + np.where(time_s % 0.7 > 0.35, 0.08, 0.0))
    closing = range_m[0] + span * (1.0 - (time_s * 1.7) % 1.0)
    strength = 3000.0 * (0.5 + 0.5 * np.cos(5.0 * time_s)) ** 2

    def echo(at: np.ndarray) -> np.ndarray:
        return np.exp(-0.5 * ((range_m - at[:, None]) / 0.025) ** 2)

    speckle = np.abs(random.normal(size=(SWEEPS, len(range_m))) + 1j * random.normal(size=(SWEEPS, len(range_m))))
    made = strength[:, None] * echo(place) + 900.0 * echo(closing) + 60.0 * speckle
    made[200:215] *= 100.0  # saturates
    made[300:306] = 0.0
    made = np.minimum(np.round(made), FULL_SCALE)
    inputs = np.zeros((SWEEPS, step.inputs))
    inputs[:, : len(range_m)] = made
    inputs[200:215, len(range_m)] = SweepFlag.SATURATED
    inputs[400:404, len(range_m)] = SweepFlag.MISSED_DATA
    inputs[1:, len(range_m) + 1] = 1.0 / RATE_HZ
    inputs[450, len(range_m) + 1] = 0.5
    inputs[500, len(range_m) + 1] = 0.0
    if step.motion:
        inputs[:, len(range_m) + 2 :] = random.random((SWEEPS, len(step.motion))) > 0.3
    if sample is not None and len(sample):
        more = np.zeros((min(len(sample), SWEEPS), step.inputs))
        more[:, : len(range_m)] = sample[:SWEEPS]
        more[1:, len(range_m) + 1] = 1.0 / RATE_HZ
        inputs = np.concatenate([inputs, more])
    with np.errstate(over="ignore"):  # of a sample that no 32 bits hold
        return inputs.astype(step.dtype)


def reference(step: PackedStep, inputs: np.ndarray) -> np.ndarray:
    """(sweeps, decision): what JAX makes of them, in the form that is compiled."""
    with precision(step.detector), reductions("plain"):
        return np.asarray(
            jax.jit(lambda state, rows: jax.lax.scan(lambda *one: step(*one), state, rows)[1])(step.initial(), inputs)
        )


def differing(step: PackedStep, program: bytes, inputs: np.ndarray, expected: np.ndarray) -> float:
    """The share of sweeps of which a compiled program says something else than `expected`: another number by
    more than `TOLERANCE` of the largest of its kind. 1 where a flag or a detection differs, or a number is none."""
    run = Program(program, step.initial(), step.inputs, len(DECISION_FIELDS))
    found = np.empty_like(expected)
    for place, row in enumerate(inputs):
        run.inputs[:] = row
        found[place] = run.run()
    flags = [DECISION_FIELDS.index(name) for name in ("valid", "saturated", "event")]
    if not np.isfinite(found).all() or not np.array_equal(found[:, flags], expected[:, flags]):
        return 1.0
    compared = [place for place in range(len(DECISION_FIELDS)) if place not in flags]
    scale = np.maximum(np.abs(expected[:, compared]).max(axis=0), 1e-9)
    return float((np.abs(found - expected)[:, compared] > TOLERANCE * scale).any(axis=1).mean())
