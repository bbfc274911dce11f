"""A pulsed coherent radar: its range axis, its pulse, and the envelope that it makes of a set of echoes.

An echo is a complex amplitude at a slant range. The field over range is the sum of all echoes, each with the pulse's
shape around it, and the envelope is its magnitude. An echo adds within its pulse only, which ends 5.7 standard
deviations σ from its middle, and the field holds no frequency above 3.5/σ (1e-4 of the whole); so the sum is taken at
nodes 0.9 σ apart and carried over to the range bins by Shannon's series, one product with a fixed matrix: half the work
of a sum in each bin at 7 mm, a twentieth at the sensor's own 0.484 mm.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxradar._numerics import cosine_sine, safe_sqrt
from jaxradar._settings import Settings, choice_setting, setting, shape_setting
from jaxradar._types import Setting, Sweep, Value
from jaxradar.signal.pulses import SIGMA_PER_FWHM
from jaxradar.units import WAVELENGTH_60_GHZ_M

__all__ = [
    "Echoes",
    "Field",
    "Radar",
    "envelope",
    "field_of",
    "nodes_of",
    "pulse",
    "pulse_scale",
    "range_axis",
    "reach_of",
]

NODE_SPACING = 0.9  # in standard deviations σ of the pulse: 1.1e-4 of an echo's peak is the largest error of the series
REACH = 3.5  # in σ: an echo so far beyond the range window still shows in it, with 0.3 % of its amplitude
MARGIN = 6.3  # in σ: how far beyond the window nodes are laid
SHARPNESS = 16  # the power that makes a parabola nearly a Gaussian
ECHOES_A_PASS = 28  # echoes that are added in one pass over the nodes


class Radar(Settings):
    """The sensor as it is set. Defaults: an A111 thinned as the thesis's program records it (table C.1).

    The gain is that of standing recordings (`scripts/compare_recordings.py`: 22 counts for each count of the receiver's
    noise) at the noise of table C.1. The width of an echo is assumed, between the 54 mm that fit those recordings with
    the sensor's smoothing and the 66 mm of their narrowest echo.

    The beam's half-power widths, one way, are the maker's (55° in the E-plane, which is taken as the vertical one, and
    80°). The amplitude of an echo falls as r^−exponent: 2 is the radar equation's for a point (power as r⁻⁴).
    """

    start_m: float = shape_setting(0.099768, 0.0, 100.0, "m", "slant range of the first bin")
    bin_m: float = shape_setting(0.0070338, 1e-5, 1.0, "m", "distance of two range bins")
    bins: int = shape_setting(128, 2, 100_000, "", "number of range bins")
    rate_hz: float = shape_setting(100.0, 1e-3, 1e5, "Hz", "sweeps per second")
    sensor: int = shape_setting(3, 0, 1000, "", "its number on the connector board")
    fwhm_m: Setting = setting(0.06, 1e-3, 1.0, "m", "width of an echo at half its height")
    wavelength_m: Setting = setting(WAVELENGTH_60_GHZ_M, 1e-3, 0.1, "m", "of the carrier")
    vertical_beam_deg: Setting = setting(55.0, 0.1, 360.0, "°", "half-power width, one way, in the vertical plane")
    lateral_beam_deg: Setting = setting(80.0, 0.1, 360.0, "°", "half-power width, one way, across it")
    polarisation: str = choice_setting("vertical", ("vertical", "horizontal"), "the plane of the electric field")
    exponent: Setting = setting(2.0, 0.0, 8.0, "", "the amplitude of an echo falls as range to this power")
    gain_counts: Setting = setting(3600.0, 0.0, 1e9, "counts", "amplitude of 1 m² at 1 m in the middle of the beam")


class Echoes(NamedTuple):
    """Echoes of one sweep: slant range, and the two parts of the amplitude in counts; `slope` is how their phase turns
    from bin to bin in rad/m while a sweep is sampled (None if all bins are sampled at once)."""

    range_m: Float[Array, " echoes"]
    real: Float[Array, " echoes"]
    imag: Float[Array, " echoes"]
    slope: Float[Array, " echoes"] | None = None


class Field(NamedTuple):
    """The two parts of the received field in each range bin, in counts."""

    real: Sweep
    imag: Sweep


def range_axis(radar: Radar) -> np.ndarray:
    """(bins,) float64 metres: the slant range of each bin."""
    return radar.start_m + radar.bin_m * np.arange(radar.bins)


def reach_of(fwhm_m: Any) -> Any:
    """How far beyond the range window an echo may lie and still show in it."""
    return REACH * SIGMA_PER_FWHM * fwhm_m


@lru_cache(maxsize=32)
def nodes_of(start_m: float, end_m: float, fwhm_m: float, widening: float = 1.0) -> tuple[np.ndarray, float]:
    """Nodes that carry the field of all echoes that show between two ranges, and their distance; metres.

    `widening`: how many times wider the band is than the pulse's own.
    """
    sigma = SIGMA_PER_FWHM * fwhm_m
    step = NODE_SPACING * sigma / widening
    count = math.ceil((end_m - start_m + 2 * MARGIN * sigma) / step) + 1
    return start_m - MARGIN * sigma + step * np.arange(count), step


def interpolation(nodes_m: np.ndarray, step_m: float, range_m: np.ndarray) -> np.ndarray:
    """(nodes, bins): Shannon's series. The field has died away at both ends, so little of the series is cut off."""
    return np.sinc((range_m[None, :] - nodes_m[:, None]) / step_m)


