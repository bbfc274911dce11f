"""A shift of the whole echo: a step moves all of it, a fade or another patch of road does not."""

from __future__ import annotations

import math
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float, UInt

from jaxradar._numerics import finite, first_argmax, largest, value_at
from jaxradar._settings import bounded, setting, shape_setting
from jaxradar._types import Counts, Flag, Flags, Index, RawSweep, Scalar, Setting, Sweep
from jaxradar.drive import FULL_SCALE
from jaxradar.signal.cells import strongest_cell
from jaxradar.signal.clutter import noise_floor, subtract_floor
from jaxradar.signal.correlate import ProfileShift, profile_shift
from jaxradar.signal.peaks import ArgMax, vertex, window_at
from jaxradar.signal.pulse_fit import NARROWEST, PulseFit
from jaxradar.systems.step.config import (
    BlockSweeps,
    Decision,
    MotionSample,
    RangeAxis,
    StepDetector,
    is_saturated,
    usable,
)
from jaxradar.systems.step.shift_block import follow_block
from jaxradar.systems.step.shift_states import (
    Evidence,
    Followed,
    Memory,
    ProfileObservation,
    Recalled,
    SelectedEcho,
    ShiftState,
)

__all__ = ["ShiftDetector"]

FAR_S = 1e6  # a time ago that is none
LONGEST_SILENCE = 5.0  # refractory times after which a detector speaks again whatever the evidence does


