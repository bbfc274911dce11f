"""Gradients of whole scenes against central differences, in float64."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxradar import sim
from jaxradar.sim.road.effects import EFFECTS
from jaxradar.sim.road.plan import plan_scene
from jaxradar.sim.road.render import render

SMOOTH = [name for name, kind in EFFECTS.items() if kind.smooth and kind.stage != "axis"]
NOISE = sim.ReceiverNoise()
ROADS = {
    "even": (),
    "step": (sim.StepUp(at_m=0.6),),
    "step behind": (sim.StepUp(at_m=0.05),),
    "oblique": (sim.StepUp(at_m=0.6, oblique_deg=20.0),),
    "step down": (sim.StepDown(at_m=0.5),),
    "kerb": (sim.Kerb(at_m=0.6),),
    "hump": (sim.SinusoidalHump(at_m=0.1),),
    "flat top": (sim.FlatTopHump(at_m=0.1),),
    "pothole": (sim.Pothole(at_m=0.4, along_m=0.3),),
}
WHERE = {
    "height": lambda scene: scene.mount.height_m,
    "speed": lambda scene: scene.motion.speed_m_s,
    "angle": lambda scene: scene.mount.angle_deg,
    "noise": lambda scene: scene.effects[0].sigma,
}
# The scene's scale of each: the gradient is compared as a change by so much.
SCALE = {"height": 1e-3, "speed": 0.01, "angle": 1.0, "noise": 10.0}


def check(scene, names=tuple(WHERE)):
    """Each gradient agrees with the central difference to 1e-4 of it."""
    plan = plan_scene(scene)
    random = np.random.default_rng(1)
    weights = jnp.asarray(random.normal(size=(plan.sweeps, 1)) + random.normal(size=(plan.sweeps, scene.radar.bins)))
    with jax.enable_x64(True):

        @jax.jit
        def value(changes):
            moved = scene
            for name, change in zip(names, changes, strict=True):
                moved = eqx.tree_at(WHERE[name], moved, jnp.asarray(WHERE[name](scene)) + change * SCALE[name])
            sweeps = render(plan, moved, jax.random.key(1), jnp.float64).sweeps
            return jnp.sum(weights * sweeps)

        zero = jnp.zeros(len(names))
        found = jax.jit(jax.grad(value))(zero)
        for place, name in enumerate(names):
            best = np.inf
            for step in (1e-3, 1e-4, 1e-5):
                ahead = value(zero.at[place].set(step))
                back = value(zero.at[place].set(-step))
                wanted = float(ahead - back) / (2 * step)
                best = min(best, abs(float(found[place]) - wanted) / max(abs(wanted), 1e-6))
            assert best < 1e-4, (name, float(found[place]), wanted)


@pytest.mark.long
@pytest.mark.parametrize("road", ROADS)
def test_gradients_over_every_element(road):
    check(sim.RoadScene(duration_s=0.03, road=ROADS[road], effects=(NOISE,)))


@pytest.mark.long
@pytest.mark.parametrize("name", SMOOTH)
def test_gradients_through_every_smooth_effect(name):
    effects = (NOISE,) if name == NOISE.name else (NOISE, EFFECTS[name]())
    check(sim.RoadScene(duration_s=0.03, road=ROADS["step"], effects=effects))


@pytest.mark.long
@pytest.mark.parametrize("vehicle", [sim.QuarterCar(), sim.HalfCar()], ids=lambda one: one.name)
def test_gradients_through_the_suspension(vehicle):
    # The wheels are on the step while the sweeps are taken.
    check(sim.RoadScene(duration_s=0.03, road=(sim.StepUp(at_m=-0.1),), vehicle=vehicle, effects=(NOISE,)))


@pytest.mark.long
def test_gradients_in_a_bend_and_while_pulling_away():
    motion = sim.CarMotion(3.0, (sim.SpeedChange(-0.5, 8.0, 2.0),), sim.Curve(-1.0, 2.0))
    check(
        sim.RoadScene(
            duration_s=0.03, motion=motion, vehicle=sim.QuarterCar(), mount=sim.Mount(lateral_m=0.3), effects=(NOISE,)
        )
    )


def test_effects_without_a_gradient_say_so():
    without = {name for name, kind in EFFECTS.items() if not kind.smooth}
    assert without == {"saturation", "quantisation", "dropped-sweeps", "cpu-clock", "accelerometer"}
