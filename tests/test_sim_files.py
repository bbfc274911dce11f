"""Scenes as TOML: there and back, and what is said of one that is wrong."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import jax
import numpy as np
import pytest

from jaxradar import ConfigError, sim

READY = sim.ready_scenes()


def same(left: sim.RoadScene, right: sim.RoadScene) -> bool:
    if jax.tree.structure(left) != jax.tree.structure(right):
        return False
    return all(np.array_equal(a, b) for a, b in zip(jax.tree.leaves(left), jax.tree.leaves(right), strict=True))


@pytest.mark.parametrize("name", READY)
def test_a_ready_scene_survives_its_own_toml(name: str, tmp_path: Path) -> None:
    scene = sim.load_scene(name)
    path = tmp_path / "scene.toml"
    path.write_text(sim.dump_scene(scene), encoding="utf-8")
    assert same(sim.load_scene(path), scene)
    assert READY[name]
    assert not READY[name].startswith("#")


def test_everything_that_a_scene_may_hold_survives(tmp_path: Path) -> None:
    scene = sim.RoadScene(
        surface=None,
        road=tuple(kind(at_m=3.0 * place) for place, kind in enumerate(sim.ELEMENTS.values())),
        roughness=sim.Roughness("C"),
        motion=sim.CarMotion(2.0, (sim.SpeedChange(), sim.SpeedChange(3.0, 0.0)), sim.Curve()),
        vehicle=sim.HalfCar(),
        effects=tuple(kind() for kind in sim.EFFECTS.values()),
    )
    path = tmp_path / "scene.toml"
    path.write_text(sim.dump_scene(scene), encoding="utf-8")
    assert same(sim.load_scene(path), scene)


HEAD = 'format = 1\nscene = "road"\n'
HUGE = "1" + 400 * "0"  # too large for a float


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("", "`format` must be 1; got 'none'"),
        ("format = 1", "`scene` must be \"road\"; got 'none'"),
        (HEAD + "[radra]", "unknown key `radra` (did you mean `radar`?)"),
        (HEAD + "radar = 3", "[radar] must be a table; got 3"),
        (HEAD + '[radar]\nbins = "many"', "`bins` in [radar] must be a number; got 'many'"),
        (HEAD + "[radar]\nbins = 2.5", "`bins` in [radar] must be a whole number; got 2.5"),
        (HEAD + "[mount]\nheight_m = -1.0", "`Mount(height_m=...)` must be between 0.02 and 10.0 m; got -1.0"),
        (HEAD + '[surface]\nname = "asphlat"', "unknown surface 'asphlat' (did you mean `asphalt`?)"),
        (HEAD + '[surface]\nname = "none"\nslope = 0.1', "unknown key `slope` in [surface] without a surface"),
        (HEAD + "[[road]]\nat_m = 1.0", "`element` of [[road]] number 1 is ''; expected step-up"),
        (HEAD + '[[road]]\nelement = "step-up"\nhight_m = 1.0', "unknown key `hight_m` (did you mean `height_m`?)"),
        (HEAD + '[[road]]\nelement = "step-up"\nheight_m = 0.5', "must not be higher than the sensor, 0.35 m"),
        (HEAD + '[road]\nelement = "step-up"', "[[road]] must be a list of tables"),
        (HEAD + '[[effects]]\neffect = "rain"\n[[effects]]\neffect = "rain"', "may hold one `rain`; got two"),
        (HEAD + '[roughness]\ngrade = "Z"', "`Roughness(grade=...)` must be one of A, B, C, D, E; got 'Z'"),
        (HEAD + "[motion]\nspeed = 3.0", "unknown key `speed` (did you mean `speed_m_s`?)"),
        (HEAD + "[[motion.changes]]\nat_s = true", "`at_s` in [[motion.changes]] number 1 must be a number; got True"),
        (HEAD + "duration_s = nan", "`RoadScene(duration_s=...)` must be between 0.0 and 1000000.0 s; got nan"),
        (HEAD + "radar.bins = ", "expected a TOML file"),
        (HEAD + '[[road]]\nelement = ["kerb"]', "`element` of [[road]] number 1 is ['kerb']"),
        (HEAD + "[[road]]\nelement = {a = 1}", "`element` of [[road]] number 1 is {'a': 1}"),
        (HEAD + '[[effects]]\neffect = ["rain"]', "`effect` of [[effects]] number 1 is ['rain']"),
        (HEAD + "[[effects]]\neffect = {a = 1}", "`effect` of [[effects]] number 1 is {'a': 1}"),
        (HEAD + '[surface]\nname = ["gravel"]', "unknown surface ['gravel']"),
        (HEAD + "[surface.name]\na = 1", "unknown surface {'a': 1}"),
        (HEAD + "[vehicle]\nmodel = []", "`model` of [vehicle] is []; expected quarter-car"),
        (HEAD + "[radar]\nbins = inf", "`bins` in [radar] must be a whole number; got inf"),
        (HEAD + "[radar]\nbins = nan", "`bins` in [radar] must be a whole number; got nan"),
        (HEAD + "[radar]\nbins = 1e30", "`Radar(bins=...)` must be between 2 and 100000; got 1000000000"),
        (HEAD + f"[radar]\nbins = {HUGE}", "`bins` in [radar] is larger than any number a computer holds"),
        (HEAD + f"duration_s = {HUGE}", "`duration_s` in the scene is larger than any number a computer holds"),
        (HEAD + f"[motion]\nspeed_m_s = -{HUGE}", "`speed_m_s` in [motion] is larger than any number"),
        (HEAD + "[mount]\nheight_m = 1e400", "`Mount(height_m=...)` must be between 0.02 and 10.0 m; got inf"),
        (HEAD + "[motion.curve]\nradius_m = 0", "`Curve(radius_m=...)` must be 0.5 m at least, to either side; got 0"),
        (HEAD + "[motion.curve]\nstart_s = 2\nstop_s = 1", "`Curve(start_s=...)` must not be later than stop_s; got 2"),
        (
            HEAD + "[[motion.changes]]\nat_s = 2\n[[motion.changes]]\nat_s = 1",
            "`CarMotion(changes[...].at_s=...)` must not be later than the next one's; got 2 and 1",
        ),
        (
            HEAD + '[radar]\nbins = 64\n[[effects]]\neffect = "thinning"\nbins = 65',
            "`RoadScene(effects=...)`: thinning must keep at most the radar's 64 bins; got 65",
        ),
        (
            HEAD + "".join(f'[[road]]\nelement = "step-up"\nat_m = {at}\nheight_m = 0.2\n' for at in (3, 1)),
            "`RoadScene(road=...)` must not be higher than the sensor, 0.35 m; got 0.4 m with a step-up of 0.2 m",
        ),
    ],
)
def test_a_wrong_scene_is_one_sentence(text: str, wanted: str, tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        sim.load_scene(path)
    assert wanted in str(caught.value)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_steps_that_add_up_are_low_enough_for_a_car_that_climbs_them(tmp_path: Path) -> None:
    steps = "".join(f'[[road]]\nelement = "step-up"\nat_m = {at}\nheight_m = 0.2\n' for at in (3, 1))
    (tmp_path / "scene.toml").write_text(HEAD + "[vehicle]\n" + steps)
    assert len(sim.load_scene(tmp_path / "scene.toml").road) == 2


def test_an_unknown_name_is_answered_with_the_nearest() -> None:
    with pytest.raises(ConfigError, match="unknown scene `trail` \\(did you mean `trial`"):
        sim.load_scene("trail")


def test_scenes_of_all_kinds_are_there() -> None:
    held = {name: sim.load_scene(name) for name in READY}
    assert {element.name for scene in held.values() for element in scene.road} >= {"step-up", "step-down", "pothole"}
    assert any(scene.motion.changes and not scene.road for scene in held.values())
    assert any(scene.motion.curve is not None and scene.road for scene in held.values())
    trial = held["trial"]
    assert float(trial.mount.angle_deg) == 45
    assert (trial.radar.rate_hz, float(trial.motion.speed_m_s)) == (300, pytest.approx(30 / 3.6, rel=1e-4))
    assert dataclasses.replace(trial, effects=()).effects == ()
