"""Hits and false alarms over the threshold, by running the detector at each of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable

from jaxradar._errors import LogError
from jaxradar.cluster import Here, cluster_of
from jaxradar.estimate.intervals import Estimate, proportion, rate
from jaxradar.evaluation.records import Failure, SeriesResult
from jaxradar.evaluation.run import evaluate_parts
from jaxradar.evaluation.table import Evaluation
from jaxradar.matching import Summary, summarise

__all__ = ["OperatingPoint", "operating_curve"]

FACTORS = (0.25, 0.4, 0.63, 0.8, 1.0, 1.25, 1.6, 2.5, 4.0)  # of the detector's own threshold


@dataclasses.dataclass(frozen=True)
class OperatingPoint:
    """A detector at one threshold: the logs whose truth is known, together. `chosen`: at its own threshold."""

    threshold: float
    summary: Summary
    chosen: bool = False

    @property
    def detected(self) -> Estimate | None:
        """The share of steps that were seen, with its 95 % interval; None without steps."""
        steps = self.summary.hits + self.summary.misses
        return proportion(self.summary.hits, steps) if steps else None

    @property
    def false_alarms_per_hour(self) -> Estimate | None:
        """With their 95 % interval, if they come independently; None without time."""
        hours = self.summary.duration_s / 3600
        return rate(self.summary.false_alarms, hours) if hours > 0 else None


def operating_curve(
    evaluation: Evaluation,
    factors: Iterable[float] = FACTORS,
    *,
    most_logs: int | None = None,
    cluster: str | Here | None = None,
    advance: Callable[[int], None] = lambda logs: None,
) -> tuple[OperatingPoint, ...]:
    """The detector at `factors` of its own threshold, over those logs of an evaluation whose truth is known.

    Each threshold is a run over the logs, on the workers of `cluster` if one is given, and compiles nothing anew; the
    detector's own (a factor of 1) is what the evaluation found. A factor that the bounds of the setting do not allow
    counts as the nearest that they do, once. `most_logs`: evenly many of them if there are more. `advance` hears how
    many of these are done, in parts that add up to all once.

    Raises `LogError` for a log that cannot be read any more: the points would not be of the same logs.
    """
    settings = evaluation.settings
    known = [one for one in evaluation.results if one.score is not None]
    paths = list(dict.fromkeys(one.path for one in known))
    if most_logs is not None and len(paths) > most_logs:
        paths = [paths[place * len(paths) // most_logs] for place in range(most_logs)]
    kept = set(paths)
    own = float(settings.detector.threshold)
    found: dict[float, OperatingPoint] = {}
    ordered = sorted(factors)
    with cluster_of(cluster) as workers:
        for number, factor in enumerate(ordered, 1):
            detector = settings.detector if factor == 1.0 else settings.detector.with_threshold(factor * own)
            threshold = float(detector.threshold)
            if factor == 1.0:
                found[threshold] = _point(threshold, (one for one in known if one.path in kept), True)
            elif threshold not in found:
                plain = dataclasses.replace(settings, detector=detector, pictures=False, figures=False)
                found[threshold] = _point(threshold, evaluate_parts(paths, plain, workers), False)
            advance(len(paths) * number // len(ordered) - len(paths) * (number - 1) // len(ordered))
    return tuple(found[threshold] for threshold in sorted(found))


def _point(threshold: float, results: Iterable[SeriesResult | Failure], chosen: bool) -> OperatingPoint:
    scores = []
    for one in results:
        if isinstance(one, Failure):
            raise LogError(one.path, f"could be evaluated before, and now: {one.error}")
        if one.score is not None:
            scores.append((one.score, one.duration_s))
    return OperatingPoint(threshold, summarise(scores), chosen)
