"""A one-sweep program run by JAX: the one that `jax.export` wrote, or a detector's own, compiled here and now."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from jaxradar._errors import ConfigError
from jaxradar.live.artefact import Artefact
from jaxradar.systems.step import precision
from jaxradar.systems.step.packed import PackedStep

__all__ = ["JaxStep"]


class JaxStep:
    """As `jaxradar.live.program.Program`, by JAX: state and inputs in vectors, one program for any number of sensors.

    Made by `of_artefact` or `of_step`.
    """

    def __init__(self, program: Callable[..., Any], state: np.ndarray, inputs: int) -> None:
        self._program, self._first = program, state
        self._state: Any = state
        self._inputs = np.zeros(inputs, state.dtype)

    @classmethod
    def of_artefact(cls, artefact: Artefact) -> JaxStep:
        """The program of an exported file. Raises `ConfigError` where this JAX does not take it."""
        from jax import export

        header = artefact.header
        try:
            program = export.deserialize(bytearray(artefact.program)).call
        except Exception as error:
            raise ConfigError(f"this version of JAX does not take the compiled detector: {error!s:.200}") from None
        return cls(_in_precision(jax.jit(program), header.vectors), header.first_state, header.inputs)

    @classmethod
    def of_step(cls, step: PackedStep) -> JaxStep:
        """A detector as it is, compiled here and now: no sweep waits for that."""
        with precision(step.detector):
            made = cls(_in_precision(step.program(), str(step.dtype)), step.initial(), step.inputs)
            made._program(made._first, made._inputs)
        return made

    @property
    def inputs(self) -> np.ndarray:
        """(inputs,) what the next `run` reads; to be written in place."""
        return self._inputs

    def run(self) -> np.ndarray:
        """(decision,) what the program makes of them; the state goes on."""
        self._state, decision = self._program(self._state, self._inputs.copy())
        return np.asarray(decision)

    def another(self) -> JaxStep:
        """The same program from its first state on, for another sensor."""
        return JaxStep(self._program, self._first, len(self._inputs))


def _in_precision(program: Callable[..., Any], vectors: str) -> Callable[..., Any]:
    def call(*arguments: Any) -> Any:
        with jax.enable_x64(True) if vectors == "float64" else contextlib.nullcontext():
            return program(*arguments)

    return call
