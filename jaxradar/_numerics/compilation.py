"""How programs are compiled: options that the compiler may not know, asked for only where it does."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
from jax.experimental.layout import Layout, with_layout_constraint

__all__ = ["compiled", "compiled_filtered", "compiler_options", "row_major"]

# What pays on CPUs, measured by `benches/run.py batch`; both leave every result within rounding of what it was.
_WANTED: dict[str, Any] = {
    # Float reductions stay in the fused loop instead of going to a library; experimental in jaxlib 0.10.
    "xla_cpu_experimental_ynn_fusion_type": "",
    # The whole width of an AVX-512 register, which the compiler leaves half empty by default; ignored elsewhere.
    "xla_cpu_prefer_vector_width": 512,
}


@functools.cache
def compiler_options() -> dict[str, Any]:
    """Those of the wanted options that this version of the compiler takes; none on other devices than CPUs."""
    if jax.default_backend() != "cpu":
        return {}
    known = {}
    for name, value in _WANTED.items():
        try:
            jax.jit(lambda x: x, compiler_options={name: value}).lower(0).compile()
        except jax.errors.JaxRuntimeError:  # "No such compile option": another version
            continue
        known[name] = value
    return known


def compiled(function: Callable[..., Any], **jit_options: Any) -> Callable[..., Any]:
    """`jax.jit` with `compiler_options`, made at the first call, so that importing starts no device.

    Has the `lower` and `trace` of `jax.jit` too. Not to be called inside another jit-compiled function: options belong
    to a whole program.
    """

    @functools.cache
    def program() -> Any:
        return jax.jit(function, compiler_options=compiler_options(), **jit_options)

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        return program()(*args, **kwargs)

    call.lower = lambda *args, **kwargs: program().lower(*args, **kwargs)  # type: ignore[attr-defined]
    call.trace = lambda *args, **kwargs: program().trace(*args, **kwargs)  # type: ignore[attr-defined]
    return call


def compiled_filtered(function: Callable[..., Any]) -> Callable[..., Any]:
    """As `compiled`, by `equinox.filter_jit`: what is no array in the arguments is static, a Python number too."""

    @functools.cache
    def program() -> Any:
        # Options of `jax.jit` pass through, which the overloads do not say.
        return eqx.filter_jit(function, compiler_options=compiler_options())  # type: ignore[call-overload]

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        return program()(*args, **kwargs)

    return call


@jax.custom_jvp
def row_major(values: jax.Array) -> jax.Array:
    """The same values, laid out in memory in the order of the axes.

    A CPU program that transposes is otherwise made by giving the axes another order in memory, and then every loop
    that follows jumps.
    """
    return with_layout_constraint(values, Layout(major_to_minor=tuple(range(values.ndim))))


@row_major.defjvp
def _row_major_jvp(primals: tuple[jax.Array], tangents: tuple[jax.Array]) -> tuple[jax.Array, jax.Array]:
    return row_major(*primals), tangents[0]
