"""Guarded arithmetic, reductions in the shape that the processor wants, and how programs are compiled."""

from jaxradar._numerics.compilation import compiled, row_major
from jaxradar._numerics.guards import (
    as_scalar,
    finite,
    nonnegative,
    safe_divide,
    safe_sqrt,
    soft_exceeds,
)
from jaxradar._numerics.staged import (
    cpu_shaped,
    first_argmax,
    first_largest,
    largest,
    packed_largest,
    reductions,
    select_largest,
    sliced,
    smallest,
    summed,
    total,
    totals,
    value_at,
)

__all__ = [
    "as_scalar",
    "compiled",
    "cpu_shaped",
    "finite",
    "first_argmax",
    "first_largest",
    "largest",
    "nonnegative",
    "packed_largest",
    "reductions",
    "row_major",
    "safe_divide",
    "safe_sqrt",
    "select_largest",
    "sliced",
    "smallest",
    "soft_exceeds",
    "summed",
    "total",
    "totals",
    "value_at",
]
