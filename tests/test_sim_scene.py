"""Scenes as a whole: a float64 oracle, only what is called for, the same draws whatever else there is, hard cases."""

import dataclasses
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from jaxradar import ConfigError, sim
from jaxradar._numerics import compiled
from jaxradar.drive import SweepFlag
from jaxradar.sim.clock import Clock
from jaxradar.sim.explain import Tolerance, _difference
from jaxradar.sim.road.echoes import ground_paths
from jaxradar.sim.road.effects import EFFECTS
from jaxradar.sim.road.ground import Points, lay_points, road_height
from jaxradar.sim.road.plan import plan_scene
from jaxradar.sim.road.render import Rendered, _pose, render
from jaxradar.sim.road.tyre import wheel_height
from jaxradar.sim.scene import Effect, named_stream, of_stage

BARE = sim.RoadScene(duration_s=0.1)
STEPPED = sim.RoadScene(duration_s=0.2, road=(sim.StepUp(at_m=1.2),), vehicle=sim.QuarterCar())


_program = compiled(lambda plan, dtype, scene, key: render(plan, scene, key, dtype), static_argnums=(0, 1))


def rendered(scene, seed=0, dtype=jnp.float32):
    with jax.enable_x64(True):
        return jax.tree.map(np.asarray, _program(plan_scene(scene), dtype, scene, jax.random.key(seed)))


def oracle(scene, number):
    """The envelope of a sweep of an even road, every scatterer in every bin, straight from the formulas."""
    plan = plan_scene(scene)
    with jax.enable_x64(True):
        y, real, imag = np.asarray(
            lay_points((), None, plan.first_point, plan.points, 0.006, 0.5, named_stream(jax.random.key(0), "ground"))
        )
    x = (plan.first_point + np.arange(plan.points)) * 0.006 - 30 / 3.6 * number / 100
    h = 0.35
    r = np.sqrt(x**2 + y**2 + h**2)
    seen = (x > -plan.behind_m) & (r < 1.2)
    x, y, r, g = x[seen], y[seen], r[seen], (real + 1j * imag)[seen]
    cosine, surface = h / r, scene.surface
    s2 = float(surface.slope) ** 2
    n = np.sqrt(float(surface.permittivity))
    sigma = ((1 - n) / (1 + n)) ** 2 / (2 * s2 * cosine**4) * np.exp(-(1 / cosine**2 - 1) / (2 * s2))
    sigma += 10 ** (float(surface.grain_db) / 10) * cosine**2
    off, across = np.arctan2(h, x) - np.pi / 4, np.arcsin(y / r)
    beam = np.exp(-4 * np.log(2) * ((np.degrees(off) / 55) ** 2 + (np.degrees(across) / 80) ** 2))
    wavelength = float(scene.radar.wavelength_m)
    echo = float(scene.radar.gain_counts) * np.sqrt(sigma) * beam / r**2 * g * np.exp(-4j * np.pi * r / wavelength)
    bins = 0.099768 + 0.0070338 * np.arange(128)
    end = 0.03 / np.sqrt(1 - 0.5 ** (1 / 16))
    pulse = np.clip(1 - ((bins[:, None] - r) / end) ** 2, 0, None) ** 16
    return np.abs(pulse @ echo)


@pytest.mark.parametrize("number", [pytest.param(0, marks=pytest.mark.long), 7])
def test_a_sweep_is_the_coherent_sum_of_the_formulas(number):
    wanted = oracle(BARE, number)
    assert np.abs(rendered(BARE, dtype=jnp.float64).sweeps[number] - wanted).max() < 3e-3 * wanted.max()
    assert np.abs(rendered(BARE).sweeps[number] - wanted).max() < 6e-3 * wanted.max()


@pytest.mark.long
def test_speckle_is_tied_to_the_ground():
    # Eight sweeps at 1 m/s and four at 2 m/s end at the same place, and must show the same.
    slow = dataclasses.replace(BARE, motion=sim.CarMotion(1.0))
    fast = dataclasses.replace(BARE, motion=sim.CarMotion(2.0))
    a, b = rendered(slow, dtype=jnp.float64).sweeps, rendered(fast, dtype=jnp.float64).sweeps
    assert_allclose(a[8], b[4], rtol=1e-6, atol=1e-6 * a.max())
    assert np.abs(a[8] - a[0]).max() > 0.1 * a.max()


