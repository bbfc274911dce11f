"""What remembers: ranges of single sweeps to a range rate, by a difference or a short filter, and a threshold."""

from __future__ import annotations

import math
from functools import partial
from typing import Any, ClassVar, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, UInt

from jaxradar._numerics import written_out
from jaxradar._settings import bounded, setting
from jaxradar._types import Flag, Scalar, Setting
from jaxradar.systems.step.config import (
    BlockSweeps,
    Decision,
    MotionSample,
    RangeAxis,
    StepDetector,
    SweepPeak,
    each_sweep,
)

__all__ = ["RangeRateBase", "RangeRateState"]


Kind = TypeVar("Kind", bound="RangeRateBase")


class RangeRateState(eqx.Module):
    """The last valid sweep's range, the time since then, and whether there was one; and, newest first, the differences
    up to it that a filter weighs, with the times that they took, both 0 of those that are not known."""

    range_m: Scalar
    elapsed_s: Scalar
    seen: Flag
    rises_m: Float[Array, " before"]
    waits_s: Float[Array, " before"]


class RangeRateBase(StepDetector[SweepPeak, RangeRateState]):
    """What remembers: the difference to the last valid sweep before, over the recorded time between the two.

    With a filter of weights w, the weighted mean of the last differences over that of their times,
    (Δr[n] + Σ w[k] Δr[n−1−k]) / (Δt[n] + Σ w[k] Δt[n−1−k]): any filter over ranges that is silent on a constant is such
    a sum, and of a ramp this gives the slope, at whatever times it was sampled. Differences from before a series, or
    across Δt <= 0, are left out of both sums; where the lower one is not above 0, the rate is 0.
    """

    statistic_name: ClassVar[str] = "|range rate|"
    statistic_unit: ClassVar[str] = "m/s"
    theory: ClassVar[str] = "false alarms of |difference of two sweeps| in Gaussian noise of the range"
    sequential: ClassVar[bool] = False
    merged: ClassVar[bool] = False

    threshold_m_s: Setting = setting(0.7, 0.0, 1e3, "m/s", "a range rate above this is a step (thesis, section 6.1)")
    exponent: Setting = setting(2.0, 0.0, 6.0, "", "amplitudes are multiplied by (2r)^exponent (thesis, B.2)")

    @property
    def threshold(self) -> Setting:
        return self.threshold_m_s

    def with_threshold(self, value: float) -> RangeRateBase:
        return bounded(self, threshold_m_s=value)

    @classmethod
    def from_false_alarm_rate(
        cls: type[Kind],
        per_hour: float = 1.0,
        *,
        rate_hz: float,
        sd_m: float,
        correlation: float = 0.0,
        **settings: Any,
    ) -> Kind:
        """With the threshold from theory: so many false alarms an hour, each sweep above it counted, where nothing
        moves (`estimate.detection.difference_threshold`, in m/s).

        `sd_m`: standard deviation of the range of a single sweep, in metres, `correlation`: that of neighbouring
        sweeps (`estimate.detection.fit_noise` finds both). Assumes Gaussian noise, every sweep valid at an even rate,
        and ranges much finer than it: on a grid of bins as coarse as the noise, every change of bin is a jump by a
        bin. Checked at one alarm in 10, 30 and 100 sweeps. Raises `ValueError` for what no threshold answers, and for
        one that lies outside the bounds of `threshold_m_s`.
        """
        from jaxradar.estimate.detection import difference_threshold  # SciPy takes long to import

        if "threshold_m_s" in settings:
            raise ValueError("`threshold_m_s` follows from the rate of false alarms; leave it out.")
        if not 0 < sd_m < math.inf:
            raise ValueError(f"`sd_m` must be above 0 and finite; got {sd_m}.")
        if not -1.0 < correlation < 1.0:
            raise ValueError(f"`correlation` must be between -1 and 1, both excluded; got {correlation}.")
        threshold = difference_threshold(per_hour, sd_m, rate_hz, correlation) * rate_hz
        return cls(threshold_m_s=threshold, **settings)

    def _weights(self) -> Float[Array | np.ndarray, " before"]:
        """Of the differences before the newest, which weighs 1."""
        return np.zeros(0)

    def init(self, axis: RangeAxis) -> RangeRateState:
        before = jnp.zeros(self._weights().shape)
        return RangeRateState(jnp.zeros(()), jnp.zeros(()), jnp.zeros((), bool), before, before)

    def track(
        self, axis: RangeAxis, state: RangeRateState, observation: SweepPeak, motion: MotionSample | None, dt: Scalar
    ) -> tuple[RangeRateState, Decision]:
        elapsed = state.elapsed_s + dt
        weights = jnp.asarray(self._weights(), state.rises_m.dtype)
        earlier = (jnp.sum(weights * state.rises_m), jnp.sum(weights * state.waits_s)) if weights.size else None
        decision = self._decide(observation, state.range_m, elapsed, state.seen, earlier)
        now = _difference(observation, state.range_m, elapsed, state.seen)
        pushed = (
            jnp.where(observation.valid, jnp.append(one, held)[: held.size], held)
            for one, held in zip(now, (state.rises_m, state.waits_s), strict=True)
        )
        after = RangeRateState(
            decision.range_m,
            jnp.where(observation.valid, 0.0, elapsed),
            state.seen | observation.valid,
            *pushed,
        )
        return after, decision

    def follow(
        self,
        axis: RangeAxis,
        state: RangeRateState,
        sweeps: BlockSweeps,
        flags: UInt[Array, "logs sweeps"],
        dt: Float[Array, "logs sweeps"],
        motion: MotionSample | None = None,
    ) -> tuple[RangeRateState, Decision]:
        observations = self._observe_all(axis, sweeps, flags)
        valid = observations.valid

        def gapless() -> tuple[RangeRateState, Decision]:
            first = jnp.arange(dt.shape[1]) == 0
            count = jnp.sum(valid, axis=1, dtype=jnp.int32)
            last = jnp.take_along_axis(observations.range_m, jnp.maximum(count - 1, 0)[:, None], axis=1)[:, 0]
            last = jnp.where(count > 0, last, state.range_m)
            # A padded slice stays in the loop of what is made of it; a concatenation is written out.
            before = jnp.pad(observations.range_m[:, :-1], ((0, 0), (1, 0)))
            before = jnp.where(jnp.arange(dt.shape[1]) <= count[:, None], before, last[:, None])
            before = jnp.where(first, state.range_m[:, None], before)
            elapsed = jnp.where(first, dt + state.elapsed_s[:, None], dt)
            seen = ~first | state.seen[:, None]
            earlier, *held = self._filtered(state, count, *each_sweep(_difference)(observations, before, elapsed, seen))
            decision = each_sweep(self._decide)(observations, before, elapsed, seen, earlier)
            waited = jnp.sum(jnp.where(valid, 0.0, dt), axis=1) + jnp.where(count > 0, 0.0, state.elapsed_s)
            return jax.vmap(RangeRateState)(last, waited, state.seen | (count > 0), *held), decision

        def with_gaps() -> tuple[RangeRateState, Decision]:
            return self.scan(axis, state, observations, dt)

        # Where every sweep is valid, up to where a series ends, the sweep before is the last valid one, and nothing
        # has to wait for another.
        return jax.lax.cond(jnp.all(valid[:, :-1] | ~valid[:, 1:]), gapless, with_gaps)

    def _filtered(self, state: RangeRateState, count: Array, *now: Array) -> tuple[Any, Array, Array]:
        """Of a block without gaps, whose first `count` sweeps are valid: what the differences before each sweep add to
        its rise and its wait, both (logs, sweeps), and what the next block is to know of `now`, the block's own."""
        weights = jnp.asarray(self._weights(), state.rises_m.dtype)
        if not weights.size:
            return None, state.rises_m, state.waits_s
        sums, held = [], []
        for before, one in zip((state.rises_m, state.waits_s), now, strict=True):
            line = jnp.concatenate([before[:, ::-1], one], axis=1)
            first, sweeps = weights.size - 1, one.shape[1]
            sums.append(sum(weights[k] * line[:, first - k : first - k + sweeps] for k in range(weights.size)))
            held.append(jnp.take_along_axis(line, count[:, None] + jnp.arange(weights.size)[::-1], axis=1))
        return tuple(sums), held[0], held[1]

    def _observe_all(
        self,
        axis: RangeAxis,
        sweeps: BlockSweeps,
        flags: UInt[Array, "logs sweeps"],
    ) -> SweepPeak:
        return each_sweep(partial(self.observe, axis))(sweeps(), flags)

    def _decide(
        self, now: SweepPeak, before_m: Scalar, elapsed: Scalar, seen: Flag, earlier: tuple[Scalar, Scalar] | None
    ) -> Decision:
        known = now.valid & seen & (elapsed > 0)
        rise = now.range_m - before_m
        if earlier is not None:
            rise, elapsed = rise + earlier[0], elapsed + earlier[1]
            known = known & (elapsed > 0)
        # The divisor is guarded, so that a gradient through a sweep at Δt = 0 is 0 and not NaN.
        speed = jnp.where(known, rise / jnp.where(known, elapsed, 1.0), 0.0)
        # What several outputs are made of is computed once: the compiler would put it into the loop of each of them.
        speed = written_out(speed)
        statistic = jnp.abs(speed)
        return Decision(
            range_m=jnp.where(now.valid, now.range_m, before_m),
            speed_m_s=speed,
            strength=now.strength,
            statistic=statistic,
            impact_in_s=jnp.zeros_like(speed),
            valid=now.valid,
            saturated=now.saturated,
            event=known & (statistic > self.threshold_m_s),
        )


def _difference(now: SweepPeak, before_m: Scalar, elapsed: Scalar, seen: Flag) -> tuple[Array, Array]:
    """To the last valid sweep: in metres and in seconds, both 0 where it is not known."""
    known = now.valid & seen & (elapsed > 0)
    return jnp.where(known, now.range_m - before_m, 0.0), jnp.where(known, elapsed, 0.0)
