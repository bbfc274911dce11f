"""The linear Kalman filter, one step at a time: x₊ = F x + B u + w, z = H x + v, w and v Gaussian and white.

What is carried is a root of the covariance, P = L Lᵀ, lower triangular with a positive diagonal: P is symmetric, and
positive definite, whatever the rounding does. A prediction makes [F L, G] triangular again by reflections; an update
multiplies L by a triangular factor that is a sum of squares throughout (Carlson, AIAA Journal 11, 1973; the textbook
is Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, sections 5.2 and 7.4).
There is no difference of covariances anywhere, so that single precision is enough.

All functions are pure and of one step: `jax.lax.scan` goes through time, with other matrices at each step where they
change, and `jax.vmap` over objects.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxradar._numerics import safe_divide, safe_sqrt
from jaxradar._types import Flag, Scalar, Setting, Value

__all__ = [
    "Dynamics",
    "Gaussian",
    "Innovation",
    "MeasurementModel",
    "constant_acceleration",
    "constant_velocity",
    "covariance_root",
    "position_model",
    "predict",
    "update",
]

LOG_2_PI = math.log(2.0 * math.pi)

Vector = Float[Array | np.ndarray, " states"]
Root = Float[Array | np.ndarray, "states states"]


class Gaussian(NamedTuple):
    """What is known of the state: its mean, and a lower triangular root L of its covariance L Lᵀ."""

    mean: Vector
    root: Root

    @classmethod
    def of(cls, mean: Vector, covariance: Root) -> Gaussian:
        return cls(jnp.asarray(mean), covariance_root(covariance))

    @property
    def covariance(self) -> Float[Array, "states states"]:
        """Symmetric to the last bit."""
        return _squared(jnp.asarray(self.root))


class Dynamics(NamedTuple):
    """How the state goes on: `transition` F, `noise_root` G with Q = G Gᵀ, `control` B for inputs u (None: none)."""

    transition: Float[Array | np.ndarray, "states states"]
    noise_root: Float[Array | np.ndarray, "states noises"]
    control: Float[Array | np.ndarray, "states inputs"] | None = None


class MeasurementModel(NamedTuple):
    """What of the state is measured: `observation` H, and a lower triangular `noise_root` of R with no 0 on its
    diagonal."""

    observation: Float[Array | np.ndarray, "measured states"]
    noise_root: Float[Array | np.ndarray, "measured measured"]


class Innovation(NamedTuple):
    """A measurement beside what was expected of it; all 0 where there was none.

    `value` z − H x and its `covariance` S = H P Hᵀ + R; `whitened`: S^(−½) (z − H x), by the triangular root of S,
    white and of variance 1 where the model is right, the sum of its squares is the normalised innovation squared;
    `log_likelihood` ln N(z; H x, S).
    """

    value: Float[Array, " measured"]
    covariance: Float[Array, "measured measured"]
    whitened: Float[Array, " measured"]
    log_likelihood: Value


def predict(
    state: Gaussian, dynamics: Dynamics, control: Float[Array | np.ndarray, " inputs"] | None = None
) -> Gaussian:
    """The state one step later: F x + B u, F P Fᵀ + Q."""
    mean = _product(dynamics.transition, state.mean)
    if dynamics.control is not None and control is not None:
        mean = mean + _product(dynamics.control, control)
    spread = jnp.concatenate([_product(dynamics.transition, state.root), jnp.asarray(dynamics.noise_root)], axis=1)
    return Gaussian(mean, _triangular(spread))


def update(
    state: Gaussian,
    measurement: Float[Array | np.ndarray, " measured"],
    model: MeasurementModel,
    seen: Flag | bool = True,
) -> tuple[Gaussian, Innovation]:
    """The state after a measurement, and the innovation; where not `seen`, the state as it was, whatever is measured.

    `seen` is of the measurement as a whole: what comes and goes on its own has a model of its own.
    """
    seen = jnp.asarray(seen)
    mean, root = jnp.asarray(state.mean), jnp.asarray(state.root)
    observation, noise_root = jnp.asarray(model.observation), jnp.asarray(model.noise_root)
    expected = _product(observation, mean)
    value = jnp.where(seen, jnp.asarray(measurement), expected) - expected
    # In units of the measurement's noise, white: its components are then taken in one by one.
    inverse = _inverse(noise_root)
    scaled, rows = _product(inverse, value), _product(inverse, observation)
    moved, whitened, variances = jnp.zeros_like(mean), [], []
    for scaled_one, row in zip(scaled, rows, strict=True):
        one = scaled_one - _product(row, moved)
        gain, root, variance = _take_in(root, row)
        moved = moved + gain * one
        whitened.append(one / jnp.sqrt(variance))
        variances.append(variance)
    white, spread = jnp.stack(whitened), jnp.stack(variances)
    density = white**2 + jnp.log(spread) + LOG_2_PI + 2.0 * jnp.log(jnp.abs(jnp.diagonal(noise_root)))
    covariance = _squared(jnp.concatenate([_product(observation, state.root), noise_root], axis=1))
    return Gaussian(jnp.where(seen, mean + moved, mean), jnp.where(seen, root, state.root)), Innovation(
        value=value,
        covariance=jnp.where(seen, covariance, 0.0),
        whitened=jnp.where(seen, white, 0.0),
        log_likelihood=jnp.where(seen, -0.5 * jnp.sum(density), 0.0),
    )


def _take_in(root: Array, row: Array) -> tuple[Array, Array, Array]:
    """Gain, root and variance of the innovation, of one measurement with a noise of variance 1.

    f = Lᵀ h, βⱼ = 1 + Σ fᵢ² from i = j on: the variance is β₀, the gain L f/β₀, and L₊ = L C with the lower triangular
    root C of 1 − f fᵀ/β₀, C ⱼⱼ = √(βⱼ₊₁/βⱼ), C ᵢⱼ = −fᵢ fⱼ/√(βⱼ βⱼ₊₁): the diagonal is never 0 (Carlson, 1973).
    """
    count = root.shape[0]
    later = jnp.triu(jnp.ones((count, count), root.dtype), 1)
    f = _product(row, root)
    after = 1.0 + _product(later, f * f)
    before = after + f * f
    weighted = root * f
    beyond = _product(weighted, later.T)
    # √β each, not of the product: that would leave the range of single precision first.
    made = root * jnp.sqrt(after / before) - beyond * (f / jnp.sqrt(before) / jnp.sqrt(after))
    return (beyond[:, 0] + weighted[:, 0]) / before[0], made, before[0]


def covariance_root(covariance: Float[Array | np.ndarray, "states states"]) -> Float[Array, "states states"]:
    """A lower triangular root of a covariance (Cholesky); 0 where something is known for certain, not NaN.

    Finite gradients wherever the covariance is positive definite or a direction of it is 0.
    """
    left = jnp.asarray(covariance)
    columns = []
    for j in range(left.shape[0]):
        at = safe_sqrt(left[j, j])
        column = jnp.where(jnp.arange(left.shape[0]) >= j, safe_divide(left[:, j], jnp.full_like(left[:, j], at)), 0.0)
        columns.append(column)
        left = left - jnp.outer(column, column)
    return jnp.stack(columns, axis=1)


def constant_velocity(dt: Scalar | float, density: Setting, axes: int = 1, control: bool = False) -> Dynamics:
    """Positions, then velocities, of `axes` dimensions `dt` s later; the acceleration is white noise.

    `density`: its power spectral density in m²/s³; the velocity changes by about √(density dt) within `dt`. Q = density
    [[dt³/3, dt²/2], [dt²/2, dt]] (Bar-Shalom, Li and Kirubarajan, 2001, equation 6.2.2-12), here by its root. With
    `control` the input is an acceleration for each axis, held over `dt`.
    """
    dt = jnp.asarray(dt, jnp.result_type(float))
    one, none, root = jnp.ones_like(dt), jnp.zeros_like(dt), safe_sqrt(dt)
    return _on_axes(
        axes,
        safe_sqrt(jnp.asarray(density, dt.dtype)),
        [[one, dt], [none, one]],
        [[dt * root / math.sqrt(3.0), none], [0.5 * math.sqrt(3.0) * root, 0.5 * root]],
        [[0.5 * dt * dt], [dt]] if control else None,
    )


def constant_acceleration(dt: Scalar | float, density: Setting, axes: int = 1) -> Dynamics:
    """Positions, velocities, accelerations of `axes` dimensions `dt` s later; the jerk is white noise.

    `density`: its power spectral density in m²/s⁵. Q = density [[dt⁵/20, dt⁴/8, dt³/6], [dt⁴/8, dt³/3, dt²/2],
    [dt³/6, dt²/2, dt]] (Bar-Shalom, Li and Kirubarajan, 2001, section 6.3.2), here by its root.
    """
    dt = jnp.asarray(dt, jnp.result_type(float))
    one, none, root = jnp.ones_like(dt), jnp.zeros_like(dt), safe_sqrt(dt)
    once, twice = dt * root, dt * dt * root
    return _on_axes(
        axes,
        safe_sqrt(jnp.asarray(density, dt.dtype)),
        [[one, dt, 0.5 * dt * dt], [none, one, dt], [none, none, one]],
        [
            [twice / math.sqrt(20.0), none, none],
            [math.sqrt(5.0) / 4.0 * once, once / (4.0 * math.sqrt(3.0)), none],
            [math.sqrt(5.0) / 3.0 * root, root / math.sqrt(3.0), root / 3.0],
        ],
    )


def position_model(sd: Setting, states: int, axes: int = 1) -> MeasurementModel:
    """The first `axes` of the states, each with independent noise of standard deviation `sd`."""
    dtype = jnp.result_type(float)
    return MeasurementModel(jnp.eye(axes, states, dtype=dtype), jnp.asarray(sd, dtype) * jnp.eye(axes, dtype=dtype))


def _on_axes(
    axes: int, scale: Array, transition: list[list[Array]], noise_root: list[list[Array]], control: object = None
) -> Dynamics:
    unit = jnp.eye(axes, dtype=scale.dtype)
    whole = lambda rows: jnp.kron(jnp.stack([jnp.stack(row) for row in rows]), unit)  # noqa: E731
    driven = None if control is None else whole(control)
    return Dynamics(whole(transition), scale * whole(noise_root), driven)


def _triangular(spread: Array) -> Array:
    """The lower triangular L, its diagonal not negative, with L Lᵀ = A Aᵀ: Householder's reflections from the right.

    Rows may be of any size beside each other, as states in their own units are.
    """
    rows = spread
    states = rows.shape[0]
    for j in range(states):
        # Their squares would leave the range of single precision: 1e-20 m is nothing, but no 0.
        largest = jax.lax.stop_gradient(jnp.max(jnp.abs(rows[j, j:])))
        some = largest > 0
        own = rows[j, j:] / jnp.where(some, largest, 1.0)
        length = safe_sqrt(jnp.sum(own * own))
        sign = jnp.where(own[0] < 0, -1.0, 1.0)
        mirror = own.at[0].add(sign * length)
        # Half of its square, without the difference of near numbers: |own| (|own| + |own₀|).
        half = jnp.where(some, length * (length + jnp.abs(own[0])), 1.0)
        turned = rows[j:, j:] - jnp.outer(_product(rows[j:, j:], mirror) / half, mirror)
        # −sign · length stands in the first column then, and 0 in the rest of the first row.
        turned = turned.at[:, 0].multiply(-sign)
        turned = turned.at[0].set(0.0).at[0, 0].set(length * largest)
        rows = rows.at[j:, j:].set(jnp.where(some, turned, rows[j:, j:]))
    return rows[:, :states]


def _inverse(root: Array) -> Array:
    """Of a small lower triangular matrix, by substitution."""
    if root.shape[0] == 1:
        return 1.0 / root
    # Written out: a library's routine would be a call that other compilers do not know.
    rows: list[Array] = []
    for place, unit in enumerate(jnp.eye(root.shape[0], dtype=root.dtype)):
        left = unit - sum((root[place, other] * rows[other] for other in range(place)), jnp.zeros_like(unit))
        rows.append(left / root[place, place])
    return jnp.stack(rows)


def _squared(root: Array) -> Array:
    half = _product(root, root.T)
    return 0.5 * (half + half.T)


def _product(left: Array | np.ndarray, right: Array | np.ndarray) -> Array:
    # An accelerator would round single precision to ten bits in a product.
    return jnp.matmul(jnp.asarray(left), jnp.asarray(right), precision=jax.lax.Precision.HIGHEST)