def jaxpr(scene):
    """The traced program, without its settings' values."""
    with jax.enable_x64(True):
        plan = plan_scene(scene)
        leaves, form = jax.tree.flatten(scene)
        return str(
            jax.make_jaxpr(lambda *leaves: render(plan, jax.tree.unflatten(form, leaves), jax.random.key(0)).sweeps)(
                *leaves
            )
        )


WHOLE = dataclasses.replace(STEPPED, effects=(sim.ReceiverNoise(),))


def test_an_effect_that_is_not_there_leaves_nothing_in_the_program(monkeypatch):
    """Its code is not even called while the program is traced."""
    plain = jaxpr(WHOLE)

    def called(self, *arguments):
        raise AssertionError(f"{self.name} was called")

    for kind in EFFECTS.values():
        if kind is not sim.ReceiverNoise:
            for method in ("__call__", "places", "stated", "turn_rad_m"):
                monkeypatch.setattr(kind, method, called)
    assert jaxpr(WHOLE) == plain
    for name, kind in EFFECTS.items():
        if kind is not sim.ReceiverNoise:
            with pytest.raises(AssertionError, match=f"{name} was called"):
                jaxpr(dataclasses.replace(WHOLE, effects=(kind(),)))


@pytest.mark.parametrize("name", EFFECTS)
def test_an_effect_that_is_there_is_in_the_program(name):
    kind = EFFECTS[name]
    with_it = dataclasses.replace(WHOLE, effects=(sim.ReceiverNoise(), kind()) if name != "receiver-noise" else ())
    if name in ("dropped-sweeps", "late-sweeps", "cpu-clock"):  # these change which sweeps are written, and when
        return
    assert lines(with_it) != lines(WHOLE)


def lines(scene):
    """The program without its first line, which lists the settings that go in."""
    return jaxpr(scene).split("\n", 1)[1].count("\n")


def test_what_a_scene_has_not_is_not_in_its_program():
    program = jaxpr(BARE)
    for word in ("erfc", "threefry", "expm", "argmax", "while"):
        assert word not in program.replace("threefry2x32", "") or word == "threefry"
    assert len(jaxpr(STEPPED)) > 1.3 * len(program)


@pytest.mark.parametrize("name", [name for name in EFFECTS if name != "receiver-noise"])
def test_an_effect_does_not_change_the_streams_of_the_others(name):
    key, noise, effect = jax.random.key(5), sim.ReceiverNoise(), EFFECTS[name]()
    ((_, alone),) = of_stage((noise,), "field", key)
    for effects in ((effect, noise), (noise, effect)):
        streams = [stream for one, stream in of_stage(effects, "field", key) if one is noise]
        assert streams == [alone]
    ((_, own),) = of_stage((effect,), effect.stage, key)
    assert (jax.random.key_data(own) != jax.random.key_data(alone)).any()


@pytest.mark.long
@pytest.mark.parametrize("name", ["rain", "lost-echo", "time-jitter", "multipath"])
def test_what_is_drawn_stays_when_another_effect_comes(name):
    # Without a road only the noise is seen.
    noise = sim.ReceiverNoise(width_m=0.0)
    alone = rendered(dataclasses.replace(BARE, surface=None, effects=(noise,)))
    found = rendered(dataclasses.replace(BARE, surface=None, effects=(EFFECTS[name](), noise)))
    assert_array_equal(found.sweeps, alone.sweeps)


@pytest.mark.long
def test_two_effects_of_a_class_have_their_own_draws():
    bursts = sim.Interference(share=1.0)
    one = rendered(dataclasses.replace(BARE, surface=None, effects=(bursts,))).sweeps
    two = rendered(dataclasses.replace(BARE, surface=None, effects=(bursts, bursts))).sweeps
    assert np.mean(np.abs(two - 2 * one) > 1.0) > 0.1
    with pytest.raises(ValueError, match="may hold one `receiver-noise`; got two"):
        dataclasses.replace(BARE, effects=(sim.ReceiverNoise(), sim.ReceiverNoise()))


