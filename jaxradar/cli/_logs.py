"""The logs that arguments name; of what it imports, reading logs is the most."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from jaxradar.logs import find_logs

__all__ = ["all_logs"]


def all_logs(paths: Sequence[str]) -> tuple[list[str], list[tuple[str, str]]]:
    """The logs that the arguments name, each once and as it was given or found, and (argument, what is wrong) of those
    that name none."""
    logs: dict[str, str] = {}
    empty = []
    for given in paths:
        found = find_logs([given])
        if not found:
            folder = f"{given}: is a folder without logs; expected <sensor>.csv, .h5 or .drive in it."
            empty.append((given, folder if given else "'': an empty name names no log."))
        for path in found:
            # `Path` writes "./a//b/" as "a/b", and who asked for the one looks for it in the results.
            logs.setdefault(os.path.realpath(path), given if path == Path(given) else os.fspath(path))
    return list(logs.values()), empty
