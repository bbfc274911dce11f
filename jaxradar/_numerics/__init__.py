"""Guarded arithmetic, reductions in the shape that the processor wants, and how programs are compiled."""

from jaxradar._numerics.compilation import compiled
from jaxradar._numerics.guards import as_scalar, finite, masked_moments, safe_divide, safe_sqrt, soft_exceeds
from jaxradar._numerics.staged import (
    cpu_shaped,
    first_argmax,
    first_largest,
    largest,
    packed_largest,
    reductions,
    smallest,
    total,
    totals,
)

__all__ = [
    "as_scalar",
    "compiled",
    "cpu_shaped",
    "finite",
    "first_argmax",
    "first_largest",
    "largest",
    "masked_moments",
    "packed_largest",
    "reductions",
    "safe_divide",
    "safe_sqrt",
    "smallest",
    "soft_exceeds",
    "total",
    "totals",
]
