"""Which part of a log is looked at, and how."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from jaxradar._errors import ConfigError
from jaxradar.drive import Drive, SensorSeries
from jaxradar.matching import MatchWindow
from jaxradar.systems.step import StepDetector, thin

__all__ = ["Part", "Selection", "Settings"]


@dataclass(frozen=True, eq=False)
class Part:
    """A part of one sensor's series; `first` and `places` say where its sweeps stand in the whole.

    `places` is None where they follow each other from `first` on.
    """

    series: SensorSeries
    first: int = 0
    places: np.ndarray | None = None

    def place(self, sweeps: np.ndarray) -> np.ndarray:
        """The indices in the whole log of sweeps of this part."""
        return sweeps + self.first if self.places is None else self.places[sweeps]


@dataclass(frozen=True)
class Selection:
    """The part of each log that is looked at: sensor number (all if None), seconds since the first sweep, bins."""

    sensor: int | None = None
    start_s: float | None = None
    stop_s: float | None = None
    bins: int | None = None

    def of(self, path: str, drive: Drive) -> Iterator[Part]:
        """The parts of a drive. Raises `ConfigError`, which names the log, if it has not got what is selected."""
        for series in self._sensors(path, drive):
            part = self._cut(path, series)
            if self.bins is not None:
                try:
                    part = replace(part, series=thin(part.series, self.bins))
                except ConfigError as error:
                    raise ConfigError(f"{path}: {error}") from None
            yield part

    def _sensors(self, path: str, drive: Drive) -> tuple[SensorSeries, ...]:
        if self.sensor is None:
            return drive.sensors
        try:
            return (drive.series(self.sensor),)
        except KeyError:
            held = ", ".join(str(series.sensor) for series in drive.sensors) or "none"
            raise ConfigError(f"{path}: has no sensor {self.sensor}; its sensors: {held}.") from None

    def _cut(self, path: str, series: SensorSeries) -> Part:
        if self.start_s is None and self.stop_s is None:
            return Part(series)
        times_s = series.times_s
        inside = np.ones(len(series), bool)
        if self.start_s is not None:
            inside &= times_s >= self.start_s
        if self.stop_s is not None:
            inside &= times_s <= self.stop_s
        if not inside.any():
            if not len(series):
                return Part(series)
            raise ConfigError(
                f"{path}: sensor {series.sensor} has no sweep in the part asked for; "
                f"its sweeps lie between {times_s.min():.3f} and {times_s.max():.3f} s."
            )
        places = np.flatnonzero(inside)
        first, together = int(places[0]), places[-1] + 1 - places[0] == len(places)
        # A slice of a memory map reads nothing; times that go back may leave the part in pieces.
        kept = slice(first, first + len(places)) if together else places
        cut = replace(series, times_ns=series.times_ns[kept], sweeps=series.sweeps[kept], flags=series.flags[kept])
        return Part(cut, first, None if together else places)


@dataclass(frozen=True)
class Settings:
    """What is done with each log. `pictures`: with a `Picture` of each series; `figures`: with all that a figure is
    drawn of, which is as large as the logs themselves."""

    detector: StepDetector[Any, Any]
    selection: Selection = field(default_factory=Selection)
    window: MatchWindow = field(default_factory=MatchWindow)
    pictures: bool = False
    figures: bool = False
