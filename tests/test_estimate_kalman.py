"""The Kalman filter against joint Gaussian conditioning in float64, and where single precision is hard."""

from __future__ import annotations

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from jaxradar.estimate.kalman import (
    Dynamics,
    Gaussian,
    MeasurementModel,
    constant_acceleration,
    constant_velocity,
    covariance_root,
    position_model,
    predict,
    update,
)

STEPS = 12


def random_root(random: np.random.Generator, size: int) -> np.ndarray:
    return np.tril(random.normal(size=(size, size)), -1) + np.diag(random.uniform(0.3, 1.5, size))


def random_problem(random: np.random.Generator, states: int, measured: int) -> dict[str, np.ndarray]:
    """Other matrices at each step, a control input, and steps without a measurement."""
    return {
        "F": np.eye(states) + 0.3 * random.normal(size=(STEPS, states, states)),
        "G": np.stack([random_root(random, states) for _ in range(STEPS)]),
        "B": random.normal(size=(STEPS, states, 2)),
        "u": random.normal(size=(STEPS, 2)),
        "H": random.normal(size=(STEPS, measured, states)),
        "R": np.stack([random_root(random, measured) for _ in range(STEPS)]),
        "z": random.normal(size=(STEPS, measured)),
        "seen": random.random(STEPS) < 0.7,
        "mean": random.normal(size=states),
        "root": random_root(random, states),
    }


def filtered(problem: dict[str, Any]) -> tuple[Gaussian, Any]:
    def step(state: Gaussian, now: Any) -> Any:
        state = predict(state, Dynamics(now["F"], now["G"], now["B"]), now["u"])
        state, innovation = update(state, now["z"], MeasurementModel(now["H"], now["R"]), now["seen"])
        return state, (state, innovation)

    first = Gaussian(problem["mean"], problem["root"])
    by_step = {name: one for name, one in problem.items() if name not in ("mean", "root")}
    return jax.lax.scan(step, first, by_step)


def conditioned(problem: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray, float]:
    """Mean and covariance of the last state given all measurements, and their log-density, out of the joint Gaussian of
    all of them: nothing recursive but the states' own making."""
    states, measured = problem["mean"].size, problem["z"].shape[1]
    # Every state as a linear map of (first state, all noises), and what is certain.
    sources = states * (STEPS + 1)
    mapped, certain = np.zeros((states, sources)), problem["mean"].copy()
    mapped[:, :states] = problem["root"]
    rows, expected, noise = [], [], []
    for k in range(STEPS):
        mapped, certain = problem["F"][k] @ mapped, problem["F"][k] @ certain + problem["B"][k] @ problem["u"][k]
        mapped[:, states * (k + 1) : states * (k + 2)] += problem["G"][k]
        if problem["seen"][k]:
            rows.append(problem["H"][k] @ mapped)
            expected.append(problem["H"][k] @ certain)
            noise.append(problem["R"][k] @ problem["R"][k].T)
    across = np.concatenate(rows)
    covariance = across @ across.T
    for place, one in enumerate(noise):
        part = slice(place * measured, (place + 1) * measured)
        covariance[part, part] += one
    surprise = problem["z"][problem["seen"]].ravel() - np.concatenate(expected)
    gain = np.linalg.solve(covariance, across @ mapped.T).T
    density = stats.multivariate_normal(np.zeros(surprise.size), covariance).logpdf(surprise)
    return certain + gain @ surprise, mapped @ mapped.T - gain @ across @ mapped.T, float(density)


@pytest.mark.parametrize(
    ("states", "measured", "dtype"),
    [(1, 1, "float64"), (2, 1, "float32"), (3, 3, "float64"), (4, 2, "float32"), (6, 3, "float64")],
)
def test_it_is_the_conditional_gaussian(states: int, measured: int, dtype: str) -> None:
    problem = random_problem(np.random.default_rng([states, measured]), states, measured)
    mean, covariance, density = conditioned(problem)
    with jax.enable_x64(dtype == "float64"):
        given = {name: jnp.asarray(one, None if one.dtype == bool else dtype) for name, one in problem.items()}
        last, (_, innovations) = jax.jit(filtered)(given)
        bound = 1e-9 if dtype == "float64" else 3e-4
        np.testing.assert_allclose(last.mean, mean, atol=bound * np.abs(mean).max())
        np.testing.assert_allclose(last.covariance, covariance, atol=bound * np.abs(covariance).max())
        np.testing.assert_allclose(np.float64(innovations.log_likelihood).sum(), density, rtol=bound)
        np.testing.assert_array_equal(last.covariance, last.covariance.T)
        np.testing.assert_array_equal(np.triu(last.root, 1), 0.0)


