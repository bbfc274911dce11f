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

from jaxradar._types import Setting, Value
from jaxradar.sim.road.surface import Surface, coherent_share, reflectivity

__all__ = ["Wall", "corner_area", "corner_share", "lit_share"]

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(24)


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
    A face that leans by δ turns its ray by 2δ: k (u²/R + 2 δ u). For w and δ small, and a breadth b, the cross-section
    4π A²/λ² is 8π b² h²/λ² at 45°, the textbook's (Knott, Shaeffer and Tuley, Radar Cross Section, table 6.2).
    """
    dtype = range_m.dtype
    k = 2.0 * math.pi / jnp.asarray(wavelength_m, dtype)
    half = height_m * sine
    u = half * jnp.asarray(_NODES, dtype)
    phase = k * (u**2 / range_m + 2.0 * lean_rad * u)
    weights = half * jnp.asarray(_WEIGHTS, dtype)
    breadth = jnp.sqrt(0.5 * jnp.asarray(wavelength_m, dtype) * range_m)
    real, imag = jnp.sum(weights * jnp.cos(phase)), -jnp.sum(weights * jnp.sin(phase))
    # times e^(−jπ/4)
    return breadth * math.sqrt(0.5) * (real + imag), breadth * math.sqrt(0.5) * (imag - real)


def corner_share(surface: Surface, sine: Value, cosine: Value, wavelength_m: Setting) -> Value:
    """What two reflections leave of the amplitude: one by the road at θ, one by the face at 90° − θ. For each the
    reflectivity at normal incidence is taken, which both polarisations together keep to within a third up to 60°."""
    rough = coherent_share(surface, cosine, wavelength_m) * coherent_share(surface, sine, wavelength_m)
    return jnp.asarray(reflectivity(surface.permittivity), cosine.dtype) * rough


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
