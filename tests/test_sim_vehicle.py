"""The car: courses in closed form, wheels over edges, springs against SciPy's integration of the same equations."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import cumulative_trapezoid, solve_ivp

from jaxradar.sim.road.elements import FlatTopHump, Kerb, Pothole, SinusoidalHump, StepDown, StepUp
from jaxradar.sim.road.ground import road_height
from jaxradar.sim.road.motion import CarMotion, SpeedChange, along
from jaxradar.sim.road.tyre import contact_m, wheel_height
from jaxradar.sim.road.vehicle import HalfCar, QuarterCar, ride

STEP = 0.0005


@pytest.fixture(autouse=True)
def double():
    with jax.enable_x64(True):
        yield


def test_course_is_the_integral_of_its_acceleration():
    motion = CarMotion(8.0, (SpeedChange(0.5, 2.0, 4.0, 0.3), SpeedChange(2.5, -1.0, 2.0, 0.1)))
    times = np.linspace(-0.2, 6.0, 62_001)
    course = along(motion, jnp.asarray(times))
    speed = 8.0 + cumulative_trapezoid(np.asarray(course.acceleration_m_s2), times, initial=0)
    assert_allclose(course.speed_m_s, speed, atol=1e-6)
    path = cumulative_trapezoid(np.asarray(course.speed_m_s), times, initial=0)
    assert_allclose(course.path_m - course.path_m[2000], path - path[2000], atol=1e-6)
    assert course.path_m[2000] == pytest.approx(0.0, abs=1e-12)  # at time 0
    assert course.speed_m_s[-1] == pytest.approx(-1.0)


def quarter_by_scipy(car, road, times):
    """Body rise and acceleration from the textbook's two equations, the road as a function of time."""
    ms, mu, ks, cs, kt = (
        float(getattr(car, name)) for name in ("body_kg", "wheel_kg", "spring_n_m", "damper_n_s_m", "tyre_n_m")
    )

    def rates(t, y):
        body, wheel, body_v, wheel_v = y
        spring = ks * (body - wheel) + cs * (body_v - wheel_v)
        return [body_v, wheel_v, -spring / ms, (spring - kt * (wheel - road(t))) / mu]

    found = solve_ivp(rates, (times[0], times[-1]), [0, 0, 0, 0], t_eval=times, rtol=1e-10, atol=1e-13, max_step=2e-4)
    body, wheel, body_v, wheel_v = found.y
    return body, -(ks * (body - wheel) + cs * (body_v - wheel_v)) / ms


@pytest.mark.parametrize(
    "height", [pytest.param(0.01, marks=pytest.mark.long), 0.04, pytest.param(0.06, marks=pytest.mark.long)]
)
def test_quarter_car_agrees_with_an_independent_integration(height):
    car, speed, radius = QuarterCar(), 30 / 3.6, 0.2
    times = np.arange(0, 0.8, STEP)
    edge = 2.0
    touch = np.sqrt(2 * radius * height - height**2)

    def wheel(t):
        away = edge - speed * t
        return height if away <= 0 else (height - radius + np.sqrt(radius**2 - away**2) if away < touch else 0.0)

    rise, acceleration = quarter_by_scipy(car, wheel, times)
    road = (StepUp(at_m=edge, height_m=height),)
    z = wheel_height(lambda x, y: road_height(road, None, x, y), road, jnp.asarray(speed * times), 0.0, radius)
    assert_allclose(z, [wheel(t) for t in times], atol=2e-5)
    found = ride(car.system(), jnp.stack([z, z, jnp.zeros_like(z)], axis=1), STEP)
    assert np.abs(found.rise_m - rise).max() < 0.005 * np.abs(rise).max()
    assert np.abs(found.body_m_s2 - acceleration).max() < 0.005 * np.abs(acceleration).max()
    assert_allclose(np.gradient(np.asarray(found.rise_m), STEP)[5:-5], found.rise_m_s[5:-5], atol=2e-3)


