"""Peak, metres, |difference|, threshold: the pipeline of the thesis, with any way of finding the peak."""

from __future__ import annotations

from functools import partial
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, UInt

from jaxradar._numerics import finite, largest, nonnegative, packed_largest, reductions, row_major
from jaxradar._settings import choice_setting, setting, shape_setting
from jaxradar._types import Flags, Index, RawSweep, Scalar, Setting, Sweep
from jaxradar.signal.peaks import MatchedFilter, Parabola, Peak, window_at
from jaxradar.signal.soft import soft_position
from jaxradar.systems.step.config import BlockSweeps, RangeAxis, SweepPeak, each_sweep, is_saturated, usable
from jaxradar.systems.step.range_rate_base import RangeRateBase

__all__ = ["RangeRateDetector"]

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
            return self._matched(self.pulse_m / axis.bin_m)(sweep)
        log_gain = self._log_gain(axis)
        if self.peak == "arg-max":
            selected, top = self._select(axis, sweep)
            return Peak(selected.astype(log_gain.dtype), finite(sweep)[selected], top > 0)
        exponent = jnp.asarray(self.exponent, log_gain.dtype)
        position, found = soft_position(sweep, self.temperature, log_gain, exponent)
        return Peak(jnp.where(found, position, 0.0), largest(finite(sweep)), found)

    def _matched(self, pulse_bins: float) -> MatchedFilter:
        return MatchedFilter(pulse_bins)

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
