"""Friis, against figures worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from jaxradar.units import WAVELENGTH_60_GHZ_M, free_space_loss, friis_power_ratio


def test_wavelength_is_the_thesis_s_five_millimetres() -> None:
    assert pytest.approx(0.005, rel=1e-3) == WAVELENGTH_60_GHZ_M


def test_loss_at_a_metre() -> None:
    # 20 log10(4π · 1 m / 4.99654 mm) = 68.01 dB
    assert 10 * np.log10(free_space_loss(1.0)) == pytest.approx(68.01, abs=0.005)


def test_loss_grows_with_the_square_of_distance() -> None:
    np.testing.assert_allclose(free_space_loss(np.array([0.2, 0.4])) / free_space_loss(0.1), [4, 16])


def test_friis_is_gain_over_loss() -> None:
    assert friis_power_ratio(0.5, 4.0, 2.5) * free_space_loss(0.5) == pytest.approx(10.0)
