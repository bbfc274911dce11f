"""The strongest echo of a sweep that was averaged into range cells."""

from __future__ import annotations

import jax.numpy as jnp

from jaxradar._numerics import select_largest
from jaxradar._types import Counts, Scalar
from jaxradar.signal.peaks import vertex

__all__ = ["strongest_cell"]


def strongest_cell(cells: Counts, level: Scalar | float = 0.0, weights: Counts | None = None) -> tuple[Scalar, Scalar]:
    """Where the strongest echo lies, in cells and their fractions (a cell's middle is at ½), and how far it rises above
    `level` (0 if it does not).

    The largest mean of three neighbouring cells is looked for, as one rough cell is not an echo, of products with the
    `weights` if there are any; the first and the last cell count twice there. Among these three the place is that of
    the largest cell, between two patches of road being on neither.
    """
    last = cells.shape[0] - 1

    def around(middle: int) -> list[Scalar]:
        return [cells[min(max(middle + k, 0), last)] for k in (-2, -1, 0, 1, 2)]

    over = [jnp.maximum((sum(around(j)[1:4]) / 3.0 - level), 0.0) for j in range(last + 1)]
    by = over if weights is None else [one * weight for one, weight in zip(over, weights, strict=True)]
    middle, _, strength, *five = select_largest([(by[j], over[j], *around(j)) for j in range(last + 1)])
    trios = [tuple(five[k : k + 3]) for k in range(3)]
    left, right = trios[0][1] > trios[1][1], trios[2][1] > jnp.maximum(trios[0][1], trios[1][1])
    top = [jnp.where(right, c, jnp.where(left, a, b)) for a, b, c in zip(*trios, strict=True)]
    beside = jnp.where(right, 1, jnp.where(left, -1, 0))
    cell = jnp.clip(middle + beside, 0, last)
    # A cell at an end has one neighbour, which makes no parabola: its middle is all that is known.
    between = jnp.where((cell == 0) | (cell == last), 0.0, vertex(*top)[0])
    return cell + 0.5 + between, strength
