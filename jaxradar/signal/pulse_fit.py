"""The place of a pulse by one closed-form step from the largest cell: the least time that the bound can be met in."""

from __future__ import annotations

import math
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jaxradar._numerics import as_scalar, finite, first_argmax, largest, safe_divide, select_largest, total
from jaxradar._types import Counts, Index, RawSweep, Scalar, Setting, Sweep
from jaxradar.signal.peaks import Peak, PeakEstimator, vertex, window_at
from jaxradar.signal.pulses import SIGMA_PER_FWHM

__all__ = ["PulseFit", "strongest_cell"]

TEMPLATE_REACH = 1.5  # widths to either side: what lies beyond has a weight of 2e-3 and less
NARROWEST = 1.0  # bins; a narrower template sees one bin alone


def strongest_cell(cells: Counts, level: Scalar | float = 0.0, weights: Counts | None = None) -> tuple[Scalar, Scalar]:
    """Where the strongest echo lies, in cells and their fractions (a cell's middle is at ½), and how far it rises above
    `level` (0 if it does not).

    The largest mean of three neighbouring cells is looked for, as one rough cell is not an echo, of products with the
    `weights` if there are any; the first and the last cell count twice. Among these three the place is that of the
    largest cell, between two patches of road being on neither.
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
    return jnp.clip(middle + beside, 0, last) + 0.5 + vertex(*top)[0], strength


class PulseFit(PeakEstimator):
    """One Newton step on the logarithm of the correlation with a Gaussian of `fwhm` bins.

    Where the echo is a Gaussian, so is its correlation c(δ) with the template, and its logarithm a parabola: one step
    −(log c)'/(log c)'' from anywhere near leads to the top, whatever the width of the two. With a template of the
    echo's own width that is the maximum-likelihood estimate in white noise (Van Trees, Detection, Estimation, and
    Modulation Theory I, section 4.2.3). A template narrower by a share q costs ((q² + 1)/(2 q))^1.5 of accuracy there;
    in noise that is as smooth as the echo itself, which a real sensor's is, a narrow one is better.

    The step begins at the largest bin or, with `cell` above 1, in the middle of the three neighbouring cells of so
    many bins that hold most: what a single bin of noise does not move. It is at most half a width long. `half_width`:
    bins to either side that are looked at; at the ends they are moved inwards.
    """

    fwhm: Setting = eqx.field(converter=as_scalar, default=8.0)
    half_width: int = eqx.field(static=True, default=12)
    cell: int = eqx.field(static=True, default=1)

    @classmethod
    def of_width(cls, fwhm: float, *, cell: int | None = None) -> PulseFit:
        """For a template of `fwhm` bins with all of its bins, and cells (or so many bins each) of half its width."""
        fwhm = max(float(fwhm), NARROWEST)
        return cls(fwhm, math.ceil(TEMPLATE_REACH * fwhm), max(1, round(0.5 * fwhm)) if cell is None else cell)

    def __check_init__(self) -> None:
        if isinstance(self.fwhm, np.ndarray) and not self.fwhm >= NARROWEST:
            raise ValueError(f"`PulseFit(fwhm=...)` must be >= {NARROWEST} bins; got {self.fwhm}.")
        for name in ("half_width", "cell"):
            if getattr(self, name) < 1:
                raise ValueError(f"`PulseFit({name}=...)` must be >= 1; got {getattr(self, name)}.")

    def __call__(self, sweep: RawSweep, near: Index | None = None) -> Peak:
        if near is None:
            near = self.search(self.cells(sweep), sweep.shape[0])
        return self.place(near, *self.read(sweep, near))

    def cells(self, sweep: RawSweep) -> Counts:
        """The sums over cells; what is left over at the end is left out."""
        size = min(self.cell, max(1, sweep.shape[0] // 3))
        count = sweep.shape[0] // size
        values = finite(sweep)
        return values if size == 1 else jnp.sum(values[: count * size].reshape(count, size), axis=1)

    def search(self, cells: Counts, bins: int) -> Index:
        """The bin to begin with."""
        if cells.shape[0] == bins:
            return first_argmax(cells)
        size = bins // cells.shape[0]
        return jnp.round(strongest_cell(cells)[0] * size - 0.5).astype(jnp.int32)

    def read(self, sweep: RawSweep, near: Index) -> tuple[Index, Any]:
        """The first bin that is looked at, and the amplitudes from there."""
        return window_at(sweep, near, min(self.half_width, (sweep.shape[0] - 1) // 2))

    def place(self, near: Index, start: Index, taps: RawSweep) -> Peak:
        """Where the peak is near the bin `near`, from the amplitudes that begin with the bin `start`."""
        values = finite(taps)
        amplitude = largest(values)
        found = amplitude > 0
        begin = jnp.asarray(near - start).astype(values.dtype)
        position = start + self.within(values, begin)
        return Peak(jnp.where(found, position, 0.0), amplitude, found)

    def within(self, taps: Sweep, near: Scalar) -> Scalar:
        """Position near another one, both in bins from the first of an odd number of taps."""
        middle = (taps.shape[0] - 1) // 2
        sigma = SIGMA_PER_FWHM * jnp.asarray(self.fwhm, taps.dtype)
        offset = jnp.arange(-middle, middle + 1, dtype=taps.dtype) / sigma
        weight = jnp.exp(-0.5 * offset * offset)
        # Of numbers up to 1, so that neither tiny nor huge amplitudes leave the range of the type.
        shares = safe_divide(taps, jnp.broadcast_to(largest(jnp.abs(taps)), taps.shape))
        most = total(shares * weight)
        rise = safe_divide(total(shares * (weight * offset)), most)
        bend = safe_divide(total(shares * (weight * (offset * offset - 1.0))), most) - rise * rise
        peaked = (most > 0) & (bend < 0)
        # Of the template in the window's middle, which is that bin but for the ends of the sweep.
        top = middle + sigma * jnp.where(peaked, -rise / jnp.where(peaked, bend, -1.0), 0.0)
        longest = 0.5 * jnp.asarray(self.fwhm, taps.dtype)
        # Nor out of the window: from a ramp, or an echo that an end cuts off, the step would lead out of the sweep.
        return jnp.clip(top, jnp.maximum(near - longest, 0.0), jnp.minimum(near + longest, 2.0 * middle))
