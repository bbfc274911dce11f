"""The car on its springs: heave and pitch while it rolls over the very road that its radar measures.

Both models are linear, so a step of time is one product with a matrix that is exact for inputs that change evenly
within it (first-order hold).
"""

from __future__ import annotations

import abc
import math
from typing import ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxradar._settings import Settings, setting
from jaxradar._types import Setting

__all__ = ["VEHICLES", "HalfCar", "QuarterCar", "Ride", "Vehicle", "ride"]

MOMENTS = 32  # moments of a ride that are worked out at once

Times = Float[Array, " times"]


class Ride(NamedTuple):
    """Of the body over time: rise and rate of rise of the sensor (m, m/s), pitch (rad, nose up), vertical acceleration
    of the body over the front axle and of the front wheels (m/s²)."""

    rise_m: Times
    rise_m_s: Times
    pitch_rad: Times
    body_m_s2: Times
    wheel_m_s2: Times


class System(NamedTuple):
    """x' = A x + B u with u = (road under the front wheels in m, under the rear wheels in m, acceleration along the
    path in m/s²); `rise` and `pitch` pick sensor rise and pitch out of x, `body` and `wheel` the velocities of which
    the accelerations are wanted."""

    a: Float[Array, "states states"]
    b: Float[Array, "states inputs"]
    rise: Float[Array, " states"]
    pitch: Float[Array, " states"]
    body: Float[Array, " states"]
    wheel: Float[Array, " states"]


class Vehicle(Settings):
    """What both models share. Defaults are a small electric car's (200 kg, 2.5 m: the thesis's); all assumed."""

    name: ClassVar[str]

    tyre_radius_m: Setting = setting(0.20, 0.02, 1.0, "m", "of the wheels")
    half_track_m: Setting = setting(0.5, 0.0, 2.0, "m", "from the middle of the car to its wheels")
    wheelbase_m: Setting = setting(1.6, 0.1, 10.0, "m", "from the front axle to the rear one")
    lever_m: Setting = setting(1.0, -5.0, 5.0, "m", "how far the sensor lies ahead of the centre of pitch")
    roll_deg_per_m_s2: Setting = setting(0.5, 0.0, 10.0, "°/(m/s²)", "roll for each m/s² across the path, outwards")

    @abc.abstractmethod
    def system(self) -> System:
        """Its equations of motion, in the precision that is set."""


class QuarterCar(Vehicle):
    """One corner of the car for heave, and a pitch of its own that follows the acceleration along the path.

    m_s z_s'' = −k_s (z_s − z_u) − c_s (z_s' − z_u'), m_u z_u'' = k_s (z_s − z_u) + c_s (z_s' − z_u') − k_t (z_u − z_r).
    Pitch is a damped oscillation about `pitch_deg_per_m_s2` times the acceleration (thesis, 6.3: 0.68° at 2 m/s²).
    """

    name: ClassVar[str] = "quarter-car"

    body_kg: Setting = setting(55.0, 1.0, 1e4, "kg", "of the body on one wheel")
    wheel_kg: Setting = setting(11.0, 0.1, 1e3, "kg", "of one wheel")
    spring_n_m: Setting = setting(7e3, 1.0, 1e7, "N/m", "of the suspension")
    damper_n_s_m: Setting = setting(370.0, 0.0, 1e6, "N s/m", "of the suspension")
    tyre_n_m: Setting = setting(80e3, 1.0, 1e8, "N/m", "of the tyre")
    pitch_deg_per_m_s2: Setting = setting(0.34, 0.0, 5.0, "°/(m/s²)", "pitch when pulling away, at rest")
    pitch_hz: Setting = setting(1.6, 0.1, 20.0, "Hz", "of the pitch oscillation")
    pitch_damping: Setting = setting(0.3, 0.0, 2.0, "", "of it, as a share of critical")

    def system(self) -> System:
        ms, mu, ks, cs, kt = (
            jnp.asarray(one, jnp.result_type(float))
            for one in (self.body_kg, self.wheel_kg, self.spring_n_m, self.damper_n_s_m, self.tyre_n_m)
        )
        turn = 2.0 * math.pi * jnp.asarray(self.pitch_hz, ms.dtype)
        damping = jnp.asarray(self.pitch_damping, ms.dtype)
        per_m_s2 = jnp.asarray(self.pitch_deg_per_m_s2, ms.dtype) * (math.pi / 180.0)
        zero = jnp.zeros_like(ms)
        # States: body, wheel, pitch, and their rates.
        rows = [
            [-ks / ms, ks / ms, zero, -cs / ms, cs / ms, zero],
            [ks / mu, -(ks + kt) / mu, zero, cs / mu, -cs / mu, zero],
            [zero, zero, -(turn**2), zero, zero, -2.0 * damping * turn],
        ]
        inputs = [[zero, zero, zero], [kt / mu, zero, zero], [zero, zero, turn**2 * per_m_s2]]
        lever = jnp.asarray(self.lever_m, ms.dtype)
        return _system(rows, inputs, rise=[1.0, 0.0, lever], pitch=[0.0, 0.0, 1.0], body=[1.0, 0.0, 0.0], wheel=1)


