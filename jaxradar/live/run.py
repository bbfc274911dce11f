"""Sweeps in, detections out: the loop of live detection, who listens to it, and what it came to.

The loop belongs to `run`, in the thread of who calls it: it takes each sweep as it comes, has it decided on, and tells
the listeners, one after the other. It goes round every period, sweep or none, and never waits for anything else. It
ends when the source does. Whoever else wants it to end, a signal or another thread, closes the source.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

from jaxradar.drive import SweepFlag
from jaxradar.live.artefact import Header
from jaxradar.live.board import Fault
from jaxradar.live.detect import LiveDecision, LiveDetector
from jaxradar.live.feed import Came, Direct, Ended, Feed, Lost
from jaxradar.live.sweeps import LiveSweep, Source
from jaxradar.live.tally import Tally
from jaxradar.units import NANOSECONDS

__all__ = ["PERIOD_S", "Listener", "Moment", "run"]

PERIOD_S = 0.1  # of a source that does not say its own
_PATIENCE = 1.5  # periods without a sweep, until it is said that none comes


class Moment(NamedTuple):
    """`came_ns`: when a sweep came, or that none came was noticed, of `time.monotonic_ns`; `time_ns`: the same on the
    clock of the sweeps; `faults`: what is wrong by then."""

    came_ns: int
    time_ns: int
    faults: Fault


class Listener:
    """Hears of a run, in the thread of its loop: what may take longer than a sweep, a disk or a serial line, goes
    through a thread of its own. What a method raises ends the run. By itself it does nothing.

    `fault`: what is wrong with it, told to all.
    """

    fault = Fault(0)

    def begin(self, source: Source, header: Header, problems: Sequence[str]) -> None:
        """Before the first sweep: the source is open and gives what the detector takes. `problems`: what is not as it
        should be all the same, a sentence each."""

    def came(self, live: LiveSweep) -> None:
        """A sweep, as soon as it has come, in the thread that waits for them; also one that is decided on too late."""

    def hear(self, live: LiveSweep, decision: LiveDecision, moment: Moment) -> None:
        """A sweep, and what the detector says of it."""

    def idle(self, moment: Moment) -> None:
        """No sweep came in time; again after each period without one."""

    def lost(self, why: str) -> None:
        """The source has failed, and is being opened again."""

    def over(self) -> None:
        """The loop has ended, well or not: heard by all that began before the source, a disk or a reader of the output
        is waited for."""

    def end(self, tally: Tally) -> None:
        """After the last sweep, also where an error ended the run. Called once for each `begin` that returned."""


def run(
    source: Source,
    detector: LiveDetector,
    listeners: Sequence[Listener] = (),
    *,
    most: int | None = None,
    again: bool = False,
    stop: Callable[[], object] = lambda: False,
) -> Tally:
    """Through the sweeps of an open source to its end, or `most` of them; returns what they came to.

    `again`: open a source that fails again, and go on. `stop`: asked every round whether to end. Raises `ConfigError`
    if the detector does not take the source's sweeps, `SourceError` when the source fails for good, and what a listener
    raises; those that have begun hear `end` in any case, the last one first.
    """
    header = detector.header
    header.check_axis(source.range_m)
    header.check_amplitudes(source.dtype)
    tally, begun_s, used_s = Tally(), time.monotonic(), time.process_time()

    def count_losses() -> None:
        tally.missed, tally.misfits = source.missed, detector.misfits
        tally.dropped, tally.reopened = feed.dropped, feed.reopened
        tally.busy = (time.process_time() - used_s) / max(time.monotonic() - begun_s, 1e-9)

    with contextlib.ExitStack() as ends:
        for listener in listeners:
            listener.begin(source, header, (*source.problems, *_blind(source, header)))
            ends.callback(listener.end, tally)

        def came(live: LiveSweep) -> None:
            for listener in listeners:
                listener.came(live)

        direct = source.waits and source.period_s is None
        feed = Direct(source, came) if direct else Feed(source, came, again=again)
        ends.callback(count_losses)  # before the listeners hear of the end
        ends.callback(feed.close)
        for listener in listeners:
            ends.callback(listener.over)
        period_ns = round((source.period_s or PERIOD_S) * NANOSECONDS)
        _loop(feed, detector, listeners, tally, period_ns, lambda: tally.sweeps == most or stop())
    return tally


def _loop(
    feed: Feed | Direct,
    detector: LiveDetector,
    listeners: Sequence[Listener],
    tally: Tally,
    period_ns: int,
    over: Callable[[], object],
) -> None:
    clock, fine = time.monotonic_ns, time.perf_counter_ns
    now_ns = clock()
    offset_ns = -now_ns  # from that clock to the one of the sweeps
    due_ns = now_ns + round(_PATIENCE * period_ns)
    lost = Fault(0)
    while not over():
        got = feed.take(max(due_ns - clock(), 0) / NANOSECONDS)
        faults = Fault(0)
        for listener in listeners:
            faults |= listener.fault
        if isinstance(got, Came):
            live, came_ns = got
            misfits, begin = detector.misfits, fine()
            decision = detector.take(live)
            tally.add(live, decision, fine() - begin)
            lost = Fault(0)
            if live.flags & SweepFlag.INVALID:
                faults |= Fault.NO_DATA
            if detector.misfits > misfits:
                faults |= Fault.WRONG_LENGTH
            if isinstance(feed, Feed) and clock() - came_ns > period_ns:
                faults |= Fault.LATE
                tally.late += 1
            offset_ns = live.time_ns - came_ns
            due_ns = came_ns + round(_PATIENCE * period_ns)
            moment = Moment(came_ns, live.time_ns, faults)
            for listener in listeners:
                listener.hear(live, decision, moment)
        elif isinstance(got, Ended):
            if got.error is not None:
                raise got.error
            return
        else:
            if isinstance(got, Lost):
                lost = Fault.SENSOR_LOST
                for listener in listeners:
                    listener.lost(got.why)
            now_ns = clock()
            tally.silent += 1
            due_ns = now_ns + period_ns
            moment = Moment(now_ns, now_ns + offset_ns, faults | lost | Fault.SENSOR_SILENT)
            for listener in listeners:
                listener.idle(moment)


def _blind(source: Source, header: Header) -> list[str]:
    if not header.motion or source.tells_motion:
        return []
    return [f"{header.detector} goes by the car's motion too, of which this source tells nothing: by the sweeps alone."]
