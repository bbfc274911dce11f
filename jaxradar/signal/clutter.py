"""What is there without an echo: the noise floor of a single sweep."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp

from jaxradar._numerics import masked_moments, safe_divide, safe_sqrt
from jaxradar._types import Counts, Scalar

__all__ = ["NoiseFloor", "noise_floor"]


class NoiseFloor(eqx.Module):
    """`level`: mean of the cells without an echo; `scatter`: standard deviation of their noise. Both in counts."""

    level: Scalar
    scatter: Scalar


def noise_floor(cells: Counts) -> NoiseFloor:
    """Floor of one sweep out of the sweep itself.

    The level is the mean of all cells that lie at or below the mean of the sweep: one step of sigma clipping, from
    above alone since echoes only add. The scatter comes from the differences of neighbouring cells among these, over
    √2 (von Neumann, Ann. Math. Stat. 12, 1941: successive differences do not see a slow trend): the flank of a strong
    echo and a sloping floor are not noise. Of a floor of Rayleigh noise that is white over cells, with mean μ and
    standard deviation .52 μ, the level is .61 μ and the scatter .24 μ, since both look only below the mean.
    """
    cells = jnp.asarray(cells)
    # Of equal cells, the mean may be rounded to below them all.
    quiet = cells <= jnp.maximum(jnp.mean(cells), jnp.min(cells))
    level, _ = masked_moments(cells, quiet)
    pairs = quiet[1:] & quiet[:-1]
    steps = jnp.where(pairs, cells[1:] - cells[:-1], 0.0)
    variance = 0.5 * safe_divide(jnp.sum(steps * steps), jnp.sum(pairs).astype(cells.dtype))
    return NoiseFloor(level, safe_sqrt(variance))
