"""Detectors as TOML files: what the command line, Python and the device share.

```toml
format = 1
detector = "default"
refractory_s = 0.3       # any setting of the detector; those that are left out keep their default
shift = false            # a part of the detector that is off

[approach]               # settings of a part
evidence = 19.0

[mounting]               # optional
height_m = 0.35
angle_deg = 45.0
front_wheel_m = 0.15

[provenance]             # optional, free: where the values come from
```
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import numpy as np

from jaxradar._errors import ConfigError
from jaxradar._settings import Settings, bounded, declared, parts, read_settings, settings_lines
from jaxradar._toml import check_keys, nearest, read_toml, toml_line, toml_value
from jaxradar.drive import Mounting
from jaxradar.systems.step.approach import ApproachDetector
from jaxradar.systems.step.config import StepDetector
from jaxradar.systems.step.default import DefaultDetector
from jaxradar.systems.step.filtered_rate import FilteredRateDetector
from jaxradar.systems.step.innovation import InnovationDetector
from jaxradar.systems.step.lab_live import LabLiveDetector
from jaxradar.systems.step.range_rate import RangeRateDetector
from jaxradar.systems.step.shift import ShiftDetector
from jaxradar.systems.step.thesis import ThesisDetector

__all__ = ["DETECTORS", "DetectorFile", "dump_detector", "load_detector", "with_mounting"]

FORMAT = 1
DETECTORS: dict[str, type[StepDetector[Any, Any]]] = {
    kind.name: kind
    for kind in (
        ThesisDetector,
        LabLiveDetector,
        RangeRateDetector,
        FilteredRateDetector,
        ShiftDetector,
        ApproachDetector,
        InnovationDetector,
        DefaultDetector,
    )
}


@dataclass(frozen=True, eq=False)
class DetectorFile:
    """A detector with the mounting it is for, where known, and where its values come from."""

    detector: StepDetector[Any, Any]
    mounting: Mounting | None = None
    provenance: dict[str, Any] = field(default_factory=dict)


def load_detector(name_or_path: str | PathLike[str]) -> DetectorFile:
    """A detector by its name (a key of `DETECTORS`) or from a TOML file.

    Raises `ConfigError` for an unknown name, an unreadable file, an unknown key (naming the nearest known one), a
    value of the wrong type or outside its bounds.
    """
    name = fspath(name_or_path)
    if name in DETECTORS:
        return DetectorFile(DETECTORS[name]())
    if not name.endswith(".toml") and not Path(name).exists():
        raise ConfigError(
            f"unknown detector `{name}`{nearest(name, DETECTORS)}; expected {', '.join(DETECTORS)} or a .toml file."
        )
    return _parse(name, read_toml(name))


def _parse(path: str, tables: dict[str, Any]) -> DetectorFile:
    if tables.get("format") != FORMAT:
        raise ConfigError(f"{path}: `format` must be {FORMAT}; got {tables.get('format', 'none')!r}.")
    name = tables.get("detector")
    if not isinstance(name, str) or name not in DETECTORS:
        raise ConfigError(
            f"{path}: unknown `detector` {name!r}{nearest(str(name), DETECTORS)}; expected {', '.join(DETECTORS)}."
        )
    kind = DETECTORS[name]
    settings = declared(kind)
    inner = parts(kind)
    known = ["format", "detector", *settings, *inner, "mounting", "provenance"]
    check_keys(path, tables, known, f"the detector `{name}`")
    held = {key: value for key, value in tables.items() if key in settings}
    values = read_settings(path, kind, held, f"the detector `{name}`")
    values |= {key: _part(path, key, getattr(kind(), key), tables[key]) for key in inner if key in tables}
    try:
        detector = kind(**values)
    except ValueError as error:
        raise ConfigError(f"{path}: {error}") from None
    provenance = _table(path, tables, "provenance")
    for key, value in provenance.items():
        try:
            toml_value(value)
        except TypeError:
            raise ConfigError(
                f"{path}: `{key}` in [provenance] must be a text, a number, true or false, or a list of these; "
                f"got {value!r}."
            ) from None
    mounting = None
    if "mounting" in tables:
        given = _table(path, tables, "mounting")
        names = [one.name for one in dataclasses.fields(Mounting)]
        check_keys(path, given, names, "[mounting]")
        for key, value in given.items():
            if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
                raise ConfigError(f"{path}: `{key}` in [mounting] must be a finite number; got {value!r}.")
        mounting = Mounting(**{key: float(value) for key, value in given.items()})
    return DetectorFile(detector, mounting, provenance)


def _part(path: str, key: str, base: Settings, given: Any) -> Settings | None:
    """A part of a detector, with the settings that a file gives; false switches it off."""
    if given is False:
        return None
    if not isinstance(given, dict):
        raise ConfigError(f"{path}: `{key}` must be a table of settings, or false; got {given!r}.")
    try:
        return dataclasses.replace(base, **read_settings(path, type(base), given, f"[{key}]"))
    except ValueError as error:
        raise ConfigError(f"{path}: [{key}]: {error}") from None


def _table(path: str, tables: dict[str, Any], key: str) -> dict[str, Any]:
    table = tables.get(key, {})
    if not isinstance(table, dict):
        raise ConfigError(f"{path}: [{key}] must be a table; got {table!r}.")
    return table


def with_mounting(detector: StepDetector[Any, Any], mounting: Mounting) -> StepDetector[Any, Any]:
    """The same detector for a sensor that sits so: what of the mounting is known, as far as the detector uses it."""
    if isinstance(detector, DefaultDetector) and detector.approach is not None:
        approach: Any = with_mounting(detector.approach, mounting)
        return dataclasses.replace(detector, approach=approach)
    if not isinstance(detector, ApproachDetector):
        return detector
    known = {"height_m": mounting.height_m, "front_wheel_m": mounting.front_wheel_m}
    return bounded(detector, **{name: value for name, value in known.items() if value is not None})


def dump_detector(file: DetectorFile | str) -> str:
    """A detector as TOML text, each setting with its unit and meaning. A name gives that detector's defaults."""
    if isinstance(file, str):
        file = load_detector(file)
    detector = file.detector
    lines = [toml_line("format", FORMAT), toml_line("detector", detector.name), ""]
    lines += settings_lines(detector)
    held = {key: getattr(detector, key) for key in parts(type(detector))}
    lines += [toml_line(key, False) for key, one in held.items() if one is None]
    for key, one in held.items():
        lines += [] if one is None else ["", f"[{key}]", *settings_lines(one)]
    if file.mounting is not None:
        lines += ["", "[mounting]"]
        lines += [toml_line(key, value) for key, value in vars(file.mounting).items() if value is not None]
    if file.provenance:
        lines += ["", "[provenance]"]
        lines += [toml_line(key, value) for key, value in file.provenance.items()]
    return "\n".join(lines) + "\n"
