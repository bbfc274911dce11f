"""How long compilation takes, from nothing and from the persistent cache: `python benches/run.py compile`."""

from __future__ import annotations

import tempfile

import numpy as np
import subject
from child import ask
from data import UnavailableError
from measure import Spread, around, figure, say
from report import Row, Section
from settings import Settings

__all__ = ["measure"]

YARDSTICK = "yardstick"
CACHE = {
    "JAX_PLATFORMS": "cpu",
    "JAX_ENABLE_COMPILATION_CACHE": "true",
    "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
    "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
}


def measure(settings: Settings) -> Section:
    repeats = 1 if settings.quick else 3
    title = f"first call less second, in processes of their own; least of {repeats}"
    section = Section("compile", title, ("program", "cold ms", "cached ms", "/yardstick", "range"))
    rows, gradients = list(subject.ROWS), list(subject.GRADIENTS)
    cold: list[dict[str, float]] = []
    cached: list[dict[str, float]] = []
    try:
        for repeat in range(repeats):
            say(f"compiling, {repeat + 1} of {repeats}")
            with tempfile.TemporaryDirectory() as folder:
                environment = {**CACHE, "JAX_COMPILATION_CACHE_DIR": folder}
                for times in (cold, cached):
                    times.append(ask("compiling", environment, rows=rows, gradients=gradients, logs=4))
    except UnavailableError as why:
        section.notes.append(f"Skipped: {why}")
        return section
    for name in cold[0]:
        values = np.array([times[name] for times in cold])
        relative = values / np.array([times[YARDSTICK] for times in cold])
        against = Spread(float(np.median(relative)), float(relative.min()), float(relative.max()))
        numbers = {"cold_ms": values.min() * 1e3, "cached_ms": min(times[name] for times in cached) * 1e3}
        cells = [name, f"{numbers['cold_ms']:.0f}", f"{numbers['cached_ms']:.0f}"]
        cells += [figure(against.median), around(against)]
        # One compilation has no spread, and so no loss either.
        section.rows.append(Row(name, cells, numbers, against if repeats > 1 and name != YARDSTICK else None))
    section.notes.append(
        "Tracing is in it; it is most of what is left with the cache. /yardstick: over a program of JAX's own "
        "operations that stays as it is, compiled in the same process."
    )
    return section