@pytest.mark.long
def test_the_same_seed_gives_the_same_drive():
    one, again, other = sim.simulate(STEPPED, 3), sim.simulate(STEPPED, 3), sim.simulate(STEPPED, 4)
    assert_array_equal(one.sensors[0].sweeps, again.sensors[0].sweeps)
    assert not np.array_equal(one.sensors[0].sweeps, other.sensors[0].sweeps)


@pytest.mark.long
def test_a_batch_is_each_scene_by_itself():
    one = sim.simulate(STEPPED, 3)
    higher = dataclasses.replace(STEPPED, road=(sim.StepUp(at_m=1.2, height_m=0.06),))
    batch = sim.simulate_batch([STEPPED, higher], [3, 3])
    assert_allclose(batch[0].sensors[0].sweeps, one.sensors[0].sweeps, rtol=1e-3, atol=1.0)
    assert batch[1].truth.steps[0].height_m == pytest.approx(0.06)
    with pytest.raises(ValueError, match="scene 1 differs from scene 0"):
        sim.simulate_batch([STEPPED, BARE], [0, 0])


def test_an_effect_of_no_stage_of_a_road_is_refused():
    with pytest.raises(TypeError, match=r"`Fog.stage` must be one of clock, surface.*; got 'air'"):
        type("Fog", (sim.RoadEffect,), {"name": "fog", "stage": "air", "explains": ""})

    class Glare(Effect):
        name, stage, explains = "glare", "field", ""

    # The tests' type checker would refuse it first; a user has none, so the scene's own check is called.
    scene = dataclasses.replace(BARE, effects=(sim.Rain(),))
    foreign = eqx.tree_at(lambda one: one.effects[0], scene, Glare())
    with pytest.raises(ValueError, match="takes effects of a road; got Glare"):
        foreign.__check_init__()


@pytest.mark.long
def test_scenes_mapped_over_are_the_scenes_one_by_one():
    scenes = [
        dataclasses.replace(BARE, duration_s=0.03, spacing_m=0.02, road=(sim.StepUp(at_m=0.3, height_m=height),))
        for height in (0.0, 0.03, 0.05)
    ]
    batch = jax.tree.map(lambda *leaves: np.stack(leaves), *scenes)
    plan, key = plan_scene(batch), jax.random.key(2)
    with jax.enable_x64(True):
        run = partial(render, plan)
        together = jax.jit(jax.vmap(run, in_axes=(0, None)))(batch, key).sweeps
        alone = jax.jit(run)
        for scene, sweeps in zip(scenes, np.asarray(together), strict=True):
            assert_allclose(sweeps, alone(scene, key).sweeps, rtol=1e-3, atol=1e-3 * sweeps.max())
    assert np.abs(together[1] - together[2]).max() > 0.1 * together.max()


def of_counts(values, saturated=False):
    """A record of one sweep."""
    values = np.asarray(values)[None]
    clock = Clock(np.zeros(1), np.zeros(1), np.ones(1, bool))
    return Rendered(clock, values, np.full(1, saturated), None, None)


def test_a_change_in_kind_matters_however_small():
    scene = dataclasses.replace(BARE, radar=sim.Radar(bins=4))
    counts = [100.0, 300.0, 200.0, 0.0]
    floats, whole = of_counts(np.float32(counts)), of_counts(np.uint16(counts))
    assert not _difference(floats, floats, scene).why(Tolerance())
    rounded = _difference(whole, floats, scene)
    assert rounded.level_db == -np.inf
    assert rounded.why(Tolerance()) == "the record holds uint16 for it and not float32"
    flagged = _difference(of_counts(np.float32(counts), saturated=True), floats, scene)
    assert flagged.level_db == -np.inf
    assert flagged.why(Tolerance()) == "100.0% of the sweeps are flagged for it"
    thinned = _difference(of_counts(np.float32(counts[::2])), floats, scene)
    assert thinned.why(Tolerance()) == "the record has other range bins for it"


