"""The range that a sensor really measures, out of what its server answers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from jaxradar.drive import unrounded_bin_m

__all__ = ["ActualRange", "actual_range", "range_problems", "sensor_problems"]


class ActualRange(NamedTuple):
    """As the server answers: the first bin, the whole length and the distance of neighbouring bins before any are left
    out, in metres."""

    start_m: float
    length_m: float
    step_m: float


def actual_range(session: Mapping[str, Any]) -> tuple[ActualRange, int]:
    """The range and the number of bins, out of what the maker's client calls a session's information.

    Raises `ValueError`, half a sentence whose subject is the server, if it is none.
    """
    try:
        found = [float(session[key]) for key in ("range_start_m", "range_length_m", "step_length_m")]
        length = int(session["data_length"])
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"does not say what range it measures: {session!r:.200}.") from error
    if not (all(map(math.isfinite, found)) and found[2] > 1e-6 and 2 <= length <= 100_000):
        raise ValueError(f"measures no range: {session!r:.200}.")
    start_m, length_m, step_m = found
    return ActualRange(start_m, length_m, unrounded_bin_m(step_m, length_m, length)), length


def range_problems(axis: np.ndarray, actual: ActualRange, asked: tuple[float, float]) -> list[str]:
    """A sentence if the axis, (bins,) metres, begins or ends more than half a bin from what was `asked` for, start and
    length in metres."""
    start_m, end_m = asked[0], asked[0] + asked[1]
    if max(abs(axis[0] - start_m), abs(axis[-1] - end_m)) <= 0.5 * actual.step_m:
        return []
    return [f"measures from {axis[0]:.5g} to {axis[-1]:.5g} m; asked for was {start_m:.5g} to {end_m:.5g} m."]


def sensor_problems(answer: Mapping[str, Any], sensors: Sequence[int], first: ActualRange, length: int) -> list[str]:
    """A sentence for each sensor whose bins lie more than half a bin from those of the first.

    The client gives the first sensor's range alone; the server's `answer` to the set-up holds all.
    """
    found = []
    try:
        ranges = [
            actual_range({"range_start_m": one["start_m"], "range_length_m": one["length_m"], **one})[0]
            for one in answer["metadata"][0]
        ]
    except (KeyError, IndexError, TypeError, ValueError):
        return []
    for sensor, (start_m, _, step_m) in list(zip(sensors, ranges, strict=False))[1:]:
        shift_m = start_m - first.start_m
        if max(abs(shift_m), abs(shift_m + (step_m - first.step_m) * (length - 1))) > 0.5 * first.step_m:
            found.append(
                f"sensor {sensor} measures from {start_m:.5g} m in steps of {1e3 * step_m:.4g} mm; its bins are taken "
                f"for those of sensor {sensors[0]}, from {first.start_m:.5g} m in steps of {1e3 * first.step_m:.4g} mm."
            )
    return found
