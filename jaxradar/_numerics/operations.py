"""How many arithmetic operations a traced program does, loops counted as often as they are gone through."""

from __future__ import annotations

import math
from typing import Any

from jax.extend.core import ClosedJaxpr, Jaxpr

__all__ = ["operations"]

# These move numbers about and compute none.
_MOVES = {
    "broadcast_in_dim",
    "concatenate",
    "convert_element_type",
    "copy",
    "dynamic_slice",
    "dynamic_update_slice",
    "gather",
    "iota",
    "pad",
    "reshape",
    "rev",
    "select_n",
    "slice",
    "split",
    "squeeze",
    "stop_gradient",
    "transpose",
}


def operations(program: ClosedJaxpr | Jaxpr) -> float:
    """Of a program as traced: one for each number that an elementwise operation gives, two for each product in a matrix
    product, one for each number that a reduction takes in. The body of a `while` loop, whose turns are not known before
    it runs, counts once; of several branches the dearest counts. The compiler may do fewer."""
    jaxpr = program.jaxpr if isinstance(program, ClosedJaxpr) else program
    return sum(_of(equation) for equation in jaxpr.eqns)


def _of(equation: Any) -> float:
    name, params = equation.primitive.name, equation.params
    inner = [
        part
        for value in params.values()
        for part in (value if isinstance(value, tuple | list) else (value,))
        if isinstance(part, ClosedJaxpr | Jaxpr)
    ]
    if name == "scan":
        return float(params["length"] * sum(map(operations, inner)))
    if name == "cond":
        return max(map(operations, inner))
    if inner:
        return sum(map(operations, inner))
    if name in _MOVES:
        return 0.0
    given = float(sum(math.prod(one.aval.shape) for one in equation.outvars if hasattr(one.aval, "shape")))
    if name == "dot_general":
        (contracted, _), _ = params["dimension_numbers"]
        return 2.0 * given * math.prod(equation.invars[0].aval.shape[axis] for axis in contracted)
    if name.startswith(("reduce_", "arg", "cum")):
        return float(math.prod(equation.invars[0].aval.shape))
    return given
