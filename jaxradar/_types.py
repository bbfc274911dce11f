"""Array types by what they hold. One sweep at a time: batches are made by `jax.vmap`."""

from __future__ import annotations

import numpy as np
from jaxtyping import Array, Bool, Float, Int, Shaped

__all__ = ["Counts", "Flag", "Index", "Lags", "RangeBins", "RawSweep", "Scalar", "Sweep"]

RawSweep = Shaped[Array | np.ndarray, " bins"]  # envelope as recorded: uint16, or float where a log holds that
Sweep = Float[Array | np.ndarray, " bins"]  # envelope in ADC counts
RangeBins = Float[Array | np.ndarray, " bins"]  # slant range of each bin in metres
Lags = Float[Array | np.ndarray, " lags"]  # one value for each trial shift
# NumPy's scalars are welcome as settings: they stay float64 until the program that uses them has its precision.
Scalar = Float[Array | np.ndarray, ""]
Flag = Bool[Array | np.ndarray, ""]
Index = Int[Array | np.ndarray, ""]
Counts = Float[Array | np.ndarray, " cells"]  # a sweep averaged over cells of several bins, ADC counts
