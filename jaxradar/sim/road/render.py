"""A scene made into sweeps: pure functions of a scene and a key, for `jax.jit`, `jax.vmap` and `jax.grad`.

What is done once for a drive (the ground's points, the car's ride) runs in float64, so that a place on a road of
kilometres is right to a fraction of the wavelength; what is done for each point in each sweep runs in `dtype`. Call
`render` inside `jax.enable_x64(True)`. Memory beside the result does not grow with the number of sweeps: they are made
a block at a time.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray, Shaped

from jaxradar._types import Sweep
from jaxradar.sim.clock import Clock
from jaxradar.sim.radar import Field, envelope, field_of, nodes_of, range_axis
from jaxradar.sim.road.corner import Wall
from jaxradar.sim.road.echoes import Paths, Pose, corner_paths, ground_paths, to_echoes
from jaxradar.sim.road.effect import Counts, SweepContext
from jaxradar.sim.road.elements import Face, RoadElement, beyond_edge
from jaxradar.sim.road.ground import lay_points, road_height, visible_points
from jaxradar.sim.road.motion import along, bend
from jaxradar.sim.road.plan import FINE_S, FINE_START_S, Plan
from jaxradar.sim.road.roughness import RoughnessTable, rough_table
from jaxradar.sim.road.scene import RoadScene
from jaxradar.sim.road.surface import Surface
from jaxradar.sim.road.tyre import wheel_height
from jaxradar.sim.road.vehicle import Ride, ride
from jaxradar.sim.scene import named_stream, through

__all__ = ["Rendered", "render"]

# How far behind and ahead of the sensor a wheel can be: overhang, wheelbase and tyre at their bounds.
REAR_M, AHEAD_M = 22.0, 7.0


class Rendered(NamedTuple):
    """A drive as simulated. `sweeps`: float in counts, or uint16 where the scene rounds them; `saturated`: which of
    them reached full scale; `ride`: the body's motion each `FINE_S`, and `acceleration_m_s2`: its vertical acceleration
    over the front axle as recorded with each sweep, both None for a car without springs."""

    clock: Clock
    sweeps: Shaped[Array, "sweeps bins"]
    saturated: Bool[Array, " sweeps"]
    ride: Ride | None
    acceleration_m_s2: Float[Array, " sweeps"] | None


def render(plan: Plan, scene: RoadScene, key: PRNGKeyArray, dtype: Any = jnp.float32) -> Rendered:
    """All sweeps of a scene. `plan`: `plan_scene` of it, or of one of the same structure and at least its size.

    Raises `ValueError` outside of `jax.enable_x64(True)`.
    """
    if not jax.config.jax_enable_x64:  # type: ignore[attr-defined]
        raise ValueError("`render` needs double precision for places and times; call it inside `jax.enable_x64(True)`.")
    ready = _prepare(plan, scene, key, dtype)
    blocks = -(-plan.sweeps // plan.block)
    numbers = jnp.arange(blocks * plan.block).reshape(blocks, plan.block)
    one = partial(_one_sweep, plan, scene, ready, key, dtype)

    made = lambda block: jax.vmap(one)(jnp.minimum(block, plan.sweeps - 1))  # noqa: E731
    if any(effect.stage == "average" for effect in scene.effects):

        def step(last: Array, block: Array) -> tuple[Array, Counts]:
            averaged = through(scene.effects, "average", made(block), last, key)
            return averaged[-1], _counted(scene, averaged, key)

        _, (sweeps, saturated) = jax.lax.scan(step, made(numbers[0, :1])[0], numbers)
    else:
        sweeps, saturated = jax.lax.map(lambda block: _counted(scene, made(block), key), numbers)
    cut = lambda values: values.reshape(blocks * plan.block, *values.shape[2:])[: plan.sweeps]  # noqa: E731
    acceleration = None
    if ready.ride is not None:
        felt = _at(ready.clock.taken_s, ready.ride.body_m_s2)
        acceleration = through(scene.effects, "acceleration", felt, None, key)
    return Rendered(ready.clock, cut(sweeps), cut(saturated), ready.ride, acceleration)


class _Ready(NamedTuple):
    """What is made once for a drive."""

    clock: Clock
    surface: Surface | None
    ground: Float[Array, "quantities points"] | None
    start: Array
    pose: Pose
    walls: tuple[Wall, ...]
    ride: Ride | None


def _prepare(plan: Plan, scene: RoadScene, key: PRNGKeyArray, dtype: Any) -> _Ready:
    period_s = 1.0 / scene.radar.rate_hz
    even = jnp.arange(plan.sweeps) * period_s
    clock = through(scene.effects, "clock", Clock(even, even, jnp.ones(plan.sweeps, bool)), period_s, key)
    course = along(scene.motion, clock.taken_s)
    rough = None
    if scene.roughness is not None:
        start = plan.first_point * scene.spacing_m
        stop = start + plan.points * scene.spacing_m
        rough = rough_table(scene.roughness, start - REAR_M, stop + AHEAD_M, named_stream(key, "rough"))
    driven = None if scene.vehicle is None else _ride_of(plan, scene, rough)

    surface, ground = scene.surface, None
    if surface is not None:
        surface = through(scene.effects, "surface", surface, None, key)
        ground = lay_points(
            scene.road,
            rough,
            plan.first_point,
            plan.points,
            scene.spacing_m,
            scene.half_width_m,
            named_stream(key, "ground"),
        ).astype(dtype)
    # Which point is the first to be seen, and how far ahead it lies: the one part that needs all digits.
    places = (course.path_m - plan.behind_m) / scene.spacing_m
    number = jnp.floor(jax.lax.stop_gradient(places))
    pose = _pose(scene, clock.taken_s, course.speed_m_s, driven)
    pose = pose._replace(first_m=number * scene.spacing_m - course.path_m)
    walls = () if surface is None else _walls(scene, rough, course.path_m, pose)
    return _Ready(
        clock,
        surface,
        ground,
        jnp.clip(number.astype(jnp.int32) - plan.first_point, 0, plan.points - plan.visible),
        pose,
        walls,
        driven,
    )


def _ride_of(plan: Plan, scene: RoadScene, rough: RoughnessTable | None) -> Ride:
    """The ride over the road that the radar sees, front and rear, left and right wheels each on its own track."""
    vehicle = scene.vehicle
    assert vehicle is not None
    times = FINE_START_S + FINE_S * jnp.arange(plan.fine_steps)
    course = along(scene.motion, times)
    height = partial(road_height, scene.road, rough)
    # All wheels in one call, (axles, sides, times).
    front_wheel = jnp.asarray(scene.mount.front_wheel_m)
    axles = jnp.stack([front_wheel, front_wheel + vehicle.wheelbase_m])
    sides = jnp.asarray(vehicle.half_track_m) * jnp.array([-1.0, 1.0])
    shape = (2, 2, len(times))
    x = jnp.broadcast_to((course.path_m - axles[:, None])[:, None], shape)
    y = jnp.broadcast_to(sides[:, None], shape)
    wheels = wheel_height(height, scene.road, x.ravel(), y.ravel(), vehicle.tyre_radius_m).reshape(shape)
    front, rear = wheels.mean(axis=1)
    return ride(vehicle.system(), jnp.stack([front, rear, course.acceleration_m_s2], axis=1), FINE_S)


def _at(times_s: Array, values: Array) -> Array:
    """Of what is worked out each `FINE_S`, its values at other times."""
    place = (times_s - FINE_START_S) / FINE_S
    whole = jnp.clip(jnp.floor(jax.lax.stop_gradient(place)).astype(jnp.int32), 0, len(values) - 2)
    share = place - whole
    return values[whole] + share * (values[whole + 1] - values[whole])


def _pose(scene: RoadScene, times_s: Array, speed_m_s: Array, driven: Ride | None) -> Pose:
    mount = scene.mount
    flat = jnp.zeros_like(times_s)
    rise, climb, pitch, roll, turn = flat, flat, flat, None, None
    if driven is not None:
        rise, climb, pitch = (_at(times_s, one) for one in (driven.rise_m, driven.rise_m_s, driven.pitch_rad))
    if scene.motion.curve is not None:
        turn = bend(scene.motion.curve, times_s)
        if scene.vehicle is not None:
            per = jnp.asarray(scene.vehicle.roll_deg_per_m_s2) * (math.pi / 180.0)
            # Outwards: in a bend to the left the right side goes down, the left one up.
            roll = per * speed_m_s**2 * turn
            rise = rise + roll * jnp.asarray(mount.lateral_m)
    down = jnp.asarray(mount.angle_deg) * (math.pi / 180.0) - pitch
    height = jnp.asarray(mount.height_m) + rise
    lateral = jnp.broadcast_to(jnp.asarray(mount.lateral_m), times_s.shape)
    return Pose(flat, height, down, roll, turn, lateral, speed_m_s, climb)


def _walls(scene: RoadScene, rough: RoughnessTable | None, path_m: Array, pose: Pose) -> tuple[Wall, ...]:
    """Each wall of the road as each sweep sees it, (sweeps,) each; rising and falling ones are told apart later."""
    return tuple(_wall(scene, rough, element, face, path_m, pose) for element in scene.road for face in element.faces())


def _wall(
    scene: RoadScene, rough: RoughnessTable | None, element: RoadElement, face: Face, path_m: Array, pose: Pose
) -> Wall:
    angle = jnp.broadcast_to(jnp.asarray(element.oblique_deg) * (math.pi / 180.0), path_m.shape)
    ahead = face.at_m - beyond_edge(element, path_m, pose.lateral_m)
    foot_x, foot_y = path_m + ahead * jnp.cos(angle), pose.lateral_m + ahead * jnp.sin(angle)
    nudge_m = 1e-6  # to either side of the face
    before = road_height(scene.road, rough, foot_x - nudge_m * jnp.cos(angle), foot_y - nudge_m * jnp.sin(angle))
    other = before + (face.height_m if face.rises else -face.height_m)
    low, high = (before, other) if face.rises else (other, before)
    return Wall(ahead, angle, low, high, jnp.broadcast_to(face.lean_rad, path_m.shape))


def _one_sweep(plan: Plan, scene: RoadScene, ready: _Ready, key: PRNGKeyArray, dtype: Any, number: Array) -> Sweep:
    """The envelope of sweep `number`, in counts."""
    here = lambda tree: jax.tree.map(lambda one: one[number].astype(dtype), tree)  # noqa: E731
    pose, walls = here(ready.pose), here(ready.walls)
    radar = scene.radar
    bins_m = range_m = through(scene.effects, "axis", range_axis(radar), None, key)
    for effect in scene.effects:
        range_m = effect.places(range_m)
    context = SweepContext(radar, ready.clock.taken_s[number], range_m, bins_m)
    field = Field(jnp.zeros(len(range_m), dtype), jnp.zeros(len(range_m), dtype))
    if ready.surface is not None:
        rates = any(effect.needs_rates for effect in scene.effects)
        paths = _paths(plan, scene, ready, number, pose, walls, rates)
        for stage in ("paths", "sampling"):
            paths = through(scene.effects, stage, paths, context, key, number)
        nodes_m, step_m = nodes_of(radar.start_m, float(range_axis(radar)[-1]), plan.fwhm_m, plan.widening)
        field = field_of(to_echoes(radar, paths), nodes_m, step_m, range_m, radar.fwhm_m)
    field = through(scene.effects, "field", field, context, key, number)
    return through(scene.effects, "smoothing", envelope(field), context, key, number)


def _paths(
    plan: Plan,
    scene: RoadScene,
    ready: _Ready,
    number: Array,
    pose: Pose,
    walls: tuple[Wall, ...],
    rates: bool,
) -> Paths:
    assert ready.ground is not None and ready.surface is not None
    faces = [face for element in scene.road for face in element.faces()]
    rising = tuple(wall for wall, face in zip(walls, faces, strict=True) if face.rises)
    falling = tuple(wall for wall, face in zip(walls, faces, strict=True) if not face.rises)
    points = visible_points(ready.ground, ready.start[number], plan.visible)
    paths = ground_paths(scene.radar, ready.surface, points, scene.spacing_m, falling, rates, pose)
    if rising:
        paths = paths.joined(corner_paths(scene.radar, ready.surface, rising, rates, pose))
    return paths


def _counted(scene: RoadScene, envelopes: Any, key: PRNGKeyArray) -> Counts:
    """Envelopes as the recorder keeps them, and which of them are saturated."""
    counts = Counts(envelopes, jnp.zeros(envelopes.shape[:1], bool))
    for stage in ("gain", "limit", "rounding"):
        counts = through(scene.effects, stage, counts, None, key)
    return counts
