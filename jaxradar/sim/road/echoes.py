"""The echoes of one sweep: what the road's points and corners send back to where the sensor is at that moment."""

from __future__ import annotations

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxradar._numerics import angle_of, cosine_sine
from jaxradar._types import Value
from jaxradar.sim.radar import Echoes, Radar, reach_of
from jaxradar.sim.road.corner import Wall, corner_area, corner_share, lit_share
from jaxradar.sim.road.ground import Points as GroundPoints
from jaxradar.sim.road.surface import Surface, backscatter

__all__ = ["Paths", "Pose", "corner_paths", "ground_paths", "to_echoes"]

Points = Float[Array, "*points"]


class Pose(NamedTuple):
    """Where the sensor is when a sweep is taken, and how it moves. `first_m`: how far ahead of its foot the first of
    the visible points lies; `turn_per_m`: curvature of the path, None in a scene without a curve; `roll_rad`: left side
    up; `down_rad`: between its line of sight and the horizontal."""

    first_m: Value
    height_m: Value
    down_rad: Value
    roll_rad: Value | None
    turn_per_m: Value | None
    lateral_m: Value
    speed_m_s: Value
    climb_m_s: Value


class Paths(NamedTuple):
    """Ways to a reflector and back. `range_m`: slant range; `amplitude`: of its echo in counts; `real` and `imag`: what
    reflection does to the phase; `rate_m_s`: how fast the range grows, None where no effect asks for it; `slope`: how
    the phase turns from range to range in rad/m, None where a sweep's bins are sampled at once."""

    range_m: Points
    amplitude: Points
    real: Points
    imag: Points
    rate_m_s: Points | None = None
    slope: Points | None = None

    def joined(self, other: Paths) -> Paths:
        """Both together, before their phases turn."""
        assert self.slope is None and other.slope is None
        rate = None
        if self.rate_m_s is not None and other.rate_m_s is not None:
            rate = jnp.concatenate([self.rate_m_s, other.rate_m_s])
        both = lambda one, two: jnp.concatenate([one, two])  # noqa: E731
        return Paths(
            both(self.range_m, other.range_m),
            both(self.amplitude, other.amplitude),
            both(self.real, other.real),
            both(self.imag, other.imag),
            rate,
        )


def _beam_exponent(radar: Radar, off_rad: Points, across_rad: Points) -> Points:
    """Logarithm of the amplitude, both ways, at angles off the line of sight: −4 ln 2 (θ/θ_hp)² in each plane.

    θ_hp is where the power is halved one way; power there and back, 2⁻², is an amplitude of 2⁻¹.
    """
    dtype = off_rad.dtype
    vertical, lateral = (
        jnp.asarray(one, dtype) * (math.pi / 180.0) for one in (radar.vertical_beam_deg, radar.lateral_beam_deg)
    )
    return -4.0 * math.log(2.0) * ((off_rad / vertical) ** 2 + (across_rad / lateral) ** 2)


def ground_paths(
    radar: Radar,
    surface: Surface,
    points: GroundPoints,
    spacing_m: float,
    walls: tuple[Wall, ...],
    rates: bool,
    pose: Pose,
) -> Paths:
    """Of the visible points, those in the shadow of a falling wall dimmed."""
    dtype = pose.height_m.dtype
    along = pose.first_m + spacing_m * jnp.arange(len(points.y_m), dtype=dtype)
    x, y = along, points.y_m
    if pose.turn_per_m is not None:
        # The road bends away under a car that goes straight for a moment: second order in the distance.
        x, y = along * (1.0 - pose.turn_per_m * y), y + 0.5 * pose.turn_per_m * along**2
    y = y - pose.lateral_m
    up = -jnp.broadcast_to(pose.height_m, x.shape) if points.z_m is None else points.z_m - pose.height_m
    reach = jnp.sqrt(x**2 + y**2 + up**2)
    cosine = -up / reach
    if points.slope_x is not None and points.slope_y is not None:
        normal = jnp.sqrt(1.0 + points.slope_x**2 + points.slope_y**2)
        cosine = (x * points.slope_x + y * points.slope_y - up) / (reach * normal)
    amplitude = jnp.sqrt(backscatter(surface, cosine)) * _received(radar, pose, x, y, up, reach)
    for wall in walls:
        beyond = x * jnp.cos(wall.turn_rad) + y * jnp.sin(wall.turn_rad) - wall.ahead_m
        amplitude = amplitude * lit_share(wall, beyond, up + pose.height_m, reach, pose.height_m, radar.wavelength_m)
    rate = -(x * pose.speed_m_s + up * pose.climb_m_s) / reach if rates else None
    return Paths(reach, amplitude, points.real, points.imag, rate)


