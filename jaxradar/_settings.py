"""Settings with bounds: what a detector, a scene and each of its effects are made of, and their form in TOML."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from functools import partial
from os import PathLike
from typing import Any, TypeVar

import equinox as eqx
import jax
import numpy as np

from jaxradar._errors import ConfigError
from jaxradar._numerics import as_scalar
from jaxradar._toml import check_keys, toml_line

__all__ = [
    "Settings",
    "bounded",
    "choice_setting",
    "declared",
    "in_order",
    "is_plain",
    "part",
    "parts",
    "read_settings",
    "setting",
    "settings_lines",
    "shape_setting",
    "weights_setting",
]

MOST_WEIGHTS = 256


def setting(default: float, low: float, high: float, unit: str, doc: str) -> Any:
    """A value that tuning may move: an array leaf with bounds (both allowed), a unit and one line of explanation."""
    return eqx.field(
        default=default, converter=as_scalar, metadata={"low": low, "high": high, "unit": unit, "doc": doc}
    )


def weights_setting(default: tuple[float, ...], low: float, high: float, unit: str, doc: str) -> Any:
    """Some values that tuning may move together or one by one, each between the bounds: an array leaf of one axis. How
    many there are sets a shape, their values do not."""
    return eqx.field(
        default=default,
        converter=as_scalar,
        metadata={"low": low, "high": high, "unit": unit, "doc": doc, "weights": True},
    )


def shape_setting(default: Any, low: float, high: float, unit: str, doc: str) -> Any:
    """A value that sets a shape or a branch of the program: static, changing it recompiles."""
    return eqx.field(default=default, static=True, metadata={"low": low, "high": high, "unit": unit, "doc": doc})


def choice_setting(default: str, choices: tuple[str, ...], doc: str) -> Any:
    """A branch of the program chosen by name: static."""
    return eqx.field(default=default, static=True, metadata={"choices": choices, "unit": "", "doc": doc})


def part(kind: type[Settings], **values: float) -> Any:
    """Settings of a part of the whole, a table of their own in a file, by default with these values; None for a part
    that is off."""
    return eqx.field(default_factory=partial(kind, **values), metadata={"part": kind})


class Settings(eqx.Module):
    """Base of what is configured by settings.

    Raises `ValueError` at construction for a value outside its bounds, naming the argument, the bound and the value.
    """

    def __check_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            # Under jit, vmap and tuning a leaf is a tracer; its value is checked where it is concrete.
            if "choices" in field.metadata and value not in field.metadata["choices"]:
                raise ValueError(
                    f"`{type(self).__name__}({field.name}=...)` must be one of "
                    f"{', '.join(field.metadata['choices'])}; got {value!r}."
                )
            if "low" not in field.metadata or isinstance(value, jax.core.Tracer):
                continue
            low, high = field.metadata["low"], field.metadata["high"]
            unit = f" {field.metadata['unit']}" if field.metadata["unit"] else ""
            if "weights" in field.metadata:
                if not (
                    np.ndim(value) == 1
                    and 1 <= len(value) <= MOST_WEIGHTS
                    and np.all((low <= np.asarray(value)) & (np.asarray(value) <= high))
                ):
                    raise ValueError(
                        f"`{type(self).__name__}({field.name}=...)` must be 1 to {MOST_WEIGHTS} numbers between {low} "
                        f"and {high}{unit}; got {np.asarray(value).tolist()}."
                    )
            elif not (np.ndim(value) == 0 and low <= float(np.asarray(value)) <= high):
                raise ValueError(
                    f"`{type(self).__name__}({field.name}=...)` must be between {low} and {high}{unit}; got {value}."
                )


Held = TypeVar("Held", bound=Settings)


def is_plain(value: Any) -> bool:
    """Whether a setting is one number, and not traced or one for each scene of a batch."""
    return not isinstance(value, jax.core.Tracer) and np.ndim(value) == 0


def bounded(held: Held, **changed: float) -> Held:
    """The same with other values, each moved to the nearest bound where it is outside."""
    known = {one.name: one.metadata for one in dataclasses.fields(held)}
    inside = {name: min(max(float(value), known[name]["low"]), known[name]["high"]) for name, value in changed.items()}
    return dataclasses.replace(held, **inside)


def in_order(kind: str, first: str, low: Any, second: str, high: Any) -> None:
    """Raises `ValueError` if `low` is above `high`, as far as both are known."""
    if is_plain(low) and is_plain(high) and float(low) > float(high):
        raise ValueError(
            f"`{kind}({first}=...)` must not be later than {second}; got {float(low):g} and {float(high):g}."
        )


def declared(kind: type[Settings]) -> dict[str, dataclasses.Field[Any]]:
    """The fields that were declared by one of the functions of this module."""
    return {one.name: one for one in dataclasses.fields(kind) if "doc" in one.metadata}


def parts(kind: type[Settings]) -> dict[str, type[Settings]]:
    """The parts that were declared by `part`, and what each is."""
    return {one.name: one.metadata["part"] for one in dataclasses.fields(kind) if "part" in one.metadata}


def read_settings(
    path: str | PathLike[str], kind: type[Settings], table: Mapping[str, Any], where: str
) -> dict[str, Any]:
    """The declared settings of `kind` that a TOML table holds, each of the right type.

    Raises `ConfigError` naming file, place and key for an unknown key (with the nearest known one) and for a value of
    a wrong type; bounds are checked when `kind` is made of them.
    """
    known = declared(kind)
    check_keys(path, table, known, where)
    return {key: _read_value(path, known[key], value, where) for key, value in table.items()}


def _read_value(path: str | PathLike[str], one: dataclasses.Field[Any], value: Any, where: str) -> Any:
    if "choices" in one.metadata:
        return value  # refused at construction if it is none of them
    if isinstance(one.default, bool):
        if not isinstance(value, bool):
            raise ConfigError(f"{path}: `{one.name}` in {where} must be true or false; got {value!r}.")
        return value
    if "weights" in one.metadata:
        if not isinstance(value, list):
            raise ConfigError(f"{path}: `{one.name}` in {where} must be a list of numbers; got {value!r}.")
        return tuple(_read_number(path, one, each, where) for each in value)
    held = _read_number(path, one, value, where)
    if one.metadata.get("static") and isinstance(one.default, int):
        if not held.is_integer():
            raise ConfigError(f"{path}: `{one.name}` in {where} must be a whole number; got {value!r}.")
        return int(value)
    return held


def _read_number(path: str | PathLike[str], one: dataclasses.Field[Any], value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ConfigError(f"{path}: `{one.name}` in {where} must be a number; got {value!r}.")
    try:
        return float(value)
    except OverflowError:
        raise ConfigError(f"{path}: `{one.name}` in {where} is larger than any number a computer holds.") from None


def settings_lines(held: Settings) -> list[str]:
    """The declared settings as lines of TOML, each with its unit and meaning."""
    lines = []
    for one in declared(type(held)).values():
        value = getattr(held, one.name)
        plain = value if isinstance(value, bool | int | str) else np.asarray(value, np.float64).tolist()
        unit = f"{one.metadata['unit']}: " if one.metadata["unit"] else ""
        choices = f": {', '.join(one.metadata['choices'])}" if "choices" in one.metadata else ""
        lines.append(toml_line(one.name, plain, unit + one.metadata["doc"] + choices))
    return lines
