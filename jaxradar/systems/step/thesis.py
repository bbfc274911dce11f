"""The thesis's rule as it is printed (section 5.2, figure 5.5), the reference to compare others with."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp

from jaxradar._numerics import finite, nonnegative, packed_largest
from jaxradar._types import Flags, RawSweep
from jaxradar.systems.step.config import RangeAxis, SweepPeak, is_saturated, usable
from jaxradar.systems.step.range_rate_base import RangeRateBase

__all__ = ["ThesisDetector"]


class ThesisDetector(RangeRateBase):
    """Compensate, take the peak, metres, |derivative|, threshold: stages 2 to 6 of figure 5.5.

    Each amplitude is multiplied by (2r)^exponent, with the thesis's exponent 2: thesis, appendix B.2. The first of
    equal maxima wins. A detection is |Δr|/Δt > threshold, strictly ("exceeds", section 6.1), between a valid sweep and
    the last valid one before it at the recorded times; Δt <= 0 gives none; each is its own detection, nothing is
    merged. A sweep without an amplitude above 0 beyond range 0, or without data, is skipped. All in float64, as in
    MATLAB; but products that agree in all but their last log2(bins) bits count as equal.
    """

    name: ClassVar[str] = "thesis"
    float64: ClassVar[bool] = True

    def observe(self, axis: RangeAxis, sweep: RawSweep, flags: Flags) -> SweepPeak:
        round_trip = 2.0 * jnp.asarray(axis.range_m)
        # The compiler's power is off by its last digit now and then; the thesis's own square is a product.
        weights = jnp.where(self.exponent == 2.0, round_trip * round_trip, round_trip**self.exponent)
        peak, compensated = packed_largest(sweep, weights, of=lambda counts, weight: nonnegative(counts) * weight)
        return SweepPeak(
            range_m=jnp.asarray(axis.range_m)[peak],
            strength=finite(sweep)[peak],
            valid=usable(flags) & (compensated > 0),
            saturated=is_saturated(flags),
        )
