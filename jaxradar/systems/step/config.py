"""What all step detectors share: settings with bounds, and the two functions `observe` and `track`.

A detector *is* its configuration: an `equinox.Module` whose tunable values are array leaves, so that another value
never recompiles, and whose shapes are static. `observe` looks at ONE sweep and is vmapped over everything; `track` is
the only thing that remembers and is scanned over time. The device runs these two as they are; `follow` does both over
a block of sweeps, for batches and tuning, and decides the same.
"""

from __future__ import annotations

import abc
from collections.abc import Callable
from functools import partial
from typing import Any, ClassVar, Generic, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Shaped, UInt

from jaxradar._settings import Settings
from jaxradar._types import Counts, Flag, Flags, RangeBins, RawSweep, Scalar, Setting, Sweep
from jaxradar.drive import SweepFlag

__all__ = [
    "BlockSweeps",
    "Decision",
    "MotionSample",
    "RangeAxis",
    "StepDetector",
    "SweepPeak",
    "each_sweep",
    "is_saturated",
    "usable",
]


def usable(flags: UInt[Array | np.ndarray, "*shape"]) -> Bool[Array | np.ndarray, "*shape"]:
    """Whether neither the sensor nor the reader says that this sweep holds no data."""
    return (flags & int(SweepFlag.INVALID)) == 0


def is_saturated(flags: UInt[Array | np.ndarray, "*shape"]) -> Bool[Array | np.ndarray, "*shape"]:
    """Whether the sensor or the reader says that this sweep reached full scale."""
    return (flags & int(SweepFlag.SATURATED)) != 0


class RangeAxis(eqx.Module):
    """The slant range of each bin in metres, and the bins' distance to three digits for what sets a shape."""

    range_m: RangeBins
    bin_m: float = eqx.field(static=True)

    @classmethod
    def of(cls, range_m: np.ndarray) -> RangeAxis:
        """From a log's own axis, (bins,) float64. Rounded, so that two logs of one sensor share one program."""
        spacing = (range_m[-1] - range_m[0]) / (len(range_m) - 1)
        return cls(np.asarray(range_m, np.float64), float(f"{spacing:.3g}"))

    @property
    def bins(self) -> int:
        return int(self.range_m.shape[0])

    def at(self, position: Scalar) -> Scalar:
        """Slant range in metres at a position in bins, which may have a fraction."""
        whole = jnp.clip(jnp.floor(position).astype(jnp.int32), 0, self.bins - 2)
        axis = jnp.asarray(self.range_m)
        return axis[whole] + (position - whole) * (axis[whole + 1] - axis[whole])

    def averaged(self, values: Sweep, bins: int) -> Counts:
        """The means over cells of so many bins, from the first on; what is left over at the end is left out."""
        count = self.bins // bins
        # Summed before it is divided: whole counts add up exactly, so that equal cells are equal on every machine.
        whole = values[: count * bins].astype(jnp.result_type(float)).reshape(count, bins)
        return jnp.sum(whole, axis=1) * (1.0 / bins)


Numbers = Float[Array | np.ndarray, "*sweeps"]
Truths = Bool[Array | np.ndarray, "*sweeps"]


class MotionSample(eqx.Module):
    """The car's motion at one sweep, or at many, each quantity with a flag that says whether it is known, and 0 where
    it is not. Acceleration is the body's vertical one, speed is positive forwards, yaw rate to the left."""

    acceleration_m_s2: Numbers
    yaw_rate_rad_s: Numbers
    speed_m_s: Numbers
    acceleration_known: Truths
    yaw_rate_known: Truths
    speed_known: Truths


class Decision(eqx.Module):
    """What a detector says of one sweep; the fields are those of `StepTrace`, `event` is a detection.

    Nothing here is ever NaN: where `valid` is false, the range is the last one known, `strength` may be that of what
    was not taken for an echo, and the rest is 0.
    `impact_in_s`: until a front wheel touches what is coming, 0 of a detector that does not know.
    """

    range_m: Scalar
    speed_m_s: Scalar
    strength: Scalar
    statistic: Scalar
    impact_in_s: Scalar
    valid: Flag
    saturated: Flag
    event: Flag