def corner_paths(radar: Radar, surface: Surface, walls: tuple[Wall, ...], rates: bool, pose: Pose) -> Paths:
    """One for each rising wall, at the point of its foot that is nearest."""
    found = []
    for wall in walls:
        x, y = wall.ahead_m * jnp.cos(wall.turn_rad), wall.ahead_m * jnp.sin(wall.turn_rad)
        up = wall.low_m - pose.height_m
        reach = jnp.sqrt(x**2 + y**2 + up**2)
        # Behind the sensor a wall shows its back.
        sine, cosine = jnp.maximum(wall.ahead_m, 0.0) / reach, -up / reach
        area = corner_area(wall.high_m - wall.low_m, sine, reach, wall.lean_rad, radar.wavelength_m)
        strength = (
            2.0 * math.sqrt(math.pi) * corner_share(surface, radar.polarisation, sine, cosine, radar.wavelength_m)
        )
        strength = strength / jnp.asarray(radar.wavelength_m, reach.dtype)
        amplitude = strength * _received(radar, pose, x, y, up, reach)
        rate = -(x * pose.speed_m_s + up * pose.climb_m_s) / reach if rates else None
        # The area is a length squared: it rides on the parts, as it turns the phase.
        found.append(Paths(reach, amplitude, *area, rate))
    together: Paths = jax.tree.map(lambda *parts: jnp.stack(parts), *found)
    return together


def _received(radar: Radar, pose: Pose, x: Points, y: Points, up: Points, reach: Points) -> Points:
    """Counts for a cross-section of 1 m²: gain, beam and range law, 0 far outside the range window."""
    dtype = reach.dtype
    if pose.roll_rad is not None:
        # Into the body's own directions, whose left side is up.
        y, up = y + up * pose.roll_rad, up - y * pose.roll_rad
    # In the vertical plane, off the line of sight; and out of that plane.
    ahead = jnp.sqrt(x**2 + up**2)
    down = jnp.cos(pose.down_rad), jnp.sin(pose.down_rad)
    off = angle_of(-(up * down[0] + x * down[1]) / ahead, (x * down[0] - up * down[1]) / ahead)
    across = angle_of(y / reach, ahead / reach)
    # The beam's and the range law's exponentials in one.
    exponent = _beam_exponent(radar, off, across) - jnp.asarray(radar.exponent, dtype) * jnp.log(reach)
    return jnp.asarray(radar.gain_counts, dtype) * jnp.exp(exponent) * _window(radar, reach)


def _window(radar: Radar, reach: Points) -> Points:
    """1 within the range window and as far outside as a pulse still shows, then smoothly down to 0.

    Shannon's series repeats; what lies beyond must not come in at the other end.
    """
    margin = jnp.asarray(reach_of(radar.fwhm_m), reach.dtype)
    low, high = radar.start_m - margin, radar.start_m + (radar.bins - 1) * radar.bin_m + margin
    width = 0.25 * margin
    into = jnp.clip((reach - (low - width)) / width, 0.0, 1.0)
    out = jnp.clip(((high + width) - reach) / width, 0.0, 1.0)
    return into**2 * (3.0 - 2.0 * into) * out**2 * (3.0 - 2.0 * out)


def to_echoes(radar: Radar, paths: Paths) -> Echoes:
    """With the phase that the way there and back gives, −4π r/λ."""
    dtype = paths.range_m.dtype
    cosine, sine = cosine_sine(paths.range_m * (2.0 / jnp.asarray(radar.wavelength_m, dtype)))
    cos, sin = paths.amplitude * cosine, -paths.amplitude * sine
    real, imag = cos * paths.real - sin * paths.imag, cos * paths.imag + sin * paths.real
    return Echoes(paths.range_m, real, imag, paths.slope)
