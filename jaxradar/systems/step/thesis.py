"""The thesis's rule as it is printed (section 5.2, figure 5.5), the reference to compare others with."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from jaxradar._numerics import finite, first_argmax
from jaxradar._types import Flag, Flags, RawSweep, Scalar, Setting
from jaxradar.systems.step.config import Decision, MotionSample, RangeAxis, StepDetector, is_saturated, setting, usable

__all__ = ["SweepPeak", "ThesisDetector", "ThesisState"]


class SweepPeak(eqx.Module):
    """The strongest bin of one sweep: slant range in metres, amplitude in counts."""

    range_m: Scalar
    strength: Scalar
    valid: Flag
    saturated: Flag


class ThesisState(eqx.Module):
    """The last valid sweep's range, the time since then, and whether there was one."""

    range_m: Scalar
    elapsed_s: Scalar
    seen: Flag


class ThesisDetector(StepDetector[SweepPeak, ThesisState]):
    """Compensate, take the peak, metres, |derivative|, threshold: stages 2 to 6 of figure 5.5.

    Each amplitude is multiplied by (2r)^exponent, with the thesis's exponent 2: thesis, appendix B.2. The first of
    equal maxima wins. A detection is |Δr|/Δt > threshold, strictly ("exceeds", section 6.1), between a valid sweep and
    the last valid one before it at the recorded times; Δt <= 0 gives none; each is its own detection, nothing is
    merged. A sweep of zeros, or without data, is skipped. All in float64, so that near-ties fall as MATLAB's would.
    """

    name: ClassVar[str] = "thesis"
    statistic_name: ClassVar[str] = "|range rate|"
    statistic_unit: ClassVar[str] = "m/s"
    float64: ClassVar[bool] = True

    threshold_m_s: Setting = setting(0.7, 0.0, 1e3, "m/s", "a range rate above this is a step (thesis, section 6.1)")
    exponent: Setting = setting(2.0, 0.0, 6.0, "", "amplitudes are multiplied by (2r)^exponent (thesis, B.2)")

    @property
    def threshold(self) -> Setting:
        return self.threshold_m_s

    def observe(self, axis: RangeAxis, sweep: RawSweep, flags: Flags) -> SweepPeak:
        amplitudes = finite(sweep)
        round_trip = 2.0 * jnp.asarray(axis.range_m)
        # The compiler's power is off by its last digit now and then; the thesis's own square is a product.
        weights = jnp.where(self.exponent == 2.0, round_trip * round_trip, round_trip**self.exponent)
        peak = first_argmax(amplitudes * weights)
        return SweepPeak(
            range_m=jnp.asarray(axis.range_m)[peak],
            strength=amplitudes[peak],
            valid=usable(flags) & (amplitudes[peak] > 0),
            saturated=is_saturated(flags),
        )

    def init(self, axis: RangeAxis) -> ThesisState:
        return ThesisState(jnp.zeros(()), jnp.zeros(()), jnp.zeros((), bool))

    def track(
        self, state: ThesisState, observation: SweepPeak, motion: MotionSample | None, dt: Scalar
    ) -> tuple[ThesisState, Decision]:
        elapsed = state.elapsed_s + dt
        known = observation.valid & state.seen & (elapsed > 0)
        # The divisor is guarded, so that a gradient through a sweep at Δt = 0 is 0 and not NaN.
        speed = jnp.where(known, (observation.range_m - state.range_m) / jnp.where(known, elapsed, 1.0), 0.0)
        statistic = jnp.abs(speed)
        after = ThesisState(
            range_m=jnp.where(observation.valid, observation.range_m, state.range_m),
            elapsed_s=jnp.where(observation.valid, 0.0, elapsed),
            seen=state.seen | observation.valid,
        )
        return after, Decision(
            range_m=after.range_m,
            speed_m_s=speed,
            strength=observation.strength,
            statistic=statistic,
            valid=observation.valid,
            saturated=observation.saturated,
            event=known & (statistic > self.threshold_m_s),
        )
