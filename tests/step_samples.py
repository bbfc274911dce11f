"""Series of sweeps with a known answer, for the tests of the step detectors."""

from __future__ import annotations

from typing import Any

import numpy as np

from jaxradar.drive import SensorSeries, SweepFlag
from jaxradar.units import NANOSECONDS

BINS = 128
# The fixture's spacing (figure C.1): a bin at 100 Hz is .70338 m/s, safely on one side of the thesis's .7.
RANGE_M = 0.1 + 0.0070338 * np.arange(BINS)


def echo(range_m: float, amplitude: float = 2000.0, fwhm_m: float = 0.06, axis: np.ndarray = RANGE_M) -> np.ndarray:
    """A Gaussian echo over a floor of 100 counts, uint16."""
    pulse = amplitude * np.exp(-4 * np.log(2) * ((axis - range_m) / fwhm_m) ** 2)
    return np.rint(np.minimum(pulse + 100.0, 65535)).astype(np.uint16)


def series(
    sweeps: Any, rate_hz: float = 100.0, times_s: Any = None, flags: Any = None, range_m: np.ndarray = RANGE_M
) -> SensorSeries:
    sweeps = np.asarray(sweeps)
    sweeps = sweeps.reshape(len(sweeps), len(range_m))
    if sweeps.dtype != np.uint16:
        sweeps = sweeps.astype(np.float64)
    times = np.arange(len(sweeps)) / rate_hz if times_s is None else np.asarray(times_s, float)
    given = np.zeros(len(sweeps), np.uint16) if flags is None else np.asarray(flags, np.uint16)
    given = given | np.where((sweeps >= 65535).any(axis=1), np.uint16(SweepFlag.SATURATED), np.uint16(0))
    return SensorSeries(1, np.rint(times * NANOSECONDS).astype(np.int64), sweeps, range_m, given.astype(np.uint16))


def over_a_step(count: int = 60, at: int = 30, shift_m: float = -0.03, range_m: float = 0.4, **echo_options: float):
    """Flat road at `range_m`, from sweep `at` on `shift_m` further out."""
    return series([echo(range_m + (shift_m if i >= at else 0.0), **echo_options) for i in range(count)])
