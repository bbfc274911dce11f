"""How the sensor and the lab's program sample the envelope over range and over sweeps."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from jaxradar._settings import setting, shape_setting
from jaxradar._types import Setting
from jaxradar.drive import kept_bins
from jaxradar.signal.pulses import SIGMA_PER_FWHM
from jaxradar.sim.radar import Radar
from jaxradar.sim.road.echoes import Paths
from jaxradar.sim.road.effect import RoadEffect, SweepContext

__all__ = ["RangeSmoothing", "RangeWalk", "RunningAverage", "Thinning"]


class Thinning(RoadEffect):
    """Every n-th bin as the lab's program keeps them (`jaxradar.drive.kept_bins`). The log states an even axis, so that
    a bin lies up to one of the sensor's own from where it is said to be."""

    name: ClassVar[str] = "thinning"
    stage: ClassVar[str] = "axis"
    explains: ClassVar[str] = "the lab's 128 columns of a sweep of about 1446 bins"

    bins: int = shape_setting(128, 2, 100_000, "", "that are kept")

    def __call__(self, value: np.ndarray, context: Any, key: PRNGKeyArray) -> np.ndarray:
        return value[kept_bins(len(value), self.bins)]

    def stated(self, range_m: np.ndarray) -> np.ndarray:
        step = (range_m[1] - range_m[0]) * len(range_m) / self.bins
        return range_m[0] + step * np.arange(self.bins)


class RangeSmoothing(RoadEffect):
    """The low-pass along range that the sensor puts on the envelope (the maker documents that it disturbs the first
    centimetres of a sweep): a Gaussian mean of magnitudes, each with noise of its own, `grain_m` apart.

    The widths are those of the floor of the standing recordings: with their running average of 0.7 undone its mean is
    about 6 times its standard deviation, where a single magnitude has 1.9 (Rayleigh), and it is correlated over some
    45 mm; so about nine are averaged. `receiver-noise` must have `width_m = 0` beside it.
    """

    name: ClassVar[str] = "range-smoothing"
    stage: ClassVar[str] = "smoothing"
    explains: ClassVar[str] = "a floor that is far steadier than one magnitude's, and smooth over centimetres"

    width_m: float = shape_setting(0.045, 1e-3, 1.0, "m", "width at half height of the Gaussian")
    grain_m: float = shape_setting(0.007, 1e-4, 1.0, "m", "distance of magnitudes with noise of their own")

    def places(self, range_m: np.ndarray) -> np.ndarray:
        margin = 3.0 * SIGMA_PER_FWHM * self.width_m
        return np.arange(range_m[0] - margin, range_m[-1] + margin + self.grain_m, self.grain_m)

    def __call__(
        self, value: Float[Array, " places"], context: SweepContext, key: PRNGKeyArray
    ) -> Float[Array, " bins"]:
        offset = (context.bins_m[None, :] - context.range_m[:, None]) / (SIGMA_PER_FWHM * self.width_m)
        kernel = np.exp(-0.5 * offset**2)
        return value @ jnp.asarray(kernel / kernel.sum(axis=0), value.dtype)


class RangeWalk(RoadEffect):
    """Bins that are sampled one after the other: while a sweep of 1 to 3 ms (assumed) goes on, an echo that closes in
    at 5.9 m/s moves by 6 to 18 mm. A term of first order in the echo's range rate, in place and in phase."""

    name: ClassVar[str] = "range-walk"
    stage: ClassVar[str] = "sampling"
    needs_rates: ClassVar[bool] = True
    explains: ClassVar[str] = "echoes that lie nearer, and are fainter, the faster they close in"

    sweep_s: Setting = setting(0.002, 0.0, 0.1, "s", "from the first bin to the last")

    def __call__(self, value: Paths, context: SweepContext, key: PRNGKeyArray) -> Paths:
        """An echo whose range changes at rate v is found at r + v t(r), t being when its bin is sampled, and its phase
        turns by −4π v/λ for each second, so from bin to bin."""
        assert value.rate_m_s is not None
        dtype = value.range_m.dtype
        walk = value.rate_m_s * jnp.asarray(self._later_s_per_m(context.radar), dtype)
        slope = -4.0 * math.pi / jnp.asarray(context.radar.wavelength_m, dtype) * walk
        return value._replace(range_m=value.range_m + walk * (value.range_m - context.radar.start_m), slope=slope)

    def turn_rad_m(self, radar: Radar, speed_m_s: float) -> float:
        shortest = float(np.min(radar.wavelength_m))
        return 4.0 * math.pi / shortest * float(np.max(self._later_s_per_m(radar))) * speed_m_s

    def _later_s_per_m(self, radar: Radar) -> Setting:
        """How much later a bin is sampled for each metre of range."""
        return self.sweep_s / (radar.bin_m * (radar.bins - 1))


class RunningAverage(RoadEffect):
    """The sensor's own exponential smoothing of the envelope from sweep to sweep; its default factor is 0.7 (maker's
    documentation of the envelope service), the thesis sets 0. It begins with the first sweep as it is."""

    name: ClassVar[str] = "running-average"
    stage: ClassVar[str] = "average"
    explains: ClassVar[str] = "noise that neighbouring sweeps share, and echoes that come late"

    factor: Setting = setting(0.7, 0.0, 0.999, "", "share of what was before")

    def __call__(
        self, value: Float[Array, "sweeps bins"], context: Float[Array, " bins"], key: PRNGKeyArray
    ) -> Float[Array, "sweeps bins"]:
        dtype = value.dtype
        number = np.arange(value.shape[0])
        factor = jnp.asarray(self.factor, dtype)
        ages = jnp.asarray(np.maximum(number[:, None] - number[None, :], 0), dtype)
        recent = jnp.asarray(number[:, None] >= number[None, :])
        # 0⁰ is 1, also for the gradient by the factor.
        powers = jnp.where(ages > 0, factor ** jnp.maximum(ages, 1.0), 1.0)
        kernel = jnp.where(recent, (1.0 - factor) * powers, 0.0)
        kept = factor ** jnp.asarray(number + 1, dtype)
        return kernel @ value + kept[:, None] * context
