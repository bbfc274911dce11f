"""Road roughness by class: ISO 8608."""

from __future__ import annotations

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from jaxradar._settings import Settings, choice_setting

__all__ = ["CLASSES", "Roughness", "RoughnessTable", "rough_height", "rough_table"]

# Displacement spectral density at 0.1 cycles/m in m³, the middle of each class (ISO 8608:2016, table C.1).
CLASSES = {"A": 16e-6, "B": 64e-6, "C": 256e-6, "D": 1024e-6, "E": 4096e-6}
REFERENCE_PER_M = 0.1
BAND_PER_M = (0.011, 2.83)  # cycles/m within which the classes are defined
WAVES = 96
SPACING_M = 0.02


class Roughness(Settings):
    """An even road of a class from A (very good) to E: density Gd(n) = Gd(n₀) (n/n₀)⁻², the same across the road."""

    grade: str = choice_setting("B", tuple(CLASSES), "class of ISO 8608")


class RoughnessTable(NamedTuple):
    """Heights in metres, `SPACING_M` apart from `start_m` on."""

    start_m: float
    height_m: Float[Array, " points"]


def rough_table(roughness: Roughness, start_m: float, end_m: float, key: PRNGKeyArray) -> RoughnessTable:
    """A realisation between two places, as a sum of waves of random phase (Cebon, Handbook of Vehicle-Road Interaction,
    section 2.5); a place's height does not depend on how long the table is. It is 0 where the scene begins."""
    edges = np.geomspace(*BAND_PER_M, WAVES + 1)
    middle = np.sqrt(edges[:-1] * edges[1:])
    density = CLASSES[roughness.grade] * (middle / REFERENCE_PER_M) ** -2
    amplitude = np.sqrt(2.0 * density * np.diff(edges))
    phase = jax.random.uniform(key, (WAVES,), jnp.float64, 0.0, 2.0 * math.pi)
    count = math.ceil((end_m - start_m) / SPACING_M) + 2
    places = start_m + SPACING_M * jnp.arange(count)
    waves = jnp.sin(2.0 * math.pi * middle * places[:, None] + phase) - jnp.sin(phase)
    return RoughnessTable(start_m, waves @ jnp.asarray(amplitude))


def rough_height(table: RoughnessTable, x_m: Float[Array, "*points"]) -> Float[Array, "*points"]:
    """Height between the points of the table, linear."""
    place = (x_m - table.start_m) / SPACING_M
    whole = jnp.clip(jnp.floor(place).astype(jnp.int32), 0, len(table.height_m) - 2)
    share = jnp.clip(place - whole, 0.0, 1.0)
    heights = table.height_m.astype(x_m.dtype)
    return heights[whole] * (1.0 - share) + heights[whole + 1] * share
