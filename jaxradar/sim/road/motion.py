"""How the car goes along its path: speed in closed form, and the curve that it goes through."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxradar._settings import Settings, in_order, is_plain, setting
from jaxradar._types import Setting, Value

__all__ = ["CarMotion", "Course", "Curve", "SpeedChange", "along", "bend"]

Times = Float[Array, "*times"]


class SpeedChange(Settings):
    """Pulling away or braking: from `at_s` on to the speed `to_m_s`, at an acceleration that builds up and dies away
    evenly within `rise_s`."""

    at_s: Setting = setting(0.0, -1e4, 1e6, "s", "when it begins")
    to_m_s: Setting = setting(8.0, -50.0, 100.0, "m/s", "the speed afterwards")
    acceleration_m_s2: Setting = setting(2.0, 0.01, 20.0, "m/s²", "how fast it changes, without sign")
    rise_s: Setting = setting(0.2, 0.001, 10.0, "s", "how long the acceleration takes to build up")


class Curve(Settings):
    """A bend of the path, entered and left within `ramp_s`."""

    start_s: Setting = setting(0.0, -1e4, 1e6, "s", "when it begins")
    stop_s: Setting = setting(1.0, -1e4, 1e6, "s", "when it ends")
    radius_m: Setting = setting(10.0, -1e5, 1e5, "m", "positive to the left")
    ramp_s: Setting = setting(0.3, 0.001, 10.0, "s", "how long steering in and out takes")

    def __check_init__(self) -> None:
        in_order("Curve", "start_s", self.start_s, "stop_s", self.stop_s)
        if is_plain(self.radius_m) and abs(float(self.radius_m)) < 0.5:
            raise ValueError(f"`Curve(radius_m=...)` must be 0.5 m at least, to either side; got {self.radius_m}.")


class CarMotion(Settings):
    """Speed at the start and what changes it, in order of time; negative is backwards."""

    speed_m_s: Setting = setting(30 / 3.6, -50.0, 100.0, "m/s", "at the start")
    changes: tuple[SpeedChange, ...] = ()
    curve: Curve | None = None

    def __check_init__(self) -> None:
        for one, other in pairwise(self.changes):
            in_order("CarMotion", "changes[...].at_s", one.at_s, "the next one's", other.at_s)


class Course(NamedTuple):
    """Path length since time 0 in metres, speed in m/s, acceleration in m/s²."""

    path_m: Times
    speed_m_s: Times
    acceleration_m_s2: Times


def along(motion: CarMotion, times_s: Times) -> Course:
    """Where the car is and how fast, in closed form, so that 0.1 mm is right after an hour too (in float64)."""
    speed = jnp.asarray(motion.speed_m_s, times_s.dtype)
    path, at, acceleration = speed * times_s, jnp.broadcast_to(speed, times_s.shape), jnp.zeros_like(times_s)
    for change in motion.changes:
        rate, rise = (jnp.asarray(one, times_s.dtype) for one in (change.acceleration_m_s2, change.rise_s))
        more = jnp.asarray(change.to_m_s, times_s.dtype) - speed
        speed = speed + more
        rate = jnp.where(more < 0, -rate, rate)
        since = times_s - jnp.asarray(change.at_s, times_s.dtype)
        start, stop = _ramp(since, rise), _ramp(since - more / rate, rise)
        # Position counts from time 0, where a change may already be under way.
        zero = -jnp.asarray(change.at_s, times_s.dtype)
        start0, stop0 = _ramp(zero, rise), _ramp(zero - more / rate, rise)
        path = path + rate * (start.path_m - stop.path_m - start0.path_m + stop0.path_m)
        at = at + rate * (start.speed_m_s - stop.speed_m_s)
        acceleration = acceleration + rate * (start.acceleration_m_s2 - stop.acceleration_m_s2)
    return Course(path, at, acceleration)


def _ramp(since: Times, rise: Value) -> Course:
    """Of an acceleration that goes from 0 to 1 within `rise`: itself and its two integrals."""
    inside = jnp.clip(since, 0.0, rise)
    beyond = jnp.maximum(since - rise, 0.0)
    path = inside**3 / (6.0 * rise) + beyond * (0.5 * rise) + 0.5 * beyond**2
    return Course(path, inside**2 / (2.0 * rise) + beyond, inside / rise)


def bend(curve: Curve, times_s: Times) -> Times:
    """Curvature of the path in 1/m, positive to the left."""
    ramp = jnp.asarray(curve.ramp_s, times_s.dtype)
    into = jnp.clip((times_s - jnp.asarray(curve.start_s, times_s.dtype)) / ramp, 0.0, 1.0)
    out = jnp.clip((times_s - jnp.asarray(curve.stop_s, times_s.dtype)) / ramp, 0.0, 1.0)
    return (into - out) / jnp.asarray(curve.radius_m, times_s.dtype)
