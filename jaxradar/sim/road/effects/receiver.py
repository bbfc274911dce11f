"""What the receiver adds to the field: leakage of its own transmitter, noise, other sensors."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PRNGKeyArray

from jaxradar._settings import setting, shape_setting
from jaxradar._types import Setting
from jaxradar.signal.pulses import SIGMA_PER_FWHM
from jaxradar.sim.radar import Field
from jaxradar.sim.road.effect import RoadEffect

__all__ = ["DirectLeakage", "Interference", "ReceiverNoise"]


class DirectLeakage(RoadEffect):
    """What goes from the transmitting antenna straight into the receiving one: A exp(−(r/l)²) with a constant phase.
    The maker gives its reach, about 0.06, 0.10, 0.18, 0.36 and 0.60 m for profiles 1 to 5; the amplitude is assumed."""

    name: ClassVar[str] = "direct-leakage"
    stage: ClassVar[str] = "field"
    explains: ClassVar[str] = "large amplitudes in the first 10 cm whatever stands before the sensor"

    amplitude: Setting = setting(10_000.0, 0.0, 1e6, "counts", "at range 0")
    length_m: Setting = setting(0.05, 1e-3, 1.0, "m", "where it has fallen to 1/e; half of its reach")

    def __call__(self, value: Field, context: Any, key: PRNGKeyArray) -> Field:
        dtype = value.real.dtype
        share = jnp.asarray(context.range_m, dtype) / jnp.asarray(self.length_m, dtype)
        return value._replace(real=value.real + jnp.asarray(self.amplitude, dtype) * jnp.exp(-(share**2)))


class ReceiverNoise(RoadEffect):
    """Complex Gaussian noise, so that the envelope of nothing is Rayleigh: 164 counts give the mean of 206 of the
    thesis's table C.1 (whose spread, 89, is less than the Rayleigh's 107).

    Over range it is correlated as far as `width_m`; at 0 each bin has its own, which is what `range-smoothing`
    averages: a scene that has that effect sets it to 0.
    """

    name: ClassVar[str] = "receiver-noise"
    stage: ClassVar[str] = "field"
    explains: ClassVar[str] = "the floor of the recordings, and that neighbouring bins share it"

    sigma: Setting = setting(164.0, 0.0, 1e5, "counts", "standard deviation of each of the two parts")
    width_m: float = shape_setting(0.04, 0.0, 1.0, "m", "width at half height of what filters it; 0 for white noise")

    def __call__(self, value: Field, context: Any, key: PRNGKeyArray) -> Field:
        dtype = value.real.dtype
        if self.width_m:
            shape = _shaping(context.range_m, self.width_m)
            noise = jax.random.normal(key, (2, shape.shape[0]), dtype) @ jnp.asarray(shape, dtype)
        else:
            noise = jax.random.normal(key, (2, len(context.range_m)), dtype)
        noise = jnp.asarray(self.sigma, dtype) * noise
        return Field(value.real + noise[0], value.imag + noise[1])


def _shaping(range_m: np.ndarray, width_m: float) -> np.ndarray:
    """(sources, bins): white noise at places 0.5 σ apart, seen through a Gaussian of that width, of variance 1."""
    sigma = SIGMA_PER_FWHM * width_m
    places = np.arange(range_m[0] - 4.0 * sigma, range_m[-1] + 4.0 * sigma, 0.5 * sigma)
    shape = np.exp(-0.5 * ((range_m[None, :] - places[:, None]) / sigma) ** 2)
    return shape / np.sqrt(np.sum(shape**2, axis=0))


class Interference(RoadEffect):
    """Another sensor of the kind near by: its pulses are not in step, so that now and then a sweep holds a burst of
    them somewhere (assumed; 60 GHz sensors of one maker do not coordinate)."""

    name: ClassVar[str] = "interference"
    stage: ClassVar[str] = "field"
    explains: ClassVar[str] = "single sweeps with an echo where nothing is"
    alone: ClassVar[bool] = False

    share: Setting = setting(0.02, 0.0, 1.0, "", "of the sweeps that are hit")
    amplitude: Setting = setting(1000.0, 0.0, 1e6, "counts", "of a burst")
    width_m: Setting = setting(0.08, 1e-3, 10.0, "m", "of a burst at half its height")

    def __call__(self, value: Field, context: Any, key: PRNGKeyArray) -> Field:
        dtype = value.real.dtype
        hit, place, angle = jax.random.uniform(key, (3,), jnp.float32).astype(dtype)
        low, high = float(context.range_m[0]), float(context.range_m[-1])
        offset = jnp.asarray(context.range_m, dtype) - (low + (high - low) * place)
        scale = math.sqrt(0.5) / (SIGMA_PER_FWHM * jnp.asarray(self.width_m, dtype))
        burst = jnp.exp(-((offset * scale) ** 2)) * jnp.asarray(self.amplitude, dtype)
        burst = jnp.where(hit < self.share, burst, 0.0)
        angle = 2.0 * math.pi * angle
        return Field(value.real + burst * jnp.cos(angle), value.imag + burst * jnp.sin(angle))
