"""Where the largest echo of a sweep lies: several estimators, one signature.

Each is a small module that is called with one sweep and, if the peak was selected elsewhere, the bin to look around.
Positions count in bins from 0 and may have a fraction. NaN and infinite bins are left out; a sweep without any
amplitude above 0 gives `found = False` and position 0, with gradient 0.
"""

from __future__ import annotations

import abc
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Shaped

from jaxradar._numerics import as_scalar, finite, first_argmax, first_largest, largest, safe_divide, smallest, total
from jaxradar._types import Flag, Index, RawSweep, Scalar, Setting, Sweep
from jaxradar.signal.pulses import SIGMA_PER_FWHM, gaussian_pulse
from jaxradar.signal.soft import soft_position

__all__ = [
    "ArgMax",
    "MatchedFilter",
    "Parabola",
    "Peak",
    "PeakEstimator",
    "SoftArgmax",
    "WindowEstimator",
    "vertex",
    "window_at",
]


REACH = 1.5  # of a pulse's width at half its height to either side: beyond, it is below 0.2 %


class Peak(eqx.Module):
    """`position` in bins, `amplitude` of the largest bin in counts, `found` or not."""

    position: Scalar
    amplitude: Scalar
    found: Flag


class PeakEstimator(eqx.Module):
    """One way of finding a peak."""

    @abc.abstractmethod
    def __call__(self, sweep: RawSweep, near: Index | None = None) -> Peak:
        """Find the peak of `sweep`, a vector of amplitudes over range bins.

        `near` is the bin to look around, the largest of the sweep (the first of equals) if not given.
        """


class WindowEstimator(PeakEstimator):
    """Looks at `half_width` bins to either side of `near`, at all bins if it is None.

    At the ends the window is moved inwards, not cut.
    """

    half_width: eqx.AbstractVar[int | None]

    def __call__(self, sweep: RawSweep, near: Index | None = None) -> Peak:
        start, window = jnp.int32(0), sweep
        if self.half_width is not None and 2 * self.half_width + 1 < sweep.shape[0]:
            centre = first_argmax(finite(sweep)) if near is None else near
            start, window = window_at(sweep, centre, self.half_width)
        window = finite(window)
        amplitude = largest(window)
        found = amplitude > 0
        inside = self.locate(jnp.where(found, window, jnp.zeros_like(window)))
        return Peak(jnp.where(found, start + inside, 0.0), amplitude, found)

    @abc.abstractmethod
    def locate(self, window: Sweep) -> Scalar:
        """Position in bins from the start of `window`, which holds finite values only."""


def window_at(sweep: RawSweep, centre: Index, half_width: int) -> tuple[Index, Shaped[Array, " taps"]]:
    """The window as recorded and the bin that it starts with: a batch of sweeps never becomes floats as a whole."""
    width = 2 * half_width + 1
    start = jnp.clip(centre - half_width, 0, sweep.shape[0] - width).astype(jnp.int32)
    return start, jax.lax.dynamic_slice(jnp.asarray(sweep), (start,), (width,))


ROUNDING = 4.0  # of three numbers that were each worked out by a few sums


def vertex(left: Scalar, middle: Scalar, right: Scalar) -> tuple[Scalar, Scalar]:
    """Offset in (−½ ... ½) from the middle, and height, of the parabola through three neighbours, the middle largest.

    Where the three lie on a line or a plateau there is no vertex: offset 0, the middle's height, and gradient 0.
    """
    curvature = left - 2.0 * middle + right
    # Three on a line are bent by their rounding, and which way is chance: that would put the vertex anywhere.
    peaked = curvature < -ROUNDING * jnp.finfo(curvature.dtype).eps * (jnp.abs(left) + jnp.abs(middle) + jnp.abs(right))
    offset = jnp.clip(safe_divide(0.5 * (left - right), jnp.where(peaked, curvature, 0.0)), -0.5, 0.5)
    return offset, middle - 0.25 * (left - right) * offset


