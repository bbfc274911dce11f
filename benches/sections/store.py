"""Thousands of drives: import, evaluation from the store, memory, workers: `python benches/run.py store`.

Of the size of its full run are 7.7 GB of sweeps; set JAXRADAR_BENCH_DIR to keep them for another run.
"""

from __future__ import annotations

import os
import shutil
import statistics
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from child import ask
from data import UnavailableError
from drives import bench_folder, make_csv, make_drives
from measure import figure, say
from report import Row, Section
from settings import Settings

from jaxradar.evaluation import Settings as Evaluating
from jaxradar.evaluation import evaluate_each
from jaxradar.ingest import import_logs
from jaxradar.logs import find_logs, read_log
from jaxradar.systems.step import RangeAxis, detect_batch, load_detector, time_steps

__all__ = ["measure"]

DETECTORS = ("thesis", "shift", "default")
FIELDS = ("range_m", "strength", "statistic", "valid", "event")
TURNS = 3


def measure(settings: Settings) -> Section:
    distinct, count, text, shared = (5, 40, 6, 40) if settings.quick else (250, 5000, 240, 1000)
    title = f"{count} drives of 20 s at 300 sweeps a second of 128 bins uint16; {TURNS} turns"
    section = Section("store", title, ("what", "s", "Msweeps/s", "ratio", "of"), words=1)
    with bench_folder() as folder:
        store = make_drives(folder, distinct, count)
        csv = make_csv(folder / "csv", text)
        _from_text(section, folder, csv)
        rates = _from_store(section, store, count, settings)
        _the_labs_way(section, csv, rates)
        _memory(section, store)
        _workers(section, store, shared)
    return section


def _row(section: Section, key: str, seconds: float, sweeps: float, ratio: float | None = None, of: str = "") -> None:
    numbers = {"seconds": seconds, "sweeps_s": sweeps / seconds}
    cells = [key, figure(seconds), figure(sweeps / seconds / 1e6), "" if ratio is None else figure(ratio), of]
    section.rows.append(Row(key, cells, numbers))


def _timed(*calls: Callable[[], object]) -> list[float]:
    """The median time of each, in turns."""
    taken: list[list[float]] = [[] for _ in calls]
    for _ in range(TURNS):
        for call, times in zip(calls, taken, strict=True):
            start = time.perf_counter()
            call()
            times.append(time.perf_counter() - start)
    return [statistics.median(times) for times in taken]


def _parse(paths: list[Path]) -> int:
    from jaxradar.labcsv import use_one_thread

    use_one_thread()
    return sum(len(series) for path in paths for series in read_log(path).sensors)


def _from_text(section: Section, folder: Path, csv: list[Path]) -> None:
    """Import against the parser alone, in as many processes."""
    cores = len(os.sched_getaffinity(0))
    size = sum(file.stat().st_size for path in csv for file in path.iterdir())
    places: Iterator[Path] = (folder / f"imported-{turn}-{os.getpid()}" for turn in range(100))
    sweeps = 0
    with ProcessPoolExecutor(cores, get_context("forkserver")) as pool:
        shares = [csv[part::cores] for part in range(cores)]
        sweeps = sum(pool.map(_parse, shares))
        say("import against the parser alone")
        parser, imported = _timed(lambda: list(pool.map(_parse, shares)), lambda: import_logs(csv, next(places)))
    for turn in range(TURNS):
        shutil.rmtree(folder / f"imported-{turn}-{os.getpid()}")
    name = f"parsing {size / 1e6:,.0f} MB of CSV, {cores} processes"
    _row(section, name, parser, sweeps)
    _row(section, "importing it", imported, sweeps, parser / imported, "the parser's speed")
    section.notes.append("Importing includes its processes' start, hashes, checksums and the catalogue.")


def _evaluate(paths: list[str], name: str) -> int:
    settings = Evaluating(load_detector(name).detector)
    return sum(one.sweeps for one in evaluate_each(paths, settings))