class SweepPeak(eqx.Module):
    """The strongest echo of one sweep: slant range in metres, amplitude in counts."""

    range_m: Scalar
    strength: Scalar
    valid: Flag
    saturated: Flag


def each_sweep(function: Callable[..., Any]) -> Callable[..., Any]:
    """`function` of one sweep over arrays of shape (logs, sweeps, ...)."""
    return jax.vmap(jax.vmap(function))


# The recorded sweeps of a block, cut out of the batch where they are read.
BlockSweeps = Callable[[], Shaped[Array, "logs sweeps bins"]]
Observed = TypeVar("Observed")
State = TypeVar("State")


class StepDetector(Settings, Generic[Observed, State]):
    """Base of all step detectors.

    `float64`: whether the detector must run in double precision to choose as its document does.
    `theory`: what its class method `from_false_alarm_rate` derives the threshold from; empty of one without.
    `sequential`: whether `follow` goes through time step by step, and so wants many logs side by side.
    `merged`: whether sweeps above the threshold that follow each other are one detection.
    `uses_motion`: whether it looks at the car's motion; where not, none is resampled nor handed to it.
    """

    name: ClassVar[str]
    statistic_name: ClassVar[str]
    statistic_unit: ClassVar[str]
    float64: ClassVar[bool] = False
    theory: ClassVar[str] = ""
    sequential: ClassVar[bool] = True
    merged: ClassVar[bool] = True
    uses_motion: ClassVar[bool] = False

    @property
    @abc.abstractmethod
    def threshold(self) -> Setting:
        """What the statistic is compared with."""

    @abc.abstractmethod
    def with_threshold(self, value: float) -> StepDetector[Observed, State]:
        """The same detector with another threshold, or the nearest that it can have, and what hangs on it."""

    @abc.abstractmethod
    def observe(self, axis: RangeAxis, sweep: RawSweep, flags: Flags) -> Observed:
        """Look at one sweep: (bins,) counts and its `SweepFlag`s. Pure; vmapped over sweeps and logs."""

    @abc.abstractmethod
    def init(self, axis: RangeAxis) -> State:
        """The state before the first sweep."""

    @abc.abstractmethod
    def track(
        self, axis: RangeAxis, state: State, observation: Observed, motion: MotionSample | None, dt: Scalar
    ) -> tuple[State, Decision]:
        """Decide on one sweep. `dt`: seconds since the sweep before, valid or not, differenced on the host."""

    def follow(
        self,
        axis: RangeAxis,
        state: State,
        sweeps: BlockSweeps,
        flags: UInt[Array, "logs sweeps"],
        dt: Float[Array, "logs sweeps"],
        motion: MotionSample | None = None,
    ) -> tuple[State, Decision]:
        """`observe` and `track` over a block: a state for each log, decisions of shape (logs, sweeps).

        `sweeps()` cuts the block out of the batch where it is read, so that it is not copied first. `motion`: fields of
        shape (logs, sweeps), None where none is known. A detector may write this otherwise where that is faster, with
        the same decisions.
        """
        observations = each_sweep(partial(self.observe, axis))(sweeps(), flags)
        return self.scan(axis, state, observations, dt, motion)

    def scan(
        self,
        axis: RangeAxis,
        state: State,
        observations: Observed,
        dt: Float[Array, "logs sweeps"],
        motion: MotionSample | None = None,
    ) -> tuple[State, Decision]:
        """`track` over observations of shape (logs, sweeps), one after the other."""

        def step(state: State, inputs: tuple[Observed, Scalar, MotionSample | None]) -> tuple[State, Decision]:
            observation, elapsed, moved = inputs
            return self.track(axis, state, observation, moved, elapsed)

        return jax.vmap(lambda *one: jax.lax.scan(step, one[0], one[1:]))(state, observations, dt, motion)
