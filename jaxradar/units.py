"""Physical constants and the conversions that carry a formula of their own."""

from __future__ import annotations

import math
from typing import Any

__all__ = [
    "NANOSECONDS",
    "SPEED_OF_LIGHT_M_S",
    "WAVELENGTH_60_GHZ_M",
    "free_space_loss",
    "friis_power_ratio",
]

NANOSECONDS = 1_000_000_000  # in a second
SPEED_OF_LIGHT_M_S = 299_792_458.0  # exact, by definition of the metre (BIPM, SI brochure, 9th edition)
WAVELENGTH_60_GHZ_M = SPEED_OF_LIGHT_M_S / 60e9


def free_space_loss(distance_m: Any, wavelength_m: float = WAVELENGTH_60_GHZ_M) -> Any:
    """One-way free-space loss (4πd/λ)², a ratio of powers: thesis, equation (B.2).

    `distance_m` may be a number or an array of either NumPy or JAX; metres. The thesis multiplies every *amplitude*
    by the square of the *round-trip* distance, (2r)²: that is the r⁴ law of a point target's power (the two-way radar
    equation), not this one-way law of power; see `StepDetector`'s exponents.
    """
    return (4.0 * math.pi / wavelength_m) ** 2 * distance_m**2


def friis_power_ratio(
    distance_m: Any, transmit_gain: float = 1.0, receive_gain: float = 1.0, wavelength_m: float = WAVELENGTH_60_GHZ_M
) -> Any:
    """Received over transmitted power Gt Gr (λ/4πd)²: Friis's transmission formula, thesis, equation (B.1).

    `distance_m` as in `free_space_loss`; gains are ratios of power. Far field only.
    """
    return transmit_gain * receive_gain / free_space_loss(distance_m, wavelength_m)
