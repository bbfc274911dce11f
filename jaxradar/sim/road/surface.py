"""How a road reflects: backscatter over the angle of incidence, and what is left of a mirror on a rough face."""

from __future__ import annotations

import math

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxradar._settings import Settings, setting
from jaxradar._types import Setting

__all__ = ["SURFACES", "Surface", "backscatter", "coherent_share", "fresnel", "reflectivity"]


class Surface(Settings):
    """A road as 5 mm waves see it.

    Two parts of backscatter: facets that stand like mirrors across the ray (`slope`: the rms slope of the patches of a
    few wavelengths that such facets are; smooth roads have small ones, and their echo comes from near the vertical),
    and the grain (`grain_db`: backscatter of a rough surface at normal incidence, Lambert's law beyond). `rms_mm` is
    the roughness that a mirror reflection sees. Nobody has measured the corner of a real step with such a radar:
    `corner_db` is there to see what hangs on it.
    """

    permittivity: Setting = setting(5.24, 1.0, 100.0, "", "relative, real part: 5.24 is concrete's (ITU-R P.2040-3)")
    slope: Setting = setting(0.30, 0.01, 2.0, "", "rms slope of the facets")
    grain_db: Setting = setting(-8.1, -60.0, 10.0, "dB", "backscatter of the grain at normal incidence")
    rms_mm: Setting = setting(0.4, 0.0, 50.0, "mm", "rms height of what is smaller than the pulse")
    corner_db: Setting = setting(0.0, -60.0, 60.0, "dB", "echo of a step's corner beyond what the rest makes it")


def reflectivity(permittivity: Setting) -> Float[Array, ""]:
    """Share of the power that a smooth face reflects at normal incidence, Fresnel's |(1 − √ε)/(1 + √ε)|²."""
    root = jnp.sqrt(jnp.asarray(permittivity))
    return ((1.0 - root) / (1.0 + root)) ** 2


def fresnel(surface: Surface, polarisation: str, cosine: Float[Array, "*points"]) -> Float[Array, "*points"]:
    """Amplitude that a smooth face reflects at the cosine of the angle to its normal, of a wave whose electric field
    lies in the plane of incidence ("vertical"; none is left at Brewster's angle, 66° for concrete) or across it
    ("horizontal"). Fresnel's formulas, as in ITU-R P.527-6, section 6; permittivity real."""
    square = jnp.asarray(surface.permittivity, cosine.dtype)
    inside = jnp.sqrt(jnp.maximum(square - 1.0 + cosine**2, 1e-12))
    outside = square * cosine if polarisation == "vertical" else cosine
    return (outside - inside) / (outside + inside)


def backscatter(surface: Surface, cosine: Float[Array, "*points"]) -> Float[Array, "*points"]:
    """Normalised radar cross-section σ⁰ (m² per m²) at the cosine of the local angle of incidence θ.

    Facets: |R|²/(2 s² cos⁴θ) exp(−tan²θ/(2 s²)), geometric optics for a Gaussian surface of rms slope s in each
    direction (Barrick, IEEE Trans. AP-16, 1968, "Rough surface scattering based on the specular point theory"; Ulaby,
    Moore and Fung, Microwave Remote Sensing II, section 12-4). Grain: γ cos²θ, Lambert's law. 0 for a point that
    faces away.
    """
    dtype = cosine.dtype
    lit = cosine > 0.02
    cos2 = jnp.where(lit, cosine, 1.0) ** 2
    slope2 = jnp.asarray(surface.slope, dtype) ** 2
    facets = jnp.asarray(reflectivity(surface.permittivity), dtype) / (2.0 * slope2 * cos2**2)
    facets = facets * jnp.exp(-(1.0 / cos2 - 1.0) / (2.0 * slope2))
    grain = jnp.exp(jnp.asarray(surface.grain_db, dtype) * (math.log(10.0) / 10.0)) * cos2
    return jnp.where(lit, facets + grain, 0.0)


def coherent_share(surface: Surface, cosine: Float[Array, "*points"], wavelength_m: Setting) -> Float[Array, "*points"]:
    """What roughness of rms height s leaves of the amplitude of a mirror reflection: exp(−½ (4π s cosθ/λ)²).

    Ament, Proc. IRE 41, 1953; Beckmann and Spizzichino, The Scattering of Electromagnetic Waves from Rough Surfaces,
    section 5.3.
    """
    dtype = cosine.dtype
    rms_m = 1e-3 * jnp.asarray(surface.rms_mm, dtype)
    return jnp.exp(-0.5 * (4.0 * math.pi * rms_m * cosine / jnp.asarray(wavelength_m, dtype)) ** 2)


# Slope and grain are fitted to standing recordings of such roads (`scripts/compare_recordings.py`; one place each, so
# good for a factor of 1.5 and 6 dB). Permittivity and roughness are assumed: concrete's for dry mineral roads, for
# water the real one that reflects as much as 11.9 − 19.5j (see `WaterFilm`), for a wet road one in between.
SURFACES: dict[str, Surface] = {
    "asphalt": Surface(),
    "wet-asphalt": Surface(permittivity=20.0, slope=0.21, grain_db=-15.5, rms_mm=0.3),
    "gravel": Surface(slope=0.72, grain_db=-11.3, rms_mm=3.0),
    "cement": Surface(slope=0.32, grain_db=-15.0, rms_mm=0.2),
    "grass": Surface(permittivity=2.0, slope=0.40, grain_db=-9.3, rms_mm=10.0),
    "water": Surface(permittivity=31.0, slope=0.21, grain_db=-15.3, rms_mm=0.2),
}
