"""Every public function at its hard inputs: finite, flagged, near its oracle, no worse than it was."""

from __future__ import annotations

import inspect
from functools import partial
from typing import Any

import hard_inputs as hard
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from public_names import ELSEWHERE, NOT_NUMERIC, offering_modules, public_names
from stability_case import loss, stacked
from stability_estimators import estimator_kinds
from stability_report import BENT, UNHURRIED, allowed, golden, measure
from stability_table import all_cases

CASES = all_cases()
QUICK = [name for name, case in CASES.items() if case.quick]
# Whose derivatives take many seconds to compile: the long run has them at all of these inputs, and at the worst of them
# `test_step_run.py`, `test_staged.py` and the tests of `jaxradar.signal`.
DEAR = {
    *("MatchedFilter", "soft_position", "profile_shift", "shifted_correlations", "strongest_cell", "reductions"),
    "fitted_slope, order 1",
}
VALUE_ALONE = DEAR | {name for name in QUICK if "systems.step.run" in CASES[name].covers}


def test_every_public_function_is_in_the_table_or_has_a_reason() -> None:
    covered = {name for case in CASES.values() for name in case.covers} | set(OTHERWISE_TESTED)
    names = public_names()
    assert sorted(set(names) - covered - set(NOT_NUMERIC)) == []
    assert sorted((covered | set(NOT_NUMERIC)) - set(names)) == []
    assert sorted(covered & set(NOT_NUMERIC)) == []
    for name, reason in NOT_NUMERIC.items():
        if reason.startswith("abstract"):
            assert inspect.isabstract(names[name])
    assert sorted(set(ELSEWHERE) - {name.partition(".")[0] for name in offering_modules()}) == []


# By properties rather than by a table of inputs.
OTHERWISE_TESTED = {
    "systems.step.InnovationDetector": "test_step_innovation.py",
    "systems.step.detect_batch": "test_stability_properties.py",
}


def test_the_golden_file_holds_the_table_s_functions() -> None:
    """Write it again with `python tests/stability_report.py --write` when a function comes or goes."""
    assert list(golden()) == list(CASES)
    assert [name for name, (quick, _) in golden().items() if quick is not None] == QUICK


@pytest.mark.parametrize("name", QUICK)
def test_hard_inputs(name: str) -> None:
    """Finite with all derivatives (under `jax.debug_nans`), flags set, within the bound, no worse than recorded."""
    case = CASES[name]
    for size in case.quick:
        found = measure(case, size, case.dtypes[0], bend=name not in VALUE_ALONE)
        assert found.problems == []
        assert found.worst <= allowed(golden()[name][0]), found.at


ESTIMATORS = [
    name for name, case in CASES.items() if {one.rpartition(".")[2] for one in case.covers} & set(estimator_kinds())
]


@pytest.mark.long
@pytest.mark.parametrize("name", CASES)
def test_hard_inputs_of_every_length(name: str) -> None:
    """In single precision: values of all lengths, derivatives of those of `BENT`."""
    case = CASES[name]
    found = [measure(case, size, case.dtypes[0], bend=bent(name, size)) for size in case.sizes]
    assert [problem for one in found for problem in one.problems] == []
    worst = max(found, key=lambda one: one.worst)
    assert worst.worst <= allowed(golden()[name][1]), worst.at


def bent(name: str, size: Any) -> bool:
    """Derivatives of a detector over 128 bins are those over 16."""
    return size in BENT and "128 bins" not in name


@pytest.mark.long
@pytest.mark.parametrize("name", [name for name, case in CASES.items() if case.dtypes == ("float32", "float64")])
def test_hard_inputs_in_double_precision(name: str) -> None:
    case = CASES[name]
    size = 17 if 17 in case.sizes else case.sizes[-1]
    assert measure(case, size, "float64", bend=bent(name, size)).problems == []


# What the estimators take: 65535 is infinite in float16, and left out.
HALF = [
    pytest.param(name, marks=pytest.mark.long) if name not in ("ArgMax", "SoftArgmax", "PulseFit") else name
    for name in ESTIMATORS
]


@pytest.mark.parametrize("dtype", ["float16", pytest.param("bfloat16", marks=pytest.mark.long)])
@pytest.mark.parametrize("name", HALF)
def test_sweeps_in_half_precision(name: str, dtype: str) -> None:
    """They are computed in single precision: as near the oracle as the same values in it."""
    found = measure(CASES[name], 17, dtype, bend=False)
    assert found.problems == []
    assert found.values["position"].dtype == np.float32


