"""What the approach detector sees of one sweep and remembers from one to the next, and the shapes of its arrays."""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

__all__ = [
    "Alarm",
    "ApproachObservation",
    "ApproachState",
    "Bank",
    "Cells",
    "CornerTrack",
    "Echoes",
    "Gathered",
    "Numbers",
    "Places",
    "Seen",
    "Speeds",
    "Told",
    "Tracks",
    "Truths",
    "over",
]

# Of one log, or of many side by side as a last axis.
Cells = Float[Array | np.ndarray, "cells *logs"]
Bank = Float[Array | np.ndarray, "speeds places *logs"]
Places = Float[Array | np.ndarray, "places *logs"]
Speeds = Float[Array | np.ndarray, "speeds *logs"]
Numbers = Float[Array | np.ndarray, "*logs"]
Truths = Bool[Array | np.ndarray, "*logs"]


class ApproachObservation(eqx.Module):
    """One sweep as the mean amplitudes of range cells, in counts; `strength`: the largest of them."""

    cells: Cells
    strength: Numbers
    valid: Truths
    saturated: Truths


class Echoes(eqx.Module):
    """`power`: running mean square of each cell, `mean`: running mean, `noise`: power of the noise among them;
    `stands`: whether the car does, by these. `age_s`: time since the track began or the car
    last stood, `gap_s`: since the last valid sweep. `tracking`: whether there is anything to go on from; `stood`:
    whether the car has stood since."""

    power: Cells
    mean: Cells
    noise: Numbers
    stands: Truths
    age_s: Numbers
    gap_s: Numbers
    tracking: Truths
    stood: Truths


class Gathered(eqx.Module):
    """`evidence`: of each track, by speed and place; `travel`: how far each speed has gone on since its evidence was
    moved, in places."""

    evidence: Bank
    travel: Speeds


class Alarm(eqx.Module):
    """`quiet_s`: time since the last detection; `armed`: whether the evidence has been low since then."""

    quiet_s: Numbers
    armed: Truths


class ApproachState(eqx.Module):
    """What is remembered of the echoes, of the tracks, and of the detections; none but the last looks at it."""

    echoes: Echoes
    gathered: Gathered
    alarm: Alarm


class Seen(NamedTuple):
    """One sweep beside those before it: the mean square of each cell before it, the power of the noise; `goes_on`:
    whether it is later than another of its track, and how much; `counts`: whether it adds to the evidence; `settled`:
    whether a detection may follow."""

    power: Cells
    noise: Numbers
    goes_on: Truths
    counts: Truths
    elapsed_s: Numbers
    settled: Truths


class CornerTrack(NamedTuple):
    """The track with the most evidence: how far ahead of the sensor's foot the corner is, its slant range, and the
    speed at which it closes in."""

    ahead_m: Numbers
    range_m: Numbers
    speed_m_s: Numbers


class Told(NamedTuple):
    """What of a sweep a decision hangs on beside the evidence."""

    strength: Numbers
    valid: Truths
    saturated: Truths
    counts: Truths
    settled: Truths

    @classmethod
    def of(cls, observation: ApproachObservation, seen: Seen) -> Told:
        return cls(observation.strength, observation.valid, observation.saturated, seen.counts, seen.settled)


class Tracks(NamedTuple):
    """What of a bank does not change. `at` picks the places out of the cells, between the two that are nearest, and
    `around` means over the cells around them, as products: what picks rows one by one is slower. `tilt` and `cost` are
    γ and c(γ) there, `inside` whether the sensor sees it; `far`: the cells where what
    stands straight below does not show."""

    ahead_m: Places
    at: Float[Array, "places cells"]
    around: Float[Array, "places cells"]
    tilt: Places
    cost: Places
    inside: Truths
    far: Truths
    speeds: Speeds


def over(values: Array | np.ndarray, logs: Numbers) -> Array:
    """Values along a first axis, the same for all logs."""
    return jnp.asarray(values).reshape(-1, *[1] * logs.ndim)
