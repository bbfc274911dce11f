"""A recorded drive as if its sensors were measuring now."""

from __future__ import annotations

import contextlib
import heapq
import math
import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from itertools import repeat

import numpy as np

from jaxradar._errors import ConfigError
from jaxradar.drive import Drive, SensorSeries, SweepFlag
from jaxradar.live.sweeps import LiveSweep, Source
from jaxradar.motion import MOTION_FIELDS, known_motion
from jaxradar.units import NANOSECONDS

__all__ = ["Replay"]

_LONGEST_WAIT_S = 3600.0  # at a time: a 32-bit system cannot wait for more than 4.29e6 s
_RESET_NS = NANOSECONDS
_NEVER_NS = 1 << 100


class Replay(Source):
    """The sweeps of a drive, in order of recorded time over all sensors and of each sensor in the order it was
    recorded.

    - `pace`: 1 as recorded, 2 twice as fast, None as fast as they are taken. Each sweep is due at its own time after
      the first, so that waiting too long for one does not delay the next; who takes them late gets those that are due
      at once, and none is left out.
    - `sensors`: which; all if None.

    Times are handed on as recorded, also where they stand still or go back: such sweeps are due at once. Where they go
    back by more than a second a clock was set anew, and counts on from there.

    Raises `ConfigError` for a sensor that the drive has not, and for sensors whose range axes differ.
    """

    def __init__(self, drive: Drive, pace: float | None = 1.0, sensors: Sequence[int] | None = None) -> None:
        if pace is not None and not (math.isfinite(pace) and pace > 0):
            raise ConfigError(f"a drive cannot be replayed at pace {pace}; expected a number above 0, 1 as recorded.")
        self._pace = pace
        self._series = _of_one_axis(drive, sensors)
        self._motion = drive.motion
        self._bell: _Bell | None = None
        self._missed = 0

    @property
    def range_m(self) -> np.ndarray:
        """(bins,) float64 slant range in metres."""
        return self._series[0].range_m

    @property
    def dtype(self) -> np.dtype:
        """Of the amplitudes, one that holds those of all sensors."""
        return np.result_type(*(series.sweeps.dtype for series in self._series))

    @property
    def tells_motion(self) -> bool:
        """Whether any of it was recorded."""
        return self._motion.recorded

    @property
    def period_s(self) -> float | None:
        """The median as recorded, at the pace of the replay."""
        steps = np.concatenate([np.diff(series.times_ns) for series in self._series])
        steps = steps[steps > 0]
        return None if self._pace is None or not len(steps) else float(np.median(steps)) / NANOSECONDS / self._pace

    @property
    def waits(self) -> bool:
        """A recording does."""
        return True

    @property
    def sensors(self) -> tuple[int, ...]:
        """Their numbers on the connector board."""
        return tuple(series.sensor for series in self._series)

    @property
    def missed(self) -> int:
        """Sweeps handed on that carry `SweepFlag.MISSED_DATA`."""
        return self._missed

    def open(self) -> None:
        """Begin at the first sweep."""
        self._bell = _Bell()
        self._missed = 0

    def close(self) -> None:
        """Let iteration end at once, also from another thread or a signal handler."""
        if self._bell is not None:
            self._bell.ring()

    def __iter__(self) -> Iterator[LiveSweep]:
        """From the first sweep on. Raises `ValueError` unless the source is open."""
        if self._bell is None:
            raise ValueError("`Replay` must be opened before it is iterated over.")
        return self._paced(self._bell)

    def _paced(self, bell: _Bell) -> Iterator[LiveSweep]:
        start_ns, origin_ns, latest_ns = time.monotonic_ns(), None, 0
        merged = heapq.merge(*map(self._sweeps_of, self._series), key=lambda sweep: sweep.time_ns)
        for sweep in merged if len(self._series) == 1 else _marked(merged):
            if self._pace is not None:
                if origin_ns is None:
                    origin_ns = latest_ns = sweep.time_ns
                elif sweep.time_ns < latest_ns - _RESET_NS:
                    # Due when the sweep before was: from the clock now, errors would add up.
                    start_ns += _paced_ns(latest_ns - origin_ns, self._pace)
                    origin_ns = latest_ns = sweep.time_ns
                latest_ns = max(latest_ns, sweep.time_ns)
                _wait_until(bell, start_ns + _paced_ns(sweep.time_ns - origin_ns, self._pace))
            if bell.rung:
                return
            if sweep.flags & SweepFlag.MISSED_DATA:
                self._missed += 1
            yield sweep

    def _sweeps_of(self, series: SensorSeries) -> Iterator[LiveSweep]:
        moved: Iterable[Sequence[float]] = repeat(())
        if self.tells_motion:
            known = known_motion(self._motion, series.times_ns)
            moved = zip(*(known[name].tolist() for name in MOTION_FIELDS), strict=True)
        for row, motion in zip(range(len(series)), moved, strict=False):
            yield LiveSweep(
                series.sensor, int(series.times_ns[row]), series.sweeps[row], int(series.flags[row]), motion
            )


def _marked(sweeps: Iterator[LiveSweep]) -> Iterator[LiveSweep]:
    """Each that is of the same time as the one after it, of another sensor, is not the last of its moment."""
    held = next(sweeps, None)
    for sweep in sweeps:
        assert held is not None
        yield held._replace(last=held.time_ns != sweep.time_ns or held.sensor == sweep.sensor)
        held = sweep
    if held is not None:
        yield held


class _Bell:
    """Wakes who waits. A bare lock, for `threading.Event` must not be set in a signal handler: what the signal
    interrupted may hold the event's own lock."""

    def __init__(self) -> None:
        self.rung = False
        self._closed = threading.Lock()
        self._closed.acquire()

    def ring(self) -> None:
        self.rung = True
        with contextlib.suppress(RuntimeError):  # rung before
            self._closed.release()

    def wait(self, seconds: float) -> None:
        if not self.rung:
            self._closed.acquire(timeout=seconds)


def _paced_ns(recorded_ns: int, pace: float) -> int:
    took_ns = recorded_ns / pace
    return round(took_ns) if math.isfinite(took_ns) else _NEVER_NS


def _wait_until(bell: _Bell, due_ns: int) -> None:
    while not bell.rung and (left_ns := due_ns - time.monotonic_ns()) > 0:
        bell.wait(min(left_ns / NANOSECONDS, _LONGEST_WAIT_S))


def _of_one_axis(drive: Drive, sensors: Sequence[int] | None) -> tuple[SensorSeries, ...]:
    have = [series.sensor for series in drive.sensors]
    wanted = have if sensors is None else list(sensors)
    if unknown := [number for number in wanted if number not in have]:
        raise ConfigError(f"the drive has no sensor {unknown[0]}; expected some of {_listed(have) or 'none'}.")
    picked = tuple(series for series in drive.sensors if series.sensor in wanted)
    if not picked:
        raise ConfigError("the drive has no sensor to replay." if not have else "no sensor is picked to be replayed.")
    first = picked[0]
    for other in picked[1:]:
        if not np.array_equal(other.range_m, first.range_m):
            raise ConfigError(
                f"the drive's sensors {first.sensor} and {other.sensor} have different range axes "
                f"({_axis(first)} and {_axis(other)}); pick sensors of one axis, one of {_listed(have)}."
            )
    return picked


def _listed(numbers: Sequence[int]) -> str:
    return ", ".join(map(str, numbers))


def _axis(series: SensorSeries) -> str:
    return f"{len(series.range_m)} bins from {series.range_m[0]:.4g} to {series.range_m[-1]:.4g} m"
