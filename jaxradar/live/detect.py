"""Sweep by sweep through a compiled detector, each sensor with a state of its own."""

from __future__ import annotations

from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from jaxradar.drive import SweepFlag
from jaxradar.live.artefact import DECISION, Header
from jaxradar.live.sweeps import LiveSweep
from jaxradar.units import NANOSECONDS

__all__ = ["LiveDecision", "LiveDetector", "Step"]


@runtime_checkable
class Step(Protocol):
    """A one-sweep program with a state, as `jaxradar.live.program.Program` is one."""

    @property
    def inputs(self) -> np.ndarray:
        """(inputs,) what the next `run` reads; to be written in place."""
        ...

    def run(self) -> np.ndarray:
        """(decision,) what it makes of them; the state goes on."""
        ...

    def another(self) -> Step:
        """The same from its first state on, for another sensor."""
        ...


class LiveDecision(NamedTuple):
    """What the detector says of one sweep, under the names of `jaxradar.Decision`.

    `place`: which sweep of its sensor it is, from 0 on; `time_ns`: as the source stamped it.
    """

    sensor: int
    place: int
    time_ns: int
    range_m: float
    speed_m_s: float
    strength: float
    statistic: float
    impact_in_s: float
    valid: bool
    saturated: bool
    event: bool


class LiveDetector:
    """A compiled detector over the sweeps of any number of sensors.

    Raises `ValueError` for a header whose decisions have other fields.
    """

    def __init__(self, header: Header, step: Step) -> None:
        if header.decision != DECISION:
            raise ValueError(f"expected decisions of {', '.join(DECISION)}; got {', '.join(header.decision)}.")
        self.header = header
        self._first = step
        self._sensors: dict[int, _Sensor] = {}
        self.misfits = 0  # sweeps of a wrong length so far

    def take(self, live: LiveSweep) -> LiveDecision:
        """Decide on one sweep. One of a wrong length counts as one without amplitudes."""
        held = self._sensors.get(live.sensor)
        if held is None:
            step = self._first.another() if self._sensors else self._first
            held = self._sensors[live.sensor] = _Sensor(step, live.time_ns)
        bins, flags = self.header.bins, live.flags
        inputs = held.step.inputs
        if live.sweep.shape == (bins,):
            inputs[:bins] = live.sweep
        else:
            self.misfits += 1
            inputs[:bins] = 0
            flags |= SweepFlag.NO_AMPLITUDES
        inputs[bins] = flags
        if self.header.motion:
            inputs[bins + 2 :] = live.motion or 0.0
        # Differenced as integers: what is left is small enough for any precision.
        inputs[bins + 1] = (live.time_ns - held.before_ns) / NANOSECONDS
        held.before_ns = live.time_ns
        numbers = held.step.run().tolist()
        place, held.place = held.place, held.place + 1
        flags_out = [number > 0 for number in numbers[5:]]
        return LiveDecision(live.sensor, place, live.time_ns, *numbers[:5], *flags_out)


class _Sensor:
    def __init__(self, step: Step, first_ns: int) -> None:
        self.step, self.before_ns, self.place = step, first_ns, 0
