"""One drive as recorded: what every reader gives and every detector takes.

NumPy alone, so that the runtime on the device can hold one too. Times are integer nanoseconds that count from the
first sweep of the drive, whichever sensor made it: float32 seconds are 7.8 ms apart after a day, and differences are
taken in integers before anything is cast. The form on disk is in `jaxradar.drivefile`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from enum import IntFlag
from typing import Any

import numpy as np

from jaxradar._errors import ConfigError
from jaxradar.motion import Channel, Motion, integer_times
from jaxradar.units import NANOSECONDS

__all__ = [
    "MAKERS_FLAGS",
    "Channel",
    "Drive",
    "Motion",
    "Mounting",
    "RoadStep",
    "SensorSeries",
    "SweepFlag",
    "Truth",
    "kept_bins",
    "unrounded_bin_m",
]

_ROUNDING_M = 1e-6
_MOST_SECONDS = 1e10  # int64 nanoseconds end at 9.2e9 s
FULL_SCALE = 65535  # of the sensor's uint16 counts: an amplitude there is saturated
SWEEP_DTYPES = (np.dtype(np.uint16), np.dtype(np.float32), np.dtype(np.float64))


class SweepFlag(IntFlag):
    """What the sensor, or the reader, said of one sweep. A sweep is *invalid* if any flag of `INVALID` is set."""

    MISSED_DATA = 1
    SATURATED = 2
    QUALITY_WARNING = 4
    COMMUNICATION_ERROR = 8
    NO_AMPLITUDES = 16  # a time was logged, but no amplitudes: the lab's program leaves such rows on a failed read
    INVALID = MISSED_DATA | COMMUNICATION_ERROR | NO_AMPLITUDES


# The keys under which the maker's server and recordings say the same.
MAKERS_FLAGS = {
    "missed_data": SweepFlag.MISSED_DATA,
    "data_saturated": SweepFlag.SATURATED,
    "data_quality_warning": SweepFlag.QUALITY_WARNING,
    "sensor_comm_error": SweepFlag.COMMUNICATION_ERROR,
}


def unrounded_bin_m(bin_m: float, length_m: float, bins: int) -> float:
    """Distance of neighbouring range bins in metres, of which the A111's server and recordings state `bin_m` rounded.

    It is rounded to micrometres, 0.48426 mm to 0.000484 m, which is .3 mm too little at the far end of a sweep of 0.6
    m. `length_m`, first bin to last, is not; so it is length / (bins − 1), as in the maker's `get_range_depths`, where
    the two agree to that rounding, and `bin_m` as it stands where they do not.
    """
    fine_m = length_m / max(bins - 1, 1)
    return fine_m if abs(fine_m - bin_m) <= _ROUNDING_M else bin_m


def kept_bins(have: int, bins: int) -> np.ndarray:
    """(bins,) int64: which of `have` range bins the lab's program keeps, out[i] = data[have·i // bins] (thesis, listing
    C.1, lines 246 to 251).

    No anti-alias filter, as there. Raises `ConfigError` unless 2 <= bins <= have.
    """
    if not 2 <= bins <= have:
        raise ConfigError(f"cannot thin {have} range bins to {bins}; expected a number from 2 to {have}.")
    return have * np.arange(bins, dtype=np.int64) // bins


@dataclass(frozen=True, eq=False)
class SensorSeries:
    """All sweeps of one sensor.

    - `sensor`: its number on the connector board (the lab's program writes it into the file name, `3.csv`).
    - `times_ns`: (sweeps,) int64, since the first sweep of the drive; as recorded, so it may jitter, stand still or
      go back.
    - `sweeps`: (sweeps, bins), envelope in ADC counts; uint16 as the sensor gives it, float32 or float64 if the log
      holds anything else. Possibly a read-only memory map.
    - `range_m`: (bins,) float64, strictly increasing slant range of each bin in metres, as the log states it.
    - `flags`: (sweeps,) uint16 of `SweepFlag`.
    - `spec`: how the sensor was set, under the maker's own keys (`profile`, `update_rate`), as far as the log says.

    Raises `ValueError` if the shapes or dtypes disagree.
    """

    sensor: int
    times_ns: np.ndarray
    sweeps: np.ndarray
    range_m: np.ndarray
    flags: np.ndarray
    spec: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        count = len(integer_times(self.times_ns, "SensorSeries(times_ns=...)"))
        if self.sweeps.dtype not in SWEEP_DTYPES:
            raise ValueError(f"`SensorSeries(sweeps=...)` must be uint16, float32 or float64; got {self.sweeps.dtype}.")
        if self.range_m.ndim != 1 or self.range_m.dtype != np.float64 or len(self.range_m) < 2:
            raise ValueError(
                "`SensorSeries(range_m=...)` must be a float64 vector of at least 2 bins; "
                f"got {self.range_m.dtype} of shape {self.range_m.shape}."
            )
        if not (np.isfinite(self.range_m).all() and (np.diff(self.range_m) > 0).all()):
            raise ValueError("`SensorSeries(range_m=...)` must be finite and strictly increasing.")
        if self.sweeps.shape != (count, len(self.range_m)):
            raise ValueError(
                f"`SensorSeries(sweeps=...)` must have shape (sweeps, bins) = {(count, len(self.range_m))}; "
                f"got {self.sweeps.shape}."
            )
        if self.flags.shape != (count,) or self.flags.dtype != np.uint16:
            raise ValueError(
                f"`SensorSeries(flags=...)` must be uint16 of shape {(count,)}; "
                f"got {self.flags.dtype} of shape {self.flags.shape}."
            )

    def __len__(self) -> int:
        return len(self.times_ns)

    @property
    def times_s(self) -> np.ndarray:
        """(sweeps,) float64 seconds since the first sweep of the drive."""
        return self.times_ns / NANOSECONDS

    @property
    def duration_s(self) -> float:
        """Seconds from the first sweep to the last in time; 0 for fewer than two sweeps."""
        return (int(self.times_ns.max()) - int(self.times_ns.min())) / NANOSECONDS if len(self) else 0.0

    @property
    def sweep_rate_hz(self) -> float | None:
        """One over the median of the positive time differences; None where there is none."""
        steps = np.diff(self.times_ns)
        steps = steps[steps > 0]
        if not steps.size:
            return None
        # Not `np.median`: picking out the middle takes NumPy five times as long as sorting all.
        ordered, middle = np.sort(steps), steps.size // 2
        return NANOSECONDS / (0.5 * (int(ordered[middle]) + int(ordered[-1 - middle])))

    @property
    def bin_m(self) -> float:
        """Mean distance of two neighbouring range bins in metres."""
        return float((self.range_m[-1] - self.range_m[0]) / (len(self.range_m) - 1))

    @property
    def invalid(self) -> np.ndarray:
        """(sweeps,) bool: the sensor or the reader says that there is no echo to be used."""
        return (self.flags & SweepFlag.INVALID) != 0


@dataclass(frozen=True)
class Mounting:
    """How the sensor sits on the car.

    `height_m` above the ground; `angle_deg` between the line of sight and the ground (the thesis: 45°, section 5.1.3);
    `front_wheel_m`: how far the front axle lies behind the sensor along the road. None where it is not known.
    """

    height_m: float | None = None
    angle_deg: float | None = None
    front_wheel_m: float | None = None


@dataclass(frozen=True)
class RoadStep:
    """A step in the road; all times in seconds since the first sweep of the drive, None what is not known.

    - `impact_s`: first contact of a front tyre. `height_m`: positive upwards in the direction of travel.
    - `at_m`: where it is, along the path from where the sensor was when the drive began.
    - `wheels_s`: when each wheel touches it, front right, front left, rear right, rear left; None for one that does
      not.
    - `peak_m_s2`: the body's largest vertical acceleration soon afterwards, without sign; `hard_s`: when it first is
      15 m/s² (thesis, section 6.2), None if it never is.

    Raises `ValueError` for an impact that is no time of a drive.
    """

    impact_s: float
    height_m: float | None = None
    wheels_s: tuple[float | None, ...] | None = None
    peak_m_s2: float | None = None
    hard_s: float | None = None
    at_m: float | None = None

    def __post_init__(self) -> None:
        if not abs(self.impact_s) < _MOST_SECONDS:
            raise ValueError(f"`RoadStep(impact_s=...)` must be within {_MOST_SECONDS:g} s of 0; got {self.impact_s}.")


@dataclass(frozen=True)
class Truth:
    """Every step that the drive went over. No steps is knowledge too: the road was flat."""

    steps: tuple[RoadStep, ...] = ()


@dataclass(frozen=True, eq=False)
class Drive:
    """One drive.

    - `sensors`: one series for each sensor, in order of sensor number.
    - `truth`: None where it is not known.
    - `started_at_ns`: Unix time of the first sweep in nanoseconds, None where the log does not say.
    - `clock_start_ns`: what the recorder's own clock showed at the first sweep; a log that is written again gets its
      own times back.
    - `problems`: one sentence for each thing that the reader mended, dropped or could not be sure of.
    """

    sensors: tuple[SensorSeries, ...]
    motion: Motion = field(default_factory=Motion)
    mounting: Mounting | None = None
    truth: Truth | None = None
    started_at_ns: int | None = None
    clock_start_ns: int = 0
    problems: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        numbers = [series.sensor for series in self.sensors]
        if len(set(numbers)) != len(numbers):
            raise ValueError(f"`Drive(sensors=...)` must have different sensor numbers; got {numbers}.")

    @property
    def started_at(self) -> datetime | None:
        """The first sweep's absolute time in UTC, to the microsecond."""
        if self.started_at_ns is None:
            return None
        seconds, rest = divmod(self.started_at_ns, NANOSECONDS)
        return datetime.fromtimestamp(seconds, UTC).replace(microsecond=rest // 1000)

    def series(self, sensor: int) -> SensorSeries:
        """The series of one sensor; `KeyError` if the drive has none of that number."""
        for series in self.sensors:
            if series.sensor == sensor:
                return series
        raise KeyError(sensor)