def _from_store(section: Section, store: Path, count: int, settings: Settings) -> dict[str, float]:
    """Store to decisions against the same detector over an array in memory."""
    paths = [str(path) for path in find_logs([store])]
    held = [read_log(path).sensors[0] for path in paths[: 16 if settings.quick else 256]]
    longest = max(map(len, held))
    shape = (len(held), longest, len(held[0].range_m))
    raw = np.zeros(int(np.prod(shape)) + 32, np.uint16)
    sweeps = raw[-raw.ctypes.data % 64 // 2 :][: int(np.prod(shape))].reshape(shape)
    flags, dt = np.zeros(shape[:2], np.uint16), np.zeros(shape[:2])
    for at, one in enumerate(held):
        sweeps[at, : len(one)], flags[at, : len(one)] = one.sweeps, one.flags
        dt[at, : len(one)] = time_steps(one.times_ns)
    lengths = np.array([len(one) for one in held])
    axis = RangeAxis.of(held[0].range_m)
    rates = {}
    for name in DETECTORS:
        detector = load_detector(name).detector
        say(f"{name}: in memory and from the store")
        in_memory = lambda detector=detector: detect_batch(detector, axis, sweeps, flags, dt, lengths, fields=FIELDS)  # noqa: E731
        from_store = lambda name=name: _evaluate(paths, name)  # noqa: E731
        in_memory()
        whole = from_store()
        array, stored = _timed(in_memory, from_store)
        rate = whole / stored
        _row(section, f"{name}, {len(held)} drives in memory", array, int(lengths.sum()))
        share = rate / (int(lengths.sum()) / array)
        _row(section, f"{name}, {count} drives from the store", stored, whole, share, "the array's speed")
        rates[name] = rate
    return rates


def _lab(path: Path, rule: float = 0.7) -> int:
    """What the lab does by hand: genfromtxt, then a loop over sweeps with the thesis's rule."""
    (file,) = [one for one in path.iterdir() if one.stem.isdigit()]
    table = np.genfromtxt(file, delimiter=",")
    range_m, before, alarms = table[0, 1:], None, 0
    for sweep in table[1:]:
        place = np.argmax(sweep[1:] * (2 * range_m) ** 2)
        now = sweep[0], range_m[place]
        if before is not None and abs(now[1] - before[1]) / (now[0] - before[0]) > rule:
            alarms += 1
        before = now
    return len(table) - 1


def _the_labs_way(section: Section, csv: list[Path], rates: dict[str, float]) -> None:
    paths = [str(path) for path in csv[:60]]
    say("the lab's way")
    few = csv[:2]
    sweeps = sum(map(_lab, few))
    (lab,) = _timed(lambda: [_lab(path) for path in few])
    _row(section, f"the lab's way: genfromtxt and a loop, {len(few)} drives of CSV", lab, sweeps)
    lab_rate = sweeps / lab
    for name in DETECTORS:
        whole = _evaluate(paths, name)
        (seconds,) = _timed(lambda name=name: _evaluate(paths, name))
        _row(section, f"{name}, from CSV", seconds, whole, whole / seconds / lab_rate, "the lab's speed")
        section.rows.append(
            Row(
                f"{name}, from the store",
                [
                    f"{name}, from the store",
                    "",
                    figure(rates[name] / 1e6),
                    figure(rates[name] / lab_rate),
                    "the lab's speed",
                ],
                {"sweeps_s": rates[name]},
            )
        )


def _memory(section: Section, store: Path) -> None:
    say("memory")
    try:
        for name in DETECTORS:
            peak = ask("store", path=str(store), detector=name)["anonymous"]
            section.notes.append(f"{name}: at most {peak / 1e9:.2f} GB of anonymous memory.")
    except UnavailableError as why:
        section.notes.append(f"Memory not measured: {why}")


def _workers(section: Section, store: Path, count: int) -> None:
    """One pinned process, one pinned worker, two; with their processes started and programs compiled."""
    say("workers")
    try:
        # Each in a process of its own, whose cores its workers share out.
        plain = ask("workers", path=str(store), count=count, workers=0, cores=1)
        one = ask("workers", path=str(store), count=count, workers=1, cores=1)
        two = ask("workers", path=str(store), count=count, workers=2, cores=2)
    except UnavailableError as why:
        section.notes.append(f"Workers not measured: {why}")
        return
    _row(section, f"{count} drives on one core, no worker", plain["seconds"], plain["sweeps"])
    share = plain["seconds"] / one["seconds"]
    _row(section, "the same, one worker on one core", one["seconds"], one["sweeps"], share, "without")
    _row(
        section, "the same, two workers", two["seconds"], two["sweeps"], one["seconds"] / two["seconds"], "one worker's"
    )
