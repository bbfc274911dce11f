"""Thousands of drives for the section `store`: out of the ready scenes, as CSV and as a store; used by `sections`."""

from __future__ import annotations

import dataclasses
import itertools
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from measure import say

from jaxradar import sim
from jaxradar.drive import Drive
from jaxradar.drivefile import write_drive
from jaxradar.store import CATALOGUE, DRIVES, Catalogue, entry_of, make_store

__all__ = ["bench_folder", "make_csv", "make_drives"]

SCENES = ("trial", "trial-averaged", "flat-asphalt", "rough-road", "pulling-away")
SECONDS, RATE_HZ = 20.0, 300.0


@contextmanager
def bench_folder() -> Iterator[Path]:
    """Where the drives lie: the folder of the environment's `JAXRADAR_BENCH_DIR`, which is kept, or one that goes."""
    kept = os.environ.get("JAXRADAR_BENCH_DIR")
    if kept:
        Path(kept).mkdir(parents=True, exist_ok=True)
        yield Path(kept)
        return
    with tempfile.TemporaryDirectory(prefix="jaxradar-bench-") as folder:
        yield Path(folder)


def _simulated(count: int) -> Iterator[tuple[str, Drive]]:
    each = -(-count // len(SCENES))
    for name in SCENES:
        ready = sim.load_scene(name)
        radar = dataclasses.replace(ready.radar, rate_hz=RATE_HZ)
        scene = dataclasses.replace(ready, duration_s=SECONDS, radar=radar)
        say(f"simulating {each} drives of `{name}`")
        for seed, drive in enumerate(sim.simulate_each([scene] * each, range(each))):
            yield f"{name}-{seed:04d}", drive


def make_csv(folder: Path, count: int) -> list[Path]:
    """So many drives as the lab's CSV, unless they are there."""
    from jaxradar.logs import write_log

    made = sorted(folder.iterdir()) if folder.exists() else []
    if len(made) != count:
        shutil.rmtree(folder, ignore_errors=True)
        for name, drive in itertools.islice(_simulated(count), count):
            write_log(drive, folder / name)
    return sorted(folder.iterdir())


def make_drives(folder: Path, distinct: int, count: int) -> Path:
    """A store of `count` drives, of which `distinct` are simulated and the others copies in files of their own."""
    store = folder / f"store-{distinct}-{count}"
    done = store / "made"
    if done.exists():
        return store
    shutil.rmtree(store, ignore_errors=True)
    make_store(store)
    with Catalogue(store / CATALOGUE, write=True) as catalogue:
        for name, drive in _simulated(distinct):
            entries = []
            for copy in range(count // distinct):
                whole = f"{copy:04d}/{name}"
                write_drive(drive, store / DRIVES / f"{whole}.drive", durable=False)
                entries.append(entry_of(drive, source=whole, name=whole, stamp="[]", hash=whole, bytes=0))
            catalogue.put(entries)
    done.touch()
    return store
