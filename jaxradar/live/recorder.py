"""Every sweep on disk, in the package's own form, without the loop ever waiting for the disk."""

from __future__ import annotations

import contextlib
import threading
import time
from collections import deque
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxradar._errors import ConfigError, LogError
from jaxradar.drivefile import DriveWriter, SensorLayout
from jaxradar.live.sweeps import LiveSweep
from jaxradar.units import NANOSECONDS

__all__ = ["Recorded", "Recorder", "folder_for_drives"]

MOST_WAITING = 4096  # sweeps: of two sensors at 300 Hz 7 s, at 1444 bins 12 MB
ROTATE_BYTES, ROTATE_S = 1 << 30, 3600.0
FLUSH_S = 5.0  # so much is lost with the power at most
RETRY_S = 5.0  # after a disk that took nothing
_LOOK_S = 1e-3
_LATEST_S = 0.02  # until what came is written, if nobody wakes the thread
_NAMES = 1000  # drives that begin within a second


class Recorded(NamedTuple):
    """`sweeps`: taken to disk; `dropped`: not, as the disk was too slow or full; `drives`: begun; `problem`: the last
    one in words, empty while all is well."""

    sweeps: int
    dropped: int
    drives: int
    problem: str


def folder_for_drives(folder: Path) -> Path:
    """The folder, made if there is none. Raises `ConfigError` if it cannot be."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"{folder}: cannot be made a folder for drives ({error.strerror}).") from None
    return folder


class _Sample(NamedTuple):
    """An acceleration that a board has told."""

    time_ns: int
    value: float


class Recorder:
    """Writes drives into a folder, in a thread of its own.

    `take` and `take_acceleration` never wait: what does not fit the queue is dropped and counted. Nor do they wake the
    thread, which would then want the interpreter just when the sweep is decided on: `wake` does, when that is done, and
    without it what came is written `_LATEST_S` later.

    A drive is closed and the next one begun after `rotate_bytes` or `rotate_s`; its name is the UTC time at which it
    was begun, as in `2026-11-23T10-48-49Z.drive`, with a number behind it where that name is taken. After a crash at
    any byte every whole sweep before it is readable. Where the disk takes nothing the drive is closed as far as it
    came, and a new one is tried every `RETRY_S`.

    `waits`: whether `take` waits all the same, for sweeps that come as fast as they are taken. `folder`: is made if
    there is none. `sensors`: their numbers; `range_m`: (bins,) slant ranges in metres of them all; `dtype`: of the
    amplitudes; `spec`: as in `SensorSeries`.

    Raises `ConfigError` if the folder cannot be made.
    """

    def __init__(
        self,
        folder: Path,
        sensors: Sequence[int],
        range_m: np.ndarray,
        dtype: np.dtype,
        *,
        spec: Mapping[str, Any] | None = None,
        accelerations: bool = False,
        rotate_bytes: int = ROTATE_BYTES,
        rotate_s: float = ROTATE_S,
        most_waiting: int = MOST_WAITING,
        waits: bool = False,
    ) -> None:
        self._folder = folder_for_drives(folder)
        self._layouts = [SensorLayout(sensor, range_m, dtype, spec or {}) for sensor in sensors]
        self._bins = {layout.sensor: len(layout.range_m) for layout in self._layouts}
        self._dtype = np.dtype(dtype)
        self._motion = ["acceleration_m_s2"] if accelerations else []
        self._rotate_bytes, self._rotate_s, self._most, self._waits = rotate_bytes, rotate_s, most_waiting, waits
        self._queue: deque[LiveSweep | _Sample] = deque()
        self._woken = threading.Event()
        self._ended = False
        self._sweeps = self._dropped = self._lost = self._drives = 0
        self._problem = ""
        self._writer: DriveWriter | None = None
        self._bytes = 0
        self._begun_s = self._flushed_s = self._retry_s = 0.0
        self._thread = threading.Thread(target=self._work, name="recorder", daemon=True)
        self._thread.start()

    @property
    def recorded(self) -> Recorded:
        """So far."""
        return Recorded(self._sweeps, self._dropped + self._lost, self._drives, self._problem)

    def take(self, live: LiveSweep) -> None:
        """One sweep, whose amplitudes must not be changed later."""
        while self._waits and len(self._queue) >= self._most:
            time.sleep(_LOOK_S)
        if len(self._queue) >= self._most or len(live.sweep) != self._bins.get(live.sensor):
            self._dropped += 1
        else:
            self._queue.append(live)

    def take_acceleration(self, time_ns: int, value: float) -> None:
        """One vertical acceleration in m/s², at a time on the sweeps' clock."""
        if len(self._queue) < self._most:
            self._queue.append(_Sample(time_ns, value))

    def wake(self) -> None:
        """Let what came be written now."""
        self._woken.set()

    def close(self, wait_s: float = 10.0) -> None:
        """Write what waits, and seal the drive; a disk that does not take it within `wait_s` is not waited for."""
        self._ended = True
        self._woken.set()
        self._thread.join(wait_s)
        if self._thread.is_alive():
            self._problem = f"{self._folder}: the disk did not take all in {wait_s:g} s"

    def _work(self) -> None:
        ended = False
        while not ended:
            self._woken.wait(_LATEST_S)
            self._woken.clear()
            before = self._sweeps + self._lost
            ended = self._ended  # before the queue is looked at: what came before the end is written
            items = [self._queue.popleft() for _ in range(len(self._queue))]
            try:
                self._write(items)
                self._keep()
            except Exception as error:  # this thread is not to end before the run: a disk fails in more ways than known
                self._lost += sum(isinstance(one, LiveSweep) for one in items) - (self._sweeps + self._lost - before)
                self._failed(LogError(self._folder, f"cannot be written: {error!s:.200}."))
        self._seal()

    def _write(self, items: Sequence[LiveSweep | _Sample]) -> None:
        sweeps = [one for one in items if isinstance(one, LiveSweep)]
        if not sweeps and self._writer is None:
            return
        writer = self._writer or self._begun()
        if writer is None:
            self._lost += len(sweeps)
            return
        try:
            for sensor in self._bins:
                own = [one for one in sweeps if one.sensor == sensor]
                self._append(writer, sensor, own)
            samples = [one for one in items if isinstance(one, _Sample)]
            for name in self._motion if samples else ():
                writer.append_motion(name, [one.time_ns for one in samples], [one.value for one in samples])
        except LogError as error:
            self._failed(error)

    def _append(self, writer: DriveWriter, sensor: int, own: list[LiveSweep]) -> None:
        """Sweep by sweep where the disk does not take them together, so that none which it takes is lost."""
        if not own:
            return
        rows = np.stack([one.sweep for one in own]).astype(self._dtype, copy=False)
        times, flags = [one.time_ns for one in own], [one.flags for one in own]
        try:
            writer.append(sensor, times, rows, flags)
        except LogError:
            for place, row in enumerate(rows):
                try:
                    writer.append(sensor, times[place], row, flags[place])
                except LogError:
                    self._lost += len(rows) - place
                    raise
                self._sweeps += 1
            return
        self._sweeps += len(own)
        self._bytes += rows.nbytes + 16 * len(own)

    def _begun(self) -> DriveWriter | None:
        """A new drive, unless the disk was asked a moment ago."""
        now_s = time.monotonic()
        if now_s < self._retry_s:
            return None
        began_ns = time.time_ns()
        stem = datetime.fromtimestamp(began_ns / NANOSECONDS, UTC).strftime("%Y-%m-%dT%H-%M-%SZ")
        for number in range(_NAMES):
            path = self._folder / (f"{stem}-{number}.drive" if number else f"{stem}.drive")
            if path.exists():
                continue
            try:
                self._writer = DriveWriter(path, self._layouts, motion=self._motion, started_at_ns=began_ns)
            except LogError as error:
                if path.exists():  # another recorder was quicker
                    continue
                self._failed(error)
                return None
            self._drives, self._bytes = self._drives + 1, 0
            self._begun_s = self._flushed_s = now_s
            self._problem = ""
            return self._writer
        self._failed(LogError(self._folder, f"holds {_NAMES} drives that begin at {stem}"))
        return None

    def _keep(self) -> None:
        """Flush now and then, and begin the next drive when this one is large or old enough."""
        if self._writer is None:
            return
        now_s = time.monotonic()
        if self._bytes >= self._rotate_bytes or now_s - self._begun_s >= self._rotate_s:
            self._seal()
        elif now_s - self._flushed_s >= FLUSH_S:
            self._flushed_s = now_s
            try:
                self._writer.flush()
            except LogError as error:
                self._failed(error)

    def _failed(self, error: LogError) -> None:
        self._problem = str(error)
        self._retry_s = time.monotonic() + RETRY_S
        self._seal()

    def _seal(self) -> None:
        writer, self._writer = self._writer, None
        if writer is not None:
            with contextlib.suppress(LogError, OSError):
                writer.close()
