"""What a road may hold: steps, kerbs, humps, potholes, each crossing it at any angle; their heights add up.

An element is placed by where the middle line of the car's path crosses its beginning (`at_m`, from where the sensor is
at the start of the scene) and by the angle `oblique_deg` between its edge and the crosswise direction: at 20° the left
wheel, y > 0, comes there half a track times tan 20° before the middle. Its height is a function of the distance *s*
beyond the edge, measured across the edge. Vertical faces are told apart (`faces`), because they are what a radar sees
as a corner and what a tyre touches first.
"""

from __future__ import annotations

import abc
import math
from typing import ClassVar, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxradar._settings import Settings, setting
from jaxradar._types import Setting

__all__ = [
    "ELEMENTS",
    "Face",
    "FlatTopHump",
    "Kerb",
    "Pothole",
    "RoadElement",
    "SinusoidalHump",
    "StepDown",
    "StepUp",
    "beyond_edge",
]

Heights = Float[Array, "*points"]


class Face(NamedTuple):
    """A wall across the road at a distance `at_m` beyond the element's edge, `height_m` high, rising in the direction
    of travel (`rises`) or falling; `lean_rad` from the vertical."""

    at_m: Float[Array, ""]
    height_m: Float[Array, ""]
    rises: bool
    lean_rad: Float[Array, ""]


class RoadElement(Settings):
    """Base of what lies on or in the road."""

    name: ClassVar[str]

    at_m: Setting = setting(0.0, -1e5, 1e5, "m", "where the middle of the path crosses its edge")
    oblique_deg: Setting = setting(
        0.0, -60.0, 60.0, "°", "of its edge to the crosswise direction; above 0 the left wheel is first"
    )

    @abc.abstractmethod
    def profile(self, beyond_m: Heights) -> Heights:
        """Height in metres at a distance beyond the edge."""

    def faces(self) -> tuple[Face, ...]:
        """Its walls, in the direction of travel."""
        return ()

    @property
    @abc.abstractmethod
    def step_m(self) -> Setting:
        """What truth calls its height, positive upwards."""


def beyond_edge(element: RoadElement, x_m: Heights, y_m: Heights) -> Heights:
    """Distance across the edge from it to points of the road, positive beyond it."""
    dtype = jnp.result_type(x_m)
    angle = jnp.asarray(element.oblique_deg, dtype) * (math.pi / 180.0)
    return (x_m - jnp.asarray(element.at_m, dtype)) * jnp.cos(angle) + y_m * jnp.sin(angle)


class StepUp(RoadElement):
    """The road goes on higher: the thesis's step."""

    name: ClassVar[str] = "step-up"

    height_m: Setting = setting(0.04, 0.0, 1.0, "m", "of the new road over the old")

    def profile(self, beyond_m: Heights) -> Heights:
        return jnp.where(beyond_m >= 0, jnp.asarray(self.height_m, beyond_m.dtype), 0.0)

    def faces(self) -> tuple[Face, ...]:
        return (_face(0.0, self.height_m, True),)

    @property
    def step_m(self) -> Setting:
        return self.height_m


class StepDown(RoadElement):
    """The road goes on lower."""

    name: ClassVar[str] = "step-down"

    height_m: Setting = setting(0.04, 0.0, 1.0, "m", "of the old road over the new")

    def profile(self, beyond_m: Heights) -> Heights:
        return jnp.where(beyond_m >= 0, -jnp.asarray(self.height_m, beyond_m.dtype), 0.0)

    def faces(self) -> tuple[Face, ...]:
        return (_face(0.0, self.height_m, False),)

    @property
    def step_m(self) -> Setting:
        return -self.height_m


class Kerb(StepUp):
    """A step up whose face leans back, so that its corner is no right angle."""

    name: ClassVar[str] = "kerb"

    height_m: Setting = setting(0.1, 0.0, 1.0, "m", "of its top over the road")
    lean_deg: Setting = setting(12.0, 0.0, 45.0, "°", "of its face from the vertical (assumed)")

    def faces(self) -> tuple[Face, ...]:
        return (_face(0.0, self.height_m, True, self.lean_deg),)


class SinusoidalHump(RoadElement):
    """One period of a raised cosine, as traffic-calming humps are built: 3.7 m long and 75 mm high (Webster and
    Layfield, TRL Report 377, 1998)."""

    name: ClassVar[str] = "sinusoidal-hump"

    height_m: Setting = setting(0.075, 0.0, 1.0, "m", "of its crest")
    along_m: Setting = setting(3.7, 0.05, 100.0, "m", "its length along the road")

    def profile(self, beyond_m: Heights) -> Heights:
        share = beyond_m / jnp.asarray(self.along_m, beyond_m.dtype)
        inside = (share > 0) & (share < 1)
        height = jnp.asarray(self.height_m, beyond_m.dtype)
        return jnp.where(inside, 0.5 * height * (1.0 - jnp.cos(2.0 * math.pi * share)), 0.0)

    @property
    def step_m(self) -> Setting:
        return self.height_m


class FlatTopHump(RoadElement):
    """Two straight ramps and a level between them: ramps of 1 in 13, 75 mm high, 6 m long on top (Department for
    Transport, Traffic Advisory Leaflet 10/00)."""

    name: ClassVar[str] = "flat-top-hump"

    height_m: Setting = setting(0.075, 0.0, 1.0, "m", "of its top")
    ramp_m: Setting = setting(1.0, 0.01, 20.0, "m", "length of each ramp")
    top_m: Setting = setting(6.0, 0.0, 100.0, "m", "length of its top")

    def profile(self, beyond_m: Heights) -> Heights:
        dtype = beyond_m.dtype
        ramp, top = jnp.asarray(self.ramp_m, dtype), jnp.asarray(self.top_m, dtype)
        up, down = beyond_m / ramp, (2.0 * ramp + top - beyond_m) / ramp
        return jnp.asarray(self.height_m, dtype) * jnp.clip(jnp.minimum(up, down), 0.0, 1.0)

    @property
    def step_m(self) -> Setting:
        return self.height_m


class Pothole(RoadElement):
    """A trough across the path with two walls."""

    name: ClassVar[str] = "pothole"

    depth_m: Setting = setting(0.05, 0.0, 0.5, "m", "of its bottom")
    along_m: Setting = setting(0.5, 0.02, 10.0, "m", "its length along the road")

    def profile(self, beyond_m: Heights) -> Heights:
        inside = (beyond_m >= 0) & (beyond_m < jnp.asarray(self.along_m, beyond_m.dtype))
        return jnp.where(inside, -jnp.asarray(self.depth_m, beyond_m.dtype), 0.0)

    def faces(self) -> tuple[Face, ...]:
        return (_face(0.0, self.depth_m, False), _face(self.along_m, self.depth_m, True))

    @property
    def step_m(self) -> Setting:
        return -self.depth_m


def _face(at_m: Setting, height_m: Setting, rises: bool, lean_deg: Setting = 0.0) -> Face:
    return Face(jnp.asarray(at_m), jnp.asarray(height_m), rises, jnp.asarray(lean_deg) * (math.pi / 180.0))


ELEMENTS: dict[str, type[RoadElement]] = {
    kind.name: kind for kind in (StepUp, StepDown, Kerb, SinusoidalHump, FlatTopHump, Pothole)
}
