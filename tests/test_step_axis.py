"""Cells of a range axis: means that are the same on every machine."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from jaxradar.systems.step import RangeAxis

BINS = 23
AXIS = RangeAxis.of(0.1 + 0.007 * np.arange(BINS))
counts = hnp.arrays(np.uint16, BINS)


@settings(max_examples=40, deadline=None)
@given(values=counts, bins=st.integers(1, BINS))
def test_means_over_cells(values: np.ndarray, bins: int) -> None:
    """Against NumPy in double precision; the sum of whole counts is exact, and so the mean but for one product."""
    found = np.asarray(AXIS.averaged(jnp.asarray(values, jnp.float32), bins))
    whole = np.array([values[low : low + bins].astype(np.int64).sum() for low in range(0, BINS - bins + 1, bins)])
    np.testing.assert_allclose(found, whole / bins, rtol=2e-7)
    np.testing.assert_array_equal(found, whole.astype(np.float32) * np.float32(1.0 / bins))


@settings(max_examples=40, deadline=None)
@given(values=counts, bins=st.integers(2, 7), seed=st.integers(0, 99))
def test_cells_of_equal_counts_are_equal(values: np.ndarray, bins: int, seed: int) -> None:
    """In whichever order a machine adds them."""
    mixed = values.copy()
    random = np.random.default_rng(seed)
    for low in range(0, BINS - bins + 1, bins):
        mixed[low : low + bins] = random.permutation(mixed[low : low + bins])
    one, other = (np.asarray(AXIS.averaged(jnp.asarray(given, jnp.float32), bins)) for given in (values, mixed))
    np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("bins", [1, 4, 23])
def test_the_slope_is_shared_by_the_bins_of_a_cell(bins: int) -> None:
    slopes = jax.jacobian(lambda values: AXIS.averaged(values, bins))(jnp.ones(BINS))
    cells = np.arange(BINS) // bins
    np.testing.assert_allclose(slopes, (cells == np.arange(BINS // bins)[:, None]) / bins, rtol=1e-6)
