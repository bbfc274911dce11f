"""A radar on a car on a road: the scene that the step detectors are for."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx

from jaxradar._settings import Settings, is_plain, setting, shape_setting
from jaxradar._types import Setting
from jaxradar.sim.radar import Radar
from jaxradar.sim.road.effect import RoadEffect
from jaxradar.sim.road.effects.sampling import Thinning
from jaxradar.sim.road.elements import RoadElement, StepDown, StepUp
from jaxradar.sim.road.motion import CarMotion
from jaxradar.sim.road.roughness import Roughness
from jaxradar.sim.road.surface import SURFACES, Surface
from jaxradar.sim.road.vehicle import Vehicle

__all__ = ["Mount", "RoadScene"]


class Mount(Settings):
    """Where the sensor sits. The thesis: 45° to the ground (section 5.1.3); height and overhang are assumed."""

    height_m: Setting = setting(0.35, 0.02, 10.0, "m", "of the sensor over the road, at rest")
    angle_deg: Setting = setting(45.0, 0.0, 90.0, "°", "between its line of sight and the road")
    front_wheel_m: Setting = setting(0.15, -5.0, 10.0, "m", "how far the front axle lies behind it")
    lateral_m: Setting = setting(0.0, -5.0, 5.0, "m", "how far left of the middle line it sits")


class RoadScene(Settings):
    """What is driven, over what, and seen by what.

    `surface` None is a road that reflects nothing, `vehicle` None a car without springs that keeps its height and
    pitch, `roughness` None an even road: none of these costs anything then. Raises `ValueError` at construction for
    values outside their bounds, for two effects of a kind that a scene may hold once, and for a road higher than the
    sensor.
    """

    kind: ClassVar[str] = "road"

    duration_s: float = shape_setting(2.0, 0.0, 1e6, "s", "how long it is recorded; one sweep at least")
    radar: Radar = eqx.field(default_factory=Radar)
    mount: Mount = eqx.field(default_factory=Mount)
    surface: Surface | None = eqx.field(default_factory=lambda: SURFACES["asphalt"])
    road: tuple[RoadElement, ...] = ()
    roughness: Roughness | None = None
    motion: CarMotion = eqx.field(default_factory=CarMotion)
    vehicle: Vehicle | None = None
    effects: tuple[RoadEffect, ...] = ()
    spacing_m: float = shape_setting(0.006, 1e-4, 0.1, "m", "between two scatterers along the road")
    half_width_m: float = shape_setting(0.5, 0.0, 5.0, "m", "of the strip of road that reflects")

    def __check_init__(self) -> None:
        seen: set[type[RoadEffect]] = set()
        for effect in self.effects:
            if not isinstance(effect, RoadEffect):
                raise ValueError(f"`RoadScene(effects=...)` takes effects of a road; got {type(effect).__name__}.")
            if effect.alone and type(effect) in seen:
                raise ValueError(f"`RoadScene(effects=...)` may hold one `{effect.name}`; got two.")
            seen.add(type(effect))
        for effect in self.effects:
            if isinstance(effect, Thinning) and effect.bins > self.radar.bins:
                raise ValueError(
                    f"`RoadScene(effects=...)`: thinning must keep at most the radar's {self.radar.bins} bins; "
                    f"got {effect.bins}."
                )
        self._check_heights()

    def _check_heights(self) -> None:
        """A car on springs climbs what it drives over; one without keeps its height, and steps add up under it."""
        settings = [one for element in self.road for one in (element.at_m, element.step_m)]
        if not all(map(is_plain, [*settings, self.mount.height_m])):
            return
        level, most = 0.0, float(self.mount.height_m)
        for element in sorted(self.road, key=lambda one: float(one.at_m)):
            top = level + float(element.step_m)
            if top >= most:
                raise ValueError(
                    f"`RoadScene(road=...)` must not be higher than the sensor, {most:g} m; "
                    f"got {top:g} m with a {element.name} of {float(element.step_m):g} m."
                )
            if self.vehicle is None and isinstance(element, StepUp | StepDown):
                level = top
