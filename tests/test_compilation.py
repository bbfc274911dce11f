"""How programs are compiled: options that a compiler does not know are left out, layouts change no value."""

from __future__ import annotations

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxradar._numerics import compilation, compiled, row_major

# A flag that every version has, so that the test does not hang on those of one.
KNOWN, UNKNOWN = {"xla_embed_ir_in_executable": False}, {"xla_of_another_version": True}


@pytest.fixture
def fresh() -> Iterator[None]:
    """The options are asked for once and kept."""
    compilation.compiler_options.cache_clear()
    yield
    compilation.compiler_options.cache_clear()


@pytest.fixture
def cpu() -> None:
    if jax.default_backend() != "cpu":
        pytest.skip("options are asked for on CPUs alone")


def test_an_unknown_option_is_left_out(fresh: None, cpu: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compilation, "_WANTED", {**UNKNOWN, **KNOWN})
    assert compilation.compiler_options() == KNOWN
    doubled = compiled(lambda x: 2 * x)
    assert float(doubled(jnp.asarray(3.0))) == 6.0


def test_none_are_asked_for_elsewhere(fresh: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compilation.jax, "default_backend", lambda: "gpu")
    assert compilation.compiler_options() == {}


def test_those_that_are_known_are_of_the_wanted(fresh: None, cpu: None) -> None:
    assert compilation.compiler_options().items() <= compilation._WANTED.items()


def test_compiled_is_jit_and_is_made_at_the_first_call(fresh: None, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    monkeypatch.setattr(compilation, "compiler_options", lambda: asked.append(True) or {})
    traces = []

    def power(base: jax.Array, exponent: int) -> jax.Array:
        """Its docstring."""
        traces.append(exponent)
        return base**exponent

    program = compiled(power, static_argnums=1)
    assert not asked
    assert [float(program(jnp.asarray(base), 3)) for base in (2.0, 3.0)] == [8.0, 27.0]
    assert float(program(jnp.asarray(2.0), exponent) if (exponent := 2) else 0) == 4.0
    assert traces == [3, 2]
    assert asked == [True]
    assert (program.__name__, program.__doc__) == ("power", "Its docstring.")


def test_compiled_lowers() -> None:
    program = compiled(lambda x: jnp.sin(x))
    ready = program.lower(jax.ShapeDtypeStruct((5,), np.float32)).compile()
    np.testing.assert_allclose(ready(np.arange(5, dtype=np.float32)), np.sin(np.arange(5.0)), rtol=1e-6)


def test_row_major_changes_no_value_and_passes_gradients(precision: str) -> None:
    values = jnp.asarray(np.random.default_rng(0).normal(size=(3, 4, 5)))
    turned = jax.jit(lambda x: row_major(jnp.transpose(x, (2, 0, 1))))(values)
    np.testing.assert_array_equal(turned, np.transpose(values, (2, 0, 1)))
    slope = jax.jit(jax.grad(lambda x: jnp.sum(row_major(x.T) ** 2)))(values)
    np.testing.assert_allclose(slope, 2 * np.asarray(values), rtol=1e-6)
    each = jax.jit(jax.vmap(lambda x: row_major(x.T)))(values)
    np.testing.assert_array_equal(each, np.swapaxes(np.asarray(values), 1, 2))
