"""Hits and false alarms over the threshold, by running the detector at each of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING

from scipy.stats import beta, chi2

from jaxradar.evaluation.records import SeriesResult
from jaxradar.matching import Summary, summarise

if TYPE_CHECKING:
    from jaxradar.evaluation.run import Settings

__all__ = ["OperatingPoint", "operating_curve"]

FACTORS = (0.25, 0.4, 0.63, 0.8, 1.0, 1.25, 1.6, 2.5, 4.0)  # of the detector's own threshold
_TAIL = 0.025  # beyond either end of the 95 % intervals


@dataclasses.dataclass(frozen=True)
class OperatingPoint:
    """A detector at one threshold: the logs whose truth is known, together. `chosen`: at its own threshold."""

    threshold: float
    summary: Summary
    chosen: bool = False

    @property
    def detection_interval(self) -> tuple[float, float] | None:
        """95 % interval of the share of steps that are seen (Clopper and Pearson, 1934); None without steps."""
        hits, steps = self.summary.hits, self.summary.hits + self.summary.misses
        if not steps:
            return None
        low = float(beta.ppf(_TAIL, hits, steps - hits + 1)) if hits else 0.0
        high = float(beta.ppf(1.0 - _TAIL, hits + 1, steps - hits)) if hits < steps else 1.0
        return low, high

    @property
    def false_alarm_interval(self) -> tuple[float, float] | None:
        """95 % interval of the false alarms an hour, if they come independently (Garwood, 1936)."""
        count, hours = self.summary.false_alarms, self.summary.duration_s / 3600
        if not hours:
            return None
        low = float(0.5 * chi2.ppf(_TAIL, 2 * count)) if count else 0.0
        return low / hours, float(0.5 * chi2.ppf(1.0 - _TAIL, 2 * count + 2)) / hours


def operating_curve(
    paths: Sequence[str],
    settings: Settings,
    factors: Iterable[float] = FACTORS,
    *,
    most_logs: int | None = None,
    advance: Callable[[int], None] = lambda logs: None,
) -> tuple[OperatingPoint, ...]:
    """The detector at `factors` of its own threshold, over the logs whose truth is known; nothing is compiled anew.

    A factor that the bounds of the setting do not allow counts as the nearest that they do, once. `most_logs`: evenly
    many of them if there are more. `advance` hears how many of these are done, in parts that add up to all once.
    """
    from jaxradar.evaluation.run import evaluate_each

    kept = list(paths)
    if most_logs is not None and len(kept) > most_logs:
        kept = [kept[place * len(kept) // most_logs] for place in range(most_logs)]
    own = float(settings.detector.threshold)
    found: dict[float, OperatingPoint] = {}
    ordered = sorted(factors)
    for number, factor in enumerate(ordered, 1):
        detector = settings.detector if factor == 1.0 else settings.detector.with_threshold(factor * own)
        threshold = float(detector.threshold)
        if threshold not in found or factor == 1.0:
            plain = dataclasses.replace(settings, detector=detector, pictures=False, figures=False)
            known = [
                (one.score, one.duration_s)
                for one in evaluate_each(kept, plain)
                if isinstance(one, SeriesResult) and one.score is not None
            ]
            found[threshold] = OperatingPoint(threshold, summarise(known), factor == 1.0)
        advance(len(kept) * number // len(ordered) - len(kept) * (number - 1) // len(ordered))
    return tuple(found[threshold] for threshold in sorted(found))
