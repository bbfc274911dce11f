"""What the page is given: columns of numbers as JSON, and pictures in compressed blobs that it opens as needed."""

from __future__ import annotations

import math
import zlib
from base64 import b64encode
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Any

import numpy as np

from jaxradar.estimate.intervals import Estimate
from jaxradar.evaluation import Evaluation, OperatingPoint, Picture, SeriesResult
from jaxradar.logs import below_common_folder

__all__ = ["page_data"]

BLOB_PICTURES = 40  # in one blob: what a screen shows is in one or two
MOST_EVENTS = 100  # of a series that the page lists; a detector that alarms at every sweep says no more with the rest
NOTHING = 65535  # where no range is known


def page_data(evaluation: Evaluation, curve: Sequence[OperatingPoint], title: str) -> tuple[dict[str, Any], list[str]]:
    """The page's JSON, finite numbers alone, and its blobs: base64 of deflated bytes.

    A blob holds the pictures of `BLOB_PICTURES` series after each other, each as little-endian uint16: the number of
    columns, of map columns and of map rows; per column the least range, the greatest, the least range rate, the
    greatest, the statistic, and whether there is a detection; then per cell of the map, row by row from the nearest,
    one byte, and one more if that makes an odd number. Ranges run from 0 at `near_m` to 65534 at `far_m`, rates from 0
    at −`fastest` to 65534 at it (65535 in both: nothing is known), the statistic to 65535 at `top`.
    """
    results = evaluation.results
    paths = [one.path for one in results]
    common, names = below_common_folder(paths)
    summary, settings = evaluation.summary, evaluation.settings
    packed = [b"" if one.picture is None else _bytes(one.picture) for one in results]
    data = {
        "title": title,
        "made": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "detector": evaluation.detector,
        "threshold": float(settings.detector.threshold),
        "statistic": [settings.detector.statistic_name, settings.detector.statistic_unit],
        "window": asdict(settings.window),
        "selection": asdict(settings.selection),
        "versions": dict(evaluation.versions),
        "folder": common,
        "summary": {
            "logs": len(set(paths)),
            "series": len(results),
            "sweeps": sum(one.sweeps for one in results),
            "duration_s": sum(one.duration_s for one in results),
            "known_s": summary.duration_s,
            "hits": summary.hits,
            "misses": summary.misses,
            "false_alarms": summary.false_alarms,
            "median_lead_s": summary.median_lead_s,
        },
        "own": [_point(OperatingPoint(0.0, summary, True))] if summary.series else [],
        "curve": [_point(one) for one in curve],
        "path": names,
        **{
            name: [_plain(getattr(one, name)) for one in results]
            for name in ("sensor", "sweeps", "duration_s", "sweep_rate_hz", "invalid_sweeps")
        },
        "detections": [len(one.events) for one in results],
        "score": [_score(one) for one in results],
        "impacts_s": [None if one.score is None else _rounded(s.impact_s for s in one.score.steps) for one in results],
        "events": [_events(one) for one in results],
        "problems": [list(one.problems) for one in results],
        "picture": [_frame(one.picture, len(raw)) for one, raw in zip(results, packed, strict=True)],
        "blob_pictures": BLOB_PICTURES,
        "failures": [[one.path, one.error] for one in evaluation.failures],
    }
    blobs = []
    for first in range(0, len(results), BLOB_PICTURES):
        raw = b"".join(packed[first : first + BLOB_PICTURES])
        packer = zlib.compressobj(6, wbits=-15)
        blobs.append(b64encode(packer.compress(raw) + packer.flush()).decode("ascii") if raw else "")
    return data, blobs


def _plain(value: Any) -> Any:
    if isinstance(value, float):
        return float(f"{value:.6g}") if math.isfinite(value) else None
    return value


def _rounded(times_s: Iterable[float]) -> list[float]:
    """To a tenth of a millisecond, however long the drive is."""
    return [round(time, 4) for time in times_s]


def _score(one: SeriesResult) -> list[Any] | None:
    if one.score is None:
        return None
    return [one.score.hits, one.score.misses, one.score.false_alarms, _rounded(one.score.lead_s)]


def _events(one: SeriesResult) -> list[list[float | None]]:
    times, *rest = (
        column[:MOST_EVENTS].tolist() for column in (one.events.time_s, one.events.range_m, one.events.statistic)
    )
    return [_rounded(times), *([_plain(value) for value in column] for column in rest)]


def _point(point: OperatingPoint) -> dict[str, Any]:
    return {
        "threshold": _plain(point.threshold),
        "rate": point.detected and _ends(point.detected),
        "false_per_hour": point.false_alarms_per_hour and _ends(point.false_alarms_per_hour),
        "series": point.summary.series,
        "hours": _plain(point.summary.duration_s / 3600),
        "chosen": point.chosen,
    }


def _ends(value: Estimate) -> list[Any]:
    return [_plain(value.value), _plain(value.low), _plain(value.high)]


def _frame(picture: Picture | None, size: int) -> list[Any] | None:
    """What is said of a picture in numbers: start, stop, near, far, the largest statistic, its size in bytes, and the
    largest rate."""
    if picture is None:
        return None
    top = float(picture.statistic.max(initial=0.0))
    frame = (picture.start_s, picture.stop_s, picture.near_m, picture.far_m, top)
    return [*map(_plain, frame), size, _plain(_fastest(picture))]


def _fastest(picture: Picture) -> float:
    known = np.abs(picture.speed_m_s[np.isfinite(picture.speed_m_s)])
    return float(known.max(initial=0.0))


def _bytes(picture: Picture) -> bytes:
    span = max(picture.far_m - picture.near_m, 1e-9)
    ranges = _words((picture.range_m - picture.near_m) / span)
    rates = _words(0.5 + 0.5 * picture.speed_m_s / max(_fastest(picture), 1e-30))
    top = max(float(picture.statistic.max(initial=0.0)), 1e-30)
    statistic = np.rint(65535 * np.clip(picture.statistic / top, 0.0, 1.0))
    rows, columns = picture.amplitude.shape
    head = np.array([len(picture.statistic), columns, rows], "<u2")
    numbers = np.concatenate([*ranges, *rates, statistic, picture.event]).astype("<u2")
    return b"".join((head.tobytes(), numbers.tobytes(), picture.amplitude.tobytes(), b"\0" * (rows * columns % 2)))


def _words(share: np.ndarray) -> np.ndarray:
    return np.where(np.isfinite(share), np.rint(65534 * np.clip(share, 0.0, 1.0)), NOTHING)
