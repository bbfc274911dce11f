"""The bank of tracks: evidence that moves on with the car, by speed and place."""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
import numpy as np

from jaxradar._numerics import written_out
from jaxradar.systems.step.approach_states import Bank, Places, Speeds

__all__ = ["cost", "largest_place", "means_around", "moved_on"]

LONGEST_JUMP = 5  # places that evidence may move on within one sweep: at 45 km/h and 100 Hz it moves on by four


def cost(tilt: Places) -> Places:
    """c(γ), see the module; e^(γ²/4), which overflows for large γ, taken out of the logarithm."""
    factor = 0.5 * math.sqrt(math.pi) * tilt * (1.0 + jax.scipy.special.erf(0.5 * tilt))
    return 0.25 * tilt**2 + jnp.log(jnp.exp(-0.25 * tilt**2) + factor)


def means_around(cells: int, reach: int) -> np.ndarray:
    """(cells, cells): means over `reach` cells to either side, the first and the last repeated."""
    means = np.zeros((cells, cells))
    for offset in range(-reach, reach + 1):
        np.add.at(means, (np.arange(cells), np.clip(np.arange(cells) + offset, 0, cells - 1)), 1.0 / (2 * reach + 1))
    return means


def moved_on(evidence: Bank, travel: Speeds, places: Speeds) -> tuple[Bank, Speeds]:
    """Evidence of each speed moved by the whole number of places nearest to its way, the rest kept for later; dropped
    where that is more than `LONGEST_JUMP`."""
    way = travel + places
    whole = jnp.floor(jax.lax.stop_gradient(way) + 0.5)
    count = evidence.shape[1]
    # Written out before it is read at each of the shifts: padding inside a loop leaves it no vectors.
    nothing = jnp.zeros_like(evidence[:, :1])
    wide = written_out(jnp.concatenate([nothing] * LONGEST_JUMP + [evidence], axis=1))
    moved = jnp.where((whole == 0)[:, None], evidence, 0.0)
    for jump in range(1, LONGEST_JUMP + 1):
        start = LONGEST_JUMP - jump
        moved = jnp.where((whole == jump)[:, None], wide[:, start : start + count], moved)
    return moved, way - whole


def largest_place(evidence: Bank) -> tuple[Speeds, Speeds]:
    """The most evidence of each speed, and its place, the first of equals: by two reductions, as an arg-max goes
    through the numbers one by one."""
    most = jnp.max(evidence, axis=1)
    count = evidence.shape[1]
    place = jnp.arange(count, dtype=evidence.dtype).reshape(-1, *[1] * (evidence.ndim - 2))
    return most, jnp.min(jnp.where(evidence == most[:, None], place, count - 1), axis=1)
