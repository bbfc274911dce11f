"""What the lab's program records of the car beside the radar."""

from __future__ import annotations

from typing import Any, ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from jaxradar._settings import setting
from jaxradar._types import Setting
from jaxradar.sim.road.effect import RoadEffect

__all__ = ["Accelerometer"]


class Accelerometer(RoadEffect):
    """The body's acceleration as the thesis's log has it: whole m/s² (table C.2), with noise (0.7 m/s² is assumed).
    Without it the drive holds the true acceleration."""

    name: ClassVar[str] = "accelerometer"
    stage: ClassVar[str] = "acceleration"
    explains: ClassVar[str] = "acceleration in whole m/s²"
    smooth: ClassVar[bool] = False

    sd_m_s2: Setting = setting(0.7, 0.0, 100.0, "m/s²", "standard deviation of its noise")
    step_m_s2: Setting = setting(1.0, 1e-6, 100.0, "m/s²", "distance of two values")

    def __call__(self, value: Float[Array, " sweeps"], context: Any, key: PRNGKeyArray) -> Float[Array, " sweeps"]:
        step = jnp.asarray(self.step_m_s2, value.dtype)
        noise = jax.random.normal(key, value.shape, jnp.float32).astype(value.dtype)
        return step * jnp.round((value + jnp.asarray(self.sd_m_s2, value.dtype) * noise) / step)
