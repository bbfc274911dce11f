"""Series of any length through one compiled program: lanes side by side that take the next series when one ends.

A *chunk* holds some sweeps of each lane; a state for each lane goes from chunk to chunk. A series begins at the start
of a chunk, where its lane's state is made anew, and ends somewhere in one; only the rest of that one is padding. So
one program serves series of every length, what is held in memory does not grow with their number, nor with their length
but by their times and by what is given out of each sweep, and what a series comes to does not depend on which others
went along.
"""

from __future__ import annotations

import contextlib
import dataclasses
import queue
import threading
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from jaxradar._machine import allow_open_files, cores
from jaxradar._numerics import compiled
from jaxradar.drive import Motion, SensorSeries
from jaxradar.drivefile.layout import is_mapped
from jaxradar.systems.step.blocks import advance, check_fields, initial
from jaxradar.systems.step.config import Decision, MotionSample, RangeAxis, StepDetector
from jaxradar.systems.step.motion import motion_at, no_motion, put_motion
from jaxradar.systems.step.pipeline import as_program, precision, time_steps
from jaxradar.systems.step.stack import aligned

__all__ = ["detect_series"]

# Sweeps in a chunk, enough that a program's work outweighs its call, and lanes: those that go through time one by one
# want a register's width of them, many times over. Measured by `benches/run.py store`.
LANES_BY_TIME, CHUNK_SWEEPS_BY_TIME = 64, 65536
LANES_BY_LOGS, CHUNK_SWEEPS_BY_LOGS = 16, 32768
LANES_ON_ACCELERATOR, CHUNK_SWEEPS_ON_ACCELERATOR = 1024, 65536
MOST_CHUNK_BYTES = 32 << 20
FEWER_LANES = 8  # where so many stay empty, there are fewer by this factor
LOOK_AHEAD = 128  # series that wait, among which those of one range axis are picked
LOOK_AHEAD_BYTES = 128 << 20  # of what of them lies in memory
LONGEST_WAIT = 512  # series that may be read and given out before one that waits has its turn
MOST_RESULTS = 64  # that wait to be fetched
OTHER_FILES = 256  # that a process may have open beside the series

Fields = tuple[str, ...]


def detect_series(
    detector: StepDetector[Any, Any],
    series: Iterable[SensorSeries | tuple[SensorSeries, Motion]],
    fields: Fields = ("range_m", "speed_m_s", "valid", "event"),
) -> Iterator[tuple[int, dict[str, np.ndarray]]]:
    """Those `fields` of the `Decision`s on each series, each (sweeps,), with the place of the series among all.
    A series may come with the motion of its drive, for a detector that uses it.

    They come in the order in which they end, which is not that of the series. Series of one range axis share lanes,
    so a mixture is gone through axis by axis as far as the look-ahead reaches; what lies in memory maps is read as it
    is needed, and its file is open until then. On a CPU a thread for each core goes through its own lanes if the
    detector is `sequential`; otherwise, and on accelerators, each local device has one. The results are those of
    `detect`, and the same whichever series go along (of `range-rate` to the last digits of the time across a gap).

    Raises `ConfigError` for an unknown field, and what reading `series` raises, once all that was read is given out.
    """
    check_fields(fields)
    feed = _Feed(series)
    done: queue.Queue[Any] = queue.Queue(maxsize=MOST_RESULTS)
    devices = _devices(detector)
    # A file that is mapped into memory is an open one.
    lanes = LANES_BY_TIME if devices[0].platform == "cpu" else LANES_ON_ACCELERATOR
    allow_open_files(LOOK_AHEAD + MOST_RESULTS + LONGEST_WAIT + lanes * len(devices) + OTHER_FILES)
    workers = [_Lanes(detector, tuple(fields), device, feed, done) for device in devices]
    threads = [threading.Thread(target=worker.run, daemon=True) for worker in workers]
    for thread in threads:
        thread.start()
    try:
        working = len(threads)
        while working:
            item = done.get()
            if item is None:
                working -= 1
            elif isinstance(item, BaseException):
                raise item
            else:
                yield item
        if feed.error is not None:
            raise feed.error
    finally:
        feed.stop()
        while any(thread.is_alive() for thread in threads):
            with contextlib.suppress(queue.Empty):  # who waits to hand in a result ends after that
                done.get(timeout=0.05)


def _devices(detector: StepDetector[Any, Any]) -> list[jax.Device]:
    """One for each thread."""
    devices = jax.local_devices()
    if len(devices) > 1 or devices[0].platform != "cpu":
        return devices
    return devices * (cores() if detector.sequential else 1)


class _Waiting(NamedTuple):
    """A series to come, with its place among all and the motion of its drive."""

    place: int
    series: SensorSeries
    motion: Motion


