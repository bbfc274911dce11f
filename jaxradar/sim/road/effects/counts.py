"""From amplitudes to the numbers in a log."""

from __future__ import annotations

from typing import Any, ClassVar

import jax.numpy as jnp
from jaxtyping import PRNGKeyArray

from jaxradar._settings import setting, shape_setting
from jaxradar._types import Setting
from jaxradar.drive import FULL_SCALE
from jaxradar.sim.road.effect import Counts, RoadEffect

__all__ = ["Gain", "Quantisation", "Saturation"]


class Gain(RoadEffect):
    """The receiver's gain setting, relative to the usual 0.5 of the maker's documentation: echoes and noise alike."""

    name: ClassVar[str] = "gain"
    stage: ClassVar[str] = "gain"
    explains: ClassVar[str] = "logs of one place that differ by a factor"

    factor: Setting = setting(1.0, 0.0, 100.0, "", "of all amplitudes")

    def __call__(self, value: Counts, context: Any, key: PRNGKeyArray) -> Counts:
        return value._replace(values=value.values * jnp.asarray(self.factor, value.values.dtype))


class Saturation(RoadEffect):
    """Amplitudes end at full scale, and the sweep is flagged, as the sensor does."""

    name: ClassVar[str] = "saturation"
    stage: ClassVar[str] = "limit"
    explains: ClassVar[str] = "plateaus at 65535"
    smooth: ClassVar[bool] = False

    full_scale: Setting = setting(float(FULL_SCALE), 1.0, float(FULL_SCALE), "counts", "the largest number")

    def __call__(self, value: Counts, context: Any, key: PRNGKeyArray) -> Counts:
        full = jnp.asarray(self.full_scale, value.values.dtype)
        return Counts(jnp.minimum(value.values, full), jnp.any(value.values >= full, axis=-1))


class Quantisation(RoadEffect):
    """Whole multiples of a step, as uint16: 8 counts in the thesis's table C.1, 1 in the maker's own recordings."""

    name: ClassVar[str] = "quantisation"
    stage: ClassVar[str] = "rounding"
    explains: ClassVar[str] = "amplitudes that are multiples of 8 (table C.1)"
    smooth: ClassVar[bool] = False

    step: int = shape_setting(8, 1, 4096, "counts", "distance of two amplitudes")

    def __call__(self, value: Counts, context: Any, key: PRNGKeyArray) -> Counts:
        most = FULL_SCALE // self.step * self.step
        rounded = jnp.clip(jnp.round(value.values / self.step) * self.step, 0, most)
        return value._replace(values=rounded.astype(jnp.uint16))
