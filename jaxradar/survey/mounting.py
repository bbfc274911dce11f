"""Height and angle of a sensor out of a stretch of flat road.

The mean square of the envelope over a road is known but for six numbers (`Ground`): the leading edge tells the height,
how the echo is shared out over range tells the angle, as the beam looks at some ranges more than at others; the road's
backscatter does so too and has to be found with it. They are fitted to the logarithm of the mean profile by
Levenberg and Marquardt (optimistix). How firm they are follows from how much the profile scatters from part to part of
the series, not from the model: the sandwich (JᵀWJ)⁻¹ JᵀW C WJ (JᵀWJ)⁻¹, C the covariance of the mean profile's
logarithm (White, Econometrica 50, 1982). A car that stands sees one speckle pattern however long it stands: what of the
speckle does not vary in time is added to C as if it were another pattern each time.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx

from jaxradar._errors import ConfigError
from jaxradar._numerics import compiled
from jaxradar.drive import SensorSeries
from jaxradar.signal.pulses import SIGMA_PER_FWHM
from jaxradar.survey.ground import Beam, Ground, ground_profile, strips_of

__all__ = ["Calibration", "calibrate", "mean_powers"]

CELL_M = 0.014  # bins are taken together up to here: neighbours share the pulse anyway
PARTS = 16  # of a series, that scatter about their mean
FEWEST_SWEEPS = 3 * PARTS
ANGLES_DEG, SLOPES = (35.0, 55.0), (0.15, 0.35)  # where fits begin
HEIGHT_RANGE_M = (0.05, 2.0)
DETERMINED_DEG = 5.0
LEAST_SCATTER = 0.03  # of a cell's logarithm: the model is not better than that
PULSE_ERROR_M = 0.001  # of the height: a pulse is not quite a Gaussian
MOVING = 0.7  # variance over mean square of the power of speckle that is driven over, at least
STEPS = 60
# What is believed of a road before anything is seen: so wide that it matters for what the data do not say.
_PRIOR = {"down_rad": (math.radians(45.0), math.radians(20.0)), "log_slope": (math.log(0.25), 0.7)}
_GRAIN_UNDER_FACETS = (-2.0, 4.0)


@dataclass(frozen=True)
class Calibration:
    """How a sensor sits, each with its standard deviation.

    `height_m` over the road, `angle_deg` between the line of sight and the road. `determined`: whether the series tells
    the angle; its standard deviation is large where it does not. `ground`: the road that was fitted with it, `misfit`:
    mean square of what is left of the profile's logarithm over what its scatter makes expected; far above 1 where the
    road is not flat, or not like the model.
    """

    height_m: float
    height_sd_m: float
    angle_deg: float
    angle_sd_deg: float
    ground: Ground
    misfit: float
    sweeps: int

    @property
    def determined(self) -> bool:
        return self.angle_sd_deg < DETERMINED_DEG


def calibrate(series: SensorSeries, beam: Beam | None = None, angles_deg: Sequence[float] = ANGLES_DEG) -> Calibration:
    """Fit height and angle to sweeps over a flat road, driven over or stood on. `angles_deg`: where fits begin.

    Raises `ConfigError` for a series with fewer than 48 sweeps with data, and for one in which there is no echo.
    """
    beam = beam or Beam()
    use = ~series.invalid
    if int(use.sum()) < FEWEST_SWEEPS:
        raise ConfigError(
            f"calibration needs at least {FEWEST_SWEEPS} sweeps with data; sensor {series.sensor} has {int(use.sum())}."
        )
    range_m, powers = mean_powers(series, use)
    mean = powers.mean(axis=0)
    if not (np.isfinite(mean).all() and mean.min() > 0 and mean.max() > 2.0 * mean.min()):
        raise ConfigError(f"sensor {series.sensor} shows no echo of a road; nothing to be fitted.")
    covariance = _covariance(beam, range_m, powers)
    scatter = np.sqrt(np.maximum(np.diag(covariance), LEAST_SCATTER**2))
    strips = strips_of(beam, float(range_m[-1]))
    with jax.enable_x64(True):
        start = _starts(range_m, mean, angles_deg)
        inputs = (beam, jnp.asarray(strips), jnp.asarray(range_m), jnp.asarray(np.log(mean)), jnp.asarray(scatter))
        fits = [np.asarray(one) for one in _fit(*inputs, start)]
    costs = np.sum(fits[1] ** 2, axis=1)
    if not np.isfinite(costs).any():
        raise ConfigError(f"sensor {series.sensor}: no road fits the mean profile.")
    found, residual, slopes = (one[int(np.nanargmin(costs))] for one in fits)
    cells = len(range_m)
    whitened = covariance / np.outer(scatter, scatter) + np.diag(
        np.maximum(0.0, 1.0 - np.diag(covariance) / scatter**2)
    )
    inverse = np.linalg.inv(slopes.T @ slopes)
    middle = slopes[:cells].T @ whitened @ slopes[:cells] + slopes[cells:].T @ slopes[cells:]
    spread = inverse @ middle @ inverse
    misfit = float(np.mean(residual[:cells] ** 2))
    # What the model leaves beyond the scatter is its own error, and as firm as that is what it says.
    sd = np.sqrt(np.diag(spread) * max(misfit, 1.0))
    sd[0] = math.hypot(sd[0], PULSE_ERROR_M)
    return Calibration(
        height_m=float(found[0]),
        height_sd_m=float(sd[0]),
        angle_deg=math.degrees(found[1]),
        angle_sd_deg=math.degrees(sd[1]),
        ground=Ground(*found),
        misfit=misfit,
        sweeps=int(use.sum()),
    )


def mean_powers(series: SensorSeries, use: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Middles of the range cells (cells,), and the mean square of each sweep that is used in each of them (sweeps,
    cells), counts²."""
    per_cell = max(1, round(CELL_M / series.bin_m))
    cells = len(series.range_m) // per_cell
    power = np.asarray(series.sweeps[use], np.float64)[:, : cells * per_cell] ** 2
    range_m = series.range_m[: cells * per_cell].reshape(cells, per_cell).mean(axis=1)
    return range_m, power.reshape(len(power), cells, per_cell).mean(axis=2)


