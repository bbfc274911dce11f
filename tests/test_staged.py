"""Reductions in both forms against NumPy: ties, NaN, rounding, gradients, and the size of the program."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxradar._numerics import (
    cpu_shaped,
    first_argmax,
    first_largest,
    largest,
    packed_largest,
    reductions,
    select_largest,
    smallest,
    total,
    totals,
    value_at,
)
from jaxradar._numerics.staged import LANES, MOST_STAGED

FORMS = ("staged", "plain")
SIZES = (1, 2, 15, 16, 17, 31, 32, 33, 64, 127, 128, 129, 827, 1240, 1448, 9000)
SHAPES = ((), (3,), (2, 5))
DTYPES = ("bool", "uint8", "uint16", "int32", "float16", "float32", "float64")
WORST_SIZES = (1, 31, 33, 128, 300, 9000)


def jitted(function: Callable[..., Any], form: str) -> Callable[..., Any]:
    """A program of its own for each form: the form is chosen while tracing and is no part of a program's name."""

    def inside(*args: Any) -> Any:
        with reductions(form):
            return function(*args)

    return jax.jit(inside)


def _all(values: jax.Array) -> dict[str, jax.Array]:
    index, top = first_largest(values)
    return {
        "total": total(values),
        "largest": largest(values),
        "smallest": smallest(values),
        "first_argmax": first_argmax(values),
        "index": index,
        "top": top,
        "value_at": value_at(values, index),
    }


REDUCE = {form: jitted(_all, form) for form in FORMS}


def wide(dtype: str) -> contextlib.AbstractContextManager[Any]:
    return jax.enable_x64(True) if dtype == "float64" else contextlib.nullcontext()


def sample(dtype: str, shape: tuple[int, ...], seed: int = 0) -> np.ndarray:
    generator = np.random.default_rng(seed)
    if dtype == "bool":
        return generator.random(shape) < 0.3
    if dtype.startswith("float"):
        return generator.normal(0, 3, shape).astype(dtype)
    low = -100_000 if dtype == "int32" else 0
    return generator.integers(low, min(np.iinfo(dtype).max, 100_000), shape, endpoint=True).astype(dtype)


def assert_as_numpy(got: dict[str, jax.Array], values: np.ndarray) -> None:
    np.testing.assert_array_equal(got["largest"], values.max(axis=-1))
    np.testing.assert_array_equal(got["smallest"], values.min(axis=-1))
    for name in ("first_argmax", "index"):
        np.testing.assert_array_equal(got[name], values.argmax(axis=-1))
    for name in ("top", "value_at"):
        np.testing.assert_array_equal(got[name], values.max(axis=-1))
    assert got["index"].dtype == got["first_argmax"].dtype == np.int32
    assert got["largest"].dtype == got["smallest"].dtype == got["top"].dtype == values.dtype
    if np.issubdtype(values.dtype, np.floating):
        exact = values.astype(np.longdouble).sum(axis=-1)
        bound = values.shape[-1] * np.finfo(values.dtype).eps * np.abs(values.astype(np.float64)).sum(axis=-1)
        assert (np.abs(np.asarray(got["total"], np.longdouble) - exact) <= bound).all()
    else:
        np.testing.assert_array_equal(got["total"], values.sum(axis=-1, dtype=np.int64))


ASKED = [(dtype, size) for dtype in DTYPES for size in (SIZES if dtype in ("uint16", "float32") else WORST_SIZES)]
# All sizes of what a sensor sends, a few of the other types; the rest behind the marker.
ASKED = [
    pytest.param(dtype, size, marks=() if dtype == "uint16" or size in (1, 33, 127) else pytest.mark.long)
    for dtype, size in ASKED
]


@pytest.mark.parametrize(("dtype", "size"), ASKED)
def test_every_size_and_type_is_numpy_s(dtype: str, size: int) -> None:
    values = sample(dtype, (2, 5, size), seed=size)
    with wide(dtype):
        for form in FORMS:
            got = REDUCE[form](values)
            assert_as_numpy(got, values)
            assert got["total"].dtype == jax.eval_shape(jnp.sum, values).dtype


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("size", [1, 33, 128, 827])
def test_every_leading_shape(shape: tuple[int, ...], size: int, form: str) -> None:
    for dtype in ("uint16", "float32"):
        values = sample(dtype, (*shape, size), seed=3)
        got = REDUCE[form](values)
        assert all(one.shape == shape for one in got.values())
        assert_as_numpy(got, values)


