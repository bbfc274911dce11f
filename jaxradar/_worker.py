"""What each worker of a cluster does first; imported where Dask is installed."""

from __future__ import annotations

import os
from typing import Any

from distributed import WorkerPlugin

from jaxradar._cache import keep_compiled_programs

__all__ = ["Ready"]


class Ready(WorkerPlugin):
    """It keeps compiled programs, as the command line does; of `share` workers on one machine each takes its own
    cores, and one that comes in the place of another takes over those."""

    name = "jaxradar"

    def __init__(self, share: int | None = None) -> None:
        self.share = share

    def setup(self, worker: Any) -> None:
        keep_compiled_programs()
        if self.share is not None and hasattr(os, "sched_setaffinity"):
            cores = sorted(os.sched_getaffinity(0))
            # The name of who takes the place of another is its number and a suffix.
            number = int(str(worker.name).partition("-")[0])
            if len(cores) >= self.share:
                os.sched_setaffinity(0, cores[number % self.share :: self.share])
