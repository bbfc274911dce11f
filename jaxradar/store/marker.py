"""The names in a store, and the file that says that it is one."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from jaxradar._errors import LogError

__all__ = ["CATALOGUE", "DRIVES", "MARKER", "alone", "check_marker", "marker_content"]

MARKER = "store.json"
CATALOGUE = "catalogue.sqlite"
DRIVES = "drives"
_FORMAT = "jaxradar.store"
_VERSION = 1
PATIENCE_S = 2.0  # the workers of an import that was killed die a moment after it, and hold the lock until then


def marker_content() -> bytes:
    """Of the marker that this version writes."""
    return json.dumps({"format": _FORMAT, "version": _VERSION}).encode("ascii") + b"\n"


def check_marker(place: Path, content: bytes) -> None:
    """Raises `LogError`, which names `place`, for a marker that is damaged, of another format or version."""
    try:
        held = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise LogError(place, f"is not JSON ({error}); it is damaged.") from error
    if not isinstance(held, dict) or held.get("format") != _FORMAT or held.get("version") != _VERSION:
        raise LogError(place, f"holds {held!r:.80}; expected format {_FORMAT!r} of version {_VERSION}.")


@contextmanager
def alone(store: Path) -> Iterator[None]:
    """Nobody else imports or packs meanwhile; the lock is gone with the process, however that ends. Raises `LogError`
    if somebody does."""
    try:
        import fcntl
    except ImportError:  # Windows, where two at once are the user's own affair
        yield
        return
    with (store / MARKER).open("rb") as file:
        ends = time.monotonic() + PATIENCE_S
        while True:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except OSError as error:
                if time.monotonic() > ends:
                    raise LogError(
                        store, "is being written or packed by another import; wait for it to end."
                    ) from error
            time.sleep(0.05)
        yield
