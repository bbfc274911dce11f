"""From amplitudes to the numbers in a log."""

from __future__ import annotations

from typing import Any, ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray, UInt

from jaxradar._settings import setting, shape_setting
from jaxradar._types import Setting
from jaxradar.drive import FULL_SCALE
from jaxradar.sim.scene import Effect

__all__ = ["Gain", "Quantisation", "Saturation"]


class Gain(Effect):
    """The receiver's gain setting, relative to the usual 0.5 of the maker's documentation: echoes and noise alike."""

    name: ClassVar[str] = "gain"
    stage: ClassVar[str] = "gain"
    explains: ClassVar[str] = "logs of one place that differ by a factor"

    factor: Setting = setting(1.0, 0.0, 100.0, "", "of all amplitudes")

    def __call__(self, value: Float[Array, "*shape"], context: Any, key: PRNGKeyArray) -> Float[Array, "*shape"]:
        return value * jnp.asarray(self.factor, value.dtype)


class Saturation(Effect):
    """Amplitudes end at full scale, and the sweep is flagged, as the sensor does."""

    name: ClassVar[str] = "saturation"
    stage: ClassVar[str] = "limit"
    explains: ClassVar[str] = "plateaus at 65535"
    smooth: ClassVar[bool] = False

    full_scale: Setting = setting(float(FULL_SCALE), 1.0, float(FULL_SCALE), "counts", "the largest number")

    def __call__(
        self, value: Float[Array, "sweeps bins"], context: Any, key: PRNGKeyArray
    ) -> tuple[Float[Array, "sweeps bins"], Bool[Array, " sweeps"]]:
        full = jnp.asarray(self.full_scale, value.dtype)
        return jnp.minimum(value, full), jnp.any(value >= full, axis=-1)


class Quantisation(Effect):
    """Whole multiples of a step, as uint16: 8 counts in the thesis's table C.1, 1 in the maker's own recordings."""

    name: ClassVar[str] = "quantisation"
    stage: ClassVar[str] = "rounding"
    explains: ClassVar[str] = "amplitudes that are multiples of 8 (table C.1)"
    smooth: ClassVar[bool] = False

    step: int = shape_setting(8, 1, 4096, "counts", "distance of two amplitudes")

    def __call__(self, value: Float[Array, "*shape"], context: Any, key: PRNGKeyArray) -> UInt[Array, "*shape"]:
        most = FULL_SCALE // self.step * self.step
        return jnp.clip(jnp.round(value / self.step) * self.step, 0, most).astype(jnp.uint16)
