"""The field over range, the surface and the corner, each against a float64 sum that shares no code with them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxradar.sim.radar import Echoes, Radar, envelope, field_of, nodes_of, pulse, pulse_scale, range_axis
from jaxradar.sim.road.corner import corner_area
from jaxradar.sim.road.surface import Surface, backscatter, coherent_share, fresnel

FWHM = 0.06


def direct_field(range_m, echoes, fwhm, slope=None):
    """Every echo in every bin."""
    offset = range_m[:, None] - np.float64(echoes[0])[None, :]
    # Half as high at half the width.
    end = 0.5 * fwhm / np.sqrt(1 - 0.5 ** (1 / 16))
    pulse = np.clip(1 - (offset / end) ** 2, 0, None).astype(complex) ** 16
    if slope is not None:
        pulse *= np.exp(1j * np.float64(slope) * offset)
    return pulse @ (np.float64(echoes[1]) + 1j * np.float64(echoes[2]))


@pytest.mark.parametrize(
    "radar", [Radar(), Radar(bin_m=0.000484, bins=1448), Radar(fwhm_m=0.02)], ids=["128", "1448", "sharp"]
)
@pytest.mark.parametrize("walking", [pytest.param(False, marks=pytest.mark.long), True], ids=["still", "walking"])
def test_field_is_the_sum_over_all_echoes_in_all_bins(radar, walking):
    random = np.random.default_rng(0)
    fwhm = float(radar.fwhm_m)
    axis = range_axis(radar)
    reach = 3.5 * fwhm / 2.3548
    places = random.uniform(axis[0] - reach, axis[-1] + reach, 200)
    parts = random.normal(size=(2, 200)) * 100
    slope = random.uniform(-50, 50, 200) if walking else None
    wanted = direct_field(axis, (places, *parts), fwhm, slope)
    nodes, step = nodes_of(radar.start_m, float(axis[-1]), fwhm, 1.6 if walking else 1.0)
    echoes = Echoes(
        *(jnp.asarray(one, jnp.float32) for one in (places, *parts)),
        None if slope is None else jnp.asarray(slope, jnp.float32),
    )
    with jax.enable_x64(True):
        found = field_of(echoes, nodes, step, axis, radar.fwhm_m)
    off = np.abs(np.asarray(found.real) + 1j * np.asarray(found.imag) - wanted)
    assert found.real.dtype == jnp.float32
    assert off.max() < 1e-3 * np.abs(wanted).max()
    assert_allclose(envelope(found), np.abs(wanted), atol=1e-3 * np.abs(wanted).max())


def test_the_pulse_is_nearly_a_gaussian():
    offset = np.linspace(-0.3, 0.3, 6001)
    gaussian = np.exp(-4 * np.log(2) * (offset / FWHM) ** 2)
    assert np.abs(pulse(jnp.asarray(offset), pulse_scale(FWHM)) - gaussian).max() < 0.012


def test_envelope_of_nothing_is_0_with_gradient_0():
    nothing = Echoes(*(jnp.zeros(4) for _ in range(3)))
    value, slope = jax.value_and_grad(
        lambda x: envelope(
            field_of(nothing._replace(real=x), np.linspace(0, 1, 9), 0.125, np.linspace(0, 1, 5), 0.3)
        ).sum()
    )(jnp.zeros(4))
    assert value == 0
    assert np.isfinite(slope).all()


def test_backscatter_is_barricks_and_lamberts():
    surface = Surface(permittivity=4.0, slope=0.3, grain_db=-10.0)
    theta = np.radians([0.0, 10.0, 30.0, 60.0, 80.0])
    facets = (1 / 9) / (2 * 0.09 * np.cos(theta) ** 4) * np.exp(-(np.tan(theta) ** 2) / 0.18)
    assert_allclose(backscatter(surface, jnp.cos(theta)), facets + 0.1 * np.cos(theta) ** 2, rtol=1e-4)
    assert backscatter(surface, jnp.asarray(-0.5)) == 0
    assert np.isfinite(jax.grad(lambda c: backscatter(surface, c))(0.0))


def test_a_small_corner_has_the_textbook_cross_section():
    # 8 pi b^2 h^2 / lambda^2 at 45 degrees for a breadth b, here the first Fresnel zone's.
    wavelength, reach, height = 0.005, 0.5, 0.004
    sine = jnp.sqrt(0.5)
    real, imag = corner_area(jnp.asarray(height), sine, jnp.asarray(reach), jnp.asarray(0.0), wavelength)
    breadth = np.sqrt(wavelength * reach / 2)
    wanted = 8 * np.pi * breadth**2 * height**2 / wavelength**2
    assert_allclose(4 * np.pi * (real**2 + imag**2) / wavelength**2, wanted, rtol=1e-3)


def test_a_tall_corner_is_half_a_mirror_after_fresnel():
    # Over an aperture without end both integrals are sqrt(lambda R / 2): a flat mirror, cross-section pi R^2.
    wavelength, reach = 0.005, 0.5
    k = 2 * np.pi / wavelength
    height = 0.05
    u = np.linspace(-1, 1, 200_001) * height * np.sqrt(0.5)
    wanted = np.trapezoid(np.exp(-1j * k * u**2 / reach), u) * np.sqrt(wavelength * reach / 2) * np.exp(-1j * np.pi / 4)
    real, imag = corner_area(jnp.asarray(height), jnp.sqrt(0.5), jnp.asarray(reach), jnp.asarray(0.0), wavelength)
    assert_allclose(complex(real, imag), wanted, rtol=1e-4)
    mirror = abs(np.sqrt(wavelength * reach / 2)) ** 2
    assert 0.8 * mirror < abs(wanted) < 1.3 * mirror


@pytest.mark.parametrize("height", [0.02, 0.1, 0.3])
@pytest.mark.parametrize("lean", [0.0, 0.05, np.radians(12.0)])
def test_a_corner_is_the_integral_over_both_ways_round(height, lean):
    # The ray that meets the face first and the one that meets the road first are turned by the lean to opposite sides.
    k, reach = 2 * np.pi / 0.005, 0.6
    u = np.linspace(0, 1, 400_001) * height * np.sqrt(0.5)
    phase = k * (u**2 / reach + 2 * lean * u)
    wanted = 2 * np.trapezoid(np.exp(-1j * phase), u) * np.sqrt(0.005 * reach / 2) * np.exp(-1j * np.pi / 4)
    found = corner_area(jnp.asarray(height), jnp.sqrt(0.5), jnp.asarray(reach), jnp.asarray(lean), 0.005)
    assert abs(complex(*found) - wanted) < 0.01 * abs(wanted)


def test_fresnel_at_its_landmarks():
    surface = Surface(permittivity=5.24)
    straight = (np.sqrt(5.24) - 1) / (np.sqrt(5.24) + 1)
    assert_allclose(fresnel(surface, "vertical", jnp.asarray(1.0)), straight, rtol=1e-5)
    assert_allclose(fresnel(surface, "horizontal", jnp.asarray(1.0)), -straight, rtol=1e-5)
    brewster = jnp.cos(jnp.arctan(jnp.sqrt(5.24)))
    assert abs(fresnel(surface, "vertical", brewster)) < 1e-5
    assert_allclose(fresnel(surface, "horizontal", jnp.asarray(0.0)), -1.0, rtol=1e-3)


def test_roughness_takes_away_what_ament_says():
    surface = Surface(rms_mm=0.5)
    assert_allclose(
        coherent_share(surface, jnp.asarray(1.0), 0.005), np.exp(-0.5 * (4 * np.pi * 0.5e-3 / 0.005) ** 2), rtol=1e-5
    )
