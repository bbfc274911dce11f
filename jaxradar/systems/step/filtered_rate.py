"""The pipeline of the thesis with weights that can be tuned: over the last sweeps, and over the shape of the pulse."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Array, Float

from jaxradar._settings import weights_setting
from jaxradar.signal.peaks import MatchedFilter
from jaxradar.systems.step.range_rate import RangeRateDetector

__all__ = ["FilteredRateDetector"]


LEAST = -0.1  # of a weight: so that 0, the plain difference, is no bound, from which no slope leads


class FilteredRateDetector(RangeRateDetector):
    """As `RangeRateDetector`, with a short filter over the last ranges in place of their plain difference, and with a
    template in place of the Gaussian pulse of `matched filter`.

    `filter`: what the differences of ranges before the newest weigh, newest first, the newest itself 1; all 0 is the
    plain difference. The rate is their weighted mean over that of their times, so that its unit is m/s and a ramp gives
    its slope whatever the weights are. Of n differences, those of the straight line that fits n + 1 ranges best weigh
    (k + 1)(n − k) / n, k = 0 ... n − 1 (Savitzky and Golay, Anal. Chem. 36, 1964): `straight_line(n - 1)`.

    `template`: what the Gaussian of `pulse_m` is multiplied by, at places that lie evenly from −1.5 to +1.5 of its
    width and linear between them; all 1 is the Gaussian.
    """

    name: ClassVar[str] = "filtered-rate"

    filter: Float[Array | np.ndarray, " before"] = weights_setting(
        (0.0,) * 7, LEAST, 8.0, "", "of the differences before the newest, which weighs 1; all 0: the plain difference"
    )
    template: Float[Array | np.ndarray, " places"] = weights_setting(
        (1.0,) * 7, 0.0, 4.0, "", "what the pulse is multiplied by, from -1.5 to +1.5 of its width; all 1: a Gaussian"
    )

    @classmethod
    def straight_line(cls, before: int) -> tuple[float, ...]:
        """Of so many differences before the newest, the weights of least squares: the best in white noise."""
        count = before + 1
        return tuple((k + 1) * (count - k) / count for k in range(1, count))

    @classmethod
    def from_false_alarm_rate(
        cls, per_hour: float = 1.0, *, rate_hz: float, sd_m: float, correlation: float = 0.0, **settings: Any
    ) -> FilteredRateDetector:
        """As of the plain difference, whose standard deviation is scaled to that of what the filter makes of such
        noise; the correlation of sweeps k apart is `correlation` to the power of k."""
        weights = np.append(1.0, np.asarray(settings.get("filter", cls().filter), np.float64))
        if -1.0 < correlation < 1.0 and weights.sum() > 0:
            taps = np.diff(np.pad(weights / weights.sum(), 1))
            apart = np.abs(np.subtract.outer(np.arange(taps.size), np.arange(taps.size)))
            sd_m *= math.sqrt(taps @ float(correlation) ** apart @ taps / (2.0 * (1.0 - correlation)))
        return super().from_false_alarm_rate(per_hour, rate_hz=rate_hz, sd_m=sd_m, correlation=correlation, **settings)

    def _weights(self) -> Float[Array | np.ndarray, " before"]:
        return self.filter

    def _matched(self, pulse_bins: float) -> MatchedFilter:
        return MatchedFilter(pulse_bins, template=self.template)
