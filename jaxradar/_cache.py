"""Programs that were compiled once are kept in the user's cache folder: the second run of a command begins at once."""

from __future__ import annotations

import os
import platform
import sys

import platformdirs

__all__ = ["keep_compiled_programs"]


def keep_compiled_programs() -> None:
    """Tell JAX, before it is imported, where to keep what it compiles. What the user has set for JAX stands.

    Where the folder cannot be written, nothing is kept. Programs are made for one processor: each machine that shares
    a home has a folder of its own.
    """
    if "jax" in sys.modules or "JAX_COMPILATION_CACHE_DIR" in os.environ:
        return
    folder = platformdirs.user_cache_path("jaxradar") / "compiled" / (platform.node() or "here")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return
    if not os.access(folder, os.W_OK):
        return
    os.environ["JAX_COMPILATION_CACHE_DIR"] = str(folder)
    # Every program, however quickly it was compiled and however small it is.
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "-1")
