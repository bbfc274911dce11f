"""The lab's rule against a plain transcription of its program."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxradar.live.rules import DistanceRule
from jaxradar.live.sweeps import LiveSweep

FLAGS = (0, 0, 0, 1, 2, 4, 8, 16)
FAILED = 1 | 8 | 16  # what counts as a read that failed


def transcribed(sweeps: np.ndarray, flags: list[int], start_m: float, length_m: float, as_it_was: bool) -> list[int]:
    """Lines 131 to 147 and 253 to 275 of appendix C.1, of the first sensor; mended: scale, start, and what a failed
    read leaves."""
    bins = sweeps.shape[1]
    index_to_meter = length_m / 128 if as_it_was else length_m / bins
    distance: float | None = None
    out = []
    for data, flag in zip(sweeps.tolist(), flags, strict=True):
        if flag & FAILED:
            distance = distance if as_it_was else None
        else:
            max_data, max_data_index = 0, 0
            for i in range(bins):
                if max_data < data[i]:
                    max_data_index, max_data = i, data[i]
            distance = index_to_meter * max_data_index + (0.0 if as_it_was else start_m) if max_data > 1000 else None
            if as_it_was and distance is None:
                distance = 0.0
        near = distance is not None and distance < 0.15 and not (as_it_was and distance == 0)
        out.append(1 if near else 0)
    return out


@pytest.mark.parametrize("as_it_was", [False, True])
@given(seed=st.integers(0, 2**32 - 1), bins=st.sampled_from([128, 1446]), other=st.booleans())
def test_byte_for_byte(as_it_was: bool, seed: int, bins: int, other: bool) -> None:
    random = np.random.default_rng(seed)
    start_m, length_m = 0.1, 0.7
    sweeps = random.integers(0, 1010, (40, bins)).astype(np.uint16)
    near = random.integers(0, 3, 40) > 0
    sweeps[near, random.integers(0, bins // 8, 40)[near]] = random.integers(995, 1015, int(near.sum()))
    sweeps[::9] = 0
    flags = random.choice(FLAGS, 40).tolist()
    range_m = start_m + np.arange(bins) * length_m / bins
    rule, found = DistanceRule(range_m, 1, as_it_was=as_it_was), []
    for place in range(40):
        rule.take(LiveSweep(1, place, sweeps[place], flags[place]))
        if other:
            rule.take(LiveSweep(3, place, sweeps[(place + 1) % 40], 0))  # which is not asked
        found.append(int(rule.near))
    assert found == transcribed(sweeps, flags, start_m, length_m, as_it_was)


def test_a_sweep_of_another_length_has_no_object() -> None:
    rule = DistanceRule(np.linspace(0.1, 0.2, 8), 1)
    sweep = np.array([0, 2000, 0, 0, 0, 0, 0, 0], np.uint16)
    rule.take(LiveSweep(1, 0, sweep, 0))
    assert rule.near
    rule.take(LiveSweep(1, 0, sweep[:7], 0))
    assert not rule.near
