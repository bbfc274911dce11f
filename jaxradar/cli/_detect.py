"""From a log's name to what a detector says of it."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxradar._errors import ConfigError
from jaxradar.cli._output import shown
from jaxradar.drive import Drive, SensorSeries
from jaxradar.evaluation import Matching, MatchWindow, match_steps
from jaxradar.logs import find_logs

if TYPE_CHECKING:
    from jaxradar.systems.step import StepTrace

__all__ = ["Outcome", "Selection", "all_logs", "detect_in", "draw_drive", "draw_sweeps", "figure_files", "record_of"]


@dataclass(frozen=True)
class Selection:
    """The part of each log that is looked at: sensor number (all if None), seconds since the first sweep, bins."""

    sensor: int | None = None
    start_s: float | None = None
    stop_s: float | None = None
    bins: int | None = None


@dataclass(frozen=True, eq=False)
class Outcome:
    """What was found in one sensor's series.

    `series` and `trace` are of the part that was looked at; `places` (sweeps,) are its indices in the whole log.
    `matching` is None where the truth is not known.
    """

    path: str
    drive: Drive
    series: SensorSeries
    places: np.ndarray
    trace: StepTrace
    matching: Matching | None


def all_logs(paths: Sequence[str]) -> tuple[list[str], list[tuple[str, str]]]:
    """The logs that the arguments name, each once and as it was given or found, and (argument, what is wrong) of those
    that name none."""
    logs: dict[str, str] = {}
    empty = []
    for given in paths:
        found = find_logs([given])
        if not found:
            folder = f"{given}: is a folder without logs; expected <sensor>.csv, .h5 or .drive in it."
            empty.append((given, folder if given else "'': an empty name names no log."))
        for path in found:
            # `Path` writes "./a//b/" as "a/b", and who asked for the one looks for it in the results.
            logs.setdefault(os.path.realpath(path), given if path == Path(given) else os.fspath(path))
    return list(logs.values()), empty


def detect_in(path: str, drive: Drive, detector: Any, selection: Selection, window: MatchWindow) -> Iterator[Outcome]:
    """Run a detector over the selected part of each selected sensor of a drive.

    Raises `ConfigError` if the drive has not got what is selected.
    """
    from jaxradar.systems.step import detect

    for whole in _chosen(path, drive, selection):
        series, places = _cut(path, whole, selection)
        trace = detect(detector, series, drive.motion)
        matching = None
        if drive.truth is not None:
            matching = match_steps(
                [event.time_s for event in trace.events],
                drive.truth.steps,
                window=window,
                speed=drive.motion.speed_m_s,
                start_s=selection.start_s,
                stop_s=selection.stop_s,
            )
        yield Outcome(path, drive, series, places, trace, matching)


def _chosen(path: str, drive: Drive, selection: Selection) -> tuple[SensorSeries, ...]:
    if selection.sensor is None:
        return drive.sensors
    try:
        return (drive.series(selection.sensor),)
    except KeyError:
        held = ", ".join(str(series.sensor) for series in drive.sensors) or "none"
        raise ConfigError(f"{path}: has no sensor {selection.sensor}; its sensors: {held}.") from None


def _cut(path: str, series: SensorSeries, selection: Selection) -> tuple[SensorSeries, np.ndarray]:
    from jaxradar.systems.step import thin

    times_s, places = series.times_s, np.arange(len(series))
    inside = np.ones(len(series), bool)
    if selection.start_s is not None:
        inside &= times_s >= selection.start_s
    if selection.stop_s is not None:
        inside &= times_s <= selection.stop_s
    if not inside.all():
        if not inside.any():
            raise ConfigError(
                f"{path}: sensor {series.sensor} has no sweep in the part asked for; "
                f"its sweeps lie between {times_s.min():.3f} and {times_s.max():.3f} s."
            )
        places = places[inside]
        # A slice of a memory map reads nothing; times that go back may leave the part in pieces.
        part = slice(places[0], places[-1] + 1) if places[-1] - places[0] + 1 == len(places) else places
        series = replace(series, times_ns=series.times_ns[part], sweeps=series.sweeps[part], flags=series.flags[part])
    if selection.bins is not None:
        try:
            series = thin(series, selection.bins)
        except ConfigError as error:
            raise ConfigError(f"{path}: {error}") from None
    return series, places


def record_of(outcome: Outcome) -> dict[str, Any]:
    """One line of `--json`."""
    series, matching = outcome.series, outcome.matching
    return {
        "path": outcome.path,
        "sensor": series.sensor,
        "sweeps": len(series),
        "duration_s": series.duration_s,
        "sweep_rate_hz": series.sweep_rate_hz,
        "invalid_sweeps": int((~outcome.trace.valid).sum()),
        "problems": list(outcome.drive.problems),
        "detections": [
            {
                "time_s": event.time_s,
                "range_m": event.range_m,
                "strength": event.strength,
                "statistic": event.statistic,
                "threshold": event.threshold,
                "sweep": int(outcome.places[event.sweep]),
            }
            for event in outcome.trace.events
        ],
        "hits": None if matching is None else matching.hits,
        "misses": None if matching is None else matching.misses,
        "false_alarms": None if matching is None else matching.false_alarms,
        "lead_s": None if matching is None else list(matching.lead_s),
    }


def figure_files(outcome: Outcome, folder: Path, detector: str, taken: set[str]) -> list[Path]:
    """Draw what was found into PNG files whose names are not among those `taken`; returns where they are."""
    # Logs of different drives often share a name; the folder above tells them apart, in the title too.
    label = _name(outcome.path)
    if f"{label}-sensor{outcome.series.sensor}" in taken:
        label = f"{Path(outcome.path).resolve().parent.name}-{label}"
    stem = name = f"{label}-sensor{outcome.series.sensor}"
    number = 1
    while name in taken:
        number += 1
        name = f"{stem}-{number}"
    taken.add(name)
    written = []
    if len(outcome.series):
        written.append(draw_drive(outcome, folder / f"{name}.png", detector, label))
    if not outcome.series.invalid.all():
        written.append(draw_sweeps(outcome, folder / f"{name}-sweeps.png", label))
    return written


def draw_drive(outcome: Outcome, path: Path, detector: str, label: str | None = None) -> Path:
    """The drive over time with the detections, under the log's name if it has no other `label`; returns `path`."""
    from jaxradar.plots import plot_drive, save

    figure = plot_drive(
        outcome.series,
        outcome.trace,
        motion=outcome.drive.motion,
        matching=outcome.matching,
        source=f"{shown(label or _name(outcome.path))}, sensor {outcome.series.sensor}, detector {detector}",
    )
    save(figure, path)
    return path


def draw_sweeps(outcome: Outcome, path: Path, label: str | None = None) -> Path:
    """The sweeps laid over each other, labelled likewise; returns `path`."""
    from jaxradar.plots import plot_sweeps, save

    source = f"{shown(label or _name(outcome.path))}, sensor {outcome.series.sensor}"
    save(plot_sweeps(outcome.series, outcome.trace, source=source), path)
    return path


def _name(path: str) -> str:
    log = Path(path).resolve()
    # A folder of CSV files may have a dot in its name: only what is a file's or a drive's ending is taken off.
    return log.stem if log.is_file() or log.suffix == ".drive" else log.name
