"""What a simulated sweep costs, and what each effect adds to it: `python benches/run.py scenes`."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import jax
from child import ask
from data import UnavailableError
from measure import figure, ratio, rounds, say, spread
from report import Row, Section
from settings import Settings

from jaxradar import sim
from jaxradar._numerics import compiled

__all__ = ["bare_scene", "measure", "renderer"]

BARE, ALL, WHOLE = "bare: a coherent diffuse road", "all effects", "all effects, springs, steps, roughness, a curve"
DRIVES = 4
ROAD = (sim.StepUp(at_m=30.0), sim.StepDown(at_m=60.0))


def bare_scene(duration_s: float) -> sim.RoadScene:
    """30 km/h over asphalt, 300 sweeps a second of 128 bins, a scatterer each 6 mm."""
    return sim.RoadScene(duration_s=duration_s, radar=sim.Radar(rate_hz=300.0))


def variants(duration_s: float) -> dict[str, sim.RoadScene]:
    bare = bare_scene(duration_s)
    changed = lambda **values: dataclasses.replace(bare, **values)  # noqa: E731
    scenes = {BARE: bare}
    scenes.update({name: changed(effects=(kind(),)) for name, kind in sim.EFFECTS.items()})
    bend = sim.CarMotion(curve=sim.Curve(start_s=1.0, stop_s=duration_s, radius_m=30.0))
    scenes.update(
        {
            "a step up and a step down": changed(road=ROAD),
            "roughness of grade B": changed(roughness=sim.Roughness(grade="B")),
            "a quarter car": changed(vehicle=sim.QuarterCar()),
            "a half car": changed(vehicle=sim.HalfCar()),
            "a curve": changed(motion=bend),
        }
    )
    # Thinning keeps 128 of 128 bins here, and changes what is named in a log alone.
    everything = tuple(kind() for kind in sim.EFFECTS.values())
    scenes[ALL] = changed(effects=everything)
    scenes[WHOLE] = changed(
        effects=everything, road=ROAD, roughness=sim.Roughness(grade="B"), vehicle=sim.QuarterCar(), motion=bend
    )
    return scenes


def renderer(scene: sim.RoadScene) -> Callable[[int], object]:
    """Renders the scene with a seed, and returns when the sweeps are there."""
    plan = sim.plan_scene(scene)
    program = compiled(lambda scene, key: sim.render(plan, scene, key))

    def call(seed: int) -> object:
        with jax.enable_x64(True):
            return jax.block_until_ready(program(scene, jax.random.key(seed)))

    return call


def measure(settings: Settings) -> Section:
    duration_s = 2.0 if settings.quick else 20.0
    sweeps = round(300 * duration_s)
    title = f"{DRIVES} drives of {sweeps} sweeps of 128 bins, two at once; {settings.rounds} rounds"
    section = Section("scenes", title, ("scene", "sweeps/s", "us a sweep", "more than bare", "range"))
    calls: dict[str, Callable[[], object]] = {}
    with ThreadPoolExecutor(2) as pool:
        for name, scene in variants(duration_s).items():
            say(f"compiling {name}")
            call = renderer(scene)
            call(0)
            calls[name] = lambda call=call: list(pool.map(call, range(DRIVES)))
        times = rounds(calls, settings.rounds, "scenes")
    for name, seconds in times.items():
        each = spread(1e6 * seconds / (DRIVES * sweeps))
        more = spread(1e6 * (seconds - times[BARE]) / (DRIVES * sweeps))
        numbers = {"us": each.median, "more_us": more.median, "sweeps_s": 1e6 / each.median}
        cells = [name, f"{1e6 / each.median:,.0f}", figure(each.median)]
        cells += ["", ""] if name == BARE else [f"{more.median:+.2f}", f"{more.low:+.2f}..{more.high:+.2f}"]
        section.rows.append(Row(name, cells, numbers, None if name == BARE else ratio(seconds, times[BARE])))
    section.notes.append("Times include the car's ride and the ground, made once a drive; compiling is not in them.")
    try:
        seconds = (5.0, 40.0) if settings.quick else (20.0, 160.0)
        grown = ask("scenes", durations_s=seconds)["grown"]
        section.notes.append(
            "Memory beyond the sweeps themselves: "
            + ", ".join(
                f"{one['beyond'] / 1e6:.0f} MB for {one['sweeps']:,} sweeps ({one['output'] / 1e6:.0f} MB)"
                for one in grown
            )
            + ". What grows is the ground (25 points a metre and quantity) and the car's ride."
        )
    except UnavailableError as why:
        section.notes.append(f"Memory not measured: {why}")
    return section