@pytest.mark.parametrize("radius", [10.0, -10.0], ids=["left", "right"])
def test_in_a_bend_the_beam_leans_inwards(radius):
    """The body leans outwards; its underside, and a sensor that looks straight down, turn inwards by h times roll."""
    scene = dataclasses.replace(
        BARE,
        mount=sim.Mount(angle_deg=90.0),
        motion=sim.CarMotion(5.0, curve=sim.Curve(-1.0, 1.0, radius)),
        vehicle=sim.QuarterCar(roll_deg_per_m_s2=2.0),
        # So narrow that neither the surface nor the range law moves the largest echo.
        radar=sim.Radar(lateral_beam_deg=3.0, exponent=0.0),
    )
    with jax.enable_x64(True):
        across = np.linspace(-0.1, 0.1, 2001)

        @jax.jit
        def seen(scene):
            pose = jax.tree.map(lambda one: one[0], _pose(scene, jnp.zeros(1), jnp.full(1, 5.0), None))
            points = Points(jnp.asarray(across), jnp.ones(2001), jnp.zeros(2001))
            # No distance between points: all are abreast of the sensor.
            return pose.roll_rad, ground_paths(scene.radar, scene.surface, points, 0.0, (), False, pose).amplitude

        rolled, amplitude = seen(scene)
    roll = np.radians(2.0 * 5.0**2 / radius)
    assert rolled == pytest.approx(roll)
    assert across[np.argmax(amplitude)] == pytest.approx(0.35 * roll, abs=5e-4)


# -- hard cases ----------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_a_step_of_no_height_is_no_step():
    flat = dataclasses.replace(STEPPED, road=(sim.StepUp(at_m=1.2, height_m=0.0),))
    drive = sim.simulate(flat)
    assert drive.truth.steps == ()
    assert np.abs(drive.motion.acceleration_m_s2.values).max() < 1e-9
    assert_allclose(
        drive.sensors[0].sweeps, sim.simulate(dataclasses.replace(flat, road=())).sensors[0].sweeps, rtol=1e-3, atol=0.5
    )


@pytest.mark.long
@pytest.mark.parametrize(("speed", "at"), [(0.0, -0.15), pytest.param(0.0, 0.3, marks=pytest.mark.long), (-3.0, 0.0)])
def test_a_step_at_the_start_standing_and_in_reverse(speed, at):
    scene = dataclasses.replace(STEPPED, road=(sim.StepUp(at_m=at),), motion=sim.CarMotion(speed))
    drive = sim.simulate(scene)
    assert np.isfinite(drive.sensors[0].sweeps).all()
    assert np.isfinite(drive.motion.acceleration_m_s2.values).all()
    if speed == 0:
        assert drive.truth.steps == ()
        assert np.ptp(drive.sensors[0].sweeps, axis=0).max() == pytest.approx(
            0.0, abs=float(1e-3 * drive.sensors[0].sweeps.max())
        )


@pytest.mark.long
def test_backwards_over_a_step_is_a_step_down_and_the_left_wheel_is_first_at_a_slanted_edge():
    back = dataclasses.replace(STEPPED, road=(sim.StepUp(at_m=-0.5),), motion=sim.CarMotion(-3.0))
    (step,) = sim.simulate(back).truth.steps
    # The front axle, 0.15 m behind the sensor, rolls off the edge 0.35 m further back; the rear axle stands beyond it.
    assert step.impact_s == pytest.approx(0.35 / 3.0, abs=1e-3)
    assert (step.height_m, step.at_m) == (-0.04, -0.5)
    assert step.wheels_s[2:] == (None, None)

    slanted = dataclasses.replace(STEPPED, road=(sim.StepUp(at_m=1.2, oblique_deg=20.0),))
    (step,) = sim.simulate(slanted).truth.steps
    right, left = step.wheels_s[:2]
    assert right - left == pytest.approx(2 * 0.5 * np.tan(np.radians(20.0)) / (30 / 3.6), rel=1e-2)
    assert step.impact_s == left


@pytest.mark.parametrize("oblique_deg", [-35.0, 20.0])
def test_a_wheel_touches_an_oblique_step_when_it_first_rises(oblique_deg):
    element = sim.StepUp(at_m=1.2, oblique_deg=oblique_deg)
    (step,) = sim.simulate(dataclasses.replace(STEPPED, road=(element,))).truth.steps
    fine_s = np.arange(0.0, 0.7, 1e-4)
    axles, sides = (0.15, 0.15 + 1.6), (-0.5, 0.5)  # the right side has y < 0
    tracks = [(30 / 3.6 * fine_s - axle, np.full_like(fine_s, side)) for axle in axles for side in sides]
    with jax.enable_x64(True):
        x, y = (jnp.asarray(np.concatenate(one)) for one in zip(*tracks, strict=True))
        rolled = lambda road: wheel_height(lambda x, y: road_height(road, None, x, y), road, x, y, 0.2)  # noqa: E731
        height = jax.jit(rolled)((element,))
    rises = np.asarray(height).reshape(4, -1) > 1e-6
    assert_allclose(step.wheels_s, fine_s[rises.argmax(axis=1)], rtol=0, atol=2e-4)
    assert step.impact_s == min(step.wheels_s)
    assert (step.wheels_s[1] < step.wheels_s[0]) == (oblique_deg > 0)