@pytest.mark.long
def test_a_half_car_whose_axles_do_not_mind_each_other_is_two_quarter_cars():
    # With an inertia of m a b the two ends of the body are free of each other.
    quarter = QuarterCar()
    half = HalfCar(body_kg=110.0, inertia_kg_m2=110.0 * 0.8**2, lever_m=0.8, mass_height_m=0.45)
    times = np.arange(0, 1.0, STEP)
    front = jnp.asarray(np.where(times > 0.2, 0.03, 0.0))
    inputs = jnp.stack([front, jnp.zeros_like(front), jnp.zeros_like(front)], axis=1)
    one, two = ride(quarter.system(), inputs, STEP), ride(half.system(), inputs, STEP)
    assert_allclose(two.rise_m, one.rise_m, atol=1e-9)
    assert_allclose(two.body_m_s2, one.body_m_s2, atol=1e-6)
    assert_allclose(two.wheel_m_s2, one.wheel_m_s2, atol=1e-5)


@pytest.mark.long
@pytest.mark.parametrize("car", [QuarterCar(), HalfCar()], ids=lambda car: car.name)
def test_pulling_away_lifts_the_nose(car):
    times = np.arange(0, 4.0, STEP)
    pull = jnp.full(len(times), 2.0) * (times > 0.5)
    flat = jnp.zeros_like(pull)
    found = ride(car.system(), jnp.stack([flat, flat, pull], axis=1), STEP)
    assert found.pitch_rad[900] == pytest.approx(0.0, abs=1e-12)
    assert 0.3 < np.degrees(found.pitch_rad[-1]) < 1.2  # requirements, section 4: 0.68 degrees
    if car.name == "quarter-car":
        assert np.degrees(found.pitch_rad[-1]) == pytest.approx(0.68, rel=0.02)


def test_peak_of_the_body_over_steps_is_that_of_the_requirements():
    # Section 2A: 4.6 / 9.1 / 13.5 / 17.9 / 22.2 m/s2 for 10 to 50 mm. A wheel that follows its circle up the edge
    # begins steeper than one that climbs evenly, which gives 3 % more.
    speed, radius = 30 / 3.6, 0.2
    times = jnp.arange(0, 0.8, STEP)
    peaks = []
    for height in (0.01, 0.02, 0.03, 0.04, 0.05):
        road = (StepUp(at_m=2.0, height_m=height),)
        z = wheel_height(lambda x, y, road=road: road_height(road, None, x, y), road, speed * times, 0.0, radius)
        peaks.append(float(ride(QuarterCar().system(), jnp.stack([z, z, 0 * z], axis=1), STEP).body_m_s2.max()))
    assert_allclose(peaks, [4.6, 9.1, 13.5, 17.9, 22.2], rtol=0.04)


def test_a_tyre_touches_an_edge_before_its_axle_is_there():
    assert contact_m(0.04, 0.2) == pytest.approx(0.12)
    assert contact_m(0.0, 0.2) == 0
    assert contact_m(0.5, 0.2) == pytest.approx(0.2)


@pytest.mark.long
@pytest.mark.parametrize(
    "element",
    [
        StepUp(at_m=1.0),
        StepDown(at_m=1.0),
        Kerb(at_m=1.0),
        SinusoidalHump(at_m=0.5),
        FlatTopHump(at_m=0.5),
        Pothole(at_m=1.0, along_m=0.1),
    ],
    ids=lambda one: one.name,
)
def test_a_wheel_stands_on_the_highest_thing_under_it(element):
    places = np.linspace(0.0, 2.5, 97)
    height = lambda x, y: road_height((element,), None, x, y)  # noqa: E731
    found = wheel_height(height, (element,), jnp.asarray(places), 0.0, 0.2)
    fine = np.linspace(-0.2, 0.2, 40_001)
    lift = np.sqrt(np.maximum(0.04 - fine**2, 0)) - 0.2
    wanted = [np.max(np.asarray(height(jnp.asarray(x + fine), jnp.zeros(fine.size))) + lift) for x in places]
    assert_allclose(found, wanted, atol=1e-4)
