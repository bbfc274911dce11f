"""How the sensor and the lab's program sample the envelope over range and over sweeps."""

from __future__ import annotations

from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from jaxradar._settings import setting, shape_setting
from jaxradar._types import Setting
from jaxradar.signal.pulses import SIGMA_PER_FWHM
from jaxradar.sim.radar import Radar
from jaxradar.sim.scene import Effect

__all__ = ["RangeSmoothing", "RangeWalk", "RunningAverage", "Thinning"]


class Thinning(Effect):
    """Every n-th bin as the lab's program keeps them, out[i] = data[len·i // bins] (thesis, listing C.1, line 243). The
    log states an even axis, so that a bin lies up to one of the sensor's own from where it is said to be."""

    name: ClassVar[str] = "thinning"
    stage: ClassVar[str] = "axis"
    explains: ClassVar[str] = "the lab's 128 columns of a sweep of about 1446 bins"

    bins: int = shape_setting(128, 2, 100_000, "", "that are kept")

    def __call__(self, value: np.ndarray, context: Any, key: PRNGKeyArray) -> np.ndarray:
        return value[len(value) * np.arange(self.bins) // self.bins]

    def stated(self, value: np.ndarray) -> np.ndarray:
        """The axis that the log gives to the bins that are kept."""
        step = (value[1] - value[0]) * len(value) / self.bins
        return value[0] + step * np.arange(self.bins)


class RangeSmoothing(Effect):
    """The low-pass along range that the sensor puts on the envelope (the maker documents that it disturbs the first
    centimetres of a sweep): a Gaussian mean of magnitudes, each with noise of its own, `grain_m` apart.

    The widths are those of the floor of the standing recordings: its mean is 6 times its standard deviation, where a
    single magnitude has 1.9 (Rayleigh), and they are correlated over some 45 mm; so about nine are averaged.
    """

    name: ClassVar[str] = "range-smoothing"
    stage: ClassVar[str] = "smoothing"
    explains: ClassVar[str] = "a floor that is far steadier than one magnitude's, and smooth over centimetres"

    width_m: float = shape_setting(0.045, 1e-3, 1.0, "m", "width at half height of the Gaussian")
    grain_m: float = shape_setting(0.007, 1e-4, 1.0, "m", "distance of magnitudes with noise of their own")

    def places(self, range_m: np.ndarray) -> np.ndarray:
        """Where magnitudes are taken for an envelope at `range_m`."""
        margin = 3.0 * SIGMA_PER_FWHM * self.width_m
        return np.arange(range_m[0] - margin, range_m[-1] + margin + self.grain_m, self.grain_m)

    def __call__(self, value: Float[Array, " places"], context: Any, key: PRNGKeyArray) -> Float[Array, " bins"]:
        """`value`: at `places(context)`; `context`: the range axis that is wanted."""
        offset = (context[None, :] - self.places(context)[:, None]) / (SIGMA_PER_FWHM * self.width_m)
        kernel = np.exp(-0.5 * offset**2)
        return value @ jnp.asarray(kernel / kernel.sum(axis=0), value.dtype)


class RangeWalk(Effect):
    """Bins that are sampled one after the other: while a sweep of 1 to 3 ms (assumed) goes on, an echo that closes in
    at 5.9 m/s moves by 6 to 18 mm. A term of first order in the echo's range rate, in place and in phase."""

    name: ClassVar[str] = "range-walk"
    stage: ClassVar[str] = "walk"
    explains: ClassVar[str] = "echoes that lie nearer, and are fainter, the faster they close in"

    sweep_s: Setting = setting(0.002, 0.0, 0.1, "s", "from the first bin to the last")

    def later(self, radar: Radar) -> Setting:
        """How much later a bin is sampled for each metre of range; s/m."""
        return self.sweep_s / (radar.bin_m * (radar.bins - 1))


class RunningAverage(Effect):
    """The sensor's own exponential smoothing of the envelope from sweep to sweep; its default factor is 0.7 (maker's
    documentation of the envelope service), the thesis sets 0. It begins with the first sweep as it is."""

    name: ClassVar[str] = "running-average"
    stage: ClassVar[str] = "average"
    explains: ClassVar[str] = "noise that neighbouring sweeps share, and echoes that come late"

    factor: Setting = setting(0.7, 0.0, 0.999, "", "share of what was before")

    def __call__(
        self, last: Float[Array, " bins"], sweeps: Float[Array, "sweeps bins"]
    ) -> tuple[Float[Array, " bins"], Float[Array, "sweeps bins"]]:
        """What a block of sweeps becomes after the smoothed sweep before it; also the last of them."""
        dtype = sweeps.dtype
        number = np.arange(sweeps.shape[0])
        factor = jnp.asarray(self.factor, dtype)
        ages = jnp.asarray(np.maximum(number[:, None] - number[None, :], 0), dtype)
        recent = jnp.asarray(number[:, None] >= number[None, :])
        # 0⁰ is 1, also for the gradient by the factor.
        powers = jnp.where(ages > 0, factor ** jnp.maximum(ages, 1.0), 1.0)
        kernel = jnp.where(recent, (1.0 - factor) * powers, 0.0)
        kept = factor ** jnp.asarray(number + 1, dtype)
        smoothed = kernel @ sweeps + kept[:, None] * last
        return smoothed[-1], smoothed