class HalfCar(Vehicle):
    """Front and rear axle under one body that heaves and pitches; pulling away and braking pitch it by the height of
    its centre of mass. Masses and springs are those of one side. (Gillespie, Fundamentals of Vehicle Dynamics, chapter
    5.)
    """

    name: ClassVar[str] = "half-car"

    body_kg: Setting = setting(110.0, 1.0, 1e4, "kg", "of one side of the body")
    inertia_kg_m2: Setting = setting(70.4, 0.1, 1e5, "kg m²", "of it about the pitch axis")
    front_share: Setting = setting(0.5, 0.05, 0.95, "", "share of the weight on the front axle")
    wheel_kg: Setting = setting(11.0, 0.1, 1e3, "kg", "of one wheel")
    spring_n_m: Setting = setting(7e3, 1.0, 1e7, "N/m", "of the suspension of one wheel")
    damper_n_s_m: Setting = setting(370.0, 0.0, 1e6, "N s/m", "of the suspension of one wheel")
    tyre_n_m: Setting = setting(80e3, 1.0, 1e8, "N/m", "of the tyre")
    mass_height_m: Setting = setting(0.45, 0.0, 3.0, "m", "of the centre of mass over the road")

    def system(self) -> System:
        m, inertia, mu, ks, cs, kt = (
            jnp.asarray(one, jnp.result_type(float))
            for one in (
                self.body_kg,
                self.inertia_kg_m2,
                self.wheel_kg,
                self.spring_n_m,
                self.damper_n_s_m,
                self.tyre_n_m,
            )
        )
        base = jnp.asarray(self.wheelbase_m, m.dtype)
        # The centre of mass lies nearer to the axle that carries more.
        ahead, behind = base * (1.0 - self.front_share), base * self.front_share
        zero = jnp.zeros_like(m)
        # States: body at the centre of mass, pitch, front wheel, rear wheel, and their rates.
        stiff = _coupling(m, inertia, mu, ahead, behind, ks, kt)
        damp = _coupling(m, inertia, mu, ahead, behind, cs, zero)
        rows = [[*first, *second] for first, second in zip(stiff, damp, strict=True)]
        moment = m * jnp.asarray(self.mass_height_m, m.dtype) / inertia
        inputs = [[zero, zero, zero], [zero, zero, moment], [kt / mu, zero, zero], [zero, kt / mu, zero]]
        lever = jnp.asarray(self.lever_m, m.dtype)
        return _system(
            rows,
            inputs,
            rise=[1.0, lever, 0.0, 0.0],
            pitch=[0.0, 1.0, 0.0, 0.0],
            body=[1.0, ahead, 0.0, 0.0],
            wheel=2,
        )


def _coupling(m, inertia, mu, ahead, behind, k, ground):  # type: ignore[no-untyped-def]
    """Accelerations of (body, pitch, front wheel, rear wheel) by each of these four, through springs `k` between body
    and wheels and `ground` below the wheels."""
    return [
        [-2 * k / m, -k * (ahead - behind) / m, k / m, k / m],
        [
            -k * (ahead - behind) / inertia,
            -k * (ahead**2 + behind**2) / inertia,
            k * ahead / inertia,
            -k * behind / inertia,
        ],
        [k / mu, k * ahead / mu, -(k + ground) / mu, 0 * k],
        [k / mu, -k * behind / mu, 0 * k, -(k + ground) / mu],
    ]