def _covariance(beam: Beam, range_m: np.ndarray, powers: np.ndarray) -> np.ndarray:
    """(cells, cells): of the logarithm of the mean profile."""
    mean = powers.mean(axis=0)
    ends = np.linspace(0, len(powers), PARTS + 1).astype(int)
    each = np.stack([powers[low:high].mean(axis=0) for low, high in itertools.pairwise(ends)])
    parts = each / mean - 1.0
    seen = parts.T @ parts / (PARTS * (PARTS - 1))
    # Of exponentially distributed power the variance is the square of the mean; what is missing stood still.
    varies = min(float(np.sum(powers.var(axis=0)) / np.sum(mean**2)), 1.0)
    apart = (range_m[:, None] - range_m[None, :]) / (SIGMA_PER_FWHM * float(beam.fwhm_m))
    return seen + max(0.0, 1.0 - varies / MOVING) * np.exp(-0.5 * apart**2)


def _starts(range_m: np.ndarray, mean: np.ndarray, angles_deg: Sequence[float]) -> Any:
    """Where fits begin: the edge where the echo passes a quarter of its top, and several angles."""
    noise = float(np.quantile(mean, 0.05))
    over = mean - noise > 0.25 * (mean.max() - noise)
    height = float(np.clip(range_m[int(np.argmax(over))], *HEIGHT_RANGE_M))
    level = math.log((mean.max() - noise) * height**2) + 2.0
    starts = [
        [height, math.radians(angle), math.log(slope), level, level - 2.0, math.log(noise)]
        for angle, slope in itertools.product(angles_deg, SLOPES)
    ]
    return jnp.asarray(starts, float)


def _residuals(beam: Beam, strips: Any, range_m: Any, log_mean: Any, scatter: Any, values: Any) -> Any:
    ground = Ground(*values)
    left = (jnp.log(ground_profile(beam, ground, strips, range_m)) - log_mean) / scatter
    prior = [(getattr(ground, name) - middle) / spread for name, (middle, spread) in _PRIOR.items()]
    under, spread = _GRAIN_UNDER_FACETS
    prior.append((ground.log_grain - ground.log_facets - under) / spread)
    return jnp.concatenate([left, jnp.stack(prior)])


def _fitted(beam: Beam, strips: Any, range_m: Any, log_mean: Any, scatter: Any, start: Any) -> Any:
    residuals = partial(_residuals, beam, strips, range_m, log_mean, scatter)
    solver: Any = optx.LevenbergMarquardt(rtol=1e-6, atol=1e-8)
    found = optx.least_squares(lambda values, _: residuals(values), solver, start, max_steps=STEPS, throw=False).value
    return found, residuals(found), jax.jacfwd(residuals)(found)


_fit = compiled(jax.vmap(_fitted, in_axes=(None, None, None, None, None, 0)))
