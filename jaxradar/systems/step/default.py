"""The detector to use: a step moves the whole echo, a fade or another patch of road does not."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from jaxradar._numerics import finite, first_argmax
from jaxradar._types import Counts, Flag, Flags, RawSweep, Scalar, Setting
from jaxradar.drive import FULL_SCALE
from jaxradar.signal.clutter import noise_floor
from jaxradar.signal.correlate import profile_shift
from jaxradar.signal.peaks import ArgMax, SoftArgmax, vertex
from jaxradar.systems.step.config import (
    Decision,
    MotionSample,
    RangeAxis,
    StepDetector,
    is_saturated,
    setting,
    shape_setting,
    usable,
)

__all__ = ["DefaultDetector", "DefaultState", "ProfileObservation"]


LONGEST_SILENCE = 5.0  # refractory times after which a detector speaks again whatever the evidence does


class ProfileObservation(eqx.Module):
    """One sweep, seen through the noise: `profile` holds the amplitudes over the floor, averaged over range cells
    whose centres are `centres_m`; `range_m` is the refined slant range of its strongest echo. `reach`: how many cells
    a trial shift goes either way."""

    profile: Counts
    centres_m: Counts
    range_m: Scalar
    strength: Scalar
    valid: Flag
    saturated: Flag
    reach: int = eqx.field(static=True)


class DefaultState(eqx.Module):
    """`reference`: the profile of the last moments, `reference_m` the range that the followed echo had in it.
    `range_m`: the followed echo now. `age_s`: time since the track began; `lost_s`: how long another echo has been
    clearly stronger; `gap_s`: time since the last valid sweep; `quiet_s`: time since the last detection."""

    reference: Counts
    reference_m: Scalar
    range_m: Scalar
    age_s: Scalar
    lost_s: Scalar
    gap_s: Scalar
    quiet_s: Scalar
    armed: Flag
    tracking: Flag


class DefaultDetector(StepDetector[ProfileObservation, DefaultState]):
    """Whole-profile shift test with a track that follows one echo.

    Each sweep is averaged into range cells, its noise floor estimated and taken away, and its strongest echo selected
    on these amplitudes, times (2r)^exponent, and refined on the raw ones. A sweep is valid if that echo stands out
    of the floor by two measures: against the floor's level (averaged sweeps, whose noise is smooth) and against its
    scatter (single sweeps, whose noise is rough). Single sweeps at full resolution, whose noise has the pulse's own
    width along range, look like weak echoes to both: there noise may pass as valid. Where the echo is strong, an
    `over_floor` of 1 or more keeps such noise out.

    The profile is then compared with a running mean of the profiles of the last `window_s`. Let u₀ be the share of
    its norm that the reference, freely scaled, leaves unexplained, and u₁ the same after the best shift: the statistic
    is u₀ − u₁. A fade leaves both at 0; two fixed patches that take turns as the maximum raise both; an echo that moves
    raises only u₀. Where even the best shift leaves more than `most_unexplained`, the profiles have nothing to do with
    each other (noise has not, from sweep to sweep) and there is no detection. Hysteresis and a refractory time make one
    detection of one step. A log with fewer than one sweep in `longest_gap_s` gives none.
    """

    name: ClassVar[str] = "default"
    statistic_name: ClassVar[str] = "evidence of a shift"
    statistic_unit: ClassVar[str] = "share of the profile"

    evidence: Setting = setting(
        0.16, 0.0, 1.0, "", "a shift must explain this share of the profile more than none does"
    )
    release: Setting = setting(0.08, 0.0, 1.0, "", "the evidence must fall below this before the next detection")
    most_unexplained: Setting = setting(0.5, 0.0, 1.1, "", "a shift that leaves more than this open explains nothing")
    least_shift_m: Setting = setting(0.006, 0.0, 1.0, "m", "a smaller shift is no step")
    window_s: Setting = setting(0.03, 1e-3, 10.0, "s", "time constant of the running mean a sweep is compared with")
    settle_s: Setting = setting(0.08, 0.0, 10.0, "s", "no detection so soon after a track has begun")
    refractory_s: Setting = setting(0.2, 0.0, 10.0, "s", "no second detection so soon after one")
    longest_gap_s: Setting = setting(0.3, 1e-3, 10.0, "s", "a longer time between valid sweeps begins a new track")
    over_floor: Setting = setting(0.58, 0.0, 100.0, "", "an echo must rise this many floor levels above the floor")
    over_scatter: Setting = setting(11.0, 0.0, 1e3, "", "and this many standard deviations of the floor's noise")
    exponent: Setting = setting(0.0, 0.0, 6.0, "", "the echo is selected on amplitudes times (2r)^exponent")
    temperature: Setting = setting(0.1, 1e-3, 10.0, "", "of the soft-argmax that refines the range")
    cell_m: float = shape_setting(0.0095, 1e-4, 1.0, "m", "size of a range cell")
    reach_m: float = shape_setting(0.12, 1e-3, 10.0, "m", "largest shift that is tried")
    pulse_m: float = shape_setting(0.04, 1e-3, 1.0, "m", "width of the window that refines the range, a pulse's width")

    @property
    def threshold(self) -> Setting:
        return self.evidence

    def observe(self, axis: RangeAxis, sweep: RawSweep, flags: Flags) -> ProfileObservation:
        amplitudes = finite(sweep)
        per_cell = self._bins_per_cell(axis)
        count = axis.bins // per_cell
        cells = amplitudes[: count * per_cell].reshape(count, per_cell).mean(axis=1)
        centres = jnp.asarray(axis.range_m)[: count * per_cell].reshape(count, per_cell).mean(axis=1)
        floor = noise_floor(cells)
        # Over three cells, about a third of an echo's width: one rough cell is not an echo.
        padded = jnp.pad(cells, 1, mode="edge")
        smooth = (padded[:-2] + padded[1:-1] + padded[2:]) / 3.0
        # The share of the floor that is taken away beyond it keeps its own unevenness out of the profile.
        profile = jnp.maximum(cells - 1.1 * floor.level, 0.0)
        selected = first_argmax(jnp.maximum(smooth - floor.level, 0.0) * (2.0 * centres) ** self.exponent)
        strength = jnp.maximum(smooth[selected] - floor.level, 0.0)
        half_width = max(1, round(0.5 * self.pulse_m / axis.bin_m))
        near = selected * per_cell + per_cell // 2
        refined = SoftArgmax(self.temperature, half_width=half_width)(amplitudes, near).position
        # The top of a saturated echo may be wider than the window: its middle is all that is known.
        clipped = jnp.max(amplitudes) == FULL_SCALE
        position = jnp.where(clipped, ArgMax()(amplitudes).position, refined)
        return ProfileObservation(
            profile=profile,
            centres_m=centres,
            range_m=axis.at(position),
            strength=strength,
            valid=usable(flags)
            & (strength > 0)
            & (strength > self.over_floor * floor.level)
            & (strength > self.over_scatter * floor.scatter),
            saturated=is_saturated(flags),
            reach=max(1, min(round(self.reach_m / (per_cell * axis.bin_m)), count - 1)),
        )

    def init(self, axis: RangeAxis) -> DefaultState:
        zero, no = jnp.zeros(()), jnp.zeros((), bool)
        cells = jnp.zeros(axis.bins // self._bins_per_cell(axis))
        return DefaultState(cells, zero, zero, zero, zero, zero, zero, ~no, no)

    def track(
        self, state: DefaultState, observation: ProfileObservation, motion: MotionSample | None, dt: Scalar
    ) -> tuple[DefaultState, Decision]:
        seen = observation.valid
        gap = state.gap_s + dt
        # Jittering times go back by a little, and then the reference still stands; a clock that was set does not.
        tracking = state.tracking & (jnp.abs(gap) <= self.longest_gap_s)
        fresh = seen & ~tracking
        compared = seen & tracking
        age = jnp.where(fresh, 0.0, state.age_s + jnp.maximum(dt, 0.0))

        cell = observation.centres_m[1] - observation.centres_m[0]
        shift = profile_shift(observation.profile, state.reference, observation.reach)
        shift_m = shift.cells * cell
        explained = shift.unexplained_still - shift.unexplained_moved
        moved = jnp.abs(shift_m) >= self.least_shift_m
        statistic = jnp.where(compared & moved, jnp.maximum(explained, 0.0), 0.0)

        quiet = state.quiet_s + jnp.maximum(dt, 0.0)
        ready = (age >= self.settle_s) & state.armed & (gap > 0)
        explains = shift.unexplained_moved <= self.most_unexplained
        event = compared & ready & explains & (statistic > self.evidence)
        # Motion that never stops would keep the evidence up: after a while it may speak again all the same.
        rested = (statistic < self.release) | (quiet >= LONGEST_SILENCE * self.refractory_s)
        rearmed = rested & (quiet >= self.refractory_s)

        stays = jnp.abs(observation.range_m - state.range_m) <= self.pulse_m
        carried = ~stays & (statistic > self.release)
        expected_m = jnp.where(carried, state.reference_m + shift_m, state.range_m)
        followed_m, lost = self._follow(observation, expected_m)
        # Forgotten as slowly as it was gathered: one sweep that looks like the old echo does not bring it back.
        passed = jnp.where(compared, jnp.maximum(gap, 0.0), 0.0)
        lost_s = jnp.maximum(state.lost_s + jnp.where(lost, passed, -passed), 0.0)
        # Another echo that stays stronger for long is the road now; taking it up is not a detection.
        taken_up = fresh | (lost_s > self.longest_gap_s)
        range_m = jnp.where(taken_up, observation.range_m, followed_m)
        range_m = jnp.where(seen, range_m, state.range_m)

        # The share of the newest sweep in a running mean of time constant window_s, whatever the sweep rate.
        share = jnp.where(compared, -jnp.expm1(-jnp.maximum(gap, 0.0) / self.window_s), jnp.where(seen, 1.0, 0.0))
        reference_m = jnp.where(seen & taken_up, range_m, state.reference_m + share * (range_m - state.reference_m))
        after = DefaultState(
            reference=state.reference + share * (observation.profile - state.reference),
            reference_m=reference_m,
            range_m=range_m,
            age_s=age,
            lost_s=jnp.where(taken_up, 0.0, lost_s),
            gap_s=jnp.where(seen, 0.0, gap),
            quiet_s=jnp.where(event, 0.0, quiet),
            armed=jnp.where(event, False, state.armed | rearmed),
            tracking=tracking | seen,
        )
        return after, Decision(
            range_m=range_m,
            # A running mean that takes in a share s each Δt is Δt/s behind a steady ramp, about window_s: the
            # difference over a window, not over one sweep.
            speed_m_s=jnp.where(
                compared & ~taken_up & (gap > 0),
                (range_m - state.reference_m) * share / jnp.where(gap > 0, gap, 1.0),
                0.0,
            ),
            strength=observation.strength,
            statistic=statistic,
            valid=seen,
            saturated=observation.saturated,
            event=event,
        )

    def _follow(self, observation: ProfileObservation, expected_m: Scalar) -> tuple[Scalar, Flag]:
        """The range of the echo nearest to where it is expected, and whether a far stronger one stands elsewhere."""
        near = jnp.abs(observation.range_m - expected_m) <= self.pulse_m
        profile, centres = observation.profile, observation.centres_m
        window = jnp.exp(-0.5 * ((centres - expected_m) / (0.5 * self.pulse_m)) ** 2)
        top = first_argmax(profile * window)
        # A peak in the first or last cell has one neighbour: counted twice, it puts the vertex on the cell.
        left, right = jnp.abs(top - 1), profile.shape[0] - 1 - jnp.abs(profile.shape[0] - 2 - top)
        offset, height = vertex(profile[left], profile[top], profile[right])
        local_m = centres[top] + offset * (centres[1] - centres[0])
        weak = height < 0.5 * jnp.max(profile)
        # What is left around a vanished echo is noise: the range is held until another is taken up.
        local_m = jnp.where(weak | (jnp.abs(local_m - expected_m) > self.pulse_m), expected_m, local_m)
        return jnp.where(near, observation.range_m, local_m), ~near & weak

    def _bins_per_cell(self, axis: RangeAxis) -> int:
        # At least two cells, or there is nothing to shift.
        return max(1, min(round(self.cell_m / axis.bin_m), axis.bins // 2))
