"""What the road was: the steps that a drive went over, and how the sensor was mounted, in a JSON file beside the log.

    {
      "steps": [{"impact_s": 1.25, "height_m": 0.03, "wheels_s": [1.25, 1.25, 1.44, 1.44],
                 "peak_m_s2": 13.9, "hard_s": null, "at_m": 102.83}],
      "mounting": {"height_m": 0.35, "angle_deg": 45, "front_wheel_m": 0.15}
    }

`truth.json` in a log folder, `NAME.truth.json` beside a log that is one file `NAME.csv` or `NAME.h5`. Every key may be
left out but `impact_s` (`RoadStep` says what they mean). `"steps": []` says that there was no step; without `steps`
that is not known.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from jaxradar._errors import LogError
from jaxradar._toml import nearest
from jaxradar.drive import Drive, Mounting, RoadStep, Truth

__all__ = ["read_truth", "truth_path", "truth_text"]


def truth_path(log: Path) -> Path:
    """Where the truth of a log stands: inside a folder, beside a file."""
    return log / "truth.json" if log.is_dir() else log.with_name(f"{log.stem}.truth.json")


def read_truth(path: Path) -> tuple[Truth | None, Mounting | None]:
    """Steps and mounting, None where the file does not say or is not there.

    Raises `LogError` naming file and key for what is not JSON, for unknown keys and for values of a wrong kind.
    """
    try:
        content = json.loads(path.read_bytes())
    except FileNotFoundError:
        return None, None
    except OSError as error:
        raise LogError(path, f"cannot be read: {error.strerror}.") from error
    except (ValueError, RecursionError) as error:
        raise LogError(path, f"is not JSON: {error}.") from error
    _check_keys(path, "the file", content, ("steps", "mounting"))
    truth = mounting = None
    if "steps" in content:
        if not isinstance(content["steps"], list):
            raise LogError(path, f"`steps` must be a list; got {content['steps']!r:.60}.")
        truth = Truth(tuple(_step(path, f"`steps[{place}]`", step) for place, step in enumerate(content["steps"])))
    if content.get("mounting") is not None:
        names = tuple(part.name for part in fields(Mounting))
        _check_keys(path, "`mounting`", content["mounting"], names)
        mounting = Mounting(**{name: _number(path, "`mounting`", content["mounting"], name) for name in names})
    return truth, mounting


def truth_text(drive: Drive) -> str | None:
    """The file's text for a drive; None if there is nothing to be said."""
    content: dict[str, Any] = {}
    if drive.truth is not None:
        content["steps"] = [_known(asdict(step)) for step in drive.truth.steps]
    if drive.mounting is not None:
        content["mounting"] = _known(asdict(drive.mounting))
    return json.dumps(content, indent=1) + "\n" if content else None


def _known(values: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if value is not None}


def _step(path: Path, place: str, step: Any) -> RoadStep:
    _check_keys(path, place, step, tuple(part.name for part in fields(RoadStep)))
    impact_s = _number(path, place, step, "impact_s")
    if impact_s is None:
        raise LogError(path, f"{place} lacks `impact_s`, the first contact of a front tyre in seconds.")
    numbers = {name: _number(path, place, step, name) for name in ("height_m", "peak_m_s2", "hard_s", "at_m")}
    wheels = step.get("wheels_s")
    if wheels is not None:
        if not isinstance(wheels, list):
            raise LogError(path, f"`wheels_s` of {place} must be a list of times; got {wheels!r:.60}.")
        held = {f"wheels_s[{wheel}]": time for wheel, time in enumerate(wheels)}
        wheels = tuple(_number(path, place, held, name) for name in held)
    try:
        return RoadStep(impact_s, wheels_s=wheels, **numbers)
    except ValueError as error:
        raise LogError(path, f"{place}: {error}") from None


def _check_keys(path: Path, place: str, found: Any, known: tuple[str, ...]) -> None:
    if not isinstance(found, dict):
        raise LogError(path, f"{place} must be an object with {', '.join(known)}; got {found!r:.60}.")
    for key in found:
        if key not in known:
            hint = nearest(key, known)
            raise LogError(path, f"{place} has the unknown key {key!r:.60}{hint}; known are {', '.join(known)}.")


def _number(path: Path, place: str, found: dict[str, Any], name: str) -> float | None:
    value = found.get(name)
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not _finite(value):
        raise LogError(path, f"`{name}` of {place} must be a finite number; got {value!r:.60}.")
    return float(value)


def _finite(value: int | float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number beyond float64
        return False
