"""Guarded arithmetic, reductions in the shape that the processor wants, and how programs are compiled."""

from jaxradar._numerics.arg_max import first_argmax, first_largest, packed_largest, select_largest, value_at
from jaxradar._numerics.compilation import compiled, compiled_filtered, row_major
from jaxradar._numerics.guards import (
    as_scalar,
    finite,
    nonnegative,
    safe_divide,
    safe_sqrt,
    soft_exceeds,
)
from jaxradar._numerics.operations import operations
from jaxradar._numerics.staged import (
    cpu_shaped,
    largest,
    largest_of,
    largest_row,
    reductions,
    sliced,
    smallest,
    summed,
    total,
    totals,
    tree,
    written_out,
)
from jaxradar._numerics.trigonometry import angle_of, cosine_sine

__all__ = [
    "angle_of",
    "as_scalar",
    "compiled",
    "compiled_filtered",
    "cosine_sine",
    "cpu_shaped",
    "finite",
    "first_argmax",
    "first_largest",
    "largest",
    "largest_of",
    "largest_row",
    "nonnegative",
    "operations",
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
    "tree",
    "value_at",
    "written_out",
]
