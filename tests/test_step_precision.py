"""Single and double precision, and both forms of the reductions, agree on every event of the real recordings."""

from __future__ import annotations

from pathlib import Path

import jax
import pytest

from jaxradar import read_log
from jaxradar._numerics import reductions
from jaxradar.systems.step import ApproachDetector, RangeRateDetector, ShiftDetector, ThesisDetector, detect, thin

# Minutes: each precision, form and number of bins is a program of its own.
pytestmark = pytest.mark.long

PEAKS = ("arg-max", "parabola", "soft-argmax", "soft-argmax over all bins", "matched filter")
DETECTORS = {
    "shift": ShiftDetector(),
    "approach": ApproachDetector(),
    **{peak: RangeRateDetector(peak=peak) for peak in PEAKS},
}


def events(detector, series) -> list[int]:
    return [event.sweep for event in detect(detector, series).events]


@pytest.mark.parametrize("bins", [128, pytest.param(None, marks=pytest.mark.long)])
@pytest.mark.parametrize("name", DETECTORS)
def test_single_and_double_precision_agree_on_every_event(road_recordings: dict[str, Path], name: str, bins) -> None:
    for recording, path in road_recordings.items():
        for series in read_log(path).sensors:
            series = thin(series, bins) if bins else series
            single = events(DETECTORS[name], series)
            with jax.enable_x64(True):
                assert events(DETECTORS[name], series) == single, recording


def test_the_rule_in_single_precision_finds_the_thesis_s_events(road_recordings: dict[str, Path]) -> None:
    found = 0
    for recording, path in road_recordings.items():
        for series in read_log(path).sensors:
            series = thin(series, 128)
            wanted = events(ThesisDetector(), series)
            assert events(RangeRateDetector(peak="arg-max"), series) == wanted, recording
            found += len(wanted)
    assert found == 29  # 27 on the standing recordings, 2 on the moving one


@pytest.mark.parametrize("name", ["shift", "approach", "thesis", "arg-max", "soft-argmax"])
def test_both_forms_of_the_reductions_find_the_same_events(road_recordings: dict[str, Path], name: str) -> None:
    detector = ThesisDetector() if name == "thesis" else DETECTORS[name]
    hardest = [thin(read_log(road_recordings[one]).sensors[0], 128) for one in ("demo1", "grass_0_60", "cement_0_0.2")]
    jax.clear_caches()  # the form is chosen when a program is traced
    with reductions("staged"):
        staged = [events(detector, series) for series in hardest]
    jax.clear_caches()
    with reductions("plain"):
        plain = [events(detector, series) for series in hardest]
    jax.clear_caches()
    assert plain == staged
