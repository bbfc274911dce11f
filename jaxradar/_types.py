"""Array types by what they hold. One sweep at a time: batches are made by `jax.vmap`."""

from __future__ import annotations

import numpy as np
from jaxtyping import Array, Bool, Float, Int, Shaped, UInt

__all__ = ["Counts", "Flag", "Flags", "Index", "Lags", "RangeBins", "RawSweep", "Scalar", "Setting", "Sweep", "Value"]

RawSweep = Shaped[Array | np.ndarray, " bins"]  # envelope as recorded: uint16, or float where a log holds that
Sweep = Float[Array | np.ndarray, " bins"]  # envelope in ADC counts
RangeBins = Float[Array | np.ndarray, " bins"]  # slant range of each bin in metres
Lags = Float[Array | np.ndarray, " lags"]  # one value for each trial shift
Scalar = Float[Array | np.ndarray, ""]
Value = Float[Array, ""]  # a scalar that a program works out
Setting = Float[Array | np.ndarray, ""] | float  # given as a number, kept as an array leaf
Flag = Bool[Array | np.ndarray, ""]
Index = Int[Array | np.ndarray, ""]
Flags = UInt[Array | np.ndarray, ""]  # `jaxradar.drive.SweepFlag`s of one sweep
Counts = Float[Array | np.ndarray, " cells"]  # a sweep averaged over cells of several bins, ADC counts
