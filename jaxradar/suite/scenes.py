"""The drives of the detection suite: cells of a step, each over one surface at one speed, and roads without one."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from jaxradar.sim import (
    EFFECTS,
    SURFACES,
    CarMotion,
    HalfCar,
    Radar,
    ReceiverNoise,
    RoadScene,
    Roughness,
    SpeedChange,
    StepDown,
    StepUp,
    Surface,
)
from jaxradar.sim.road.tyre import contact_m

__all__ = [
    "HEIGHTS_M",
    "NEGATIVES",
    "ROADS",
    "SPEEDS_KMH",
    "Negative",
    "StepCell",
    "base_scene",
    "grid",
    "lead_allowed_s",
    "variations",
]

KMH = 3.6
# Smooth as a floor of poured concrete (assumed), wet asphalt, dry asphalt, gravel.
ROADS: dict[str, Surface] = {
    "specular": Surface(slope=0.1, grain_db=-25.0, rms_mm=0.1),
    "wet": SURFACES["wet-asphalt"],
    "diffuse": SURFACES["asphalt"],
    "rough": SURFACES["gravel"],
}
SPEEDS_KMH = (5.0, 10.0, 20.0, 30.0, 40.0)
HEIGHTS_M = (-0.06, -0.04, -0.02, 0.01, 0.02, 0.03, 0.05, 0.08)
RATE_HZ = 300.0
VIEW_M = 0.95  # ahead of the sensor's foot, where a step comes into the range window
BEFORE_S = 0.7  # driven before that, so that detectors have settled
AFTER_S = 0.05  # after the impact


def base_scene(surface: Surface, **changed: Any) -> RoadScene:
    """A small electric car on springs with the sensor of the thesis and its receiver's noise."""
    effects = (ReceiverNoise(), *(EFFECTS[name]() for name in ("saturation", "quantisation")))
    held = {"radar": Radar(rate_hz=RATE_HZ), "surface": surface, "vehicle": HalfCar(), "effects": effects}
    return RoadScene(**{**held, **changed})


def lead_allowed_s(scene: RoadScene, speed_m_s: float, height_m: float) -> float:
    """How long before the impact the sensor's line of sight meets the step: (overhang + H/tan α − L)/v, α its angle to
    the road, 45° as a rule, with L = √(2 r h − h²) where the tyre touches a step up (requirements, 2A)."""
    assert scene.vehicle is not None
    reach = contact_m(max(height_m, 0.0), float(scene.vehicle.tyre_radius_m))
    sight = float(scene.mount.height_m) / math.tan(math.radians(float(scene.mount.angle_deg)))
    return float((scene.mount.front_wheel_m + sight - reach) / speed_m_s)


@dataclasses.dataclass(frozen=True)
class StepCell:
    """Drives over one step. `variation`: what is otherwise than usual, empty for the grid."""

    road: str
    speed_kmh: float
    height_m: float
    variation: str = ""
    radar: tuple[tuple[str, Any], ...] = ()
    surface: tuple[tuple[str, float], ...] = ()
    noise: float = 1.0
    rough: bool = False
    change_m_s2: float = 0.0
    oblique_deg: float = 0.0
    mount: tuple[tuple[str, float], ...] = ()

    @property
    def name(self) -> str:
        """As tables show it."""
        text = f"{self.road}, {self.speed_kmh:g} km/h, {1e3 * self.height_m:+g} mm"
        return f"{text}, {self.variation}" if self.variation else text

    def scenes(self, count: int, random: np.random.Generator) -> list[RoadScene]:
        """As many drives of it, each at a speed within 3 % and with the step somewhere else between two sweeps."""
        surface = dataclasses.replace(ROADS[self.road], **dict(self.surface))
        scene = base_scene(surface)
        noise = dataclasses.replace(ReceiverNoise(), sigma=float(ReceiverNoise().sigma) * self.noise)
        scene = dataclasses.replace(
            scene,
            radar=dataclasses.replace(scene.radar, **dict(self.radar)),
            mount=dataclasses.replace(scene.mount, **dict(self.mount)),
            effects=(noise, *scene.effects[1:]),
            roughness=Roughness("B") if self.rough else None,
        )
        speed = self.speed_kmh / KMH
        along = VIEW_M + speed * BEFORE_S + 0.5 * abs(math.tan(math.radians(self.oblique_deg)))
        scene = dataclasses.replace(scene, duration_s=(along + 0.25) / (0.97 * speed) + AFTER_S + self._later_s())
        places = along + 0.1 * random.random(count)
        speeds = speed * random.uniform(0.97, 1.03, count)
        return [self._one(scene, float(one), float(other)) for one, other in zip(places, speeds, strict=True)]

    def _later_s(self) -> float:
        return 0.5 if self.change_m_s2 else 0.0

    def _one(self, scene: RoadScene, at_m: float, speed_m_s: float) -> RoadScene:
        kind: Any = StepUp if self.height_m > 0 else StepDown
        element = kind(at_m=at_m, height_m=abs(self.height_m), oblique_deg=self.oblique_deg)
        motion = CarMotion(speed_m_s=speed_m_s)
        if self.change_m_s2:
            change = SpeedChange(
                at_s=0.2,
                to_m_s=speed_m_s + math.copysign(0.4 * speed_m_s, self.change_m_s2),
                acceleration_m_s2=abs(self.change_m_s2),
            )
            motion = CarMotion(speed_m_s=speed_m_s, changes=(change,))
        return dataclasses.replace(scene, road=(element,), motion=motion)


