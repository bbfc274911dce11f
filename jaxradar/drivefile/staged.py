"""Writing that leaves what was there before unless it ends well."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from jaxradar._errors import LogError

__all__ = ["staged"]


@contextmanager
def staged(path: Path, *, overwrite: bool, replaceable: Callable[[Path], bool] = Path.is_file) -> Iterator[Path]:
    """A free name beside `path` to write a file or a folder under; it becomes `path` when the block ends well.

    Raises `LogError` if `path` exists and `overwrite` is false, if what exists is not `replaceable` (a folder of
    something else is never thrown away), and for every `OSError` of the block.
    """

    def check() -> None:
        if os.path.lexists(path) and not overwrite:
            raise LogError(path, "exists already; it is replaced only if overwriting is asked for.")
        if os.path.lexists(path) and not replaceable(path):
            raise LogError(path, "exists and is something else than what would be written there; it was left alone.")

    token = secrets.token_hex(4)
    stage = path.with_name(f".{path.name}.{token}.new")
    aside = path.with_name(f".{path.name}.{token}.old")
    try:
        check()
        path.parent.mkdir(parents=True, exist_ok=True)
        yield stage
        check()  # writing took a while
        if path.is_dir():  # a folder that holds something cannot be renamed over
            path.rename(aside)
        try:
            stage.replace(path)
        except OSError:
            if aside.exists():
                aside.rename(path)
            raise
    except OSError as error:
        raise LogError(path, f"cannot be written: {error.strerror or error}.") from error
    except LogError as error:
        if Path(error.path).is_relative_to(stage):  # a name that nobody gave and that is gone by now
            raise LogError(path, error.problem, line=error.line, column=error.column) from error
        raise
    finally:
        for rest in (stage, aside):
            if rest.is_dir():
                shutil.rmtree(rest, ignore_errors=True)
            else:
                rest.unlink(missing_ok=True)
