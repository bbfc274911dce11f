"""How far each public function is from the truth at its worst input, in single precision.

`python tests/stability_report.py` prints it; `--write` keeps it as `tests/data/stability.txt`, which the tests compare
with, so that a loss of accuracy shows in a review; `--quick` looks at the plain run's inputs alone.
"""

from __future__ import annotations

import functools
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import hard_inputs as hard
import jax
import numpy as np
from stability_case import Case, derivatives, stacked
from stability_table import all_cases

GOLDEN = Path(__file__).parent / "data" / "stability.txt"
EPS = float(np.finfo(np.float32).eps)
# Of these lengths, which are all branches; of the others values alone.
BENT = (None, 1, 2, 17, 128)
# Derivatives are asked to be finite: the compiler takes a fifth of the time if it need not make them fast.
UNHURRIED = {"xla_backend_optimization_level": 0, "xla_llvm_disable_expensive_passes": True}
HEAD = """\
# Worst error of each public function in float32 against its oracle in float64, over the hard inputs of the tests:
# those of the plain run | those of all lengths. Relative to the scale in brackets; "bins" is the length of the axis,
# "steps" a metre in the shortest time step. Written by `python tests/stability_report.py --write`.
"""


class Measured(NamedTuple):
    """The worst error and its input; what is wrong, in words; all that was computed."""

    worst: float
    at: str
    problems: list[str]
    values: dict[str, np.ndarray]
    slopes: dict[str, Any]
    arguments: dict[str, tuple[np.ndarray, ...]]


def run_guarded(program: Any, arguments: tuple[np.ndarray, ...], problems: list[str]) -> Any:
    """Under `jax.debug_nans`; what it complains of is looked at without."""
    try:
        with jax.debug_nans(True):
            return jax.device_get(program(*arguments))
    except FloatingPointError as error:
        problems.append(f"debug_nans: {str(error).splitlines()[0]}")
        return jax.device_get(program(*arguments))


@functools.cache
def measure(case: Case, size: Any, dtype: str = "float32", bend: bool = True) -> Measured:
    """All hard inputs of one shape: values against the oracle, derivatives finite.

    `dtype`: of the input; float16 and bfloat16 are computed in float32.
    """
    inputs, problems = case.inputs(size), []
    with jax.enable_x64(dtype == "float64"):
        columns = stacked(inputs, hard.DTYPES[dtype])
        # Written once: what is a finite float64 may be an infinity in float16.
        exact = [one.astype(np.float64) if one.dtype.kind in "fV" else one for one in columns]
        # In double precision LLVM gives up on some programs for AVX-512 if it is to make them fast.
        options = UNHURRIED if dtype == "float64" else None
        values = run_guarded(jax.jit(jax.vmap(case.function), compiler_options=options), columns, problems)
        slopes = {}
        if bend and (case.smooth or case.settings):
            program = jax.jit(jax.vmap(partial(derivatives, case)), compiler_options=UNHURRIED)
            slopes = run_guarded(program, columns, problems)
    worst, at = 0.0, "-"
    arguments = {label: tuple(one[place] for one in exact) for place, label in enumerate(inputs)}
    for place, (label, given) in enumerate(arguments.items()):
        got = {key: np.asarray(one[place]) for key, one in values.items()}
        problems += [f"{key} is not finite at {label}" for key, one in got.items() if not np.isfinite(one).all()]
        for key, leaves in slopes.items():
            if not all(np.isfinite(np.asarray(one[place], np.float64)).all() for one in jax.tree.leaves(leaves)):
                problems.append(f"the {key} is not finite at {label}")
        if "position" in got and not 0 <= got["position"] <= len(given[0]) - 1:
            problems.append(f"the position is {got['position']} at {label}, outside of the sweep")
        if label in case.undefined or label.startswith(hard.SUBNORMAL):
            continue
        with np.errstate(all="ignore"):
            wanted = case.answer(*given)
        for key, one in wanted.items():
            if key not in case.scale:
                if np.any(got[key] != one):
                    problems.append(f"{key} is {got[key]} at {label}; expected {one}")
                continue
            error = np.abs(got[key].astype(np.float64) - np.asarray(one)) / case.scale_of(key, given, one)
            # Of several answers that would do, the nearest.
            error = float(np.max(error.min(axis=0) if np.ndim(one) > np.ndim(got[key]) else error))
            if not error <= worst:
                worst, at = error, f"{label} ({key})"
    bound = case.bound64 if dtype == "float64" else case.bound
    if not worst <= bound:
        problems.append(f"{at} is {worst:.2g} off; allowed {bound:.2g}")
    return Measured(worst, at, problems, values, slopes, arguments)


def golden() -> dict[str, tuple[float | None, float]]:
    """By function: the worst error over the plain run's inputs, None where it has none, and over all."""
    lines = [line.split("|") for line in GOLDEN.read_text().splitlines() if not line.startswith("#")]
    return {
        line[0].split("[")[0].strip(): tuple(
            None if column.split()[0] == "-" else float(column.split()[0]) for column in line[1:3]
        )
        for line in lines
    }  # type: ignore[return-value]


def allowed(recorded: float) -> float:
    """Another processor rounds otherwise: twice as much, and a few last digits."""
    return 2.0 * recorded + 4.0 * EPS


def worst_of(case: Case, sizes: tuple[Any, ...]) -> tuple[float, str]:
    dtype = case.dtypes[0]
    found = [(measure(case, size, dtype, bend=False), size) for size in sizes]
    if not found:
        return -1.0, ""
    one, size = max(found, key=lambda pair: pair[0].worst)
    return one.worst, one.at + (f", {size} bins" if size is not None else "")


def report(quick: bool = False) -> Iterator[str]:
    yield HEAD
    for name, case in all_cases().items():
        columns = [f"{name} [{', '.join(dict.fromkeys(case.scale.values()))}]"]
        for sizes in (case.quick,) if quick else (case.quick, case.sizes):
            worst, at = worst_of(case, sizes)
            columns.append("-" if worst < 0 else f"{worst:.1e} {at}" if worst > 0 else "0")
        yield " | ".join(columns) + "\n"


def main() -> None:
    lines = []
    for line in report("--quick" in sys.argv):
        print(line, end="", flush=True)
        lines.append(line)
    if "--write" in sys.argv:
        GOLDEN.parent.mkdir(exist_ok=True)
        GOLDEN.write_text("".join(lines))


if __name__ == "__main__":
    main()
