"""The road as points that reflect, each with its own place, height and complex reflectivity, tied to the ground.

That the points do not move is what makes speckle move with the car: the echoes of many add up with phases that turn as
the car goes on. They stand one behind the other along the path, at places across it that are spread by the golden
ratio, closer together near the middle, where a smooth road reflects most.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from jaxradar._numerics import cosine_sine
from jaxradar.sim.road.elements import RoadElement, beyond_edge
from jaxradar.sim.road.roughness import RoughnessTable, rough_height

__all__ = ["Points", "lay_points", "road_height", "visible_points"]

CROWDING = 3.0  # points stand sinh(3)/3 = 3.3 times closer in the middle than evenly spread ones
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


class Points(NamedTuple):
    """Points in order along the path. `real` and `imag`: reflectivity, complex Gaussian so that an echo's phase is any,
    times the root of the patch of road that a point stands for (its mean square is that area in m²). Height and slopes
    are None on a road that is even throughout."""

    y_m: Float[Array, " points"]
    real: Float[Array, " points"]
    imag: Float[Array, " points"]
    z_m: Float[Array, " points"] | None = None
    slope_x: Float[Array, " points"] | None = None
    slope_y: Float[Array, " points"] | None = None


def road_height(
    road: tuple[RoadElement, ...],
    rough: RoughnessTable | None,
    x_m: Float[Array, "*points"],
    y_m: Float[Array, "*points"],
) -> Float[Array, "*points"]:
    """Height of the road in metres at distances along the path and across it (positive to the left)."""
    height = jnp.zeros_like(x_m)
    for element in road:
        height = height + element.profile(beyond_edge(element, x_m, y_m))
    return height if rough is None else height + rough_height(rough, x_m)


def lay_points(
    road: tuple[RoadElement, ...],
    rough: RoughnessTable | None,
    first: int,
    count: int,
    spacing_m: float,
    half_width_m: float,
    key: PRNGKeyArray,
) -> Float[Array, "quantities points"]:
    """The points number `first` to `first + count`, `spacing_m` apart, number 0 at the sensor's foot when the scene
    begins: a row for each quantity of `Points`. A point is the same wherever the table begins: its draws come from its
    own number."""
    number = first + jnp.arange(count)
    x = number * spacing_m
    # Which fraction of a turn needs all digits; what is made of it does not.
    even = (2.0 * jnp.mod(number * GOLDEN + 0.5, 1.0) - 1.0).astype(jnp.float32)
    up = jnp.exp(CROWDING * even)
    sinh, cosh = 0.5 * (up - 1.0 / up), 0.5 * (up + 1.0 / up)
    crowd = math.sinh(CROWDING)
    y = (half_width_m / crowd * sinh).astype(x.dtype)
    # A strip of no width stands for a road that has no breadth, and so for an area of its own length.
    width = 2.0 * half_width_m * CROWDING / crowd * cosh if half_width_m else spacing_m
    root = jnp.sqrt(0.5 * width * spacing_m)
    rows = [y, *((root * part).astype(x.dtype) for part in complex_normal(key, number))]
    if road or rough is not None:
        single = lambda x, y: road_height(road, rough, x, y)  # noqa: E731
        z, (slope_x, slope_y) = jax.vmap(jax.value_and_grad(single, argnums=(0, 1)))(x, y)
        rows += [z, slope_x, slope_y]
    return jnp.stack(rows)


def complex_normal(
    key: PRNGKeyArray, number: Int[Array, " points"]
) -> tuple[Float[Array, " points"], Float[Array, " points"]]:
    """Two independent standard normals for each number, the same wherever it stands among others.

    Box and Muller, Annals of Mathematical Statistics 29, 1958, from the two words of the key that belongs to the
    number: one hash each, a third of what `jax.random.normal` of that key would take.
    """
    words = jax.random.key_data(jax.vmap(lambda one: jax.random.fold_in(key, one))(number & 0x7FFFFFFF))
    share = ((words >> 8).astype(jnp.float32) + 0.5) * 2.0**-24  # never 0
    cosine, sine = cosine_sine(share[:, 1])
    length = jnp.sqrt(-2.0 * jnp.log(share[:, 0]))
    return length * cosine, length * sine


def visible_points(table: Float[Array, "quantities points"], start: Int[Array, ""], count: int) -> Points:
    """`count` points from number `start` of the table on."""
    return Points(*jax.lax.dynamic_slice_in_dim(table, start, count, axis=1))
