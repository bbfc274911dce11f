"""A compiled one-sweep program, run by IREE's runtime: NumPy in, NumPy out."""

from __future__ import annotations

from typing import Any

import numpy as np

from jaxradar._errors import ConfigError
from jaxradar.live.artefact import Artefact
from jaxradar.live.options import RUNTIME

__all__ = ["Program"]


class Program:
    """The function `main(state, inputs) -> (state, decision)` of a program in IREE's byte code.

    Each instance keeps a state of its own; instances made with `another` share the program. The inputs lie in memory
    that the program reads where it is: `run` writes them there. Raises `ConfigError` where the runtime is missing or
    does not take the program. The bytes are believed: who has them from a file compares their hash first, as a
    damaged program may load without a word.
    """

    def __init__(self, program: bytes, state: np.ndarray, inputs: int, outputs: int) -> None:
        runtime = _runtime()
        config = runtime.Config("local-sync")
        context = runtime.SystemContext(config=config)
        try:
            module = runtime.VmModule.copy_buffer(context.instance, program)
            context.add_vm_module(module)
            function = module.lookup_function("main")
        except (RuntimeError, ValueError, KeyError) as error:
            why = "it is compiled for another processor" if "__device_0" in str(error) else f"{error!s:.200}"
            raise ConfigError(f"the compiled detector does not run here: {why}.") from None
        self._held = (config, context, module)  # which the function needs while it lives
        self._function, self._invoke = function, context.vm_context.invoke
        self._outputs = [outputs]
        self._begin(state, inputs)

    @classmethod
    def of_artefact(cls, artefact: Artefact) -> Program:
        """The program of a compiled file. Raises `ConfigError` where it does not take what the header says."""
        header = artefact.header
        made = cls(artefact.program, header.first_state, header.inputs, len(header.decision))
        try:
            made.another().run()
        except (RuntimeError, ValueError):
            raise ConfigError("the compiled detector does not take what its header says; export it again.") from None
        return made

    def another(self) -> Program:
        """The same program from its first state on, for another sensor."""
        other = object.__new__(Program)
        other.__dict__.update(self.__dict__)
        other._begin(self._first, len(self._inputs))
        return other

    def _begin(self, state: np.ndarray, inputs: int) -> None:
        runtime = _runtime()
        self._first = np.array(state)
        self._dtype = self._first.dtype
        kinds = {"f4": runtime.HalElementType.FLOAT_32, "f8": runtime.HalElementType.FLOAT_64}
        device = self._held[0].device

        def placed(values: np.ndarray) -> Any:
            return device.allocator.allocate_buffer_copy(
                memory_type=runtime.MemoryType.DEVICE_LOCAL | runtime.MemoryType.HOST_VISIBLE,
                allowed_usage=runtime.BufferUsage.DEFAULT | runtime.BufferUsage.MAPPING,
                device=device,
                buffer=values,
                element_type=kinds[self._dtype.str[1:]],
            )

        self._state = placed(self._first)
        self._buffer = placed(np.zeros(inputs, self._dtype))
        self._inputs: np.ndarray = self._buffer.map().asarray([inputs], self._dtype)
        self._list, self._view = runtime.VmVariantList, runtime.HalBufferView

    @property
    def inputs(self) -> np.ndarray:
        """(inputs,) what the next `run` reads; to be written in place."""
        return self._inputs

    def run(self) -> np.ndarray:
        """(outputs,) what the program makes of `inputs`; the state goes on."""
        given, made = self._list(2), self._list(2)
        given.push_ref(self._state)
        given.push_ref(self._buffer)
        self._invoke(self._function, given, made)
        self._state = made.get_as_object(0, self._view)
        found = made.get_as_object(1, self._view)
        return np.array(found.map().asarray(self._outputs, self._dtype))

    def state(self) -> np.ndarray:
        """(state,) a copy of what is remembered."""
        return np.array(self._state.map().asarray(list(self._first.shape), self._dtype))


def _runtime() -> Any:
    try:
        import iree.runtime
    except ImportError:
        raise ConfigError(
            f"a compiled detector needs IREE's runtime; install it with `pip install '{RUNTIME}'`."
        ) from None
    return iree.runtime