def ties(size: int, dtype: str) -> np.ndarray:
    """Rows whose largest value stands in several places."""
    rows = [np.full(size, 7.0), np.zeros(size), np.arange(size) % 3.0, np.arange(size) % LANES, np.arange(size) % 33]
    rows.append(np.eye(1, size, size - 1)[0])
    for start, stop in ((LANES - 1, LANES + 1), (2 * LANES - 3, 3 * LANES + 3), (size // 2, size)):  # over borders
        plateau = np.ones(size)
        plateau[start:stop] = 9.0
        rows.append(plateau)
    if dtype.startswith("float"):
        zeros = np.where(np.arange(size) % 2, 0.0, -0.0)
        below = np.where(np.arange(size) > size // 3, -0.0, -1.0)
        below[2 * size // 3 :] = 0.0
        rows += [zeros, -zeros, below, np.full(size, -np.inf), np.full(size, np.inf), np.full(size, -5.0)]
        rows.append(np.where(np.arange(size) % 5 == 3, np.inf, -np.inf))
        rows.append(np.where(np.arange(size) < size // 2, -np.inf, -np.finfo(dtype).max))
    return np.stack(rows).astype(dtype)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("size", WORST_SIZES)
@pytest.mark.parametrize(
    "dtype",
    ["int32", "float32", *(pytest.param(rare, marks=pytest.mark.long) for rare in ("uint8", "float16", "float64"))],
)
def test_the_first_of_equals_wins(dtype: str, size: int, form: str) -> None:
    values = ties(size, dtype)
    with wide(dtype):
        got = REDUCE[form](values)
    np.testing.assert_array_equal(got["index"], values.argmax(axis=-1))
    np.testing.assert_array_equal(got["first_argmax"], values.argmax(axis=-1))
    np.testing.assert_array_equal(got["top"], values.max(axis=-1))
    np.testing.assert_array_equal(got["largest"], values.max(axis=-1))
    np.testing.assert_array_equal(got["smallest"], values.min(axis=-1))


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("size", WORST_SIZES)
@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_nan_and_infinities_are_numpy_s(dtype: str, size: int, form: str) -> None:
    # On CPUs the compiler's own maximum loses a NaN among many bins; what is reduced there has none.
    lost = size > 128 and (form == "plain" or size > MOST_STAGED) and jax.default_backend() == "cpu"
    rows = []
    for bad in (np.nan, -np.nan, np.inf, -np.inf):
        places = {0, size // 2, size - 1}
        rows += [np.where(np.arange(size) == place, bad, sample(dtype, (size,))) for place in places]
    rows.append(np.where(np.arange(size) % 2, np.inf, -np.inf))
    rows.append(np.full(size, np.nan))
    rows.append(np.where(np.arange(size) % 2, np.nan, np.inf))
    values = np.stack(rows).astype(dtype)
    with wide(dtype):
        got = REDUCE[form](values)
    rows_asked = ~np.isnan(values).any(axis=-1) if lost else slice(None)
    for name, wanted in (("largest", values.max(axis=-1)), ("smallest", values.min(axis=-1))):
        np.testing.assert_array_equal(np.asarray(got[name])[rows_asked], wanted[rows_asked])
    with np.errstate(invalid="ignore"):
        wanted = values.sum(axis=-1)
    still = np.isfinite(wanted)
    np.testing.assert_array_equal(np.asarray(got["total"])[~still], wanted[~still])
    np.testing.assert_allclose(np.asarray(got["total"])[still], wanted[still], rtol=1e-3)


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "int32"])
def test_the_ends_of_the_whole_numbers(dtype: str) -> None:
    low, high = np.iinfo(dtype).min, np.iinfo(dtype).max
    values = np.full((3, 77), low, dtype)
    values[1, [40, 76]] = high
    values[2, 76] = low + 1
    for form in FORMS:
        got = REDUCE[form](values)
        assert got["index"].tolist() == [0, 40, 76]
        assert got["top"].tolist() == got["largest"].tolist() == [low, high, low + 1]
        assert got["smallest"].tolist() == [low, low, low]


@pytest.mark.parametrize("dtype", ["uint32", "int64", "uint64"])
def test_arg_max_of_types_that_leave_no_room_for_the_index(dtype: str) -> None:
    generator = np.random.default_rng(1)
    top = np.iinfo(dtype).max
    values = generator.integers(top - 3, top, (20, 100), endpoint=True, dtype=dtype)
    with jax.enable_x64(True):
        for form in FORMS:
            index, found = jitted(first_largest, form)(values)
            np.testing.assert_array_equal(index, values.argmax(axis=-1))
            np.testing.assert_array_equal(found, values.max(axis=-1))
            assert index.dtype == np.int32


WHOLE = st.lists(st.sampled_from([-2.0, -1.0, -0.0, 0.0, 1.0, 3.0, np.inf, -np.inf]), min_size=70, max_size=70)
ANY = st.lists(st.floats(width=32, allow_nan=False, allow_subnormal=False), min_size=70, max_size=70)


@settings(deadline=None, max_examples=80, derandomize=True)
@given(st.one_of(WHOLE, ANY))
def test_both_forms_agree_bit_by_bit(drawn: list[float]) -> None:
    values = np.array(drawn, np.float32)
    staged, plain = (REDUCE[form](values) for form in FORMS)
    for name in ("largest", "smallest", "top", "index", "first_argmax"):
        # A zero has two signs, of which a maximum may give either.
        bits = [np.asarray(one[name] + 0 if name != "index" else one[name]).tobytes() for one in (staged, plain)]
        assert bits[0] == bits[1], name
    assert int(staged["index"]) == int(np.argmax(values))


@settings(deadline=None, max_examples=60, derandomize=True)
@given(st.lists(st.integers(0, 65535), min_size=70, max_size=70))
def test_both_forms_agree_on_counts(drawn: list[int]) -> None:
    values = np.array(drawn, np.uint16)
    for form in FORMS:
        got = REDUCE[form](values)
        assert int(got["index"]) == int(np.argmax(values))
        assert int(got["total"]) == sum(drawn)


@pytest.mark.parametrize("size", [1448, 4000])
def test_the_staged_sum_errs_by_less_than_a_chain(size: int) -> None:
    """Of numbers near 1, whose sum a chain of float32 rounds at every step: bound log2 against n."""
    values = (1.0 + np.random.default_rng(5).random((50, size))).astype(np.float32)
    exact = values.astype(np.float64).sum(axis=-1)
    error = np.abs(np.asarray(REDUCE["staged"](values)["total"], np.float64) - exact) / exact
    # log2(slices) levels of the tree and a chain of LANES.
    assert error.max() <= (np.log2(size / LANES) + LANES) * np.finfo(np.float32).eps / 2


# Gradients, in double against central differences


def _terms(x: Any, y: Any) -> tuple[Any, Any]:
    return jnp.exp(0.1 * x) * y, x * y * y


SMOOTH: dict[str, Callable[[jax.Array], jax.Array]] = {
    "total": lambda x: total(jnp.sin(x)),
    "largest": lambda x: largest(x) ** 2,
    "smallest": lambda x: smallest(x) ** 2,
    "totals": lambda x: sum(totals(_terms, x, jnp.cos(x))),
    "value_at": lambda x: value_at(x**2, first_argmax(x)),
    "select_largest": lambda x: sum(
        select_largest([(x[..., i], x[..., -1 - i] ** 2) for i in range(min(9, x.shape[-1]))])[1:]
    ),
}


@pytest.mark.parametrize("size", [1, 127])
@pytest.mark.parametrize("name", SMOOTH)
def test_gradient_agrees_with_central_differences(name: str, size: int) -> None:
    values = sample("float64", (size,), seed=7)
    step, gradients = 1e-6, []
    with jax.enable_x64(True):
        for form in FORMS:
            function = jitted(SMOOTH[name], form)
            bumps = step * np.eye(size)
            wanted = (np.asarray(function(values + bumps)) - np.asarray(function(values - bumps))) / (2 * step)
            gradients.append(np.asarray(jitted(jax.grad(SMOOTH[name]), form)(values)))
            np.testing.assert_allclose(gradients[-1], wanted, rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(gradients[0], gradients[1], rtol=1e-14, atol=1e-14)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("extreme", [largest, smallest])
def test_gradient_is_shared_equally_by_equals(extreme: Callable[..., Any], form: str, precision: str) -> None:
    values = np.zeros(100)
    sign = 1.0 if extreme is largest else -1.0
    values[[3, 31, 32, 99]] = sign
    gradient = jitted(jax.grad(extreme), form)(jnp.asarray(values))
    np.testing.assert_array_equal(gradient, 0.25 * np.abs(values))
    np.testing.assert_array_equal(jitted(jax.grad(extreme), form)(jnp.zeros(40)), np.full(40, 1 / 40, precision))


def test_no_gradient_flows_through_the_first_largest() -> None:
    for form in FORMS:
        gradient = jitted(jax.grad(lambda x: first_largest(x)[1]), form)(jnp.arange(50.0))
        assert (gradient == 0).all()


@pytest.mark.parametrize("form", FORMS)
def test_gradient_where_an_extreme_is_nan_or_infinite(form: str) -> None:
    """NaN has no equal, so that nothing flows; an infinite maximum takes the gradient as any other."""
    slope = jitted(jax.grad(largest), form)
    assert (slope(jnp.asarray([1.0, np.nan, 2.0])) == 0).all()
    assert slope(jnp.asarray([1.0, np.inf, 2.0])).tolist() == [0, 1, 0]


@pytest.mark.parametrize("size", [100])
@pytest.mark.parametrize("name", SMOOTH)
def test_maps_and_gradients_of_maps(name: str, size: int, precision: str) -> None:
    """A batch is the same as one after the other, whichever axis it lies on, and so is its gradient."""
    values = sample(precision, (4, size), seed=2)
    for form in FORMS:
        both = jitted(jax.value_and_grad(SMOOTH[name]), form)
        alone, slopes = (np.stack(one) for one in zip(*(both(row) for row in values), strict=True))
        tolerance = {
            "rtol": 1e-5 if precision == "float32" else 1e-13,
            "atol": 1e-4 if precision == "float32" else 1e-12,
        }
        np.testing.assert_allclose(jitted(jax.vmap(SMOOTH[name]), form)(values), alone, **tolerance)
        across = jitted(jax.vmap(SMOOTH[name], in_axes=-1), form)
        np.testing.assert_allclose(across(np.ascontiguousarray(values.T)), alone, **tolerance)
        of_map = jitted(jax.grad(lambda x: jax.vmap(SMOOTH[name])(x).sum()), form)
        np.testing.assert_allclose(of_map(values), slopes, **tolerance)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("size", SIZES)
def test_totals_are_the_totals_of_each(size: int, form: str) -> None:
    """Of a function that is not 0 at 0: what fills up the last slice must not count."""
    x, y = (sample("float32", (3, size), seed=seed) for seed in (1, 2))
    got = jitted(lambda a, b: totals(lambda u, v: (jnp.exp(u), u * v + 1.0, jnp.ones_like(u)), a, b), form)(x, y)
    doubles = x.astype(np.float64), y.astype(np.float64)
    np.testing.assert_allclose(got[0], np.exp(doubles[0]).sum(axis=-1), rtol=2e-5)
    np.testing.assert_allclose(got[1], (doubles[0] * doubles[1] + 1).sum(axis=-1), rtol=2e-5, atol=1e-2)
    np.testing.assert_array_equal(got[2], size)


def test_select_largest_carries_along_what_goes_with_it(precision: str) -> None:
    generator = np.random.default_rng(9)
    for count in (1, 2, 3, 7, 16):
        values = generator.integers(0, 4, (50, count)).astype(precision)
        beside = generator.normal(size=(50, count)).astype(precision)
        got = jax.jit(lambda v, b: select_largest([(v[:, i], b[:, i]) for i in range(v.shape[1])]))(values, beside)
        best = values.argmax(axis=1)
        np.testing.assert_array_equal(got[0], best)
        np.testing.assert_array_equal(got[1], values.max(axis=1))
        np.testing.assert_array_equal(got[2], beside[np.arange(50), best])


# The largest of doubles in one pass


def packed(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    with jax.enable_x64(True):
        index, top = PACKED(values)
    return np.asarray(index), np.asarray(top)


PACKED = jax.jit(packed_largest)


@pytest.mark.parametrize("bins", [1, 2, 3, 16, 127, 128, 129, 1448])
def test_packed_largest_of_counts_times_weights(bins: int) -> None:
    generator = np.random.default_rng(bins)
    for levels in (2, 50, 65536):
        amplitudes = generator.integers(0, levels, (200, bins)).astype(np.uint16)
        weights = ((2 * (0.1 + 0.9 * generator.random(bins))) ** 2).astype(np.float32).astype(np.float64)
        products = amplitudes * weights
        index, top = packed(products)
        np.testing.assert_array_equal(index, products.argmax(axis=1))
        np.testing.assert_allclose(top, products.max(axis=1), rtol=bins * 4.5e-16)
        assert index.dtype == np.int32
        assert top.dtype == np.float64


def test_packed_largest_tells_products_apart_that_differ_by_one_count() -> None:
    weights = (2 * (0.1 + 0.007 * np.arange(128))).astype(np.float32).astype(np.float64) ** 2
    weights = weights.astype(np.float32).astype(np.float64)
    generator = np.random.default_rng(0)
    rows = []
    for _ in range(300):
        first, second = np.sort(generator.choice(128, 2, replace=False))
        high = int(generator.integers(100, 60_000))
        row = np.zeros(128)
        row[first] = np.rint(high * weights[second] / weights[first]).clip(0, 65535)
        row[second] = high + generator.integers(-1, 2)
        rows.append(row)
    products = np.array(rows) * weights
    np.testing.assert_array_equal(packed(products)[0], products.argmax(axis=1))
    equal = np.full((3, 128), 60_000.0)
    equal[1, 77], equal[2, [5, 90]] = 60_001.0, 60_001.0
    assert packed(equal * 1.7)[0].tolist() == [0, 77, 5]
    assert packed(np.zeros((2, 128)))[0].tolist() == [0, 0]


def test_packed_largest_takes_products_as_equal_that_differ_in_the_last_bits_alone() -> None:
    row = np.ones(128)
    row[60] = np.nextafter(1.0, 2.0)
    assert packed(row)[0] == 0
    row[60] = 1.0 + 128 * np.finfo(np.float64).eps
    assert packed(row)[0] == 60
    assert packed(np.array([1.0, np.inf, 3.0, np.inf])) == (1, np.inf)


def test_packed_largest_takes_doubles_alone() -> None:
    with pytest.raises(TypeError, match="takes float64; got float32"):
        packed_largest(jnp.zeros(3))


# The form, and what it leaves behind


def test_the_form_is_chosen_inside_the_context_alone() -> None:
    before = cpu_shaped()
    with reductions("plain"):
        assert not cpu_shaped()
        with reductions("staged"):
            assert cpu_shaped()
        assert not cpu_shaped()
    with pytest.raises(RuntimeError), reductions("plain" if before else "staged"):
        raise RuntimeError
    assert cpu_shaped() == before == (jax.default_backend() == "cpu")
    with pytest.raises(ValueError, match=r'must be "staged" or "plain"; got \'trees\''), reductions("trees"):
        pass


def operations(function: Callable[..., Any], size: int) -> int:
    with reductions("staged"):
        text = str(jax.make_jaxpr(lambda x: function(x))(jnp.zeros(size)))
    return text.count(" = ")


@pytest.mark.parametrize("function", [total, largest, smallest, first_argmax])
def test_the_program_does_not_grow_without_bound(function: Callable[..., Any]) -> None:
    assert operations(function, MOST_STAGED) > operations(function, 1024) > operations(function, 100)
    assert operations(function, MOST_STAGED + 1) == operations(function, 10 * MOST_STAGED) < 30
    assert operations(function, MOST_STAGED) < 20 * MOST_STAGED / LANES


@pytest.mark.parametrize("form", FORMS)
def test_double_keys_leave_single_precision_outside(form: str) -> None:
    def inside(values: jax.Array) -> Any:
        index, top = first_largest(values)
        return index, top, top * 2.0 + index, jnp.zeros(())

    assert not jax.config.jax_enable_x64
    got = jitted(inside, form)(np.arange(100.0, dtype=np.float32))
    assert [one.dtype for one in got] == [np.int32, np.float32, np.float32, np.float32]
    assert not jax.config.jax_enable_x64
    assert jnp.arange(3.0).dtype == np.float32


@pytest.mark.parametrize("size", [1, 33, 127, 9000])
def test_largest_of_what_is_made_of_several_arrays(size: int) -> None:
    """Counts times weights, slice by slice: a row of weights for each row of counts, or one for all."""
    counts = sample("uint16", (4, size), seed=1)
    weights = np.random.default_rng(2).random((4, size)).astype(np.float32)

    def product(count: jax.Array, weight: jax.Array) -> jax.Array:
        return count.astype(weight.dtype) * weight

    for form in FORMS:
        index, top = jitted(lambda a, b: first_largest(a, b, of=product), form)(counts, weights)
        products = counts.astype(np.float32) * weights
        np.testing.assert_array_equal(index, products.argmax(axis=-1))
        np.testing.assert_array_equal(top, products.max(axis=-1))
        with jax.enable_x64(True):
            index, top = jitted(jax.vmap(lambda a, b: packed_largest(a, b, of=product), in_axes=(0, None)), form)(
                counts, weights[0].astype(np.float64)
            )
        products = counts * weights[0].astype(np.float64)
        np.testing.assert_array_equal(index, products.argmax(axis=-1))
        np.testing.assert_allclose(top, products.max(axis=-1), rtol=size * 4.5e-16)
