"""A detector over logs: read while others are computed, given out in their order."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from os import PathLike
from typing import Any

import numpy as np

from jaxradar._errors import ConfigError, JaxradarError
from jaxradar.cluster import Cluster, Here, LostError, cluster_of
from jaxradar.drive import Channel, Drive, Motion, SensorSeries, Truth
from jaxradar.evaluation.picture import picture_of
from jaxradar.evaluation.records import Drawn, Events, Failure, SeriesResult
from jaxradar.evaluation.selection import Part, Selection, Settings
from jaxradar.evaluation.table import Evaluation
from jaxradar.logs import find_logs, read_log
from jaxradar.matching import MatchWindow, Score, match_steps
from jaxradar.systems.step import Decision, StepDetector, detect_series, load_detector
from jaxradar.systems.step.pipeline import trace_of
from jaxradar.units import NANOSECONDS

__all__ = ["evaluate", "evaluate_each", "evaluate_parts"]

# Logs that a worker of a cluster goes through at a time: at most so many that its lanes are full most of that time, and
# few enough that the workers end together.
SHARD, SHARDS_A_WORKER = 256, 4
_FIELDS = ("range_m", "strength", "statistic", "impact_in_s", "valid", "event")


@dataclasses.dataclass(eq=False)
class _Reading:
    """A series on its way through the detector."""

    number: int
    path: str
    drive: Drive | None
    part: Part
    truth: Truth | None
    speed: Channel | None
    problems: tuple[str, ...]


class _Logs:
    """Series out of logs, for `detect_series`; what becomes of them is put into order again."""

    def __init__(self, paths: Iterable[str], settings: Settings) -> None:
        self._paths, self._settings = paths, settings
        self._under_way: dict[int, _Reading] = {}
        self._ready: dict[int, SeriesResult | Failure] = {}
        self._given = 0

    def series(self) -> Iterator[tuple[SensorSeries, Motion]]:
        number = place = 0
        for path in self._paths:
            try:
                drive = read_log(path)
                parts = list(self._settings.selection.of(path, drive))
            except (JaxradarError, OSError) as error:
                self._ready[number] = Failure(path, _sentence(error), isinstance(error, ConfigError))
                number += 1
                continue
            for part in parts:
                kept = drive if self._settings.figures else None
                reading = _Reading(number, path, kept, part, drive.truth, drive.motion.speed_m_s, drive.problems)
                self._under_way[place] = reading
                number, place = number + 1, place + 1
                yield part.series, drive.motion

    def done(self, place: int, found: dict[str, Any]) -> None:
        reading = self._under_way.pop(place)
        self._ready[reading.number] = _result(reading, found, self._settings)

    def in_order(self) -> Iterator[SeriesResult | Failure]:
        while self._given in self._ready:
            yield self._ready.pop(self._given)
            self._given += 1


def _sentence(error: JaxradarError | OSError) -> str:
    if isinstance(error, OSError):
        return f"{error.filename or 'input or output'}: {error.strerror or error}."
    return str(error)


def _result(reading: _Reading, found: dict[str, Any], settings: Settings) -> SeriesResult:
    series = reading.part.series
    at = np.flatnonzero(found["event"])
    impact_in_s = found["impact_in_s"][at].astype(np.float64)
    events = Events(
        time_s=series.times_ns[at] / NANOSECONDS,
        **{name: found[name][at].astype(np.float64) for name in ("range_m", "strength", "statistic")},
        impact_in_s=np.where(impact_in_s > 0, impact_in_s, np.nan),
        sweep=reading.part.place(at),
        threshold=float(settings.detector.threshold),
    )
    matching = None
    if reading.truth is not None:
        matching = match_steps(
            events.time_s,
            reading.truth.steps,
            window=settings.window,
            speed=reading.speed,
            start_s=settings.selection.start_s,
            stop_s=settings.selection.stop_s,
        )
    drawn = None
    if reading.drive is not None:
        drawn = Drawn(reading.drive, series, trace_of(settings.detector, series, found), matching)
    return SeriesResult(
        path=reading.path,
        sensor=series.sensor,
        sweeps=len(series),
        duration_s=series.duration_s,
        sweep_rate_hz=series.sweep_rate_hz,
        invalid_sweeps=int((~found["valid"]).sum()),
        events=events,
        score=None if matching is None else Score.of(matching),
        problems=tuple(reading.problems),
        picture=picture_of(series, found) if settings.pictures else None,
        drawn=drawn,
    )


def evaluate_each(paths: Iterable[str], settings: Settings) -> Iterator[SeriesResult | Failure]:
    """What a detector finds in each sensor of each log, and which logs could not be read, in the order of the logs.

    `paths`: as `read_log` takes them. What is held in memory does not grow with their number, and with their length by
    a few numbers a sweep of those that are under way.
    """
    logs = _Logs(paths, settings)
    fields: tuple[str, ...] = _FIELDS
    if settings.pictures:
        fields = (*_FIELDS, "speed_m_s")
    if settings.figures:
        fields = tuple(one.name for one in dataclasses.fields(Decision))
    for place, found in detect_series(settings.detector, logs.series(), fields):
        logs.done(place, found)
        yield from logs.in_order()
    yield from logs.in_order()


def _shard(settings: Settings, paths: Sequence[str]) -> list[SeriesResult | Failure]:
    return list(evaluate_each(paths, settings))


def evaluate_parts(
    paths: Sequence[str],
    settings: Settings,
    cluster: str | Here | None = None,
    advance: Callable[[int], None] = lambda logs: None,
) -> Iterator[SeriesResult | Failure]:
    """As `evaluate_each`, on the workers of a cluster if one is given (`cluster_of`), with the same results.

    `advance` hears of how many more logs the results were given out.
    """
    with cluster_of(cluster) as workers:
        if not isinstance(workers, Cluster):
            last = None
            for one in evaluate_each(paths, settings):
                advance(int(one.path != last))
                last = one.path
                yield one
            return
        size = max(1, min(SHARD, len(paths) // (SHARDS_A_WORKER * max(1, workers.workers))))
        shards = [paths[first : first + size] for first in range(0, len(paths), size)]
        for shard, found in zip(shards, workers.map(partial(_shard, settings), shards), strict=True):
            if isinstance(found, LostError):
                yield from (Failure(path, f"{path}: {found}") for path in shard)
            else:
                yield from found
            advance(len(shard))


def evaluate(
    logs: str | PathLike[str] | Iterable[str | PathLike[str]],
    detector: str | PathLike[str] | StepDetector[Any, Any] = "default",
    *,
    selection: Selection | None = None,
    window: MatchWindow | None = None,
    pictures: bool = False,
    cluster: str | Here | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Evaluation:
    """Run a detector over logs and stores, and hold what it finds against the truth.

    - `logs`: a path or many: logs, folders of logs, stores, archives and patterns, as `find_logs` takes them.
    - `detector`: a name, a TOML file, or a detector.
    - `selection`: the part of each log that is looked at; `window`: `MatchWindow()` if None.
    - `pictures`: keep what a report shows of each series, some 3 kB.
    - `cluster`: the address of a Dask scheduler (`tcp://...`), `local:N` for N processes here, or a `Cluster`; the
      logs must lie under the same paths on its machines. The result is the same as without.
    - `progress`: hears how many logs are done, of how many.

    A log that cannot be read is one of the `failures` and stops nothing. Raises `ConfigError` for a detector or a
    cluster that there is not, `LogError` for a store whose catalogue is damaged.
    """
    paths = list(map(str, find_logs(logs)))
    made = detector if isinstance(detector, StepDetector) else load_detector(detector).detector
    settings = Settings(made, selection or Selection(), window or MatchWindow(), pictures)
    done = 0

    def advance(more: int) -> None:
        nonlocal done
        done += more
        progress(done, len(paths))

    return Evaluation.of(evaluate_parts(paths, settings, cluster, advance), settings)
