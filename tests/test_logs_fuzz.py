"""Nothing but what was asked for or a sentence comes out of a malformed file, soon and without taking memory."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest
from fuzz_logs import KINDS, MOST_MEGABYTES, check_variants, peak_megabytes, write_seeds


def _check(tmp_path: Path, first: int, count: int) -> Counter[str]:
    seeds = write_seeds(tmp_path / "seeds")
    (tmp_path / "work").mkdir()
    before = peak_megabytes()
    outcomes = check_variants(seeds, tmp_path / "work", first, count)
    assert peak_megabytes() - before < MOST_MEGABYTES
    kinds = {name.split()[0] for name in outcomes}
    assert kinds == KINDS
    # Both must occur: variants that are all refused, or all read, test nothing.
    assert all(outcomes[f"{kind} sound"] and outcomes[f"{kind} error"] for kind in kinds), outcomes
    return outcomes


def test_malformed_variants(tmp_path: Path) -> None:
    assert _check(tmp_path, 0, 1500).total() == 1500


@pytest.mark.long
def test_a_hundred_thousand_malformed_variants(tmp_path: Path) -> None:
    print(_check(tmp_path, 10_000, 100_000))
