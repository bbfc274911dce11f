"""What every source of live sweeps gives, whether a sensor, a server or a recorded drive is behind it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple, Protocol, TypeVar, runtime_checkable

import numpy as np

__all__ = ["LiveSweep", "Source"]

# Not `typing.Self`, which the tests' type checker does not take in a method.
AnySource = TypeVar("AnySource", bound="Source")


class LiveSweep(NamedTuple):
    """One sweep of one sensor.

    - `sensor`: its number on the connector board.
    - `time_ns`: when it came, in nanoseconds of a clock that does not jump, since the first sweep of the source; of a
      replayed drive as recorded.
    - `sweep`: (bins,), envelope in ADC counts; uint16, float32 or float64 only where a replayed log holds that.
    - `flags`: of `jaxradar.drive.SweepFlag`.
    - `last`: whether it is the last of this moment: false where a sweep of another sensor, of the same time, follows.
    - `motion`: what is known of the car's by then, `jaxradar.motion.MOTION_FIELDS`; empty where the source tells none.
    """

    sensor: int
    time_ns: int
    sweep: np.ndarray
    flags: int
    motion: Sequence[float] = ()
    last: bool = True


@runtime_checkable
class Source(Protocol):
    """Sweeps one after the other, of one sensor or several of one range axis.

    `open` before anything else, or use it as a context manager. Iteration ends when the source is exhausted or closed,
    and raises `SourceError` when it fails; `close` may come from another thread or from a signal handler, and more
    than once. One thread at a time may iterate.
    """

    @property
    def range_m(self) -> np.ndarray:
        """(bins,) float64, slant range of each bin in metres; (0,) before `open` where the sensor has to be asked."""
        ...

    @property
    def sensors(self) -> tuple[int, ...]:
        """Their numbers on the connector board."""
        ...

    @property
    def dtype(self) -> np.dtype:
        """Of the amplitudes: whole counts, unless a source says otherwise."""
        return np.dtype(np.uint16)

    @property
    def tells_motion(self) -> bool:
        """Whether sweeps come with the car's motion: not, unless a source says otherwise."""
        return False

    @property
    def period_s(self) -> float | None:
        """From one sweep of a sensor to the next, as it was asked for or recorded; None where that is not known, or
        where they come as fast as they are taken."""
        return None

    @property
    def waits(self) -> bool:
        """Whether sweeps can be taken as slowly as one likes: of a file, not of a sensor."""
        return False

    @property
    def problems(self) -> tuple[str, ...]:
        """What of the settings is not as asked for, a sentence each, once it is open."""
        return ()

    @property
    def missed(self) -> int:
        """Sweeps that the sensor or the server said it had lost, of all sensors together, since `open`."""
        ...

    def open(self) -> None:
        """Make ready. Raises `ConfigError` for settings that cannot be had, `SourceError` if nothing answers."""
        ...

    def close(self) -> None:
        """Let iteration end soon, and give back what is held."""
        ...

    def __iter__(self) -> Iterator[LiveSweep]: ...

    def __enter__(self: AnySource) -> AnySource:
        self.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