def pulse(offset: Float[Array, "*shape"], scale: Value) -> Float[Array, "*shape"]:
    """Envelope of an echo at `offset` from its middle: (1 − (offset × scale)²)¹⁶, 0 where that is negative.

    Within 1.2 % of the Gaussian of the same width at half height everywhere (the maker gives no formula), it ends, and
    costs no exponential. `scale`: from `pulse_scale`.
    """
    value = jnp.maximum(1.0 - (offset * scale) ** 2, 0.0)
    for _ in range(SHARPNESS.bit_length() - 1):
        value = value * value
    return value


def pulse_scale(fwhm_m: Setting) -> Value:
    """One over the distance at which a pulse ends, 2.43 times its width at half height."""
    return 2.0 * math.sqrt(1.0 - 2.0 ** (-1.0 / SHARPNESS)) / jnp.asarray(fwhm_m)


def field_of(echoes: Echoes, nodes_m: np.ndarray, step_m: float, range_m: np.ndarray, fwhm_m: Setting) -> Field:
    """The field in each bin of a sweep."""
    dtype = echoes.range_m.dtype
    nodes = jnp.asarray(nodes_m, dtype)
    scale = pulse_scale(fwhm_m).astype(dtype)

    def add(field: Array, part: Echoes) -> Array:
        # One pass over the nodes for all of these: a reduction over the echoes would be a chain of single numbers. Both
        # parts as one complex number, or the compiler would work out every pulse twice.
        real = imag = jnp.zeros_like(nodes)
        for one in range(part.range_m.shape[0]):
            offset = nodes - part.range_m[one]
            height = pulse(offset, scale)
            if part.slope is None:
                real, imag = real + height * part.real[one], imag + height * part.imag[one]
            else:
                cos, sin = cosine_sine(part.slope[one] * offset * (0.5 / math.pi))
                real = real + height * (cos * part.real[one] - sin * part.imag[one])
                imag = imag + height * (cos * part.imag[one] + sin * part.real[one])
        return field + jax.lax.complex(real, imag)

    def pass_from(field: Array, start: Array) -> tuple[Array, None]:
        cut = lambda one: jax.lax.dynamic_slice_in_dim(one, start, ECHOES_A_PASS)  # noqa: E731
        return add(field, jax.tree.map(cut, echoes)), None

    count = echoes.range_m.shape[0]
    whole = count // ECHOES_A_PASS * ECHOES_A_PASS
    field = jax.lax.complex(0.0 * nodes, 0.0 * nodes)
    if whole:
        field, _ = jax.lax.scan(pass_from, field, jnp.arange(0, whole, ECHOES_A_PASS, dtype=jnp.int32))
    if whole < count:
        field = add(field, jax.tree.map(lambda one: one[whole:], echoes))
    carried = jnp.asarray(interpolation(nodes_m, step_m, range_m), dtype)
    return Field(field.real @ carried, field.imag @ carried)


def envelope(field: Field) -> Sweep:
    """Magnitude of the field; 0 with gradient 0 where there is none."""
    return safe_sqrt(field.real**2 + field.imag**2)