class _Feed:
    """The series to come, each with its place, picked by their range axis."""

    def __init__(self, series: Iterable[SensorSeries | tuple[SensorSeries, Motion]]) -> None:
        self._source = enumerate(one if isinstance(one, tuple) else (one, Motion()) for one in series)
        self._waiting: dict[Any, list[_Waiting]] = {}
        self._count = self._bytes = self._read = 0
        self._lock = threading.Lock()
        self._ended = self.stopped = False
        self.error: BaseException | None = None

    def stop(self) -> None:
        """Nobody gets any more, and what is under way is left."""
        self._ended = self.stopped = True
        with self._lock:
            self._waiting.clear()

    def take(self, axis: Any) -> tuple[Any, _Waiting] | None:
        """The next with this axis; with None the next of the axis of who waits longest. None if there is none, or if
        another axis has waited too long."""
        with self._lock:
            self._look_ahead()
            if self._waiting:
                longest = min(self._waiting, key=lambda one: self._waiting[one][0].place)
                if axis is None:
                    axis = longest
                elif axis != longest and self._read - self._waiting[longest][0].place > LONGEST_WAIT:
                    return None
            held = self._waiting.get(axis)
            if not held:
                return None
            one = held.pop(0)
            if not held:
                del self._waiting[axis]
            self._count -= 1
            self._bytes -= _bytes_in_memory(one.series)
            return axis, one

    def waiting(self, axis: Any) -> int:
        """How many with this axis are known to come."""
        with self._lock:
            return len(self._waiting.get(axis, ()))

    def _look_ahead(self) -> None:
        while not self._ended and self._count < LOOK_AHEAD and self._bytes < LOOK_AHEAD_BYTES:
            try:
                item = next(self._source, None)
            except BaseException as error:
                self.error, item = error, None
            if item is None:
                self._ended = True
                return
            place, (series, motion) = item
            axis = (series.sweeps.dtype.str, series.range_m.tobytes())
            self._waiting.setdefault(axis, []).append(_Waiting(place, series, motion))
            self._count += 1
            self._read += 1
            self._bytes += _bytes_in_memory(series)


def _bytes_in_memory(series: SensorSeries) -> int:
    sweeps = 0 if is_mapped(series.sweeps) else int(series.sweeps.nbytes)
    return sweeps + int(series.times_ns.nbytes) + int(series.flags.nbytes)


@dataclasses.dataclass
class _Lane:
    """A series on its way: how far it was read, and what was found so far."""

    place: int
    series: SensorSeries
    dt: np.ndarray
    motion: MotionSample | None
    found: dict[str, np.ndarray]
    read: int = 0


# A lane's share of a chunk: which lane, the series on it, the first of its sweeps there and their number.
Share = tuple[int, _Lane, int, int]


class _Chunk:
    """The arrays of one chunk, read by the program where they lie."""

    def __init__(self, lanes: int, sweeps: int, bins: int, dtype: np.dtype, moves: bool) -> None:
        self.sweeps = aligned((lanes, sweeps, bins), dtype)
        self.flags = aligned((lanes, sweeps), np.dtype(np.uint16))
        self.dt = aligned((lanes, sweeps), np.dtype(np.float64))
        self.lengths = np.zeros(lanes, np.int32)
        self.fresh = np.zeros(lanes, bool)
        self.motion = no_motion((lanes, sweeps)) if moves else None
        self.shares: list[Share] = []


