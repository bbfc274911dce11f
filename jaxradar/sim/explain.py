"""Which effects of a scene matter: what each contributes to the record, what it costs, and which may go."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np

from jaxradar._numerics import compiled, operations
from jaxradar.sim.radar import range_axis
from jaxradar.sim.road.plan import Plan, plan_scene
from jaxradar.sim.road.render import Rendered, render
from jaxradar.sim.road.scene import RoadScene
from jaxradar.sim.scene import Effect

__all__ = ["Contribution", "Significance", "Tolerance", "significant", "without"]

MOST_SWEEPS = 100_000  # of a scene that are looked at
ROUNDS = 3


@dataclass(frozen=True)
class Tolerance:
    """What may be left out: a change of the record below all of these. `level_db` is relative to the record's own rms,
    `range_mm` an rms shift of the strongest echo, `time_ms` an rms shift of the recorded times, `acceleration_m_s2` an
    rms change of the recorded acceleration."""

    level_db: float = -40.0
    range_mm: float = 0.1
    time_ms: float = 0.05
    acceleration_m_s2: float = 0.05


@dataclass(frozen=True)
class Difference:
    """Of two records: `level_db`, `range_mm`, `time_ms`, `acceleration_m_s2` as in `Tolerance`, −∞ or 0 where nothing
    changes; `lost`: share of sweeps that the first lacks; `form`: how they differ in kind, else empty."""

    level_db: float
    range_mm: float
    time_ms: float
    acceleration_m_s2: float
    lost: float
    form: str

    def why(self, tolerance: Tolerance) -> str:
        """The first thing about it that matters; empty if nothing does."""
        reasons = (
            (bool(self.form), self.form),
            (self.lost > 0, f"{self.lost:.1%} of the sweeps are lost to it"),
            (self.level_db > tolerance.level_db, f"it changes amplitudes by {self.level_db:.1f} dB of their rms"),
            (self.range_mm > tolerance.range_mm, f"it moves the strongest echo by {self.range_mm:.2g} mm"),
            (self.time_ms > tolerance.time_ms, f"it moves the recorded times by {self.time_ms:.2g} ms"),
            (
                self.acceleration_m_s2 > tolerance.acceleration_m_s2,
                f"it changes the recorded acceleration by {self.acceleration_m_s2:.2g} m/s²",
            ),
        )
        return next((text for holds, text in reasons if holds), "")

    def figures(self) -> str:
        """Its four figures in words."""
        return (
            f"{self.level_db:.1f} dB, {self.range_mm:.2g} mm, {self.time_ms:.2g} ms and "
            f"{self.acceleration_m_s2:.2g} m/s²"
        )


@dataclass(frozen=True)
class Contribution:
    """What one effect does to a scene's record, all else as it is.

    `operations` and `microseconds`: what it adds to a sweep's cost, as counted in the traced program and as measured (a
    difference of two measurements, so it may come out below 0).
    """

    effect: str
    difference: Difference
    operations: float
    microseconds: float
    kept: bool
    why: str


@dataclass(frozen=True)
class Significance:
    """The scene with the effects that matter, and the table that says why; `together`: what leaving out all of the
    others changes (None if none is left out); `bare_operations` and `bare_microseconds` are the cost of a sweep without
    any effect."""

    scene: RoadScene
    table: tuple[Contribution, ...]
    together: Difference | None
    bare_operations: float
    bare_microseconds: float


def without(scene: RoadScene, *effects: Effect) -> RoadScene:
    """The scene without some of its effects."""
    rest = tuple(one for one in scene.effects if not any(one is gone for gone in effects))
    return dataclasses.replace(scene, effects=rest)


def significant(
    scene: RoadScene,
    tolerance: Tolerance | None = None,
    seed: int = 0,
    progress: Callable[[], object] | None = None,
) -> Significance:
    """Measure what each effect contributes, and drop those that stay below the tolerance, alone and together.

    Each is taken away from the whole scene in turn; the others keep their draws, so that the difference is its alone.
    At most the first `MOST_SWEEPS` sweeps are looked at. Every variant is a program of its own, seconds to compile;
    `progress` is called when one of the first (effects and 2 more) is ready. Raises `ConfigError` for a scene that is
    too large.
    """
    tolerance = Tolerance() if tolerance is None else tolerance
    looked_at = min(scene.duration_s, MOST_SWEEPS / scene.radar.rate_hz)
    short = dataclasses.replace(scene, duration_s=looked_at)
    variants = [short, without(short, *short.effects), *(without(short, effect) for effect in short.effects)]
    with ThreadPoolExecutor(2) as pool:
        # Compiling takes the time; what is measured is measured afterwards, alone.
        programs = list(pool.map(lambda variant: _compiled(variant, seed, progress), variants))
    whole, cost = _run(programs[0])
    _, bare = _run(programs[1])
    differences, costs = [], []
    for program in programs[2:]:  # one record at a time
        other, its = _run(program)
        differences.append(_difference(whole, other, short))
        costs.append((cost[0] - its[0], cost[1] - its[1]))

    dropped = {place: one for place, one in enumerate(differences) if not one.why(tolerance)}
    beyond: dict[int, str] = {}
    together = None
    while dropped:
        others = [short.effects[place] for place in dropped]
        together = _difference(whole, _run(_compiled(without(short, *others), seed, None))[0], short)
        if len(dropped) == 1 or not together.why(tolerance):
            break
        largest = max(dropped, key=lambda place: dropped[place].level_db)
        beyond[largest] = f"kept: with the others that are small it comes to {together.figures()}"
        del dropped[largest]
        together = None
    table = []
    for place, (effect, difference) in enumerate(zip(short.effects, differences, strict=True)):
        why = beyond.get(place) or difference.why(tolerance)
        if place in dropped:
            first = f" in the first {looked_at:.0f} s" if looked_at < scene.duration_s else ""
            why = f"dropped: {difference.figures()}{first} are below the tolerance"
        table.append(Contribution(effect.name, difference, *costs[place], place not in dropped, why))
    kept = tuple(effect for place, effect in enumerate(scene.effects) if place not in dropped)
    return Significance(dataclasses.replace(scene, effects=kept), tuple(table), together, *bare)


class _Compiled(NamedTuple):
    plan: Plan
    operations: float
    call: Callable[[], Rendered]


def _compiled(scene: RoadScene, seed: int, progress: Callable[[], object] | None) -> _Compiled:
    plan = plan_scene(scene)
    with jax.enable_x64(True):
        key = jax.random.key(seed)
        # jit's own method, which a plain callable's type does not have
        traced = compiled(partial(render, plan)).trace(scene, key)  # type: ignore[attr-defined]
        program = traced.lower().compile()
    if progress is not None:
        progress()
    return _Compiled(plan, operations(traced.jaxpr) / plan.sweeps, lambda: program(scene, key))


def _run(ready: _Compiled) -> tuple[Rendered, tuple[float, float]]:
    """The record, and operations and microseconds for each of its sweeps."""
    with jax.enable_x64(True):
        found = jax.block_until_ready(ready.call())
        took = []
        for _ in range(ROUNDS):
            start = time.perf_counter()
            jax.block_until_ready(ready.call())
            took.append(time.perf_counter() - start)
    return jax.tree.map(np.asarray, found), (ready.operations, 1e6 * min(took) / ready.plan.sweeps)


def _difference(whole: Rendered, other: Rendered, scene: RoadScene) -> Difference:
    """Of the whole scene's record and another."""
    form = ""
    if whole.sweeps.shape != other.sweeps.shape:
        form = "the record has other range bins for it"
    elif whole.sweeps.dtype != other.sweeps.dtype:
        form = f"the record holds {whole.sweeps.dtype} for it and not {other.sweeps.dtype}"
    elif (whole.saturated != other.saturated).any():
        form = f"{np.mean(whole.saturated != other.saturated):.1%} of the sweeps are flagged for it"
    lost = float(np.mean(other.clock.kept) - np.mean(whole.clock.kept)) if len(whole.clock.kept) else 0.0
    drift = np.concatenate(
        [
            np.ravel(whole.clock.recorded_s - other.clock.recorded_s),
            np.ravel((whole.clock.motion_pace - other.clock.motion_pace) * whole.clock.taken_s),
        ]
    )
    felt = 0.0
    if whole.acceleration_m_s2 is not None and other.acceleration_m_s2 is not None:
        felt = _rms(whole.acceleration_m_s2 - other.acceleration_m_s2)
    level_db, range_mm = -math.inf, 0.0
    if whole.sweeps.shape == other.sweeps.shape and whole.sweeps.size:
        one, two = (np.asarray(held.sweeps, np.float64) for held in (whole, other))
        level, change = _rms(one), _rms(one - two)
        if change > 0:
            level_db = 20.0 * math.log10(change / level) if level > 0 else math.inf
        axis = range_axis(scene.radar)
        axis = axis if len(axis) == one.shape[1] else np.linspace(axis[0], axis[-1], one.shape[1])
        strongest = one.argmax(axis=1)
        range_mm = 1e3 * _rms(_centre(one, axis, strongest) - _centre(two, axis, strongest))
    return Difference(level_db, range_mm, 1e3 * _rms(drift), felt, lost, form)


def _rms(values: Any) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else 0.0


def _centre(sweeps: np.ndarray, range_m: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Centre of what is above half of the largest within 5 cm of bin `at` of each sweep, in metres: smooth enough to
    show 0.01 mm, and not thrown by which of two equal echoes is the largest."""
    near = np.abs(range_m[None, :] - range_m[at][:, None]) < 0.05
    top = np.max(sweeps, axis=1, where=near, initial=0.0)[:, None]
    weight = np.where(near, np.maximum(sweeps - 0.5 * top, 0.0), 0.0)
    total = weight.sum(axis=1)
    centre = (weight * range_m).sum(axis=1) / np.where(total > 0, total, 1.0)
    return np.where(total > 0, centre, range_m[at])