class ShiftDetector(StepDetector[ProfileObservation, ShiftState]):
    """Whole-profile shift test with a track that follows one echo.

    Each sweep is averaged into range cells, its noise floor estimated and taken away, and its strongest echo selected
    on these amplitudes, times (2r)^exponent, and refined on the raw ones. A sweep is valid if that echo stands out
    of the floor by two measures: against the floor's level (averaged sweeps, whose noise is smooth) and against its
    scatter (single sweeps, whose noise is rough). Single sweeps at full resolution, whose noise has the pulse's own
    width along range, look like weak echoes to both: there noise may pass as valid. Where the echo is strong, an
    `over_floor` of 1 or more keeps such noise out.

    The range is refined by the `PulseFit` that `jaxradar frontier range --case "recorded 40 dB"` shows as the default:
    in noise as recorded, which is as smooth as the echo, a template of a third of its width is near the bound.

    The profile is then compared with a running mean of the profiles of the last `window_s`. Let u₀ be the share of
    its norm that the reference, freely scaled, leaves unexplained, and u₁ the same after the best shift: the statistic
    is u₀ − u₁. A fade leaves both at 0; two fixed patches that take turns as the maximum raise both; an echo that moves
    raises only u₀. Where even the best shift leaves more than `most_unexplained`, the profiles have nothing to do with
    each other (noise has not, from sweep to sweep) and there is no detection. Hysteresis and a refractory time make one
    detection of one step. A log with fewer than one sweep in `longest_gap_s` gives none.
    """

    name: ClassVar[str] = "shift"
    statistic_name: ClassVar[str] = "evidence of a shift"
    statistic_unit: ClassVar[str] = "share of the profile"

    evidence: Setting = setting(
        0.16, 0.0, 1.0, "", "a shift must explain this share of the profile more than none does"
    )
    release: Setting = setting(0.08, 0.0, 1.0, "", "the evidence must fall below this before the next detection")
    most_unexplained: Setting = setting(0.5, 0.0, 1.1, "", "a shift that leaves more than this open explains nothing")
    most_left: Setting = setting(1e3, 0.0, 1e3, "", "nor does one that leaves so many times what it explains")
    least_shift_m: Setting = setting(0.006, 0.0, 1.0, "m", "a smaller shift is no step")
    window_s: Setting = setting(0.03, 1e-3, 10.0, "s", "time constant of the running mean a sweep is compared with")
    settle_s: Setting = setting(0.08, 0.0, 10.0, "s", "no detection so soon after a track has begun")
    refractory_s: Setting = setting(0.2, 0.0, 10.0, "s", "no second detection so soon after one")
    longest_gap_s: Setting = setting(0.3, 1e-3, 10.0, "s", "a longer time between valid sweeps begins a new track")
    still_s: Setting = setting(0.0, 0.0, 10.0, "s", "a step is a jump after so long a stillness; 0: or at any time")
    restless: Setting = setting(0.5, 0.0, 1.0, "", "still is evidence below this share of what makes a detection")
    sudden_s: Setting = setting(0.012, 0.0, 10.0, "s", "and a jump has no more than this from there to a detection")
    over_floor: Setting = setting(0.58, 0.0, 100.0, "", "an echo must rise this many floor levels above the floor")
    over_scatter: Setting = setting(11.0, 0.0, 1e3, "", "and this many standard deviations of the floor's noise")
    exponent: Setting = setting(0.0, 0.0, 6.0, "", "the echo is selected on amplitudes times (2r)^exponent")
    template_m: Setting = setting(0.02, 1e-3, 1.0, "m", "width of the Gaussian that refines the range")
    steps_down: bool = shape_setting(True, 0, 1, "", "an echo that moves away is a step too: one down")
    cell_m: float = shape_setting(0.02, 2e-3, 1.0, "m", "size of a range cell")
    reach_m: float = shape_setting(0.12, 1e-3, 10.0, "m", "largest shift that is tried")
    window_m: float = shape_setting(0.06, 1e-3, 1.0, "m", "width of the window that refines the range")
    pulse_m: float = shape_setting(0.04, 1e-3, 1.0, "m", "echoes closer than this are one, a pulse's width")

    @property
    def threshold(self) -> Setting:
        return self.evidence

    def with_threshold(self, value: float) -> ShiftDetector:
        return bounded(self, evidence=value, release=float(self.release) * value / float(self.evidence))

    def observe(self, axis: RangeAxis, sweep: RawSweep, flags: Flags) -> ProfileObservation:
        selected = self.select(axis, self.averaged(axis, finite(sweep)))
        refined = self.refine(axis, selected.near, *self.estimator(axis).read(sweep, selected.near))
        # The top of a saturated echo may be wider than the window: its middle is all that is known.
        clipped, middle = self.clipped_top(sweep, flags)
        return self.observed(axis, selected, jnp.where(clipped, middle, refined), flags)

    def clipped_top(self, sweep: RawSweep, flags: Flags) -> tuple[Flag, Scalar]:
        """Whether the sensor or the reader says that a sweep is saturated, and it is; and the middle of its top."""
        top = ArgMax()(sweep)
        return is_saturated(flags) & (top.amplitude >= FULL_SCALE), top.position

    def select(self, axis: RangeAxis, cells: Counts) -> SelectedEcho:
        """The strongest echo of one sweep over its own noise floor."""
        centres, _ = self.centres(axis)
        floor = noise_floor(cells)
        middle, strength = strongest_cell(cells, floor.level, (2.0 * centres) ** self.exponent)
        profile = subtract_floor(cells, floor.level)
        # The largest of the profile, without going through it again.
        highest = subtract_floor(largest(cells)[None], floor.level)[0]
        near = jnp.round(middle * self._bins_per_cell(axis) - 0.5).astype(jnp.int32)
        return SelectedEcho(profile, highest, near, strength, floor)

    def estimator(self, axis: RangeAxis) -> PulseFit:
        """What refines the range of the selected echo."""
        fwhm = jnp.maximum(jnp.asarray(self.template_m, float) / axis.bin_m, NARROWEST)
        return PulseFit(fwhm, max(1, round(0.5 * self.window_m / axis.bin_m)), self._bins_per_cell(axis))

    def refine(self, axis: RangeAxis, near: Index, start: Index, taps: RawSweep) -> Scalar:
        """Its place in bins, out of the amplitudes around it, which begin with the bin `start`."""
        return self.estimator(axis).place(near, start, taps).position

    def observed(self, axis: RangeAxis, echo: SelectedEcho, position: Scalar, flags: Flags) -> ProfileObservation:
        """What is known of one sweep without those before it."""
        return ProfileObservation(
            profile=echo.profile,
            highest=echo.highest,
            range_m=axis.at(position),
            strength=echo.strength,
            valid=usable(flags)
            & (echo.strength > 0)
            & (echo.strength > self.over_floor * echo.floor.level)
            & (echo.strength > self.over_scatter * echo.floor.scatter),
            saturated=is_saturated(flags),
        )

    def init(self, axis: RangeAxis) -> ShiftState:
        zero, far, no = jnp.zeros(()), jnp.asarray(FAR_S, float), jnp.zeros((), bool)
        nothing = jnp.zeros(axis.bins // self._bins_per_cell(axis))
        return ShiftState(Memory(nothing, zero, no), Followed(zero, zero, zero, zero, zero, far, far, ~no))

    def track(
        self,
        axis: RangeAxis,
        state: ShiftState,
        observation: ProfileObservation,
        motion: MotionSample | None,
        dt: Scalar,
    ) -> tuple[ShiftState, Decision]:
        memory, recalled = self.remember(state.memory, observation, dt)
        shift = self.compare(axis, observation, recalled)
        evidence = self.weigh(axis, state.echo, observation, recalled, shift)
        around = window_at(observation.profile, evidence.cell, self.search_half_width(axis))
        echo, decision = self.decide(axis, state.echo, observation, recalled, evidence, around, dt)
        return ShiftState(memory, echo), decision

    def follow(
        self,
        axis: RangeAxis,
        state: ShiftState,
        sweeps: BlockSweeps,
        flags: UInt[Array, "logs sweeps"],
        dt: Float[Array, "logs sweeps"],
        motion: MotionSample | None = None,
    ) -> tuple[ShiftState, Decision]:
        return follow_block(self, axis, state, sweeps, flags, dt)

    def remember(self, memory: Memory, observation: ProfileObservation, dt: Scalar) -> tuple[Memory, Recalled]:
        """The running mean after this sweep, and what this sweep is to be held against."""
        seen = observation.valid
        gap = memory.gap_s + dt
        # Jittering times go back by a little, and then the reference still stands; a clock that was set does not.
        tracking = memory.tracking & (jnp.abs(gap) <= self.longest_gap_s)
        compared = seen & tracking
        # The share of the newest sweep in a running mean of time constant window_s, whatever the sweep rate.
        share = jnp.where(compared, -jnp.expm1(-jnp.maximum(gap, 0.0) / self.window_s), jnp.where(seen, 1.0, 0.0))
        after = Memory(
            reference=memory.reference + share * (observation.profile - memory.reference),
            gap_s=jnp.where(seen, 0.0, gap),
            tracking=tracking | seen,
        )
        return after, Recalled(memory.reference, gap, share, compared, seen & ~tracking)

    def compare(self, axis: RangeAxis, observation: ProfileObservation, recalled: Recalled) -> ProfileShift:
        """How far the profile lies from the running mean."""
        cells = observation.profile.shape[0]
        reach = round(self.reach_m / (self._bins_per_cell(axis) * axis.bin_m))
        return profile_shift(observation.profile, recalled.reference, max(1, min(reach, cells - 1)))

    def weigh(
        self, axis: RangeAxis, state: Followed, observation: ProfileObservation, recalled: Recalled, shift: ProfileShift
    ) -> Evidence:
        """What that says of a step, and where the followed echo should be now."""
        centres, cell_m = self.centres(axis)
        shift_m = shift.cells * cell_m
        explained = shift.unexplained_still - shift.unexplained_moved
        moved = (jnp.abs(shift_m) if self.steps_down else -shift_m) >= self.least_shift_m
        statistic = jnp.where(recalled.compared & moved, jnp.maximum(explained, 0.0), 0.0)
        stays = jnp.abs(observation.range_m - state.range_m) <= self.pulse_m
        carried = ~stays & (statistic > self.release)
        expected_m = jnp.where(carried, state.reference_m + shift_m, state.range_m)
        return Evidence(
            statistic=statistic,
            explained=jnp.where(recalled.compared, explained, 0.0),
            explains=(shift.unexplained_moved <= self.most_unexplained)
            & (shift.unexplained_moved <= self.most_left * explained),
            expected_m=expected_m,
            cell=jnp.round((expected_m - centres[0]) / cell_m).astype(jnp.int32),
        )

    def decide(
        self,
        axis: RangeAxis,
        state: Followed,
        observation: ProfileObservation,
        recalled: Recalled,
        evidence: Evidence,
        around: tuple[Index, Counts],
        dt: Scalar,
    ) -> tuple[Followed, Decision]:
        """`around`: the profile near the expected echo, after the cell that this begins with."""
        seen, compared, gap = observation.valid, recalled.compared, recalled.gap_s
        # What changes all the time, as the speckle of a road that is driven over does, or slowly, as it does when the
        # car pulls away, is no step.
        elapsed = jnp.maximum(dt, 0.0)
        rises = evidence.explained > self.restless * self.evidence
        # A log begins still, until it shows otherwise; a track that was lost does not.
        lost_track = recalled.fresh & (state.age_s > 0)
        still = jnp.where(rises | lost_track, 0.0, state.still_s + elapsed)
        jumping = jnp.where(rises & (state.still_s >= self.still_s), 0.0, state.jumping_s + elapsed)
        sudden = (jumping <= self.sudden_s) | (self.still_s <= 0)
        statistic = jnp.where(sudden, evidence.statistic, 0.0)
        age = jnp.where(recalled.fresh, 0.0, state.age_s + jnp.maximum(dt, 0.0))
        quiet = state.quiet_s + jnp.maximum(dt, 0.0)
        # What can be no detection is no evidence of one either.
        counts = compared & (age >= self.settle_s) & (gap > 0) & evidence.explains
        shown = jnp.where(counts, statistic, 0.0)
        event = state.armed & (shown > self.evidence)
        # Motion that never stops would keep the evidence up: after a while it may speak again all the same.
        rested = (statistic < self.release) | (quiet >= LONGEST_SILENCE * self.refractory_s)
        rearmed = rested & (quiet >= self.refractory_s)

        followed_m, lost = self._local_range(axis, observation, evidence.expected_m, *around)
        # Forgotten as slowly as gathered: one sweep that looks like the old echo does not bring it back.
        passed = jnp.where(compared, jnp.maximum(gap, 0.0), 0.0)
        lost_s = jnp.maximum(state.lost_s + jnp.where(lost, passed, -passed), 0.0)
        # Another echo that stays stronger for long is the road now; taking it up is not a detection.
        taken_up = recalled.fresh | (lost_s > self.longest_gap_s)
        range_m = jnp.where(seen, jnp.where(taken_up, observation.range_m, followed_m), state.range_m)

        share = recalled.share
        reference_m = jnp.where(seen & taken_up, range_m, state.reference_m + share * (range_m - state.reference_m))
        after = Followed(
            range_m=range_m,
            reference_m=reference_m,
            age_s=age,
            lost_s=jnp.where(taken_up, 0.0, lost_s),
            quiet_s=jnp.where(event, 0.0, quiet),
            still_s=still,
            jumping_s=jumping,
            armed=jnp.where(event, False, state.armed | rearmed),
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
            statistic=shown,
            impact_in_s=jnp.zeros_like(range_m),
            valid=seen,
            saturated=observation.saturated,
            event=event,
        )

    def _local_range(
        self, axis: RangeAxis, observation: ProfileObservation, expected_m: Scalar, start: Index, taps: Counts
    ) -> tuple[Scalar, Flag]:
        """The range of the echo nearest to where it is expected, and whether a far stronger one stands elsewhere.

        `taps`: the profile around there, from the cell `start` on.
        """
        near = jnp.abs(observation.range_m - expected_m) <= self.pulse_m
        centres, cell_m = self.centres(axis)
        places = centres[0] + cell_m * (start + jnp.arange(taps.shape[0]))
        top = first_argmax(taps * jnp.exp(-0.5 * ((places - expected_m) / (0.5 * self.pulse_m)) ** 2))
        # A peak in the first or last cell has one neighbour: counted twice, it puts the vertex on the cell.
        last = taps.shape[0] - 1
        three = (jnp.minimum(jnp.abs(top - 1), last), top, jnp.maximum(last - jnp.abs(last - top - 1), 0))
        offset, height = vertex(*(value_at(taps, place) for place in three))
        local_m = centres[start + top] + cell_m * offset
        weak = height < 0.5 * observation.highest
        # What is left around a vanished echo is noise: the range is held until another is taken up.
        local_m = jnp.where(weak | (jnp.abs(local_m - expected_m) > self.pulse_m), expected_m, local_m)
        return jnp.where(near, observation.range_m, local_m), ~near & weak

    def _bins_per_cell(self, axis: RangeAxis) -> int:
        return max(1, min(round(self.cell_m / axis.bin_m), axis.bins // 2))  # at least two cells, or nothing can shift

    def search_half_width(self, axis: RangeAxis) -> int:
        """How many cells to either side of where an echo is expected it is looked for in."""
        per_cell = self._bins_per_cell(axis)
        return min(math.ceil(self.pulse_m / (per_cell * axis.bin_m)) + 1, (axis.bins // per_cell - 1) // 2)

    def averaged(self, axis: RangeAxis, values: Sweep) -> Counts:
        return axis.averaged(values, self._bins_per_cell(axis))

    def centres(self, axis: RangeAxis) -> tuple[Counts, Scalar]:
        """Slant range of each cell's middle, and their mean distance: an axis that was thinned is not quite even."""
        centres = self.averaged(axis, jnp.asarray(axis.range_m))
        return centres, (centres[-1] - centres[0]) / (centres.shape[0] - 1)
