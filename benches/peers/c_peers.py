"""The pipeline in C with OpenMP (`pipeline.c`), compiled on the spot; and how fast the machine reads memory at all."""

from __future__ import annotations

import ctypes
import platform
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

import numpy as np
from data import ESTIMATORS, THRESHOLD_M_S, Batch, Outputs, UnavailableError

__all__ = ["FLAGS", "candidates", "reader"]

FLAGS = ("-O3", "-march=native", "-ffast-math", "-fopenmp")


@cache
def _library(bins: int) -> ctypes.CDLL:
    compiler = shutil.which("cc")
    if compiler is None:
        raise UnavailableError("there is no C compiler `cc`.")
    # GCC prefers registers of half the width on machines where the full one once slowed the clock.
    wide = ["-mprefer-vector-width=512"] if platform.machine() == "x86_64" else []
    source = Path(__file__).with_name("pipeline.c")
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "pipeline.so"
        command = [compiler, *FLAGS, *wide, f"-DBINS={bins}", "-shared", "-fPIC", str(source), "-o", str(target), "-lm"]
        built = subprocess.run(command, capture_output=True, text=True, check=False)
        if built.returncode:
            first = (built.stderr.strip() or "no message").splitlines()[0]
            raise UnavailableError(f"`cc` did not compile pipeline.c: {first}")
        return ctypes.CDLL(str(target))  # stays loaded when its file is gone


def _address(values: np.ndarray) -> ctypes.c_void_p:
    return ctypes.c_void_p(values.ctypes.data)


def candidates(batch: Batch) -> dict[str, dict[str, Callable[[], Outputs]]]:
    """Raises `UnavailableError` without a compiler."""
    library = _library(batch.bins)
    shape = batch.flags.shape
    outputs = Outputs(np.zeros(shape, np.float32), np.zeros(shape, np.float32), np.zeros(shape, bool))
    arrays = [_address(values) for values in (batch.sweeps, batch.weights, batch.dt32, *outputs)]
    sizes = [ctypes.c_long(size) for size in shape]
    constants = [ctypes.c_float(value) for value in (batch.start_m, batch.bin_m, THRESHOLD_M_S)]

    def call(name: str) -> Outputs:
        getattr(library, f"pipeline_{name}")(*arrays, *sizes, *constants)
        return outputs

    return {"C, OpenMP": {name: partial(call, name) for name in ESTIMATORS}}


def reader(batch: Batch) -> Callable[[], int]:
    """Adds up all bytes of the batch, eight at a time, on all cores. Raises `UnavailableError` without a compiler."""
    read_all = _library(batch.bins).read_all
    read_all.restype = ctypes.c_uint64
    return lambda: read_all(_address(batch.sweeps), ctypes.c_long(batch.sweeps.nbytes // 8))