def grid(
    roads: Sequence[str] = tuple(ROADS),
    speeds_kmh: Sequence[float] = SPEEDS_KMH,
    heights_m: Sequence[float] = HEIGHTS_M,
) -> Iterator[StepCell]:
    """Every road at every speed over every height."""
    return (StepCell(*one) for one in itertools.product(roads, speeds_kmh, heights_m))


def variations() -> Iterator[StepCell]:
    """One thing at a time that is otherwise, at 30 km/h."""
    for road, height_m in (("wet", 0.01), ("specular", 0.02), ("diffuse", 0.03)):
        usual = StepCell(road, 30.0, height_m)
        for decibels in (-10.0, 10.0):
            yield dataclasses.replace(usual, variation=f"corner {decibels:+g} dB", surface=(("corner_db", decibels),))
        for variation, changed in (
            ("twice the noise", {"noise": 2.0}),
            ("half the noise", {"noise": 0.5}),
            ("100 sweeps/s", {"radar": (("rate_hz", 100.0),)}),
            ("electric field across", {"radar": (("polarisation", "horizontal"),)}),
            ("class B road", {"rough": True}),
            ("pulling away, 2 m/s²", {"change_m_s2": 2.0}),
            ("braking, 4 m/s²", {"change_m_s2": -4.0}),
            ("oblique, 20°", {"oblique_deg": 20.0}),
            ("oblique, 40°", {"oblique_deg": 40.0}),
            ("sensor 35 mm higher", {"mount": (("height_m", 0.385),)}),
            ("sensor at 40°", {"mount": (("angle_deg", 40.0),)}),
        ):
            yield dataclasses.replace(usual, variation=variation, **changed)


@dataclasses.dataclass(frozen=True)
class Negative:
    """Drives without a step, `share` of the hours of all."""

    name: str
    duration_s: float
    share: float
    rough: bool = False
    pulls_away: bool = False
    brakes: bool = False

    def scenes(self, count: int, random: np.random.Generator) -> list[RoadScene]:
        """As many drives, over each road in turn, at speeds of 5 to 40 km/h."""
        return [self._one(place, random) for place in range(count)]

    def _one(self, place: int, random: np.random.Generator) -> RoadScene:
        surface = list(ROADS.values())[place % len(ROADS)]
        speed = random.uniform(SPEEDS_KMH[0], SPEEDS_KMH[-1]) / KMH
        motion = CarMotion(speed_m_s=speed)
        if self.pulls_away or self.brakes:
            change = SpeedChange(
                at_s=random.uniform(1.2, 1.8),
                to_m_s=speed if self.pulls_away else 0.0,
                acceleration_m_s2=random.uniform(1.0, 3.0) if self.pulls_away else random.uniform(2.0, 6.0),
                rise_s=random.uniform(0.1, 0.4),
            )
            motion = CarMotion(speed_m_s=0.0 if self.pulls_away else speed, changes=(change,))
        rough = Roughness("B") if self.rough else None
        return base_scene(surface, motion=motion, roughness=rough, duration_s=self.duration_s)


NEGATIVES: tuple[Negative, ...] = (
    Negative("steady", 10.0, 0.35),
    Negative("class B", 10.0, 0.30, rough=True),
    Negative("pulling away", 4.0, 0.20, pulls_away=True),
    Negative("braking", 6.0, 0.15, brakes=True, rough=True),
)