def test_a_window_that_ends_before_the_road_is_silent():
    near = dataclasses.replace(BARE, radar=sim.Radar(start_m=0.05, bin_m=0.001, bins=64))
    assert rendered(near).sweeps.max() < 1e-3 * rendered(BARE).sweeps.max()


def test_an_empty_scene_is_silent_and_no_noise_is_none():
    empty = dataclasses.replace(BARE, surface=None)
    assert rendered(empty).sweeps.max() == 0
    quiet = dataclasses.replace(empty, effects=(sim.ReceiverNoise(sigma=0.0),))
    assert rendered(quiet).sweeps.max() == 0
    assert rendered(dataclasses.replace(BARE, duration_s=0.0)).sweeps.shape == (1, 128)


@pytest.mark.long
def test_a_pulse_narrower_than_a_bin():
    sharp = dataclasses.replace(BARE, radar=sim.Radar(fwhm_m=0.004), spacing_m=0.002)
    assert np.isfinite(rendered(sharp).sweeps).all()


def test_what_makes_no_sense_is_refused_at_construction():
    with pytest.raises(ValueError, match=r"Radar\(vertical_beam_deg=...\)` must be between 0.1"):
        sim.Radar(vertical_beam_deg=0.0)
    with pytest.raises(ValueError, match="higher than the sensor"):
        dataclasses.replace(BARE, road=(sim.StepUp(height_m=0.4),))
    with pytest.raises(ConfigError, match="scatterers"):
        plan_scene(dataclasses.replace(BARE, duration_s=100_000.0))
    standing = dataclasses.replace(BARE, motion=sim.CarMotion(0.0))
    with pytest.raises(ConfigError, match=r"12,800,000,000 amplitudes, .*: lower `duration_s`"):
        plan_scene(dataclasses.replace(standing, duration_s=1e6))
    with pytest.raises(ConfigError, match=r"moments, .*: shorten `duration_s`"):
        plan_scene(dataclasses.replace(standing, duration_s=1e6, radar=sim.Radar(rate_hz=1.0)))


def test_saturated_sweeps_are_flagged():
    loud = dataclasses.replace(BARE, effects=(sim.Gain(factor=100.0), sim.Saturation(), sim.Quantisation()))
    series = sim.simulate(loud).sensors[0]
    assert series.sweeps.dtype == np.uint16
    assert series.sweeps.max() <= 65535
    assert (series.flags == SweepFlag.SATURATED).all()
    assert (series.sweeps % 8 == 0).all()


@pytest.mark.long
def test_thinning_keeps_the_bins_that_the_labs_program_keeps():
    native = dataclasses.replace(BARE, radar=sim.Radar(bin_m=0.000484, bins=1446))
    whole, thin = (
        rendered(native).sweeps,
        sim.simulate(dataclasses.replace(native, effects=(sim.Thinning(),))).sensors[0],
    )
    assert_allclose(thin.sweeps, whole[:, 1446 * np.arange(128) // 128], rtol=1e-4, atol=0.05)
    assert_allclose(thin.range_m, 0.099768 + 0.000484 * 1446 / 128 * np.arange(128))


@pytest.mark.long
def test_running_average_is_the_recursion_across_blocks():
    scene = dataclasses.replace(BARE, duration_s=6.0, motion=sim.CarMotion(0.5))
    factor = 0.7
    plain = np.float64(rendered(scene).sweeps)
    wanted = [plain[0]]
    for sweep in plain[1:]:
        wanted.append(factor * wanted[-1] + (1 - factor) * sweep)
    smoothed = rendered(dataclasses.replace(scene, effects=(sim.RunningAverage(factor),))).sweeps
    assert_allclose(smoothed, wanted, rtol=1e-4, atol=1e-3 * plain.max())
