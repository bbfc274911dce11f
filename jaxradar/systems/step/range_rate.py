"""Peak, metres, |difference|, threshold: the pipeline of the thesis, with any way of finding the peak."""

from __future__ import annotations

import math
from functools import partial
from typing import Any, ClassVar, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, UInt

from jaxradar._numerics import finite, largest, nonnegative, packed_largest, reductions, row_major
from jaxradar._settings import bounded, choice_setting, setting, shape_setting
from jaxradar._types import Flag, Flags, Index, RawSweep, Scalar, Setting, Sweep
from jaxradar.signal.peaks import MatchedFilter, Parabola, Peak, window_at
from jaxradar.signal.soft import soft_position
from jaxradar.systems.step.config import (
    BlockSweeps,
    Decision,
    MotionSample,
    RangeAxis,
    StepDetector,
    SweepPeak,
    each_sweep,
    is_saturated,
    usable,
)

__all__ = ["RangeRateBase", "RangeRateDetector", "RangeRateState"]


Kind = TypeVar("Kind", bound="RangeRateBase")


class RangeRateState(eqx.Module):
    """The last valid sweep's range, the time since then, and whether there was one."""

    range_m: Scalar
    elapsed_s: Scalar
    seen: Flag


class RangeRateBase(StepDetector[SweepPeak, RangeRateState]):
    """What remembers: the difference to the last valid sweep before, over the recorded time between the two."""

    statistic_name: ClassVar[str] = "|range rate|"
    statistic_unit: ClassVar[str] = "m/s"
    sequential: ClassVar[bool] = False

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

    def init(self, axis: RangeAxis) -> RangeRateState:
        return RangeRateState(jnp.zeros(()), jnp.zeros(()), jnp.zeros((), bool))

    def track(
        self, axis: RangeAxis, state: RangeRateState, observation: SweepPeak, motion: MotionSample | None, dt: Scalar
    ) -> tuple[RangeRateState, Decision]:
        elapsed = state.elapsed_s + dt
        decision = self._decide(observation, state.range_m, elapsed, state.seen)
        after = RangeRateState(
            range_m=decision.range_m,
            elapsed_s=jnp.where(observation.valid, 0.0, elapsed),
            seen=state.seen | observation.valid,
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
            decision = jax.vmap(jax.vmap(self._decide))(observations, before, elapsed, seen)
            waited = jnp.sum(jnp.where(valid, 0.0, dt), axis=1) + jnp.where(count > 0, 0.0, state.elapsed_s)
            return jax.vmap(RangeRateState)(last, waited, state.seen | (count > 0)), decision

        def with_gaps() -> tuple[RangeRateState, Decision]:
            return self.scan(axis, state, observations, dt)

        # Where every sweep is valid, up to where a series ends, the sweep before is the last valid one, and nothing
        # has to wait for another.
        return jax.lax.cond(jnp.all(valid[:, :-1] | ~valid[:, 1:]), gapless, with_gaps)

    def _observe_all(
        self,
        axis: RangeAxis,
        sweeps: BlockSweeps,
        flags: UInt[Array, "logs sweeps"],
    ) -> SweepPeak:
        return each_sweep(partial(self.observe, axis))(sweeps(), flags)

    def _decide(self, now: SweepPeak, before_m: Scalar, elapsed: Scalar, seen: Flag) -> Decision:
        known = now.valid & seen & (elapsed > 0)
        # The divisor is guarded, so that a gradient through a sweep at Δt = 0 is 0 and not NaN.
        speed = jnp.where(known, (now.range_m - before_m) / jnp.where(known, elapsed, 1.0), 0.0)
        # What several outputs are made of is computed once: the compiler would put it into the loop of each of them.
        speed = jax.lax.optimization_barrier(speed)
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


PEAKS = ("arg-max", "parabola", "soft-argmax", "soft-argmax over all bins", "matched filter")


class RangeRateDetector(RangeRateBase):
    """Compensate, find the peak between the bins, metres, |derivative|, threshold.

    The echo is selected on amplitudes times (2r)^exponent, the first of equal maxima. From there `peak` finds the
    place between the bins, on the amplitudes as recorded unless `refine_compensated` (which moves an echo outwards:
    by 1 mm where an echo is 4 cm wide). `soft-argmax over all bins` selects nothing: it is the mean over all
    compensated bins; `matched filter` looks for a Gaussian of `pulse_m` in all amplitudes as recorded.
    A detection is |Δr|/Δt > threshold between a valid sweep and the last valid one before it, as in `ThesisDetector`.
    """

    name: ClassVar[str] = "range-rate"

    temperature: Setting = setting(0.1, 1e-3, 10.0, "", "of the soft-argmax, as a share of the largest amplitude")
    peak: str = choice_setting("soft-argmax", PEAKS, "how the place of the echo between the bins is found")
    window_m: float = shape_setting(0.045, 1e-4, 10.0, "m", "width of what the parabola and the soft-argmax look at")
    pulse_m: float = shape_setting(0.04, 1e-3, 1.0, "m", "full width of an echo at half its height")
    refine_compensated: bool = shape_setting(False, 0, 1, "", "refine on compensated amplitudes, not on raw ones")

    def observe(self, axis: RangeAxis, sweep: RawSweep, flags: Flags) -> SweepPeak:
        if not self._windowed:
            return self._observed(axis, self._unwindowed(axis, sweep), flags)
        selected, _ = self._select(axis, sweep)
        return self._observed(axis, self._refine(selected, *self._read(axis, sweep, selected)), flags)

    def _observe_all(
        self,
        axis: RangeAxis,
        sweeps: BlockSweeps,
        flags: UInt[Array, "logs sweeps"],
    ) -> SweepPeak:
        if not self._windowed:
            return super()._observe_all(axis, sweeps, flags)
        selected, _ = each_sweep(partial(self._select, axis))(sweeps())
        start, *taps = each_sweep(partial(self._read, axis))(sweeps(), selected)
        # The few taps of all sweeps side by side: they fill the processor's registers, whatever their number is.
        taps = [row_major(jnp.moveaxis(row_major(one), -1, 1)) for one in taps]
        with reductions("plain"):
            refine = jax.vmap(jax.vmap(self._refine, in_axes=-1))
            return each_sweep(partial(self._observed, axis))(refine(selected, start, *taps), flags)

    @property
    def _windowed(self) -> bool:
        return self.peak in ("parabola", "soft-argmax")

    def _half_width(self, axis: RangeAxis) -> int:
        return min(max(1, round(0.5 * self.window_m / axis.bin_m)), (axis.bins - 1) // 2)

    def _log_gain(self, axis: RangeAxis) -> Sweep:
        return jnp.log(2.0 * jnp.maximum(jnp.asarray(axis.range_m), 1e-6))

    def _select(self, axis: RangeAxis, sweep: RawSweep) -> tuple[Index, Scalar]:
        """The bin of the largest compensated amplitude, and that."""
        gain = jnp.exp(jnp.asarray(self.exponent, float) * self._log_gain(axis))
        # In double the product of a 16-bit count and a single-precision gain is exact, with room for the index.
        with jax.enable_x64(True):
            selected, top = packed_largest(
                sweep, gain.astype(jnp.float64), of=lambda counts, one: nonnegative(counts) * one
            )
            return selected, top.astype(gain.dtype)

    def _unwindowed(self, axis: RangeAxis, sweep: RawSweep) -> Peak:
        if self.peak == "matched filter":
            return MatchedFilter(self.pulse_m / axis.bin_m)(sweep)
        log_gain = self._log_gain(axis)
        if self.peak == "arg-max":
            selected, top = self._select(axis, sweep)
            return Peak(selected.astype(log_gain.dtype), finite(sweep)[selected], top > 0)
        exponent = jnp.asarray(self.exponent, log_gain.dtype)
        position, found = soft_position(sweep, self.temperature, log_gain, exponent)
        return Peak(jnp.where(found, position, 0.0), largest(finite(sweep)), found)

    def _read(self, axis: RangeAxis, sweep: RawSweep, selected: Index) -> tuple[Any, ...]:
        """The first bin of the window, the amplitudes in it, and the logarithms of what they are multiplied by."""
        start, taps = window_at(sweep, selected, self._half_width(axis))
        if not self.refine_compensated:
            return start, taps
        return start, taps, window_at(self._log_gain(axis), selected, self._half_width(axis))[1]

    def _refine(self, selected: Index, start: Index, taps: RawSweep, log_gain: Sweep | None = None) -> Peak:
        values = finite(taps)
        amplitude = largest(values)
        found = amplitude > 0
        exponent = jnp.asarray(self.exponent, values.dtype)
        if self.peak == "soft-argmax":
            position = start + soft_position(values, self.temperature, log_gain, exponent)[0]
        else:
            weighted = values if log_gain is None else values * jnp.exp(exponent * log_gain)
            position = Parabola.through(weighted, selected - start) + start
        return Peak(jnp.where(found, position, 0.0), amplitude, found)

    def _observed(self, axis: RangeAxis, peak: Peak, flags: Flags) -> SweepPeak:
        return SweepPeak(
            range_m=axis.at(peak.position),
            strength=peak.amplitude,
            valid=usable(flags) & peak.found,
            saturated=is_saturated(flags),
        )