class _Lanes:
    """One thread's lanes: fills a chunk while the one before is computed."""

    def __init__(
        self,
        detector: StepDetector[Any, Any],
        fields: Fields,
        device: jax.Device,
        feed: _Feed,
        done: queue.Queue[Any],
    ) -> None:
        self.detector, self.fields, self.device, self.feed, self.done = detector, fields, device, feed, done

    def run(self) -> None:
        try:
            double = self.detector.float64 or jax.config.jax_enable_x64  # type: ignore[attr-defined]
            with jax.enable_x64(double), precision(self.detector), jax.default_device(self.device):
                while (first := self.feed.take(None)) is not None:
                    self._one_axis(first)
            self.done.put(None)
        except BaseException as error:  # handed to who waits for the results
            self.done.put(error)

    def _one_axis(self, first: tuple[Any, _Waiting]) -> None:
        """All series of one range axis, until none of it waits any more."""
        key, series = first[0], first[1].series
        axis = RangeAxis.of(series.range_m)
        row_bytes = axis.bins * series.sweeps.dtype.itemsize
        lanes, sweeps = _chunk_shape(self.detector, row_bytes, self.device.platform, 1 + self.feed.waiting(key))
        moves = self.detector.uses_motion
        chunks = [_Chunk(lanes, sweeps, axis.bins, series.sweeps.dtype, moves) for _ in range(2)]
        state = _start(self.detector, axis, lanes)
        held: list[_Lane | None] = [None] * lanes
        next_one: tuple[Any, _Waiting] | None = first
        running: tuple[_Chunk, dict[str, Any]] | None = None
        turn = 0
        while True:
            chunk = chunks[turn % 2]
            for lane in range(lanes):
                while held[lane] is None:
                    taken = next_one if next_one is not None else self.feed.take(key)
                    next_one = None
                    if taken is None:
                        break
                    held[lane] = self._begin(taken[1])
            self._fill(chunk, held, sweeps)
            if chunk.shares:
                inputs = (chunk.fresh, chunk.sweeps, chunk.flags, chunk.dt, chunk.lengths, chunk.motion)
                with contextlib.nullcontext() if turn else _first_call:
                    state, found = _advance(self.fields, self.detector, axis, state, *inputs)
            if running is not None:
                self._collect(*running)
            if not chunk.shares or self.feed.stopped:
                return
            running = (chunk, found)
            turn += 1

    def _begin(self, waiting: _Waiting) -> _Lane | None:
        place, series, motion = waiting
        if not len(series):
            kind = {name: bool if name in _FLAGS else jnp.result_type(float) for name in self.fields}
            self.done.put((place, {name: np.empty(0, dtype) for name, dtype in kind.items()}))
            return None
        moved = motion_at(motion, series.times_ns) if self.detector.uses_motion else None
        return _Lane(place, series, time_steps(series.times_ns), moved, {})

    @staticmethod
    def _fill(chunk: _Chunk, held: list[_Lane | None], sweeps: int) -> None:
        chunk.shares = []
        chunk.lengths[:] = 0
        chunk.fresh[:] = False
        for at, lane in enumerate(held):
            if lane is None:
                continue
            part = slice(lane.read, min(lane.read + sweeps, len(lane.series)))
            count = part.stop - part.start
            chunk.sweeps[at, :count] = lane.series.sweeps[part]
            chunk.flags[at, :count] = lane.series.flags[part]
            chunk.dt[at, :count] = lane.dt[part]
            if chunk.motion is not None and lane.motion is not None:
                put_motion(chunk.motion, at, lane.motion, lane.read, count)
            chunk.lengths[at] = count
            chunk.fresh[at] = lane.read == 0
            chunk.shares.append((at, lane, lane.read, count))
            lane.read = part.stop
            if lane.read == len(lane.series):
                held[at] = None

    def _collect(self, chunk: _Chunk, found: Mapping[str, Any]) -> None:
        host = {name: np.asarray(values) for name, values in found.items()}
        for at, lane, first, count in chunk.shares:
            if not first:
                lane.found = {name: np.empty(len(lane.series), values.dtype) for name, values in host.items()}
            for name, values in host.items():
                lane.found[name][first : first + count] = values[at, :count]
            if first + count == len(lane.series):
                self.done.put((lane.place, lane.found))


_FLAGS = ("valid", "saturated", "event")
# Two threads would compile the same program side by side.
_first_call = threading.Lock()


def _chunk_shape(detector: StepDetector[Any, Any], sweep_bytes: int, platform: str, waiting: int) -> tuple[int, int]:
    """Lanes, and sweeps of each, for so many series; of few shapes, each of which is compiled."""
    lanes, sweeps = LANES_BY_LOGS, CHUNK_SWEEPS_BY_LOGS
    if platform != "cpu":
        lanes, sweeps = LANES_ON_ACCELERATOR, CHUNK_SWEEPS_ON_ACCELERATOR
    elif detector.sequential:
        lanes, sweeps = LANES_BY_TIME, CHUNK_SWEEPS_BY_TIME
    each = max(16, min(sweeps, MOST_CHUNK_BYTES // sweep_bytes) // lanes)
    while lanes >= 2 * FEWER_LANES * waiting:
        lanes //= FEWER_LANES
    return lanes, each


def _start(detector: StepDetector[Any, Any], axis: RangeAxis, lanes: int) -> Any:
    return jax.tree.map(lambda leaf: jnp.array(leaf), initial(detector, axis, lanes))


def _advance_fields(fields: Fields, detector: StepDetector[Any, Any], axis: RangeAxis, state: Any, *inputs: Any) -> Any:
    fresh, sweeps, flags, dt, lengths, motion = inputs

    def pick(decisions: Decision) -> dict[str, Any]:
        return {name: getattr(decisions, name) for name in fields}

    anew = initial(detector, axis, len(fresh))
    state = jax.tree.map(lambda new, old: jnp.where(fresh.reshape(-1, *[1] * (old.ndim - 1)), new, old), anew, state)
    dt, motion = jax.tree.map(as_program, (dt, motion))
    return advance(detector, axis, pick, state, sweeps, flags, dt, lengths, motion=motion)


_advance = compiled(_advance_fields, static_argnums=0)
