"""How likely sweeps over a step are at each height of it: the part of `step_height` that is compiled.

While the edge passes below the sensor, the road before it lies H below the sensor and that beyond it H − h, both
raised by the body b: the mean power of each range cell is that of the strips before the edge, of one road, and of the
strips beyond it, of the other. Speckle makes each power exponential about its mean P, so ln p = −ln P − p/P (Goodman,
Speckle Phenomena in Optics, section 2.2).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxradar._numerics import compiled
from jaxradar._types import Value
from jaxradar.signal.pulses import SIGMA_PER_FWHM
from jaxradar.survey.ground import Beam, Ground, strip_powers

__all__ = ["Car", "Passage", "height_likelihood", "road_table", "slopes_of"]

USUAL_M = 0.04  # height of a step whose body sets what a sweep counts
# Where on its way over an edge a wheel has made these shares of the height: steep at first up, at last down.
SHARES = (0.125, 0.375, 0.625, 0.875)
CLIMB, DROP = tuple(1.0 - math.sqrt(1.0 - one) for one in SHARES), tuple(math.sqrt(one) for one in SHARES)


class Passage(NamedTuple):
    """Sweeps around a step, and where it is looked for.

    - `times_s` (sweeps,), `powers` (sweeps, cells): mean square of each range cell, counts²; `weights` (sweeps,): 0 of
      those that are left out.
    - `rise_m`: (sweeps,) rise of the sensor since before the step where it was measured, NaN elsewhere.
    - `passes_s` (times,): when the edge is below the sensor; `log_prior` (times,). `speed_m_s`: of the car.
    - `heights_m` (heights,), `corners` (corners,): the step's height, and the power of its corner over the road's.
    """

    times_s: Float[Array, " sweeps"]
    powers: Float[Array, "sweeps cells"]
    weights: Float[Array, " sweeps"]
    rise_m: Float[Array, " sweeps"]
    passes_s: Float[Array, " times"]
    log_prior: Float[Array, " times"]
    speed_m_s: Value
    heights_m: Float[Array, " heights"]
    corners: Float[Array, " corners"]


class Car(NamedTuple):
    """Scalars: how far the front axle lies behind the sensor, the tyre's radius, the body's own frequency in rad/s and
    damping over its front axle, how much of the front axle's rise the sensor makes, how long the wheel takes to take it
    along, and the share of the step from which on a guessed rise is not trusted."""

    front_wheel_m: Value
    tyre_m: Value
    omega: Value
    damping: Value
    lever: Value
    lag_s: Value
    follows: Value


class Table(NamedTuple):
    """Mean powers of the strips behind each place, for each distance of the road below the sensor:
    (levels, strips + 1, cells), with the first level and place and their spacing."""

    behind: Float[Array, "levels places cells"]
    level_m: Value
    level_step_m: Value
    place_m: Value
    place_step_m: Value

    def at(self, level_m: Array, place_m: Array) -> Array:
        """Linear between levels and places: (..., cells)."""
        levels, places = self.behind.shape[:2]
        level = jnp.clip((level_m - self.level_m) / self.level_step_m, 0.0, levels - 1.001)
        place = jnp.clip((place_m - self.place_m) / self.place_step_m, 0.0, places - 1.001)
        i, j = jnp.floor(level).astype(jnp.int32), jnp.floor(place).astype(jnp.int32)
        u, w = (level - i)[..., None], (place - j)[..., None]
        low = (1.0 - w) * self.behind[i, j] + w * self.behind[i, j + 1]
        high = (1.0 - w) * self.behind[i + 1, j] + w * self.behind[i + 1, j + 1]
        return (1.0 - u) * low + u * high


def _road_table(beam: Beam, ground: Ground, levels_m: Array, strips_m: Array, range_m: Array) -> Table:
    powers = jax.vmap(lambda level: strip_powers(beam, ground, level, strips_m, range_m))(levels_m)
    behind = jnp.pad(jnp.cumsum(powers, axis=1), ((0, 0), (1, 0), (0, 0)))
    step = strips_m[1] - strips_m[0]
    return Table(behind, levels_m[0], levels_m[1] - levels_m[0], strips_m[0] - 0.5 * step, step)


def _body(car: Car, passage: Passage, pass_s: Array, height_m: Array) -> tuple[Array, Array]:
    """Rise of the sensor at each sweep, and how much each sweep still says: where the rise is not measured, that of a
    mass on spring and damper over a wheel that climbs the edge, whose answer to a step of its base is
    1 − e^(−ζωt) (cos ω't − ζ/√(1 − ζ²) sin ω't)."""
    size = jnp.minimum(jnp.abs(height_m), car.tyre_m)
    reach = jnp.sqrt(jnp.maximum(2.0 * car.tyre_m * size - size**2, 1e-12))
    touches = pass_s + (car.front_wheel_m - jnp.where(height_m > 0, reach, 0.0)) / passage.speed_m_s
    way = jnp.where(height_m > 0, jnp.asarray(CLIMB), jnp.asarray(DROP)) * reach
    since = passage.times_s[:, None] - touches - way / passage.speed_m_s
    t = jnp.maximum(since - car.lag_s, 0.0)
    root = jnp.sqrt(1.0 - car.damping**2)
    turn = car.omega * root * t
    answer = 1.0 - jnp.exp(-car.damping * car.omega * t) * (jnp.cos(turn) - car.damping / root * jnp.sin(turn))
    share = car.lever * jnp.mean(answer, axis=1)
    measured = ~jnp.isnan(passage.rise_m)
    rise = jnp.where(measured, jnp.nan_to_num(passage.rise_m), height_m * share)
    # What a guess of the car's springs errs by grows with the rise.
    return rise, jnp.where(measured, 1.0, jnp.exp(-0.5 * (share / car.follows) ** 2))


def _likelihood(beam: Beam, ground: Ground, table: Table, range_m: Array, car: Car, passage: Passage) -> Array:
    """(times, corners, heights): logarithm of the likelihood, prior of the times included."""
    noise = jnp.exp(ground.log_noise)
    farthest = table.place_m + table.place_step_m * (table.behind.shape[1] - 1)
    # Of one height and moment for all: whose sweeps counted less would seem likelier.
    _, says = _body(car, passage, jnp.zeros(()), jnp.asarray(USUAL_M))

    def at(pass_s: Array, height_m: Array) -> Array:
        ahead = passage.speed_m_s * (pass_s - passage.times_s)
        rise, _ = _body(car, passage, pass_s, height_m)
        level = ground.height_m + rise
        # Behind a step down the road lies in its shadow.
        lit = ahead * (1.0 + jnp.maximum(-height_m, 0.0) / level * (ahead > 0))
        beyond = table.at(level - height_m, jnp.full_like(ahead, farthest)) - table.at(level - height_m, lit)
        power = table.at(level, ahead) + beyond + noise
        corner = _corner(beam, ground, level, ahead, range_m) * (height_m > 0)

        def one(strength: Array) -> Array:
            mean = power + strength * corner
            each = -jnp.log(mean) - passage.powers / mean + jnp.log(passage.powers + 1e-3 * noise) + 1.0
            return jnp.sum(passage.weights * says * jnp.sum(each, axis=1))

        return jax.vmap(one)(passage.corners)

    over_heights = jax.vmap(at, in_axes=(None, 0), out_axes=1)
    found = jax.lax.map(lambda pass_s: over_heights(pass_s, passage.heights_m), passage.passes_s)
    return found + passage.log_prior[:, None, None]


def _corner(beam: Beam, ground: Ground, level: Array, ahead: Array, range_m: Array) -> Array:
    """(sweeps, cells): power of a corner `ahead`, of which the aperture is the face seen at sin θ, in that of 1 m² of
    a grain as bright as the road's."""
    x = jnp.maximum(ahead, 0.0)
    reach = jnp.sqrt(x**2 + level**2)
    off = (jnp.arctan2(level, x) - ground.down_rad) / (beam.vertical_beam_deg * (math.pi / 180.0))
    brightness = jnp.exp(ground.log_facets) + jnp.exp(ground.log_grain)
    power = (
        brightness
        * (x / reach) ** 2
        * jnp.exp(-8.0 * math.log(2.0) * off**2 - (2.0 * beam.exponent - 1.0) * jnp.log(reach))
    )
    sigma = SIGMA_PER_FWHM * beam.fwhm_m
    return power[:, None] * jnp.exp(-(((reach[:, None] - range_m) / sigma) ** 2))


def _slopes(table: Table, ground: Ground) -> tuple[Array, Array]:
    """(cells,) each: mean power over the flat road, and the slope of its logarithm by the road's height."""
    end = jnp.asarray(table.place_m + table.place_step_m * (table.behind.shape[1] - 1))
    noise = jnp.exp(ground.log_noise)
    mean, other = (table.at(ground.height_m + by, end) + noise for by in (0.0, table.level_step_m))
    return mean, jnp.log(other / mean) / table.level_step_m


road_table = compiled(_road_table)
height_likelihood = compiled(_likelihood)
slopes_of = compiled(_slopes)
