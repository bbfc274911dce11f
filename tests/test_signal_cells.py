"""The strongest echo among range cells: between patches, at the ends, of equal ones, and of hardly any cells."""

from __future__ import annotations

import jax.numpy as jnp
import pytest

from jaxradar.signal.cells import strongest_cell


def test_begins_at_the_largest_of_three_cells() -> None:
    """Two patches with a gap between them: the middle of all three cells is on neither."""
    cells = jnp.asarray([0.0, 0, 5, 3, 6, 0, 0, 0])
    place, strength = strongest_cell(cells)
    assert 4.0 < float(place) < 5.0
    assert float(strength) == pytest.approx(14 / 3)
    assert float(strongest_cell(cells, 4.0)[1]) == pytest.approx(2 / 3)
    weighted, kept = strongest_cell(jnp.asarray([3.0, 3, 3, 0, 0, 1, 1, 1]), weights=jnp.asarray([1.0] * 4 + [9.0] * 4))
    assert 5.0 <= float(weighted) <= 8.0
    assert float(kept) == pytest.approx(1.0)
    assert float(strongest_cell(jnp.zeros(5))[1]) == 0.0


@pytest.mark.parametrize(
    ("cells", "place", "strength"),
    [
        pytest.param([0, 5, 0, 0, 0, 5, 0], 1.5, 5 / 3, id="the first of two equal echoes"),
        pytest.param([0, 4, 4, 0], 2.0, 8 / 3, id="between two equal cells"),
        pytest.param([0, 0, 3, 3, 3, 0, 0], 3.5, 3.0, id="the middle of three equal cells"),
        pytest.param([4, 4, 4, 4], 0.5, 4.0, id="the first cell where all are equal"),
        pytest.param([5, 0, 0, 0, 5], 0.5, 10 / 3, id="the first of two equal ends"),
    ],
)
def test_of_equal_ones_the_first(cells: list[float], place: float, strength: float) -> None:
    found, above = strongest_cell(jnp.asarray(cells, float))
    assert float(found) == pytest.approx(place)
    assert float(above) == pytest.approx(strength, rel=1e-6)


@pytest.mark.parametrize("beside", [0.0, 1.0, 4.0])
@pytest.mark.parametrize("bins", [3, 5, 8])
def test_an_echo_in_the_first_cell_and_in_the_last(bins: int, beside: float) -> None:
    """It has one neighbour, and so no vertex: its middle."""
    cells = jnp.zeros(bins).at[:2].set(jnp.asarray([5.0, beside]))
    first, strength = strongest_cell(cells)
    last, mirrored = strongest_cell(cells[::-1])
    assert float(first) == pytest.approx(0.5)
    assert float(last) == pytest.approx(bins - 0.5)
    assert float(strength) == pytest.approx((10.0 + beside) / 3) == float(mirrored)


@pytest.mark.parametrize(
    ("cells", "place", "strength"),
    [([7], 0.5, 7.0), ([0], 0.5, 0.0), ([3, 1], 0.5, 7 / 3), ([1, 3], 1.5, 7 / 3), ([2, 2], 0.5, 2.0)],
)
def test_one_cell_and_two_are_enough(cells: list[float], place: float, strength: float) -> None:
    found, above = strongest_cell(jnp.asarray(cells, float))
    assert float(found) == pytest.approx(place)
    assert float(above) == pytest.approx(strength, rel=1e-6)
