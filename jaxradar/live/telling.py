"""The board as a listener of a run."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from jaxradar.live.artefact import Header
from jaxradar.live.board import Alarm, Fault, Told, unsure
from jaxradar.live.detect import LiveDecision
from jaxradar.live.link import Link
from jaxradar.live.rules import DistanceRule
from jaxradar.live.run import PERIOD_S, Listener, Moment
from jaxradar.live.sweeps import LiveSweep, Source
from jaxradar.live.tally import Durations, Tally
from jaxradar.live.wires import Wire

__all__ = ["Telling"]


class Telling(Listener):
    """Tells a board once every period: at the last sweep of each moment, and in time where none comes.

    `hold_s`: as of `Alarm`. `rule`: makes of the source what is told instead of detections. `accelerated`: hears of
    time (ns, on the sweeps' clock) and value (m/s²) of each acceleration that the board tells. `say`: takes a sentence
    when the board goes, comes back, or says nothing.
    """

    def __init__(
        self,
        port: str,
        wire: Wire,
        *,
        rule: Callable[[Source], DistanceRule] | None = None,
        hold_s: float | None = None,
        accelerated: Callable[[int, float], None] = lambda time_ns, value: None,
        say: Callable[[str], None] = lambda sentence: None,
    ) -> None:
        self._say, self._state = say, "board there"
        self._port, self._wire, self._rule_of = port, wire, rule
        self._alarm = Alarm(hold_s)
        self._accelerated = accelerated
        self._faults = Fault(0)
        self._took = Durations()  # from when a sweep came to when the board was told
        self._rule: DistanceRule | None = None
        self._link: Link | None = None
        self._last = Told()  # that was said

    def state(self) -> str:
        """In two words, for people."""
        if self._link is None or not self._link.is_open:
            return "board away"
        return "board silent" if self._link.is_silent else "board there"

    def begin(self, source: Source, header: Header, problems: Sequence[str]) -> None:
        if self._rule_of is not None:
            self._rule = self._rule_of(source)
        self._link = Link(self._port, self._wire, source.period_s or PERIOD_S)
        self._link.open()
        self._look()

    def hear(self, live: LiveSweep, decision: LiveDecision, moment: Moment) -> None:
        if decision.event:
            self._alarm.detected(decision.time_ns, decision.impact_in_s)
        if self._rule is not None:
            self._rule.take(live)
        self._faults |= moment.faults
        if live.last:
            self._tell(moment, self._faults)
            self._faults = Fault(0)
            self._took.add(time.monotonic_ns() - moment.came_ns)

    def idle(self, moment: Moment) -> None:
        self._tell(moment, moment.faults)

    def over(self) -> None:
        """The board is the first to know."""
        assert self._link is not None
        self._link.close(self._last._replace(event=False, impact_in_s=None, faults=Fault.STOPPING))

    def end(self, tally: Tally) -> None:
        assert self._link is not None
        self._link.close()  # where the loop did not even begin
        tally.more["board"] = self._link.counts._asdict() | {"told_after_us": self._took.record()}

    def _look(self) -> None:
        """Say how the board is, where that has changed."""
        assert self._link is not None
        before, self._state = self._state, self.state()
        if self._state != before:
            words = {
                "board away": f"{self._link.problem or self._port + ': there is no board yet'}. Trying again.",
                "board silent": f"{self._port}: the board says nothing.",
                "board there": f"{self._port}: the board is there.",
            }
            self._say(words[self._state])

    def _tell(self, moment: Moment, faults: Fault) -> None:
        assert self._link is not None
        told = self._alarm.at(moment.time_ns, faults)
        if self._rule is not None:
            told = told._replace(event=self._rule.near and not unsure(faults), impact_in_s=None)
        self._last = told
        if self.state() != self._state:
            self._look()
        heard = self._link.exchange(told)
        if heard.acceleration_m_s2 is not None:
            self._accelerated(moment.time_ns, heard.acceleration_m_s2)
