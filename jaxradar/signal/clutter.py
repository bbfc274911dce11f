"""What is there without an echo: the noise floor of a single sweep."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxradar._numerics import safe_divide, safe_sqrt, total, totals
from jaxradar._types import Counts, Scalar

__all__ = ["NoiseFloor", "noise_floor", "subtract_floor"]


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
    # The mean of equal cells may be rounded to below them all.
    mean = (1.0 + 4.0 * jnp.finfo(cells.dtype).eps) * total(cells) / cells.shape[0]

    def quiet_cells(cell: Any) -> tuple[Any, Any]:
        quiet = cell <= mean
        return quiet.astype(cell.dtype), jnp.where(quiet, cell, 0.0)

    # What is squared is a share of the mean: float32 holds no square of 1e20 or of 1e-23.
    scale = jax.lax.stop_gradient(jnp.where(mean == 0, 1.0, jnp.abs(mean)))
    inverse = 1.0 / scale

    def quiet_pairs(cell: Any, before: Any) -> tuple[Any, Any]:
        quiet = (cell <= mean) & (before <= mean)
        step = jnp.where(quiet, (cell - before) * inverse, 0.0)
        return quiet.astype(cell.dtype), step * step

    count, level = totals(quiet_cells, cells)
    pairs, squares = totals(quiet_pairs, cells[1:], cells[:-1])
    return NoiseFloor(safe_divide(level, count), scale * safe_sqrt(0.5 * safe_divide(squares, pairs)))


def subtract_floor(cells: Counts, level: Scalar) -> Counts:
    """The amplitudes over a floor of this level, 0 where they are below it.

    A tenth of the floor is taken away beyond it: that keeps its own unevenness out.
    """
    return jnp.maximum(cells - 1.1 * level, 0.0)
