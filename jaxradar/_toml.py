"""TOML in and out: values with a comment each, and a typo answered with the nearest known key. Plain Python."""

from __future__ import annotations

import difflib
import json
import re
import tomllib
from collections.abc import Iterable, Mapping
from os import PathLike
from pathlib import Path
from typing import Any

from jaxradar._errors import ConfigError

__all__ = ["check_keys", "nearest", "read_toml", "toml_line", "toml_value"]


def nearest(word: str, known: Iterable[str]) -> str:
    """` (did you mean `…`?)` for the known word that is most like this one, empty if none is."""
    close = difflib.get_close_matches(word, sorted(known), n=1, cutoff=0.6)
    return f" (did you mean `{close[0]}`?)" if close else ""


def read_toml(path: str | PathLike[str]) -> dict[str, Any]:
    """The tables of a TOML file. Raises `ConfigError` naming the file, and the place if it is not TOML."""
    try:
        return tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror or error}.") from None
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ConfigError(f"{path}: expected a TOML file: {error}.") from None
    except (ValueError, RecursionError):  # a number of thousands of digits, thousands of brackets
        raise ConfigError(f"{path}: expected a TOML file; it holds what is too long or too deep to be read.") from None


def check_keys(path: str | PathLike[str], table: Mapping[str, Any], known: Iterable[str], where: str) -> None:
    """Refuse a key that nobody reads, naming the nearest one that somebody does."""
    known = list(known)
    for key in table:
        if key not in known:
            raise ConfigError(
                f"{path}: unknown key `{key}`{nearest(key, known)} in {where}; expected {', '.join(known)}."
            )


def toml_value(value: Any) -> str:
    """One value as TOML text. Raises `TypeError` for what TOML has no form for."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)  # TOML's basic strings are JSON's, but for DEL
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return repr(value)  # also `inf` and `nan`, which TOML spells alike
    if isinstance(value, list | tuple):
        return "[" + ", ".join(toml_value(item) for item in value) + "]"
    raise TypeError(f"TOML has no form for a {type(value).__name__}")


def toml_line(key: str, value: Any, comment: str = "") -> str:
    """`key = value  # comment`, without a line end."""
    bare = re.fullmatch(r"[A-Za-z0-9_-]+", key)
    return f"{key if bare else json.dumps(key, ensure_ascii=False)} = {toml_value(value)}" + (
        f"  # {comment}" if comment else ""
    )