def _system(rows, inputs, rise, pitch, body, wheel: int) -> System:  # type: ignore[no-untyped-def]
    """Puts the rows of the accelerations below those that say that a rate is a rate."""
    count = len(rows)
    accelerations = jnp.stack([jnp.stack([jnp.asarray(one) for one in row]) for row in rows])
    dtype = accelerations.dtype
    places = jnp.concatenate([jnp.zeros((count, count), dtype), jnp.eye(count, dtype=dtype)], axis=1)
    driven = jnp.stack([jnp.stack(row) for row in inputs])
    still = jnp.zeros(count, dtype)
    as_row = lambda parts: jnp.stack([jnp.asarray(one, dtype) for one in parts])  # noqa: E731
    return System(
        jnp.concatenate([places, accelerations]),
        jnp.concatenate([jnp.zeros_like(driven), driven]),
        rise=jnp.concatenate([as_row(rise), still]),
        pitch=jnp.concatenate([as_row(pitch), still]),
        body=jnp.concatenate([still, as_row(body)]),
        wheel=jnp.concatenate([still, jnp.eye(count, dtype=dtype)[wheel]]),
    )


def ride(system: System, inputs: Float[Array, "times inputs"], step_s: float) -> Ride:
    """The answer to inputs `step_s` apart, from rest on the road as it is at the first of them.

    First-order hold: x₊ = Φ x + Γ₀ u + Γ₁ (u₊ − u), all three out of one matrix exponential (Franklin, Powell and
    Workman, Digital Control of Dynamic Systems, section 4.3).
    """
    states, count = system.b.shape
    dtype = system.a.dtype
    whole = jnp.zeros((states + 2 * count, states + 2 * count), dtype)
    whole = whole.at[:states, :states].set(system.a * step_s)
    whole = whole.at[:states, states : states + count].set(system.b * step_s)
    whole = whole.at[states : states + count, states + count :].set(jnp.eye(count, dtype=dtype))
    power = jax.scipy.linalg.expm(whole)
    phi, hold, slope = (
        power[:states, :states],
        power[:states, states : states + count],
        power[:states, states + count :],
    )
    start = -jnp.linalg.solve(system.a, system.b @ inputs[0])
    pushes = inputs[:-1] @ hold.T + (inputs[1:] - inputs[:-1]) @ slope.T
    states_over_time = _recurrence(phi, start, pushes)
    rates = states_over_time @ system.a.T + inputs @ system.b.T
    pick = lambda row, values: values @ row  # noqa: E731
    return Ride(
        pick(system.rise, states_over_time),
        pick(system.rise, rates),
        pick(system.pitch, states_over_time),
        pick(system.body, rates),
        pick(system.wheel, rates),
    )


def _recurrence(
    phi: Float[Array, "states states"], start: Float[Array, " states"], pushes: Float[Array, "steps states"]
) -> Float[Array, "times states"]:
    """x₊ = Φ x + p from `start` on, `MOMENTS` steps at a time: what the pushes of a block do within it is one product
    with the powers of Φ, so that only the states between blocks wait for each other."""
    steps, states = pushes.shape
    blocks = -(-steps // MOMENTS)
    pushes = jnp.pad(pushes, ((0, blocks * MOMENTS - steps), (0, 0))).reshape(blocks, MOMENTS, states)
    unit = jnp.eye(states, dtype=phi.dtype)
    _, powers = jax.lax.scan(lambda power, _: (phi @ power, power), unit, length=MOMENTS + 1)
    age = np.subtract.outer(np.arange(MOMENTS), np.arange(MOMENTS))
    answers = jnp.where((age >= 0)[:, :, None, None], powers[np.maximum(age, 0)], 0.0)
    forced = jnp.einsum("kjab,mjb->mka", answers, pushes)

    def step(state: Array, last: Array) -> tuple[Array, Array]:
        return powers[-1] @ state + last, state

    _, begins = jax.lax.scan(step, start, forced[:, -1])
    after = jnp.einsum("kab,mb->mka", powers[1:], begins) + forced
    return jnp.concatenate([start[None], after.reshape(blocks * MOMENTS, states)[:steps]])


VEHICLES: dict[str, type[Vehicle]] = {kind.name: kind for kind in (QuarterCar, HalfCar)}
