"""Detections held against the truth: what was hit, missed and raised for nothing, and how long before the impact.

The rule. A detection *may hit* a step if 0 <= impact − time <= window, both ends included, where window is the longer
of 0.25 s and the time that the car takes for 1 m at its speed at the impact (0.25 s alone where that speed is
unknown). Steps are gone through in the order of their impacts; each takes the earliest detection of its window that no
earlier step took, which is its *hit* and gives its *lead* (impact − time). A step that finds none is a *miss*. A
detection that is in some window and no hit counts as nothing; one that is in no window is a *false alarm*. So one
detection hits at most one step, and where windows overlap no other assignment would hit more steps.

Times are compared in whole nanoseconds, as they are recorded: 0.55 − 0.3 is 0.25 and not 0.25000000000000006.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np

from jaxradar.drive import Channel, RoadStep
from jaxradar.units import NANOSECONDS

__all__ = ["Counted", "MatchWindow", "Matching", "Score", "Summary", "match_steps", "speed_at", "summarise"]


@dataclass(frozen=True)
class MatchWindow:
    """How long before an impact a detection may come and still be meant for it: the longer of `seconds` and the time
    for `metres` of road. Raises `ValueError` unless both are finite and at least 0."""

    seconds: float = 0.25
    metres: float = 1.0

    def __post_init__(self) -> None:
        for name, value in (("seconds", self.seconds), ("metres", self.metres)):
            if not (math.isfinite(value) and value >= 0):
                raise ValueError(f"`MatchWindow({name}=...)` must be finite and >= 0; got {value}.")

    def before(self, speed_m_s: float | None) -> float:
        """The window in seconds at a speed in m/s. A speed that is None, or not above 0, counts as unknown: a car that
        stands meets no step, whatever its speed channel says."""
        if speed_m_s is None or not speed_m_s > 0:
            return self.seconds
        return max(self.seconds, self.metres / speed_m_s)


class _Hits:
    """What steps and leads come to."""

    steps: tuple[RoadStep, ...]
    lead_s: Any

    @property
    def hits(self) -> int:
        """Steps that were seen before the impact."""
        return len(self.lead_s)

    @property
    def misses(self) -> int:
        """Steps that were not."""
        return len(self.steps) - len(self.lead_s)


@dataclass(frozen=True, eq=False)
class Matching(_Hits):
    """The outcome for one series.

    - `steps`: the steps that count, in order of `impact_s`.
    - `hit_by`: for each of them the index of the detection that hit it, None for a miss.
    - `lead_s`: impact − time of each hit in seconds, in the order of the steps.
    - `false`: (false alarms,) int64, their indices, in the order of the detections.
    """

    steps: tuple[RoadStep, ...] = ()
    hit_by: tuple[int | None, ...] = ()
    lead_s: tuple[float, ...] = ()
    false: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))

    @property
    def false_alarms(self) -> int:
        """Detections in no step's window."""
        return len(self.false)


def speed_at(speed: Channel | None, time_s: float) -> float | None:
    """Speed in m/s at a time in seconds, linear between the samples that are numbers; None where there is no channel
    and outside the time that it covers."""
    if speed is None:
        return None
    finite = np.isfinite(speed.values)
    times, values = speed.times_s[finite], speed.values[finite]
    if not times.size or not times.min() <= time_s <= times.max():
        return None
    order = np.argsort(times, kind="stable")
    return float(np.interp(time_s, times[order], values[order]))


