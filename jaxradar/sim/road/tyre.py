"""Where a wheel runs on a road: a circle touches edges before its axle is above them."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxradar._types import Setting, Value
from jaxradar.sim.road.elements import RoadElement, beyond_edge

__all__ = ["contact_m", "wheel_height"]

OFFSETS = 101  # places under the tyre that are looked at, denser towards its ends, where it is steep
CHUNK = 1024

Height = Callable[[Array, Array], Array]


def contact_m(height_m: Setting, radius_m: Setting) -> Setting:
    """How far before its axle is above an edge a tyre touches it, √(2 r h − h²): requirement 2A; for h ≥ r, r."""
    return np.sqrt(max(2.0 * radius_m * min(height_m, radius_m) - min(height_m, radius_m) ** 2, 0.0))


def wheel_height(
    height: Height,
    road: tuple[RoadElement, ...],
    x_m: Float[Array, " places"],
    y_m: Float[Array, " places"] | float,
    radius_m: Setting,
) -> Float[Array, " places"]:
    """Height of the lowest point of wheels over the first road, their axles at `x_m`, themselves at `y_m` (one for all
    or one for each): the largest of z(x + u) + √(r² − u²) − r over all u within the tyre, so that a wheel stands on the
    highest thing that it touches.

    The edges of vertical faces are looked at where they are, not at the nearest of the places. Constant, rigid radius.
    The gradient is that at the point of contact.
    """
    radius = jnp.asarray(radius_m, x_m.dtype)
    offsets = radius * jnp.sin(0.5 * np.pi * jnp.linspace(-1.0, 1.0, OFFSETS, dtype=x_m.dtype))

    def at(place: tuple[Value, Value]) -> Value:
        x, y = place
        places = offsets
        for element in road:
            for face in element.faces():
                # The edge is at x + u; a wheel meets the top of the face, on whichever side of it that is.
                angle = jnp.asarray(element.oblique_deg, x.dtype) * (np.pi / 180.0)
                away = beyond_edge(element, x, y) - face.at_m
                edge = -away / jnp.cos(angle)
                high = edge + (1e-9 if face.rises else -1e-9)
                places = jnp.concatenate([places, jnp.clip(high, -radius, radius)[None]])
        rest = jnp.sqrt(jnp.maximum(radius**2 - places**2, 1e-30)) - radius
        lifted = height(x + places, jnp.full_like(places, y)) + rest
        return lifted[jax.lax.stop_gradient(jnp.argmax(lifted))]

    across = jnp.broadcast_to(jnp.asarray(y_m, x_m.dtype), x_m.shape)
    return jax.lax.map(at, (x_m, across), batch_size=CHUNK)