# One input at a time

SAME = [
    name
    for name, case in CASES.items()
    if case.smooth and "float32" in case.dtypes and "systems.step.run" not in case.covers
]


@pytest.mark.long
@pytest.mark.parametrize("name", SAME)
def test_alone_compiled_and_op_by_op_are_the_same(name: str) -> None:
    """Plain, `jit`, `vmap` and the gradient of each, at a few inputs without NaN; op by op under `jax.debug_nans`."""
    case = CASES[name]
    size = 17 if 17 in case.sizes else case.sizes[-1]
    inputs = {
        label: one
        for label, one in case.inputs(size).items()
        if all(np.isfinite(part).all() for part in one) and not label.startswith(hard.SUBNORMAL)
    }
    columns = stacked(inputs, np.float32)
    slope = jax.grad(partial(loss, case), argnums=case.smooth)
    together = jax.jit(jax.vmap(lambda *one: (case.function(*one), slope(*one))))(*columns)
    compiled = jax.jit(lambda *one: (case.function(*one), slope(*one)))
    for place in range(0, len(inputs), 1 + len(inputs) // 3):
        one = tuple(jnp.asarray(column[place]) for column in columns)
        with jax.debug_nans(True):
            plain = (case.function(*one), slope(*one))
        of_batch = jax.tree.map(lambda leaf, place=place: leaf[place], together)
        for other in (compiled(*one), of_batch):
            for got, wanted in zip(jax.tree.leaves(other), jax.tree.leaves(plain), strict=True):
                size_of = np.abs(np.asarray(wanted, np.float64)).max(initial=1e-30)
                np.testing.assert_allclose(
                    np.asarray(got, np.float64), np.asarray(wanted, np.float64), rtol=1e-3, atol=1e-5 + 1e-3 * size_of
                )


@pytest.mark.long
@pytest.mark.parametrize("name", SAME)
def test_gradients_are_the_oracle_s_differences(name: str) -> None:
    """In float64, along a random direction, where the oracle's answer is smooth; and in float32 near it."""
    case = CASES[name]
    size = 17 if 17 in case.sizes else case.sizes[-1]
    inputs = {label: one for label, one in case.inputs(size).items() if smooth(name, label)}
    if not inputs:
        pytest.skip("no input at which differences say something")
    keys = [key for key in case.scale if key != "found" and key not in case.flat]
    generator = np.random.default_rng(0)

    def weighed(*one: Any) -> Any:
        given = case.function(*one)
        return sum(jnp.sum(given[key]) for key in keys)

    slope = jax.jit(jax.vmap(jax.grad(weighed, argnums=case.smooth)), compiler_options=UNHURRIED)
    single = jax.device_get(slope(*stacked(inputs, np.float32)))
    with jax.enable_x64(True):
        double = jax.device_get(slope(*stacked(inputs, np.float64)))
    for place, (label, one) in enumerate(inputs.items()):
        for argument, slopes32, slopes64 in zip(case.smooth, single, double, strict=True):
            at = np.asarray(one[argument], np.float64)
            norm = np.linalg.norm(slopes64[place])
            assert np.linalg.norm(slopes32[place] - slopes64[place]) <= 1e-2 * norm + 1e-6, (label, argument)
            direction = generator.normal(size=at.shape) * np.maximum(np.abs(at).max(), 1e-3)

            def ends(
                step: float, one: Any = one, argument: int = argument, at: Any = at, way: Any = direction
            ) -> float:
                moved = [np.asarray(part, np.float64) if np.asarray(part).dtype.kind == "f" else part for part in one]
                moved[argument] = at + step * way
                answer = case.answer(*moved)
                return sum(
                    float(np.sum(np.min(answer[key], axis=0) if np.ndim(answer[key]) > 1 else answer[key]))
                    for key in keys
                )

            wanted = (ends(1e-6) - ends(-1e-6)) / 2e-6
            assert np.sum(slopes64[place] * direction) == pytest.approx(wanted, rel=1e-3, abs=1e-6 + 1e-4 * norm), label


def smooth(name: str, label: str) -> bool:
    """An echo over a floor with its own largest bin, at a temperature that rounds nothing away."""
    if name == "reductions":  # of a floor, which bin is the smallest is open
        return "ramp" in label
    return label.startswith("echo") and not any(
        word in label for word in ("bin", "0.001", "against", "beyond", "before")
    )
