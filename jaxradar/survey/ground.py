"""What a flat road sends back over range, in the mean: the echo power of its speckle, bin by bin.

A patch of road dA at the slant range r, seen at θ from the vertical, adds to the mean square of the envelope

    G(θ) σ⁰(θ) r^(−2n) dA · p(r − r_bin)²,  σ⁰ = F exp(−tan²θ/(2 s²))/cos⁴θ + L cos²θ,

facets of rms slope s (Barrick, IEEE Trans. AP-16, 1968) and a grain by Lambert's law, through a Gaussian beam there and
back (4^−((α/α_hp)² + (β/β_hp)²), α_hp the half-power width one way) and a Gaussian pulse p: the phases of patches are
independent, so powers add (Goodman, Speckle Phenomena in Optics, section 2.2). Receiver noise adds its own.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxradar._settings import Settings, setting, shape_setting
from jaxradar._types import Setting, Value
from jaxradar.signal.pulses import SIGMA_PER_FWHM

__all__ = ["Beam", "Ground", "ground_profile", "strip_patches", "strip_powers", "strips_of"]

ACROSS = 8  # places on either side, of Gauss and Legendre's rule
STEEPEST_COS = 0.02


class Beam(Settings):
    """What the sensor is like; defaults of an A111 as it is recorded."""

    fwhm_m: Setting = setting(0.06, 1e-3, 1.0, "m", "width of an echo's amplitude at half its height")
    vertical_beam_deg: Setting = setting(55.0, 0.1, 360.0, "°", "half-power width, one way, in the vertical plane")
    lateral_beam_deg: Setting = setting(80.0, 0.1, 360.0, "°", "half-power width, one way, across it")
    exponent: Setting = setting(2.0, 0.0, 8.0, "", "the amplitude of an echo falls as range to this power")
    half_width_m: Setting = setting(0.5, 0.01, 5.0, "m", "of the strip of road that reflects, left and right")
    strip_m: float = shape_setting(0.015, 1e-3, 0.1, "m", "length of the strips that the road is cut into")


class Ground(NamedTuple):
    """A sensor over a road, each a scalar: its height in metres, the angle between its line of sight and the road in
    radians, logarithms of the facets' slope, of the power of facets and grain (F and L above, in counts² m^(2n−2)) and
    of the noise (counts²)."""

    height_m: Value
    down_rad: Value
    log_slope: Value
    log_facets: Value
    log_grain: Value
    log_noise: Value


def strips_of(beam: Beam, farthest_m: float) -> Float[np.ndarray, " strips"]:
    """Middles of the strips that are seen within a slant range, metres ahead of the sensor's foot, in order."""
    reach = farthest_m + 4.0 * SIGMA_PER_FWHM * float(beam.fwhm_m)
    return np.arange(-0.5 * reach, reach, beam.strip_m) + 0.5 * beam.strip_m


def strip_patches(
    beam: Beam, ground: Ground, height_m: Value, strips_m: Float[Array | np.ndarray, " strips"]
) -> tuple[Float[Array, "strips across"], Float[Array, "strips across"]]:
    """Slant range of the patches of each strip of a road `height_m` below the sensor, and the power of each, counts²
    in the middle of its pulse."""
    # Closer together near the middle, where a smooth road reflects most: y = w t².
    nodes, weights = np.polynomial.legendre.leggauss(ACROSS)
    turn = 0.5 * (nodes + 1.0)
    x = jnp.asarray(strips_m, float)[:, None]
    y = beam.half_width_m * jnp.asarray(turn**2, float)
    reach2 = x**2 + y**2 + height_m**2
    cos2 = height_m**2 / reach2
    lit = cos2 > STEEPEST_COS**2
    cos2 = jnp.where(lit, cos2, 1.0)
    facets = ground.log_facets - 0.5 * (1.0 / cos2 - 1.0) * jnp.exp(-2.0 * ground.log_slope)
    echo = jnp.exp(facets) / cos2**2 + jnp.exp(ground.log_grain) * cos2
    off = jnp.arctan2(height_m, x) - ground.down_rad
    across = jnp.arctan2(y, jnp.sqrt(x**2 + height_m**2))
    half_power = math.pi / 180.0
    there_and_back = (off / (beam.vertical_beam_deg * half_power)) ** 2
    there_and_back = there_and_back + (across / (beam.lateral_beam_deg * half_power)) ** 2
    area = 2.0 * beam.strip_m * beam.half_width_m * jnp.asarray(turn * weights, float)  # both sides
    exponent = -8.0 * math.log(2.0) * there_and_back - beam.exponent * jnp.log(reach2)
    power = jnp.where(lit, echo * jnp.exp(exponent) * area, 0.0)
    return jnp.sqrt(reach2), power


def strip_powers(
    beam: Beam,
    ground: Ground,
    height_m: Value,
    strips_m: Float[Array | np.ndarray, " strips"],
    range_m: Float[Array | np.ndarray, " bins"],
) -> Float[Array, "strips bins"]:
    """Mean square in counts² that each strip of a road `height_m` below the sensor adds to each bin, without noise."""
    reach, power = strip_patches(beam, ground, height_m, strips_m)
    sigma = SIGMA_PER_FWHM * beam.fwhm_m
    pulses = jnp.exp(-(((reach[..., None] - jnp.asarray(range_m, float)) / sigma) ** 2))
    return jnp.sum(power[..., None] * pulses, axis=1)


def ground_profile(
    beam: Beam,
    ground: Ground,
    strips_m: Float[Array | np.ndarray, " strips"],
    range_m: Float[Array | np.ndarray, " bins"],
) -> Float[Array, " bins"]:
    """Mean square of the envelope over a flat road in counts², with noise."""
    return jnp.sum(strip_powers(beam, ground, ground.height_m, strips_m, range_m), axis=0) + jnp.exp(ground.log_noise)