def test_the_innovation_is_what_it_says() -> None:
    problem = random_problem(np.random.default_rng(7), 4, 2)
    with jax.enable_x64(True):
        before = Gaussian(jnp.asarray(problem["mean"]), jnp.asarray(problem["root"]))
        _, found = update(before, problem["z"][0], MeasurementModel(problem["H"][0], problem["R"][0]))
    covariance = problem["H"][0] @ problem["root"] @ problem["root"].T @ problem["H"][0].T
    covariance += problem["R"][0] @ problem["R"][0].T
    value = problem["z"][0] - problem["H"][0] @ problem["mean"]
    np.testing.assert_allclose(found.value, value, rtol=1e-12)
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-12)
    np.testing.assert_allclose(found.whitened, np.linalg.solve(np.linalg.cholesky(covariance), value), rtol=1e-10)


def test_what_is_not_seen_changes_nothing() -> None:
    before = Gaussian(jnp.array([1.0, 2.0]), jnp.array([[2.0, 0.0], [0.3, 1.0]]))
    after, found = jax.jit(update)(before, jnp.array([jnp.nan]), position_model(0.1, 2), False)
    jax.tree.map(np.testing.assert_array_equal, after, before)
    for one in found:
        np.testing.assert_array_equal(one, 0.0)
    slope = jax.grad(lambda z: jnp.sum(update(before, z, position_model(0.1, 2), False)[0].mean))(jnp.array([jnp.nan]))
    np.testing.assert_array_equal(slope, 0.0)


@pytest.mark.parametrize("dt", [1e-3, 0.05, 2.0])
@pytest.mark.parametrize("axes", [1, 2])
def test_models_are_those_of_the_book(dt: float, axes: int) -> None:
    unit = np.eye(axes)
    with jax.enable_x64(True):
        velocity = constant_velocity(dt, 3.0, axes, control=True)
        noise = 3.0 * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        np.testing.assert_allclose(velocity.noise_root @ velocity.noise_root.T, np.kron(noise, unit), rtol=1e-12)
        np.testing.assert_allclose(velocity.transition, np.kron([[1, dt], [0, 1]], unit))
        np.testing.assert_allclose(velocity.control, np.kron([[dt**2 / 2], [dt]], unit))
        jerk = constant_acceleration(dt, 3.0, axes)
        noise = 3.0 * np.array(
            [
                [dt**5 / 20, dt**4 / 8, dt**3 / 6],
                [dt**4 / 8, dt**3 / 3, dt**2 / 2],
                [dt**3 / 6, dt**2 / 2, dt],
            ]
        )
        np.testing.assert_allclose(jerk.noise_root @ jerk.noise_root.T, np.kron(noise, unit), rtol=1e-11)
        np.testing.assert_allclose(jerk.transition, np.kron([[1, dt, dt**2 / 2], [0, 1, dt], [0, 0, 1]], unit))


@pytest.mark.parametrize("model", [constant_velocity, constant_acceleration])
def test_two_short_steps_are_one_long_one(model: Any) -> None:
    states = 2 if model is constant_velocity else 3
    with jax.enable_x64(True):
        start = Gaussian(jnp.arange(1.0, 1.0 + states), 0.1 * jnp.eye(states))
        twice = predict(predict(start, model(0.2, 5.0)), model(0.3, 5.0))
        once = predict(start, model(0.5, 5.0))
        np.testing.assert_allclose(twice.mean, once.mean, rtol=1e-12)
        np.testing.assert_allclose(twice.covariance, once.covariance, rtol=1e-12)


def test_errors_are_as_large_as_the_filter_says() -> None:
    """NEES over 1,000 runs of a tracker of two axes, in its 95 % band (Bar-Shalom et al., 2001, equation 5.4.2-7)."""
    runs, steps, dt = 1000, 40, 0.05
    dynamics, sensor = constant_velocity(dt, 2.0, axes=2), position_model(0.03, 4, axes=2)
    random = np.random.default_rng(11)
    first = np.diag([0.03, 0.03, 1.0, 1.0])
    truth = random.normal(size=(runs, 4)) @ first
    states = [truth := truth @ np.asarray(dynamics.transition).T + w @ np.asarray(dynamics.noise_root).T
              for w in random.normal(size=(steps, runs, 4))]  # fmt: skip
    truths = np.stack(states, axis=1)
    measured = truths[..., :2] + 0.03 * random.normal(size=(runs, steps, 2))

    def one(track: Any) -> Any:
        def step(state: Gaussian, z: Any) -> Any:
            state, innovation = update(predict(state, dynamics), z, sensor)
            return state, (state, jnp.sum(innovation.whitened**2))

        return jax.lax.scan(step, Gaussian(jnp.zeros(4), jnp.asarray(first, jnp.float32)), track)[1]

    found, nis = jax.jit(jax.vmap(one))(jnp.asarray(measured, jnp.float32))
    error = np.linalg.solve(np.float64(found.root[:, -1]), (truths - found.mean)[:, -1, :, None])[..., 0]
    low, high = stats.chi2(4 * runs).ppf([0.025, 0.975]) / runs
    assert low < np.mean(np.sum(error**2, axis=1)) < high
    # Innovations are independent, so all steps of all runs count (5.4.2-8).
    low, high = stats.chi2(2 * runs * steps).ppf([0.025, 0.975]) / (runs * steps)
    assert low < np.mean(np.float64(nis)) < high


