"""What of the machine a process may use."""

from __future__ import annotations

import contextlib
import os

__all__ = ["allow_open_files", "cores"]


def cores() -> int:
    """Cores that this process may run on; not all systems say so, and then those that there are."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def allow_open_files(count: int) -> None:
    """Raise this process's own limit of open files to so many, as far as the system lets it; never lower it."""
    try:
        import resource
    except ImportError:  # Windows, where the limit is another
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = count if hard == resource.RLIM_INFINITY else min(count, hard)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
