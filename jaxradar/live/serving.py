"""A run as a service of systemd's."""

from __future__ import annotations

from jaxradar.live.board import Fault, in_words
from jaxradar.live.detect import LiveDecision
from jaxradar.live.run import Listener, Moment
from jaxradar.live.sweeps import LiveSweep
from jaxradar.live.systemd import Notifier
from jaxradar.live.tally import Tally

__all__ = ["Serving"]


class Serving(Listener):
    """Says to systemd that it is ready with the first sweep, alive as long as the loop goes round, and ending."""

    def __init__(self) -> None:
        self._notifier = Notifier()
        self._sweeps = self._events = 0

    def hear(self, live: LiveSweep, decision: LiveDecision, moment: Moment) -> None:
        self._events += decision.event
        if not self._sweeps:
            self._notifier.ready("sweeps are coming")
        self._sweeps += 1
        self._alive(moment.faults)

    def idle(self, moment: Moment) -> None:
        self._alive(moment.faults)

    def end(self, tally: Tally) -> None:
        self._notifier.stopping()

    def _alive(self, faults: Fault) -> None:
        self._notifier.alive(lambda: f"{self._sweeps} sweeps, {self._events} detections; {in_words(faults)}")
