"""Scenes as TOML files, and those that the package brings along.

```toml
format = 1
scene = "road"
duration_s = 2.0

[radar]                    # settings of each part; what is left out keeps its default
rate_hz = 300.0
[mount]
height_m = 0.35
[surface]
name = "asphalt"           # or wet-asphalt, gravel, cement, grass, water, none; settings beside it change it
[roughness]                # left out: an even road
grade = "B"
[motion]
speed_m_s = 8.33
[[motion.changes]]         # pulling away, braking
at_s = 0.5
to_m_s = 2.0
[vehicle]                  # left out: a car without springs
model = "quarter-car"
[[road]]
element = "step-up"
at_m = 8.0
height_m = 0.04
[[effects]]
effect = "receiver-noise"
```
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from os import PathLike, fspath
from pathlib import Path
from typing import Any, TypeVar

from jaxradar._errors import ConfigError
from jaxradar._settings import Settings, declared, read_settings, settings_lines
from jaxradar._toml import check_keys, nearest, read_toml, toml_line
from jaxradar.sim.radar import Radar
from jaxradar.sim.road.effects import EFFECTS
from jaxradar.sim.road.elements import ELEMENTS
from jaxradar.sim.road.motion import CarMotion, Curve, SpeedChange
from jaxradar.sim.road.roughness import Roughness
from jaxradar.sim.road.scene import Mount, RoadScene
from jaxradar.sim.road.surface import SURFACES, Surface
from jaxradar.sim.road.vehicle import VEHICLES

__all__ = ["dump_scene", "load_scene", "ready_scenes"]

FORMAT = 1
Kind = TypeVar("Kind", bound=Settings)


def ready_scenes() -> dict[str, str]:
    """Names of the scenes that the package brings along, and what each shows."""
    found = {}
    for file in sorted(resources.files("jaxradar.sim.scenes").iterdir(), key=lambda one: one.name.split(".")[0]):
        if file.name.endswith(".toml"):
            first = file.read_text(encoding="utf-8").splitlines()[0]
            found[file.name.removesuffix(".toml")] = first.removeprefix("# ")
    return found


def load_scene(name_or_path: str | PathLike[str]) -> RoadScene:
    """A scene by its name (`ready_scenes`) or from a TOML file.

    Raises `ConfigError` for an unknown name, an unreadable file, an unknown key (naming the nearest known one), a value
    of a wrong type or outside its bounds, and for parts that do not go together.
    """
    name = fspath(name_or_path)
    ready = ready_scenes()
    if name in ready:
        with resources.as_file(resources.files("jaxradar.sim.scenes") / f"{name}.toml") as path:
            return _parse(name, read_toml(path))
    if not name.endswith(".toml") and not Path(name).exists():
        raise ConfigError(f"unknown scene `{name}`{nearest(name, ready)}; expected {', '.join(ready)} or a .toml file.")
    return _parse(name, read_toml(name))


def _parse(path: str, tables: dict[str, Any]) -> RoadScene:
    if tables.get("format") != FORMAT:
        raise ConfigError(f"{path}: `format` must be {FORMAT}; got {tables.get('format', 'none')!r}.")
    if tables.get("scene") != RoadScene.kind:
        raise ConfigError(f'{path}: `scene` must be "{RoadScene.kind}"; got {tables.get("scene", "none")!r}.')
    own = declared(RoadScene)
    parts = ("radar", "mount", "surface", "roughness", "motion", "vehicle", "road", "effects")
    check_keys(path, tables, ["format", "scene", *own, *parts], "the scene")
    values = read_settings(path, RoadScene, {key: tables[key] for key in own if key in tables}, "the scene")
    values["radar"] = _part(path, tables, "radar", Radar)
    values["mount"] = _part(path, tables, "mount", Mount)
    values["surface"] = _surface(path, _table(path, tables, "surface"))
    values["motion"] = _motion(path, _table(path, tables, "motion"))
    if "roughness" in tables:
        values["roughness"] = _part(path, tables, "roughness", Roughness)
    if "vehicle" in tables:
        table = _table(path, tables, "vehicle")
        values["vehicle"] = _named(path, table, "model", VEHICLES, "[vehicle]", default="quarter-car")
    values["road"] = _list(path, tables, "road", "element", ELEMENTS)
    values["effects"] = _list(path, tables, "effects", "effect", EFFECTS)
    return _made(path, RoadScene, values)


def _made(path: str, kind: type[Kind], values: Mapping[str, Any], where: str = "") -> Kind:
    try:
        return kind(**values)
    except ValueError as error:
        raise ConfigError(f"{path}: {where}{': ' if where else ''}{error}") from None


def _table(path: str, tables: Mapping[str, Any], key: str, within: str = "") -> dict[str, Any]:
    table = tables.get(key, {})
    if not isinstance(table, dict):
        raise ConfigError(f"{path}: [{within}{key}] must be a table; got {table!r}.")
    return table


def _part(path: str, tables: Mapping[str, Any], key: str, kind: type[Kind], within: str = "") -> Kind:
    return _made(path, kind, read_settings(path, kind, _table(path, tables, key, within), f"[{within}{key}]"))


def _surface(path: str, table: dict[str, Any]) -> Surface | None:
    name = table.get("name", "asphalt")
    rest = {key: value for key, value in table.items() if key != "name"}
    if name == "none":
        check_keys(path, rest, [], "[surface] without a surface")
        return None
    if not isinstance(name, str) or name not in SURFACES:
        known = [*SURFACES, "none"]
        raise ConfigError(f"{path}: unknown surface {name!r}{nearest(str(name), known)}; expected {', '.join(known)}.")
    held = SURFACES[name]
    values = {key: getattr(held, key) for key in declared(Surface)}
    return _made(path, Surface, values | read_settings(path, Surface, rest, "[surface]"))


def _motion(path: str, table: dict[str, Any]) -> CarMotion:
    check_keys(path, table, [*declared(CarMotion), "changes", "curve"], "[motion]")
    own = {key: value for key, value in table.items() if key in declared(CarMotion)}
    values = read_settings(path, CarMotion, own, "[motion]")
    values["changes"] = tuple(
        _made(path, SpeedChange, read_settings(path, SpeedChange, one, where), where)
        for place, one in _numbered(path, table, "changes", "motion.")
        for where in (f"[[motion.changes]] number {place}",)
    )
    if "curve" in table:
        values["curve"] = _part(path, table, "curve", Curve, "motion.")
    return _made(path, CarMotion, values)


def _numbered(path: str, tables: Mapping[str, Any], key: str, within: str = "") -> list[tuple[int, dict[str, Any]]]:
    held = tables.get(key, [])
    if not isinstance(held, list) or not all(isinstance(one, dict) for one in held):
        raise ConfigError(f"{path}: [[{within}{key}]] must be a list of tables; got {held!r:.60}.")
    return list(enumerate(held, 1))


def _list(
    path: str, tables: Mapping[str, Any], key: str, naming: str, kinds: Mapping[str, type[Kind]]
) -> tuple[Kind, ...]:
    return tuple(
        _named(path, one, naming, kinds, f"[[{key}]] number {place}") for place, one in _numbered(path, tables, key)
    )


def _named(
    path: str, table: dict[str, Any], naming: str, kinds: Mapping[str, type[Kind]], where: str, default: str = ""
) -> Kind:
    name = table.get(naming, default)
    if not isinstance(name, str) or name not in kinds:
        hint = nearest(str(name), kinds)
        raise ConfigError(f"{path}: `{naming}` of {where} is {name!r}{hint}; expected {', '.join(kinds)}.")
    kind = kinds[name]
    rest = {key: value for key, value in table.items() if key != naming}
    return _made(path, kind, read_settings(path, kind, rest, f"{where}, `{name}`"), where)


def dump_scene(scene: RoadScene) -> str:
    """A scene as TOML text, each setting with its unit and meaning."""
    lines = [toml_line("format", FORMAT), toml_line("scene", scene.kind), *settings_lines(scene)]

    def part(head: str, held: Settings | None, *first: str) -> None:
        if held is not None:
            lines.extend(["", head, *first, *settings_lines(held)])

    part("[radar]", scene.radar)
    part("[mount]", scene.mount)
    if scene.surface is None:
        lines.extend(["", "[surface]", toml_line("name", "none")])
    part("[surface]", scene.surface)
    part("[roughness]", scene.roughness)
    part("[motion]", scene.motion)
    for change in scene.motion.changes:
        part("[[motion.changes]]", change)
    part("[motion.curve]", scene.motion.curve)
    if scene.vehicle is not None:
        part("[vehicle]", scene.vehicle, toml_line("model", scene.vehicle.name))
    for element in scene.road:
        part("[[road]]", element, toml_line("element", element.name))
    for effect in scene.effects:
        part("[[effects]]", effect, toml_line("effect", effect.name))
    return "\n".join(lines) + "\n"