class ArgMax(WindowEstimator):
    """The largest bin; of a plateau (a saturated echo) its midpoint; of two equal echoes the first."""

    half_width: int | None = eqx.field(static=True, default=None, kw_only=True)

    def locate(self, window: Sweep) -> Scalar:
        bins = jnp.arange(window.shape[0], dtype=jnp.int32)
        first, top = first_largest(window)
        beyond = (bins > first) & (window < top)
        after = smallest(jnp.where(beyond, bins, window.shape[0]))
        return 0.5 * (first + after - 1).astype(window.dtype)


class Parabola(PeakEstimator):
    """Vertex of the parabola fitted by least squares to the `reach` bins on either side of the largest one.

    `reach=1` is the usual three-point form. Where neighbouring bins carry correlated noise or a plateau (full A111
    resolution), three points tell nothing: choose a reach of about a third of the echo's width.
    The largest bin is the midpoint of a plateau. Closed form of a Savitzky-Golay fit of order 2 (Anal. Chem. 36, 1964).
    Where the taps have no vertex among them, the largest bin (or `near`) stands.
    """

    reach: int = eqx.field(static=True, default=1)

    def __check_init__(self) -> None:
        if self.reach < 1:
            raise ValueError(f"`Parabola(reach=...)` must be >= 1; got {self.reach}.")

    def __call__(self, sweep: RawSweep, near: Index | None = None) -> Peak:
        reach = min(self.reach, (sweep.shape[0] - 1) // 2)
        if near is None:
            top = ArgMax()(sweep).position
            near = jnp.round(top).astype(jnp.int32)
        else:
            top = jnp.asarray(near).astype(jnp.result_type(float))
        start, recorded = window_at(sweep, near, reach)
        taps = finite(recorded)
        amplitude = largest(taps)
        if reach < 1:
            return Peak(jnp.where(amplitude > 0, top, 0.0), amplitude, amplitude > 0)
        found = amplitude > 0
        position = self.through(taps, top - start) + start
        return Peak(jnp.where(found, position, 0.0), amplitude, found)

    @staticmethod
    def through(taps: Sweep, top: Scalar | Index) -> Scalar:
        """Vertex of the parabola through an odd number of taps, in bins from the first; `top` if none is among them."""
        reach = (taps.shape[0] - 1) // 2
        if reach < 1:  # one tap has no curvature, and 0/0 would give NaN gradients
            return jnp.asarray(top).astype(taps.dtype)
        steps = np.arange(-reach, reach + 1, dtype=np.float64)
        square = steps**2 - np.mean(steps**2)
        slope = total(taps * jnp.asarray(steps / np.sum(steps**2), taps.dtype))
        curvature = total(taps * jnp.asarray(square / np.sum(square**2), taps.dtype))
        # Relative to the taps' own size: rounding makes a plateau's curvature tiny rather than 0. That size is never
        # below 0, or a plateau of negative taps would be divided by its curvature of 0.
        peaked = curvature < -1e-6 * jnp.maximum(largest(taps), 0.0)
        offset = safe_divide(-0.5 * slope, jnp.where(peaked, curvature, 0.0))
        return jnp.where(peaked & (jnp.abs(offset) <= reach), reach + offset, top)


class SoftArgmax(WindowEstimator):
    """Mean of the bins under weights exp((a/a_max − 1) / temperature): the estimator that gradients flow through.

    `temperature` counts in units of the window's largest amplitude, so that no exponent is above 0 (float32 overflows
    at 88.7, compensated counts reach 258,000) and a change of gain moves nothing. As it falls to 0 the mean tends to
    the arg-max. Too soft, and the floor draws the mean to the window's middle; two equal echoes give a phantom
    between them unless `half_width` keeps one of them out.
    """

    temperature: Setting = eqx.field(converter=as_scalar, default=0.1)
    half_width: int | None = eqx.field(static=True, default=None, kw_only=True)

    def locate(self, window: Sweep) -> Scalar:
        return soft_position(window, self.temperature)[0]


class MatchedFilter(WindowEstimator):
    """Largest correlation with a Gaussian pulse of `fwhm` bins, refined by Newton steps between the bins.

    The maximum-likelihood estimate of one echo's place in white noise (Van Trees, Detection, Estimation, and
    Modulation Theory I, section 4.2.3); all bins are searched, which removes the gross outliers of the others at low
    SNR. What an edge cuts off is taken into account: the correlation is held against the energy of the pulse inside the
    window. No step is taken where the likelihood is not concave, none is longer than a bin.

    `template`: what the pulse is multiplied by, at places that lie evenly over `REACH` widths to either side and linear
    between them; without one it is the Gaussian.

    The one to take as the reference, and where an end of the sweep may cut an echo off: it searches the likelihood over
    all bins and accounts for what is cut off, in some 50 times the time of a `PulseFit`.
    """

    fwhm: float = eqx.field(static=True, default=8.0)
    newton_steps: int = eqx.field(static=True, default=2)
    template: Float[Array | np.ndarray, " places"] | None = None
    half_width: int | None = eqx.field(static=True, default=None, kw_only=True)

    def __check_init__(self) -> None:
        if not self.fwhm > 0:
            raise ValueError(f"`MatchedFilter(fwhm=...)` must be > 0 bins; got {self.fwhm}.")

    def locate(self, window: Sweep) -> Scalar:
        size = window.shape[0]
        bins = jnp.arange(size, dtype=window.dtype)
        radius = int(np.ceil(REACH * self.fwhm))
        taps = jnp.arange(-radius, radius + 1, dtype=window.dtype)
        template = gaussian_pulse(taps, self.fwhm) * self._factor(taps)[0]
        scaled = safe_divide(window, jnp.broadcast_to(jnp.max(window), window.shape))
        energy = jnp.convolve(jnp.ones_like(scaled), template**2, mode="full")[radius : radius + size]
        likelihood = jnp.convolve(scaled, template, mode="full")[radius : radius + size]
        likelihood = likelihood / jnp.sqrt(jnp.where(energy > 0, energy, 1.0))
        position = first_argmax(likelihood).astype(window.dtype)
        sigma = self.fwhm * SIGMA_PER_FWHM
        for _ in range(self.newton_steps):
            # Of log c − ½ log e, with the correlation c and the pulse's energy e; all in units of sigma.
            offset = (bins - position) / sigma
            gaussian = jnp.exp(-0.5 * offset**2)
            factor, slant = self._factor(bins - position)
            slant = slant * sigma
            # The pulse with its first and second slopes by the position; those of the factor are 0 beyond the first.
            pulse = gaussian * factor
            pulse_rise = gaussian * (offset * factor - slant)
            pulse_bend = gaussian * ((offset**2 - 1.0) * factor - 2.0 * offset * slant)
            correlation = jnp.maximum(jnp.sum(scaled * pulse), 0.0)
            rise = safe_divide(jnp.sum(scaled * pulse_rise), correlation)
            bend = safe_divide(jnp.sum(scaled * pulse_bend), correlation)
            energy = jnp.sum(pulse**2)
            energy_rise = safe_divide(jnp.sum(2.0 * pulse * pulse_rise), energy)
            energy_bend = safe_divide(jnp.sum(2.0 * (pulse_rise**2 + pulse * pulse_bend)), energy)
            slope = (rise - 0.5 * energy_rise) / sigma
            curvature = (bend - rise**2 - 0.5 * (energy_bend - energy_rise**2)) / sigma**2
            concave = curvature < 0
            step = jnp.where(concave, -slope / jnp.where(concave, curvature, -1.0), 0.0)
            position = position + jnp.clip(step, -1.0, 1.0)
        return jnp.clip(position, 0.0, size - 1.0)

    def _factor(self, offset: Array) -> tuple[Any, Any]:
        """What the pulse is multiplied by at an offset in bins, and its slope by the offset."""
        if self.template is None:
            return 1.0, 0.0
        places = jnp.asarray(self.template, offset.dtype)
        if places.size == 1:
            return places[0], 0.0
        spacing = 2.0 * REACH * self.fwhm / (places.size - 1)
        at = jnp.clip(offset / spacing + 0.5 * (places.size - 1), 0.0, places.size - 1.0)
        before = jnp.clip(jnp.floor(at).astype(jnp.int32), 0, places.size - 2)
        slope = places[before + 1] - places[before]
        inside = (at > 0) & (at < places.size - 1.0)
        return places[before] + (at - before) * slope, jnp.where(inside, slope / spacing, 0.0)
