"""What the shift detector sees of one sweep, and what it remembers from one to the next."""

from __future__ import annotations

import equinox as eqx

from jaxradar._types import Counts, Flag, Index, Scalar
from jaxradar.signal.clutter import NoiseFloor

__all__ = [
    "Evidence",
    "Followed",
    "Memory",
    "ProfileObservation",
    "Recalled",
    "SelectedEcho",
    "ShiftState",
]


class ProfileObservation(eqx.Module):
    """One sweep, seen through the noise: `profile` holds the amplitudes over the floor, averaged over range cells,
    `highest` the largest of them; `range_m` is the refined slant range of its strongest echo."""

    profile: Counts
    highest: Scalar
    range_m: Scalar
    strength: Scalar
    valid: Flag
    saturated: Flag


class SelectedEcho(eqx.Module):
    """The strongest echo of one sweep, found on cells: the bin to look `near`. `highest`: of the profile."""

    profile: Counts
    highest: Scalar
    near: Index
    strength: Scalar
    floor: NoiseFloor


class Memory(eqx.Module):
    """`reference`: the profile of the last moments; `gap_s`: time since the last valid sweep; `tracking`: whether
    there is a reference to compare with."""

    reference: Counts
    gap_s: Scalar
    tracking: Flag


class Recalled(eqx.Module):
    """What one sweep is to be held against: the memory before it, and the `share` that it has in the memory after.
    `gap_s`: time since the last valid sweep; `compared`: whether there is something to compare it with; `fresh`:
    whether a track begins with it."""

    reference: Counts
    gap_s: Scalar
    share: Scalar
    compared: Flag
    fresh: Flag


class Evidence(eqx.Module):
    """`statistic`: what a shift explains more than none, 0 where it is too small; `explained`: the same
    of any shift; `explains`: whether it explains enough. `expected_m`: where the followed echo should be, in the range
    cell `cell`."""

    statistic: Scalar
    explained: Scalar
    explains: Flag
    expected_m: Scalar
    cell: Index


class Followed(eqx.Module):
    """`range_m`: the followed echo now; `reference_m`: its range in the memory's profile. `age_s`: time since the
    track began; `lost_s`: how long another echo has been clearly stronger; `quiet_s`: time since the last detection;
    `still_s`: how long the evidence has been low, `jumping_s`: since it rose out of such stillness; `armed`: whether
    the evidence has been low since the last detection."""

    range_m: Scalar
    reference_m: Scalar
    age_s: Scalar
    lost_s: Scalar
    quiet_s: Scalar
    still_s: Scalar
    jumping_s: Scalar
    armed: Flag


class ShiftState(eqx.Module):
    """What is remembered of the profiles, and of the echo that is followed in them. The second never changes the
    first, so that a block of sweeps is compared with its references all at once."""

    memory: Memory
    echo: Followed
