"""What the suspension's board is told each period, and when it is safe to tell of a step."""

from __future__ import annotations

import enum
import math
from typing import NamedTuple

from jaxradar.units import NANOSECONDS

__all__ = ["HOLD_S", "Alarm", "Fault", "Told", "in_words", "names", "unsure"]

HOLD_S = 0.1  # of a detection whose impact is not foreseen; the thesis saw a step 50 ms before the wheel met it


class Fault(enum.IntFlag):
    """What is wrong. All but `RECORDER` make what is known of the road unsure: then the board is told of no step."""

    SENSOR_SILENT = 1  # no sweep within a period and a half
    SENSOR_LOST = 2  # the source has failed, and is being opened again
    NO_DATA = 4  # the sweep holds nothing that can be used
    WRONG_LENGTH = 8  # the sweep has another number of bins than the detector
    LATE = 16  # the decision came more than a period after the sweep
    RECORDER = 32  # sweeps are not being recorded
    STOPPING = 64  # the program ends


_WORDS = {
    Fault.SENSOR_SILENT: "no sweeps",
    Fault.SENSOR_LOST: "sensor lost",
    Fault.NO_DATA: "no data",
    Fault.WRONG_LENGTH: "sweeps of a wrong length",
    Fault.LATE: "late",
    Fault.RECORDER: "not recording",
    Fault.STOPPING: "stopping",
}


def unsure(faults: Fault) -> bool:
    """Whether the board is to be told of no step."""
    return bool(faults & ~Fault.RECORDER)


def names(faults: Fault) -> list[str]:
    """For machines: those of `Fault`, in lower case."""
    return [one.name.lower() for one in Fault if one in faults and one.name]


def in_words(faults: Fault) -> str:
    """For people."""
    return ", ".join(words for fault, words in _WORDS.items() if fault in faults) or "all well"


class Told(NamedTuple):
    """One period's message.

    - `event`: whether a step is coming: from its detection until its impact, or for as long as it is held.
    - `number`: of the detection, counted from 1; 0 before the first.
    - `impact_in_s`: until a front wheel meets it, None where that is not known, is over, or nothing is coming.
    - `height_m`: of the step, None where it is not known; no detector tells it yet.
    - `faults`: of `Fault`.
    """

    event: bool = False
    number: int = 0
    impact_in_s: float | None = None
    height_m: float | None = None
    faults: Fault = Fault(0)


class Alarm:
    """Holds a detection until its impact.

    `hold_s`: for so long instead; None: until the impact that the detector foresaw, `HOLD_S` where it foresaw none.
    """

    def __init__(self, hold_s: float | None = None) -> None:
        self._hold_s = hold_s
        self._since_ns = 0
        self._until_ns: int | None = None
        self._impact_ns: int | None = None
        self._number = 0

    def detected(self, time_ns: int, impact_in_s: float) -> None:
        """A detection at `time_ns`; an `impact_in_s` of 0 is not known."""
        foreseen = 0 < impact_in_s < math.inf
        lasts_s = self._hold_s if self._hold_s is not None else impact_in_s if foreseen else HOLD_S
        if self._was_reset(time_ns):
            self._until_ns = None
        self._since_ns = time_ns
        until_ns = time_ns + round(lasts_s * NANOSECONDS)
        self._until_ns = max(until_ns, self._until_ns or until_ns)
        self._impact_ns = time_ns + round(impact_in_s * NANOSECONDS) if foreseen else None
        self._number = self._number % 0xFFFF + 1

    def at(self, time_ns: int, faults: Fault) -> Told:
        """What the board is told at `time_ns`, on the clock of the detections."""
        if self._until_ns is not None and (self._was_reset(time_ns) or time_ns >= self._until_ns):
            self._until_ns = self._impact_ns = None
        if self._until_ns is None or unsure(faults):
            return Told(number=self._number, faults=faults)
        # Of an impact that is over while the step is still held nothing is said: to a board 0 s are an end.
        left_ns = 0 if self._impact_ns is None else self._impact_ns - time_ns
        left_s = left_ns / NANOSECONDS if left_ns > 0 else None
        return Told(True, self._number, left_s, None, faults)

    def _was_reset(self, time_ns: int) -> bool:
        """Whether a recording's clock was set back since the last detection: its end may then be hours away."""
        return time_ns < self._since_ns - NANOSECONDS
