"""How much more memory a process holds at the height of a call than before it; used in a process of its own."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import resource
import time
from collections.abc import Callable
from pathlib import Path

from data import UnavailableError

__all__ = ["anonymous_bytes", "growth_bytes"]

_STATUS, _CLEAR = Path("/proc/self/status"), Path("/proc/self/clear_refs")


def _status(key: str) -> int:
    for line in _STATUS.read_text().splitlines():
        if line.startswith(key):
            return int(line.split()[1]) * 1024
    raise UnavailableError(f"the kernel does not tell `{key}` of a process.")


def anonymous_bytes() -> int:
    """What this process holds in memory now that is no file's. Raises `UnavailableError` without /proc."""
    if not _STATUS.exists():
        raise UnavailableError("there is no /proc to read a process's memory from.")
    return _status("RssAnon")


def growth_bytes(call: Callable[[], object]) -> int:
    """Peak resident memory during the second call, results included, beyond what was resident before it.

    The first call compiles and starts threads. What it leaves behind in the allocator is given back, or the second
    would find it there and seem to need nothing. Where the kernel cannot forget an earlier peak (it is Linux's
    /proc/self/clear_refs that does), only growth beyond that peak is seen. Raises `UnavailableError` without /proc.
    """
    if not _STATUS.exists():
        raise UnavailableError("there is no /proc to read a process's memory from.")
    call()
    gc.collect()
    with contextlib.suppress(AttributeError):  # not the GNU library: the figure may come out small
        ctypes.CDLL(None).malloc_trim(0)
    time.sleep(0.05)
    before = _status("VmRSS")
    try:
        _CLEAR.write_text("5")
        result = call()
        peak = _status("VmHWM")
    except OSError:
        result = call()
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    del result
    return max(peak - before, 0)
