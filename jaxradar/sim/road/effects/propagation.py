"""What lies between the sensor and the road, and on the road: second ways, rain, water, warmth."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import jax.numpy as jnp
from jaxtyping import PRNGKeyArray

from jaxradar._settings import in_order, setting
from jaxradar._types import Setting
from jaxradar.sim.road.echoes import Paths
from jaxradar.sim.road.effect import RoadEffect
from jaxradar.sim.road.surface import Surface, reflectivity

__all__ = ["LostEcho", "Multipath", "Rain", "TemperatureDrift", "WaterFilm"]

_PER_DB = math.log(10.0) / 20.0  # of an amplitude


class Multipath(RoadEffect):
    """Everything seen once more by a longer way, by way of the bumper for example; 6 cm and −10 dB are assumed."""

    name: ClassVar[str] = "multipath"
    stage: ClassVar[str] = "paths"
    explains: ClassVar[str] = "a second, weaker echo behind the first"
    alone: ClassVar[bool] = False

    longer_m: Setting = setting(0.06, 0.0, 10.0, "m", "how much further away it appears")
    level_db: Setting = setting(-10.0, -100.0, 0.0, "dB", "of its amplitude")

    def __call__(self, value: Paths, context: Any, key: PRNGKeyArray) -> Paths:
        dtype = value.range_m.dtype
        level = jnp.exp(jnp.asarray(self.level_db, dtype) * _PER_DB)
        second = value._replace(
            range_m=value.range_m + jnp.asarray(self.longer_m, dtype), amplitude=value.amplitude * level
        )
        return value.joined(second)


class LostEcho(RoadEffect):
    """Nothing of the road comes back for a while: the sensor is covered, or turned away. 60 dB and edges of 20 ms are
    assumed."""

    name: ClassVar[str] = "lost-echo"
    stage: ClassVar[str] = "paths"
    explains: ClassVar[str] = "stretches of a recording that hold the floor alone"
    alone: ClassVar[bool] = False

    start_s: Setting = setting(1.0, -1e6, 1e6, "s", "when it goes")
    stop_s: Setting = setting(2.0, -1e6, 1e6, "s", "when it is back")
    level_db: Setting = setting(-60.0, -200.0, 0.0, "dB", "what is left of its amplitude")
    edge_s: Setting = setting(0.02, 1e-4, 10.0, "s", "how long going and coming take")

    def __check_init__(self) -> None:
        in_order("LostEcho", "start_s", self.start_s, "stop_s", self.stop_s)

    def __call__(self, value: Paths, context: Any, key: PRNGKeyArray) -> Paths:
        into = jnp.clip((context.taken_s - self.start_s) / self.edge_s, 0.0, 1.0)
        out = jnp.clip((context.taken_s - self.stop_s) / self.edge_s, 0.0, 1.0)
        level = jnp.exp(self.level_db * _PER_DB * (into - out)).astype(value.amplitude.dtype)
        return value._replace(amplitude=value.amplitude * level)


class Rain(RoadEffect):
    """Attenuation by drops, γ = 0.8606 R^0.7656 dB/km at 60 GHz and R mm/h (ITU-R P.838-3, horizontal): 0.01 dB for
    each metre in a cloudburst, so nothing over the ranges of a road sensor. `significant` says so."""

    name: ClassVar[str] = "rain"
    stage: ClassVar[str] = "paths"
    explains: ClassVar[str] = "nothing that could be seen: it is here to be shown to be negligible"

    rate_mm_h: Setting = setting(25.0, 0.0, 500.0, "mm/h", "how hard it rains")

    def __call__(self, value: Paths, context: Any, key: PRNGKeyArray) -> Paths:
        dtype = value.range_m.dtype
        rate = jnp.asarray(self.rate_mm_h, dtype)
        dry = rate <= 0
        per_m = jnp.where(dry, 0.0, 0.8606e-3 * jnp.where(dry, 1.0, rate) ** 0.7656)
        return value._replace(amplitude=value.amplitude * jnp.exp(-2.0 * _PER_DB * per_m * value.range_m))


class WaterFilm(RoadEffect):
    """Water on the road: it reflects more (|R|² = 0.48 at 60 GHz and 20 °C, from ε = 11.9 − 19.5j: Liebe, Hufford and
    Manabe, Int. J. Infrared Millim. Waves 12, 1991) as soon as it is thicker than the 0.17 mm after which 1/e of the
    power is left, and fills the grain: `calm` is how much of slope and roughness it takes away (assumed)."""

    name: ClassVar[str] = "water-film"
    stage: ClassVar[str] = "surface"
    explains: ClassVar[str] = "wet roads whose echo is stronger and nearer to the vertical"

    depth_mm: Setting = setting(0.5, 0.0, 20.0, "mm", "of the water")
    calm: Setting = setting(0.4, 0.0, 0.95, "", "share of slope and roughness that a deep film takes away")

    def __call__(self, value: Surface, context: Any, key: PRNGKeyArray) -> Surface:
        covered = 1.0 - jnp.exp(-jnp.asarray(self.depth_mm) / 0.17)
        power = reflectivity(value.permittivity)
        root = jnp.sqrt(power + (0.482 - power) * covered)
        smoother = 1.0 - self.calm * covered
        changed = ((1.0 + root) / (1.0 - root)) ** 2, value.slope * smoother, value.rms_mm * smoother
        # Not through the constructor, whose bounds are for values that a user gives.
        return Surface(
            permittivity=changed[0],
            slope=changed[1],
            grain_db=value.grain_db + 20.0 * jnp.log10(jnp.maximum(smoother, 1e-3)),
            rms_mm=changed[2],
        )


class TemperatureDrift(RoadEffect):
    """A sensor that warms up: its clock, and so its range scale, goes with 50 ppm/K (assumed: a plain crystal), its
    gain with −0.05 dB/K (assumed)."""

    name: ClassVar[str] = "temperature-drift"
    stage: ClassVar[str] = "paths"
    explains: ClassVar[str] = "a slow change of the range of a standing target"

    kelvin_per_s: Setting = setting(0.01, -10.0, 10.0, "K/s", "how fast it warms up")
    ppm_per_kelvin: Setting = setting(50.0, -1000.0, 1000.0, "ppm/K", "of the range scale")
    db_per_kelvin: Setting = setting(-0.05, -10.0, 10.0, "dB/K", "of the gain")

    def __call__(self, value: Paths, context: Any, key: PRNGKeyArray) -> Paths:
        dtype = value.range_m.dtype
        warmer = (context.taken_s * self.kelvin_per_s).astype(dtype)
        scale = 1.0 + 1e-6 * jnp.asarray(self.ppm_per_kelvin, dtype) * warmer
        gain = jnp.exp(_PER_DB * jnp.asarray(self.db_per_kelvin, dtype) * warmer)
        return value._replace(range_m=value.range_m * scale, amplitude=value.amplitude * gain)
