"""Drives out of scenes: what was recorded, and what really was."""

from __future__ import annotations

import math
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxradar._numerics import compiled
from jaxradar.drive import Channel, Drive, Motion, Mounting, RoadStep, SensorSeries, SweepFlag, Truth
from jaxradar.sim.radar import range_axis
from jaxradar.sim.road.motion import along, bend
from jaxradar.sim.road.plan import FINE_S, FINE_START_S, Plan, plan_scene
from jaxradar.sim.road.render import render
from jaxradar.sim.road.scene import RoadScene
from jaxradar.sim.road.tyre import contact_m
from jaxradar.sim.road.vehicle import QuarterCar
from jaxradar.units import NANOSECONDS

__all__ = ["HARD_M_S2", "drive_seeds", "held_out_seeds", "simulate", "simulate_batch", "simulate_each"]

HARD_M_S2 = 15.0  # what the thesis calls a step that matters (section 6.2)
HELD_OUT = 0x7E57  # what sets their seeds apart from all others
THREADS = min(8, os.cpu_count() or 1)  # at once: what one render leaves idle of the processor, another one uses

_one = compiled(lambda plan, scene, key: render(plan, scene, key), static_argnums=0)


def drive_seeds(seed: int, count: int) -> list[int]:
    """`count` seeds that come of one, so that the drives of two seeds have nothing in common."""
    return [int(np.random.SeedSequence([seed, place]).generate_state(1)[0]) for place in range(count)]


def held_out_seeds(seed: int, count: int) -> list[int]:
    """As `drive_seeds`, but of drives that nothing may be tuned on: what is measured on them is news to every
    detector."""
    return [int(np.random.SeedSequence([seed, place, HELD_OUT]).generate_state(1)[0]) for place in range(count)]


def simulate(scene: RoadScene, seed: int = 0) -> Drive:
    """Drive through a scene; the same scene and `seed` give the same drive.

    The drive's motion holds the vertical acceleration of the body over the front axle, the yaw rate and the speed, as
    far as the scene has them; its truth the steps, when each wheel touches them, and how hard. Raises `ConfigError` for
    a scene that is too large.
    """
    return _simulated(plan_scene(scene), scene, seed)


def simulate_batch(scenes: Sequence[RoadScene], seeds: Sequence[int]) -> list[Drive]:
    """`simulate_each`, all drives at once in memory."""
    return list(simulate_each(scenes, seeds))


def simulate_each(scenes: Sequence[RoadScene], seeds: Sequence[int]) -> Iterator[Drive]:
    """`simulate` for each pair of scene and seed, in order, by one program, a few at once; no more drives are held than
    that.

    Raises `ValueError` for scenes that differ in more than the values of their settings, `ConfigError` for scenes that
    are too large.
    """
    if len(scenes) != len(seeds):
        raise ValueError(f"expected a seed for each scene; got {len(scenes)} scenes and {len(seeds)} seeds.")
    if not scenes:
        return iter(())
    form: Any = jax.tree.structure(scenes[0])
    for place, scene in enumerate(scenes):
        if jax.tree.structure(scene) != form:
            raise ValueError(f"scene {place} differs from scene 0 in more than the values of its settings.")
    different = list({id(scene): scene for scene in scenes}.values())
    plan = plan_scene(
        different[0] if len(different) == 1 else jax.tree.map(lambda *leaves: np.stack(leaves), *different)
    )
    return _side_by_side(lambda place: _simulated(plan, scenes[place], seeds[place]), range(len(scenes)))


def _simulated(plan: Plan, scene: RoadScene, seed: int) -> Drive:
    with jax.enable_x64(True):
        found = _one(plan, scene, jax.random.key(seed))
        return _drive(plan, scene, jax.tree.map(np.asarray, found))


def _side_by_side(work: Callable[[int], Drive], items: Iterable[int]) -> Iterator[Drive]:
    """Results in order, `THREADS` at once; the first alone, as it compiles."""
    waiting: deque[Future[Drive]] = deque()
    left = iter(items)
    with ThreadPoolExecutor(THREADS) as pool:
        for first in left:
            yield work(first)
            break
        for item in left:
            waiting.append(pool.submit(work, item))
            if len(waiting) > THREADS:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


def _drive(plan: Plan, scene: RoadScene, found: Any) -> Drive:
    """`found`: what `render` gave, as NumPy arrays."""
    clock = found.clock
    kept = clock.kept
    taken = clock.taken_s[kept]
    recorded = clock.recorded_s[kept]
    start, begin = (recorded[0], taken[0]) if len(taken) else (0.0, 0.0)
    range_m = range_axis(scene.radar)
    for effect in scene.effects:
        range_m = effect.stated(range_m)
    flags = np.where(found.saturated[kept], np.uint16(SweepFlag.SATURATED), np.uint16(0)).astype(np.uint16)
    pace = float(clock.motion_pace)
    times = _nanoseconds((taken - begin) * pace)
    mount = scene.mount
    return Drive(
        sensors=(
            SensorSeries(
                sensor=scene.radar.sensor,
                times_ns=_nanoseconds(recorded - start),
                sweeps=found.sweeps[kept],
                range_m=range_m,
                flags=flags,
            ),
        ),
        motion=_motion(scene, found, taken, times),
        mounting=Mounting(float(mount.height_m), float(mount.angle_deg), float(mount.front_wheel_m)),
        truth=Truth(_steps(plan, scene, found, float(begin))),
    )