@partial(jax.jit, static_argnums=(0, 1))
def many_updates(count: int, axes: int, density: Any) -> tuple[Gaussian, Any]:
    dynamics, sensor = constant_velocity(1e-3, density, axes), position_model(1e-6, 2 * axes, axes)

    def step(held: Any, k: Any) -> Any:
        state, well = held
        state, _ = update(predict(state, dynamics), jnp.sin(k + jnp.arange(axes, dtype=jnp.float32)), sensor)
        covariance = state.covariance
        well &= jnp.all(jnp.diagonal(state.root) > 0) & jnp.all(covariance == covariance.T)
        return (state, well & jnp.all(jnp.isfinite(state.mean))), None

    return jax.lax.scan(step, (Gaussian(jnp.zeros(2 * axes), jnp.eye(2 * axes)), True), jnp.arange(count))[0]


def is_well(count: int, axes: int, density: float) -> None:
    state, well = many_updates(count, axes, jnp.float32(density))
    assert well
    root = np.float64(state.root)
    covariance = np.float32(root @ root.T)
    # As double precision has it, and as a user of single precision would find out.
    assert np.linalg.eigvalsh(root @ root.T).min() > 0
    assert np.isfinite(np.linalg.cholesky(np.float64(covariance))).all()


@pytest.mark.parametrize("density", [0.0, 1e-6, 1.0])
def test_twenty_thousand_updates_without_noise_stay_positive_definite(density: float) -> None:
    is_well(20_000, 1, density)


@pytest.mark.long
@pytest.mark.parametrize(("axes", "density"), [(1, 0.0), (1, 1.0), (2, 0.0), (2, 1e-6)])
def test_a_million_updates_without_noise_stay_positive_definite(axes: int, density: float) -> None:
    is_well(1_000_000, axes, density)


def test_a_mean_of_many_loses_nothing() -> None:
    """A constant, measured 30,000 times in single precision: its variance is R/n."""
    still, sensor = Dynamics(jnp.eye(1), jnp.zeros((1, 1))), MeasurementModel(jnp.ones((1, 1)), 1e-6 * jnp.ones((1, 1)))
    z = np.float32(1e-6) * np.random.default_rng(3).normal(size=(30_000, 1)).astype(np.float32)
    step = lambda state, one: (update(predict(state, still), one, sensor)[0], None)  # noqa: E731
    last = jax.jit(lambda z: jax.lax.scan(step, Gaussian(jnp.zeros(1), jnp.ones((1, 1))), z)[0])(z)
    np.testing.assert_allclose(last.covariance[0, 0], 1e-12 / 30_000, rtol=3e-3)
    np.testing.assert_allclose(last.mean, np.float64(z).mean(axis=0), atol=2e-10)


def test_slopes_are_those_of_central_differences() -> None:
    problem = random_problem(np.random.default_rng(1), 2, 2)
    names = ("z", "F", "G", "H", "R", "u", "mean", "root")
    random = np.random.default_rng(5)
    with jax.enable_x64(True):
        given = {name: jnp.asarray(one) for name, one in problem.items()}

        @jax.jit
        def cost(changed: dict[str, Any]) -> Any:
            last, (_, found) = filtered({**given, **changed})
            return jnp.sum(found.log_likelihood) + jnp.sum(last.mean) + jnp.sum(last.covariance)

        slopes = jax.grad(cost)({name: given[name] for name in names})
        for name in names:
            along = random.normal(size=given[name].shape)
            if name in ("R", "root"):
                along = np.tril(along)  # what lies above the diagonal is no part of a root
            ahead, back = (cost({name: given[name] + sign * 1e-6 * along}) for sign in (1, -1))
            np.testing.assert_allclose(np.sum(slopes[name] * along), (ahead - back) / 2e-6, rtol=1e-5, err_msg=name)


@jax.jit
@partial(jax.value_and_grad, argnums=(0, 1, 2))
def sloped(density: Any, dt: Any, sd: Any) -> Any:
    state = predict(Gaussian(jnp.zeros(3), jnp.eye(3)), constant_acceleration(dt, density))
    state, found = update(state, jnp.ones(1), position_model(sd, 3))
    return jnp.sum(state.mean) + found.log_likelihood


@pytest.mark.parametrize("density", [0.0, 1e-20, 1e10])
@pytest.mark.parametrize("dt", [0.0, 1e-9, 1e3])
def test_values_and_slopes_are_finite_where_it_is_hard(density: float, dt: float) -> None:
    value, slopes = sloped(*map(jnp.float32, (density, dt, 1e-3)))
    assert jnp.isfinite(value)
    assert all(map(jnp.isfinite, slopes))


def test_a_root_of_what_is_known_for_certain_has_no_nan() -> None:
    covariance = np.array([[4.0, 0.0, 2.0], [0.0, 0.0, 0.0], [2.0, 0.0, 3.0]])
    root = covariance_root(covariance)
    np.testing.assert_allclose(root @ root.T, covariance, atol=1e-6)
    assert jnp.isfinite(jax.jit(jax.jacobian(covariance_root))(jnp.asarray(covariance))).all()