def match_steps(
    detections_s: Sequence[float] | np.ndarray,
    steps: Iterable[RoadStep],
    *,
    window: MatchWindow | None = None,
    speed: Channel | None = None,
    start_s: float | None = None,
    stop_s: float | None = None,
) -> Matching:
    """Match detections with the steps of a drive by the rule of this module.

    - `detections_s`: (n,) times in seconds since the first sweep of the drive, in any order.
    - `steps`: all steps of the drive; none is knowledge too.
    - `window`: `MatchWindow()` if None. `speed`: the car's speed over time in m/s, if it was recorded.
    - `start_s`, `stop_s`: the part that was looked at. A step outside is left out; a detection in its window alone
      counts as nothing, because it was right to come.

    Raises `ValueError` for a time that is not finite.
    """
    window = MatchWindow() if window is None else window
    times = _nanoseconds(detections_s, "detections_s")
    order = np.argsort(times, kind="stable")
    waiting = np.ones(len(times), bool)
    excused = np.zeros(len(times), bool)
    hit_by: list[int | None] = []
    counted: list[RoadStep] = []
    lead_s: list[float] = []
    for step in sorted(steps, key=lambda step: step.impact_s):
        impact = int(_nanoseconds([step.impact_s], "steps")[0])
        # A car that crawls has a window of hours; beyond a year no clock of a drive goes.
        reach = round(min(window.before(speed_at(speed, step.impact_s)), 3.2e7) * NANOSECONDS)
        inside = waiting & (times <= impact) & (impact - times <= reach)
        excused |= inside
        if (start_s is not None and step.impact_s < start_s) or (stop_s is not None and step.impact_s > stop_s):
            continue
        counted.append(step)
        earliest = next(iter(order[inside[order]].tolist()), None)
        hit_by.append(earliest)
        if earliest is not None:
            waiting[earliest] = False
            lead_s.append((impact - int(times[earliest])) / NANOSECONDS)
    return Matching(tuple(counted), tuple(hit_by), tuple(lead_s), np.flatnonzero(~excused))


def _nanoseconds(times_s: Sequence[float] | np.ndarray, name: str) -> np.ndarray:
    given = np.asarray(times_s, np.float64)
    with np.errstate(over="ignore"):
        scaled = given * NANOSECONDS
    if not np.isfinite(scaled).all():
        wrong = given[~np.isfinite(scaled)][0]
        raise ValueError(f"`match_steps({name}=...)` must hold finite times; got {wrong}.")
    # No further than differences of int64 reach, which is 146 years.
    return np.rint(np.clip(scaled, -4.6e18, 4.6e18)).astype(np.int64)


@runtime_checkable
class Counted(Protocol):
    """A `Matching`, or what of it is counted."""

    @property
    def hits(self) -> int: ...

    @property
    def misses(self) -> int: ...

    @property
    def false_alarms(self) -> int: ...

    @property
    def lead_s(self) -> tuple[float, ...]: ...


@dataclass(frozen=True)
class Score(_Hits):
    """What is kept of a `Matching`.

    - `steps`: the steps that count, in order of `impact_s`.
    - `leads_s`: of each of them how long before the impact it was seen, in seconds; None for a miss.
    - `false_alarms`: how many.
    """

    steps: tuple[RoadStep, ...] = ()
    leads_s: tuple[float | None, ...] = ()
    false_alarms: int = 0

    @classmethod
    def of(cls, matching: Matching) -> Score:
        leads = iter(matching.lead_s)
        return cls(
            matching.steps,
            tuple(None if place is None else next(leads) for place in matching.hit_by),
            matching.false_alarms,
        )

    @property
    def lead_s(self) -> tuple[float, ...]:
        """Of the hits alone."""
        return tuple(lead for lead in self.leads_s if lead is not None)


@dataclass(frozen=True)
class Summary:
    """Many series together: only those whose truth is known. `duration_s` is the time that they cover."""

    series: int = 0
    duration_s: float = 0.0
    hits: int = 0
    misses: int = 0
    false_alarms: int = 0
    lead_s: tuple[float, ...] = field(default=())

    @property
    def detection_rate(self) -> float | None:
        """Share of the steps that were seen; None if there was no step."""
        steps = self.hits + self.misses
        return self.hits / steps if steps else None

    @property
    def false_alarms_per_hour(self) -> float | None:
        """None if the series cover no time."""
        return self.false_alarms * 3600 / self.duration_s if self.duration_s > 0 else None

    @property
    def median_lead_s(self) -> float | None:
        """None if nothing was hit."""
        return float(np.median(self.lead_s)) if self.lead_s else None


def summarise(outcomes: Iterable[tuple[Counted, float]]) -> Summary:
    """Add up (matching, duration in seconds) of many series."""
    held = list(outcomes)
    return Summary(
        series=len(held),
        duration_s=sum(duration for _, duration in held),
        hits=sum(matching.hits for matching, _ in held),
        misses=sum(matching.misses for matching, _ in held),
        false_alarms=sum(matching.false_alarms for matching, _ in held),
        lead_s=tuple(lead for matching, _ in held for lead in matching.lead_s),
    )