def _nanoseconds(times_s: np.ndarray) -> np.ndarray:
    # To the microsecond, as the lab's log has them, so that nothing is lost on the way through it.
    return np.rint(times_s * 1e6).astype(np.int64) * (NANOSECONDS // 1_000_000)


def _motion(scene: RoadScene, found: Any, taken_s: np.ndarray, times_ns: np.ndarray) -> Motion:
    if not len(taken_s):
        return Motion()
    speed = np.asarray(along(scene.motion, jnp.asarray(taken_s)).speed_m_s)
    curve = scene.motion.curve
    yaw = None if curve is None else Channel(times_ns, speed * np.asarray(bend(curve, jnp.asarray(taken_s))))
    body = None
    if found.acceleration_m_s2 is not None:
        body = Channel(times_ns, found.acceleration_m_s2[found.clock.kept])
    return Motion(acceleration_m_s2=body, yaw_rate_rad_s=yaw, speed_m_s=Channel(times_ns, speed))


def _fine_times(count: int) -> np.ndarray:
    """The moments at which the car's motion is worked out; s."""
    return FINE_START_S + FINE_S * np.arange(count)


def _steps(plan: Plan, scene: RoadScene, found: Any, begin_s: float) -> tuple[RoadStep, ...]:
    """Every element that the front wheels touch while the drive lasts, and when each wheel does."""
    fine_s = _fine_times(plan.fine_steps)
    path, speed = (np.asarray(one) for one in along(scene.motion, jnp.asarray(fine_s))[:2])
    mount, vehicle = scene.mount, scene.vehicle or QuarterCar()  # wheels are there without springs too
    radius, half_track, base = (
        float(one) for one in (vehicle.tyre_radius_m, vehicle.half_track_m, vehicle.wheelbase_m)
    )
    steps = []
    for element in scene.road:
        height = float(element.step_m)
        if height == 0:
            continue  # a step of no height is none
        first = [face for face in element.faces() if float(face.at_m) == 0]
        # A tyre touches an edge that is higher than its road before its axle is above it.
        reach = float(contact_m(abs(height), radius))
        ahead = reach if any(face.rises for face in first) else 0.0
        behind = reach if any(not face.rises for face in first) else 0.0
        slant = half_track * math.tan(math.radians(float(element.oblique_deg)))
        middles = [float(element.at_m) - side * slant for side in (-1.0, 1.0)]
        wheels = [
            _passes(fine_s, path, middle + axle, ahead, behind)
            for axle in (float(mount.front_wheel_m), float(mount.front_wheel_m) + base)
            for middle in middles
        ]
        front = [time for time in wheels[:2] if time is not None]
        if not front or not 0 <= min(front) - begin_s <= scene.duration_s:
            continue
        forwards = np.interp(min(front), fine_s, speed) >= 0
        peak, hard = _shock(found, min(front))
        steps.append(
            RoadStep(
                impact_s=min(front) - begin_s,
                height_m=height if forwards else -height,
                wheels_s=tuple(None if time is None else time - begin_s for time in wheels),
                peak_m_s2=peak,
                hard_s=None if hard is None else hard - begin_s,
                at_m=float(element.at_m),
            )
        )
    return tuple(sorted(steps, key=lambda step: step.impact_s))


def _passes(times_s: np.ndarray, path_m: np.ndarray, edge_m: float, ahead_m: float, behind_m: float) -> float | None:
    """When the path first reaches an edge, `ahead_m` before it forwards or `behind_m` before it backwards; None if it
    does neither."""
    moments = []
    for way, place in ((1.0, edge_m - ahead_m), (-1.0, edge_m + behind_m)):
        over = way * (path_m - place) >= 0
        later = np.flatnonzero(over[1:] & ~over[:-1])
        if later.size:
            before = int(later[0])
            share = (place - path_m[before]) / (path_m[before + 1] - path_m[before])
            moments.append(float(times_s[before] + share * (times_s[before + 1] - times_s[before])))
    return min(moments, default=None)


def _shock(found: Any, impact_s: float, within_s: float = 0.3) -> tuple[float | None, float | None]:
    """Of the body's vertical acceleration soon after an impact: the largest, and when it first is `HARD_M_S2`."""
    if found.ride is None:
        return None, None
    values = np.abs(found.ride.body_m_s2)
    times = _fine_times(len(values))
    soon = (times >= impact_s) & (times <= impact_s + within_s)
    if not soon.any():
        return None, None
    hard = np.flatnonzero(soon & (values >= HARD_M_S2))
    return float(values[soon].max()), float(times[hard[0]]) if hard.size else None
