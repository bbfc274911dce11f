"""The whole pipeline over a batch of logs, beside what others would write: `python benches/run.py batch`."""

from __future__ import annotations

from collections.abc import Callable

import jax
import numpy as np
import reference
import subject
from child import ask
from data import ESTIMATORS, Batch, UnavailableError, make_batch
from measure import around, figure, ratio, rounds, say, spread
from peers import c_peers, numba_peers, numpy_peers
from report import Row, Section
from settings import Settings

__all__ = ["measure"]

OURS = "jaxradar"
READ = "read"
CHECKED_LOGS = 8
COLUMNS = ("estimator", "candidate", "ms", "10..90 %", "GB/s", "of read", "Msweeps/s", "/argmax", "/NumPy", "10..90 %")
Candidates = dict[tuple[str, str], Callable[[], object]]


def _peers(batch: Batch, section: Section) -> Candidates:
    """All candidates that are not ours, checked."""
    found: Candidates = {}
    wanted = {estimator: reference.expected(batch, estimator, CHECKED_LOGS) for estimator in ESTIMATORS}
    for module in (numpy_peers, numba_peers, c_peers):
        try:
            for name, by_estimator in module.candidates(batch).items():
                for estimator, call in by_estimator.items():
                    wrong = reference.check(call(), wanted[estimator])
                    if wrong:
                        section.failed = True
                        section.notes.append(f"WRONG, not timed: {estimator} of {name}: {wrong}.")
                    else:
                        found[estimator, name] = call
        except UnavailableError as why:
            section.notes.append(f"Skipped: {module.__name__.rpartition('.')[2]}: {why}")
    return found


def ours(batch: Batch, section: Section, device: jax.Device) -> tuple[Candidates, list[str]]:
    """Our rows, checked, and their names. `device`: where the data lie and the program runs."""
    found: Candidates = {}
    for row, estimator in subject.ROWS.items():
        detector = subject.build(row, batch.range_m)
        # The processor reads NumPy's arrays where they are.
        arrays = subject.place(detector, batch, None if device.platform == "cpu" else device)
        call = subject.runner(detector, batch, arrays)
        say(f"checking {row}")
        if estimator is None:
            wrong = subject.check_default(detector, batch, call(), 3)
        else:
            wrong = reference.check(call(), reference.expected(batch, estimator, CHECKED_LOGS))
        if wrong:
            section.failed = True
            section.notes.append(f"WRONG, not timed: {row} of {OURS}: {wrong}.")
        else:
            found[row, OURS] = call
    return found, [row for row, _ in found]


def fill(section: Section, batch: Batch, times: dict[tuple[str, str], np.ndarray], read_gb_s: float | None) -> None:
    """A row for each candidate, NumPy's time beside it round by round."""
    for (estimator, name), seconds in sorted(times.items(), key=_order):
        took = spread(seconds).scaled(1e3)
        peer = subject.ROWS.get(estimator) if name == OURS else estimator
        # What has no peer is still compared from run to run by the same yardstick.
        against = ratio(seconds, times[peer or "argmax", numpy_peers.BY_LOG])
        argmax = times.get(("argmax", name))
        gb_s = batch.sweeps.nbytes / took.median / 1e6
        section.rows.append(
            Row(
                key=f"{estimator}, {name}",
                cells=[
                    estimator,
                    name,
                    figure(took.median),
                    around(took),
                    figure(gb_s),
                    f"{gb_s / read_gb_s:.0%}" if read_gb_s else "-",
                    figure(batch.count / took.median / 1e3),
                    figure(ratio(seconds, argmax).median) if argmax is not None else "-",
                    figure(against.median) if peer else "-",
                    around(against) if peer else "-",
                ],
                numbers={"ms": took.median, "ms_low": took.low, "ms_high": took.high, "gb_s": gb_s},
                ratio=against,
            )
        )


def _order(item: tuple[tuple[str, str], np.ndarray]) -> tuple[int, bool, float]:
    (estimator, name), seconds = item
    return list(subject.ROWS).index(estimator), name != OURS, -float(np.median(seconds))


def _memory(section: Section, rows: list[str], logs: int) -> None:
    say("measuring memory in a process of its own")
    try:
        answer = ask("memory", {"JAX_PLATFORMS": "cpu"}, rows=rows, logs=logs)
    except UnavailableError as why:
        section.notes.append(f"Skipped: memory: {why}")
        return
    section.notes.append("Peak of resident memory during a call beyond what was there before, results included:")
    for row, found in answer.items():
        temp = "" if found["temp"] is None else f"; the compiled program sets {found['temp'] / 1e6:.1f} MB aside"
        share = found["peak"] / found["input"]
        section.notes.append(f"  {row:9} {found['peak'] / 1e6:7.1f} MB, {share:6.1%} of the input{temp}")
        section.rows.append(Row(f"memory, {row}", [], found))


def measure(settings: Settings) -> Section:
    logs = 32 if settings.quick else 512
    say(f"making {logs} logs")
    batch = make_batch(logs)
    title = (
        f"{logs} logs x {batch.sweeps.shape[1]} sweeps x {batch.bins} bins uint16, {batch.sweeps.nbytes / 1e6:.0f} MB"
    )
    section = Section("batch", f"{title}; {settings.rounds} rounds", COLUMNS, words=2)
    cpu = jax.devices("cpu")[0]
    candidates = _peers(batch, section)
    mine, rows = ours(batch, section, cpu)
    candidates |= mine
    try:
        candidates[READ, READ] = c_peers.reader(batch)
    except UnavailableError as why:
        section.notes.append(f"Skipped: read bandwidth: {why}")
    named = {"\n".join(key): call for key, call in candidates.items()}
    found = rounds(named, settings.rounds, "batch")
    times = {(key.split("\n")[0], key.split("\n")[1]): seconds for key, seconds in found.items()}
    read = times.pop((READ, READ), None)
    read_gb_s = None if read is None else batch.sweeps.nbytes / float(np.median(read)) / 1e9
    fill(section, batch, times, read_gb_s)
    if read_gb_s:
        section.notes.append(
            f"Reading the batch once, all cores, C: {read_gb_s:.1f} GB/s. `of read` is the share of it."
        )
    if settings.quick:
        section.notes.append("--quick: so small a batch may stay in the last cache; GB/s are then not the memory's.")
    section.notes.append(
        f"/NumPy: time over that of `{numpy_peers.BY_LOG}` of the same estimator in the same round, median and spread; "
        "the thesis in float64 over NumPy's argmax in float32. /argmax: over the same candidate's argmax. C, numba and "
        f"`{numpy_peers.BY_LOG}` write into buffers that they keep, the others make new ones."
    )
    _memory(section, rows, logs)
    return section
