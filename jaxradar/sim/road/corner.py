"""A wall across the road: the corner that it forms with the road before it, and the shadow that it throws behind it.

A face that rises in the direction of travel and the road before it send a ray back to where it came from, whatever its
angle in the vertical plane: the brightest thing on a road. Its strength is not chosen. It is that of a dihedral corner
of the face's height, as long as the first Fresnel zone, of the road's own reflectivity and roughness.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxradar._numerics import cosine_sine
from jaxradar._types import Setting, Value
from jaxradar.sim.road.surface import Surface, coherent_share, fresnel

__all__ = ["Wall", "corner_area", "corner_share", "lit_share"]

# On (0, 1); right to 1 % up to a phase of 250 rad over the face, which 0.3 m has at 0.46 m.
_NODES, _WEIGHTS = (0.5 * (np.polynomial.legendre.leggauss(128)[part] + (1 - part)) for part in (0, 1))


class Wall(NamedTuple):
    """A face as one sweep sees it. `ahead_m`: distance from the sensor's foot to it, measured across the edge (below 0
    when it is behind); `turn_rad`: between the edge and the crosswise direction; `low_m`, `high_m`: the height of the
    road at the foot of the face and at its top, of the point of it that is nearest."""

    ahead_m: Value
    turn_rad: Value
    low_m: Value
    high_m: Value
    lean_rad: Value


def corner_area(
    height_m: Value, sine: Value, range_m: Value, lean_rad: Value, wavelength_m: Setting
) -> tuple[Value, Value]:
    """Real and imaginary part of the effective area in m² of a corner with a face `height_m` high.

    A ray that reaches the face at height z is displaced by z sin θ (θ from the vertical), one that reaches the road
    first as far the other way: an aperture w = 2 h sin θ, ∫ exp(−j k u²/R) du over which (the image of the sensor lies
    at 2R) is the height of the area, and √(λR/2) e^(−jπ/4), the same integral over an edge without end, its breadth.
    A face that leans by δ turns its ray by 2δ, and the one that comes the other way round just so: k (u²/R + 2 δ |u|).
    For w and δ small, and a breadth b, the cross-section 4π A²/λ² is 8π b² h²/λ² at 45°, the textbook's (Knott,
    Shaeffer and Tuley, Radar Cross Section, table 6.2).
    """
    dtype = range_m.dtype
    half = height_m * sine
    u = half * jnp.asarray(_NODES, dtype)
    cosine, sine_of = cosine_sine((u**2 / range_m + 2.0 * lean_rad * u) / jnp.asarray(wavelength_m, dtype))
    weights = 2.0 * half * jnp.asarray(_WEIGHTS, dtype)
    breadth = jnp.sqrt(0.5 * jnp.asarray(wavelength_m, dtype) * range_m)
    real, imag = jnp.sum(weights * cosine), -jnp.sum(weights * sine_of)
    # times e^(−jπ/4)
    return breadth * math.sqrt(0.5) * (real + imag), breadth * math.sqrt(0.5) * (imag - real)


def corner_share(surface: Surface, polarisation: str, sine: Value, cosine: Value, wavelength_m: Setting) -> Value:
    """What two reflections leave of the amplitude: one by the road at θ from its normal, one by the face at 90° − θ."""
    rough = coherent_share(surface, cosine, wavelength_m) * coherent_share(surface, sine, wavelength_m)
    gain = jnp.exp(jnp.asarray(surface.corner_db, cosine.dtype) * (math.log(10.0) / 20.0))
    return gain * rough * fresnel(surface, polarisation, cosine) * fresnel(surface, polarisation, sine)


def lit_share(
    wall: Wall,
    beyond_m: Float[Array, " points"],
    z_m: Float[Array, " points"],
    range_m: Float[Array, " points"],
    sensor_m: Value,
    wavelength_m: Setting,
) -> Float[Array, " points"]:
    """Share of the amplitude, both ways, that comes over the edge of a falling wall to points `beyond_m` it.

    One way ½ erfc(½ √π ν), with ν the edge's height over the ray in Fresnel zones (ITU-R P.526-15, equation 26): it has
    the value and the slope of the knife edge's diffraction at grazing, and stays smooth from light into shadow.
    """
    dtype = range_m.dtype
    ahead = jnp.maximum(wall.ahead_m, 1e-3)
    behind = (beyond_m > 0) & (wall.ahead_m > 0)
    beyond = jnp.where(behind, beyond_m, ahead)
    reach = ahead + beyond
    share = beyond / reach
    over = wall.high_m - (z_m + (sensor_m - z_m) * share)
    across = over * reach / range_m
    zone = 0.5 * jnp.asarray(wavelength_m, dtype) * range_m * share * (1.0 - share)
    one_way = 0.5 * jax.scipy.special.erfc(0.5 * math.sqrt(math.pi) * across / jnp.sqrt(zone))
    return jnp.where(behind, one_way**2, 1.0)
