"""From logs' names to figures of what a detector says of them."""

from __future__ import annotations

from pathlib import Path

from jaxradar._errors import ConfigError, JaxradarError
from jaxradar._program import shown
from jaxradar.evaluation import Drawn, SeriesResult, Settings, evaluate_each

__all__ = ["draw_drive", "draw_sweeps", "figure_files", "results_of"]


def results_of(path: str, settings: Settings) -> list[SeriesResult]:
    """What a detector finds in each sensor of one log. Raises `JaxradarError` if it cannot be read, `ConfigError` if
    it has not got what is selected."""
    found = []
    for one in evaluate_each([path], settings):
        if not isinstance(one, SeriesResult):
            raise (ConfigError if one.wrong_option else JaxradarError)(one.error)
        found.append(one)
    return found


def figure_files(result: SeriesResult, folder: Path, detector: str, taken: set[str]) -> list[Path]:
    """Draw what was found into PNG files whose names are not among those `taken`; returns where they are."""
    # Logs of different drives often share a name; the folder above tells them apart, in the title too.
    label = _name(result.path)
    if f"{label}-sensor{result.sensor}" in taken:
        label = f"{Path(result.path).resolve().parent.name}-{label}"
    stem = name = f"{label}-sensor{result.sensor}"
    number = 1
    while name in taken:
        number += 1
        name = f"{stem}-{number}"
    taken.add(name)
    written = []
    if result.sweeps:
        written.append(draw_drive(result, folder / f"{name}.png", detector, label))
    if not _drawn(result).series.invalid.all():
        written.append(draw_sweeps(result, folder / f"{name}-sweeps.png", label))
    return written


def draw_drive(result: SeriesResult, path: Path, detector: str, label: str | None = None) -> Path:
    """The drive over time with the detections, under the log's name if it has no other `label`; returns `path`."""
    from jaxradar.plots import plot_drive, save

    drawn = _drawn(result)
    figure = plot_drive(
        drawn.series,
        drawn.trace,
        motion=drawn.drive.motion,
        matching=drawn.matching,
        source=f"{shown(label or _name(result.path))}, sensor {result.sensor}, detector {detector}",
    )
    save(figure, path)
    return path


def draw_sweeps(result: SeriesResult, path: Path, label: str | None = None) -> Path:
    """The sweeps laid over each other, labelled likewise; returns `path`."""
    from jaxradar.plots import plot_sweeps, save

    drawn = _drawn(result)
    source = f"{shown(label or _name(result.path))}, sensor {result.sensor}"
    save(plot_sweeps(drawn.series, drawn.trace, source=source), path)
    return path


def _drawn(result: SeriesResult) -> Drawn:
    if result.drawn is None:
        raise ValueError("a figure needs `Settings(figures=True)`.")
    return result.drawn


def _name(path: str) -> str:
    log = Path(path).resolve()
    # A folder of CSV files may have a dot in its name: only what is a file's or a drive's ending is taken off.
    return log.stem if log.is_file() or log.suffix == ".drive" else log.name
