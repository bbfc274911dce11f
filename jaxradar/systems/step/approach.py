"""The corner of a step closes in on the car along a track that geometry knows: what looks faint in one sweep adds up.

The foot of a step's face, x ahead of the sensor's foot, is seen at the slant range r = √(H² + x²), and x shrinks by the
way that the car goes. A road's own echoes, speckle, lie on such tracks too, but their amplitude is another one after
some centimetres; a corner stays bright. So evidence is gathered along the tracks of a bank of speeds before anything is
decided (track before detect: Tonissen and Bar-Shalom, IEEE Trans. AES 34, 1998; here with a CUSUM on each track).

The evidence. The amplitude of noise and speckle, over its own root mean square, is Rayleigh distributed, and

    s = γ a − c(γ),  c(γ) = ln E[e^(γ a)] = ln(1 + ½ √π γ e^(γ²/4) (1 + erf(γ/2)))

is the logarithm of a likelihood ratio, against the Rayleigh density tilted by e^(γ a): E[e^s] = 1 where there is no
corner, so that a sum of s along a track, begun anywhere, ever exceeds h with a probability of at most e^(−h) (Ville,
Étude critique de la notion de collectif, 1939). Whoever counts the places where a track may begin knows a threshold.
Sweeps closer than the speckle's length say the same twice: each counts as a part, and E[e^(ws)] <= 1 for w <= 1.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, UInt

from jaxradar._numerics import finite, largest_row, row_major, safe_divide, select_largest, tree
from jaxradar._settings import bounded, setting, shape_setting
from jaxradar._types import Flags, RawSweep, Scalar, Setting
from jaxradar.systems.step.approach_bank import cost, largest_place, means_around, moved_on
from jaxradar.systems.step.approach_states import (
    Alarm,
    ApproachObservation,
    ApproachState,
    Cells,
    CornerTrack,
    Echoes,
    Gathered,
    Numbers,
    Places,
    Seen,
    Told,
    Tracks,
    Truths,
    over,
)
from jaxradar.systems.step.config import (
    BlockSweeps,
    Decision,
    MotionSample,
    RangeAxis,
    StepDetector,
    each_sweep,
    is_saturated,
    usable,
)

__all__ = ["ApproachDetector"]

SPECKLE = 0.79  # square of the mean over the mean square, of the cells of simulated roads
LEAST_STANDING = 0.015  # of the same, summed over cells


class ApproachDetector(StepDetector[ApproachObservation, ApproachState]):
    """Track before detect: the bright corner of a step, followed along the road over a bank of speeds and places.

    Each sweep is averaged into range cells and divided by the root of their running mean square, or of that of the
    cells around where theirs is much smaller (a car that has just pulled away still holds the fades of where it stood).
    What a place of the road adds to the evidence of a track is s (see the module), for the whole sweep where noise
    makes the echo, and for the share v Δt/`look_m` of it where the road does. The tilt γ grows from `tilt_far` to
    `tilt_near`, as a corner does on its way. Evidence never falls below 0. A detection is evidence above `evidence`, on
    any track; hysteresis and a refractory time make one detection of one step.

    Evidence that would go on by more than five places within a sweep, 150 mm, is dropped: 45 km/h want 83 sweeps/s. It
    needs neither the speed nor more than about the height of the sensor. A step down has no corner, and is not seen.
    """

    name: ClassVar[str] = "approach"
    statistic_name: ClassVar[str] = "evidence of a corner"
    statistic_unit: ClassVar[str] = "nats"
    theory: ClassVar[str] = "a bound of the false alarms where noise and speckle are Rayleigh distributed"

    evidence: Setting = setting(15.5, 0.0, 1e3, "nats", "evidence on a track above this is a step")
    release: Setting = setting(0.5, 0.0, 1.0, "", "it must fall below this share of it before the next detection")
    tilt_far: Setting = setting(1.0, 0.0, 10.0, "", "what an amplitude weighs at the farthest place, γ")
    tilt_near: Setting = setting(3.5, 0.0, 10.0, "", "and at the nearest")
    look_m: Setting = setting(0.07, 1e-4, 1.0, "m", "the road's speckle is another one after so much of the way")
    noise_share: Setting = setting(1.3, 0.0, 10.0, "", "noise is so many times the power of the quietest cell")
    reference_s: Setting = setting(0.15, 1e-2, 60.0, "s", "time constant of the mean square amplitudes are held to")
    fade_share: Setting = setting(0.6, 0.0, 1.0, "", "it is not below this share of that of the cells around")
    settle_s: Setting = setting(0.15, 0.0, 10.0, "s", "no detection so soon after a track has begun")
    refractory_s: Setting = setting(0.2, 0.0, 10.0, "s", "no second detection so soon after one")
    longest_gap_s: Setting = setting(0.3, 1e-3, 10.0, "s", "a longer time between valid sweeps begins anew")
    height_m: Setting = setting(0.35, 0.02, 10.0, "m", "of the sensor over the road")
    front_wheel_m: Setting = setting(0.15, -5.0, 10.0, "m", "how far the front axle lies behind the sensor")
    contact_m: Setting = setting(0.1, 0.0, 1.0, "m", "a tyre touches a step so far ahead of its axle")
    stands: Setting = setting(
        0.7, 0.0, 2.0, "", "the car stands where echoes are so far from speckle, 0, towards stillness, 1"
    )
    start_s: Setting = setting(0.5, 0.0, 10.0, "s", "no detection so soon after the car has stood")
    slowest_m_s: Setting = setting(1.25, 0.1, 100.0, "m/s", "of the speeds of the bank")
    fastest_m_s: Setting = setting(12.5, 0.1, 100.0, "m/s", "of the speeds of the bank")
    farthest_m: Setting = setting(0.92, 0.05, 100.0, "m", "where tracks begin, ahead of the sensor's foot")
    speeds: int = shape_setting(12, 1, 1000, "", "number of speeds, evenly spaced in their logarithm")
    places: int = shape_setting(23, 2, 1000, "", "number of places of each track")
    place_m: float = shape_setting(0.03, 1e-3, 1.0, "m", "distance of two places")
    cell_m: float = shape_setting(0.014, 2e-3, 1.0, "m", "size of a range cell")
    around_m: float = shape_setting(0.1, 1e-3, 10.0, "m", "width of the cells around")

    @property
    def threshold(self) -> Setting:
        return self.evidence

    def with_threshold(self, value: float) -> ApproachDetector:
        return bounded(self, evidence=value)

    @classmethod
    def from_false_alarm_rate(cls, per_hour: float = 1.0, *, rate_hz: float, **settings: Any) -> ApproachDetector:
        """With the threshold from theory: at most so many false alarms an hour where noise and speckle are Rayleigh
        distributed, and independent from look to look; and where some range cell shows bare noise, as otherwise the
        road is taken for noise that is another one in each sweep.

        ln(places at which evidence may begin in an hour / `per_hour`), by Ville's inequality for each of them: an upper
        bound, as neighbouring tracks share most of what they see. Raises `ValueError` for a rate that is not above 0.
        """
        if not (0 < per_hour < math.inf and 0 < rate_hz < math.inf):
            raise ValueError(f"`per_hour` and `rate_hz` must be above 0 and finite; got {per_hour} and {rate_hz}.")
        if "evidence" in settings:
            raise ValueError("`evidence` follows from the rate of false alarms; leave it out.")
        made = cls(**settings)
        places = 3600.0 * rate_hz * made.speeds * made.places
        if per_hour >= places:
            raise ValueError(f"`per_hour` must be below {places:g}, as often as a track begins; got {per_hour}.")
        return bounded(made, evidence=math.log(places / per_hour))

    def observe(self, axis: RangeAxis, sweep: RawSweep, flags: Flags) -> ApproachObservation:
        return self.observed(axis.averaged(finite(sweep), self.bins_per_cell(axis)), flags)

    def observed(self, cells: Cells, flags: UInt[Array | np.ndarray, "*logs"]) -> ApproachObservation:
        """One sweep out of its cells."""
        strength = largest_row(cells)
        return ApproachObservation(cells, strength, usable(flags) & (strength > 0), is_saturated(flags))

    def init(self, axis: RangeAxis) -> ApproachState:
        zero, no = jnp.zeros(()), jnp.zeros((), bool)
        nothing = jnp.zeros(axis.bins // self.bins_per_cell(axis))
        return ApproachState(
            Echoes(nothing, nothing, zero, no, zero, zero, no, no),
            Gathered(jnp.zeros((self.speeds, self.places)), jnp.zeros(self.speeds)),
            Alarm(zero, ~no),
        )

    def track(
        self,
        axis: RangeAxis,
        state: ApproachState,
        observation: ApproachObservation,
        motion: MotionSample | None,
        dt: Scalar,
    ) -> tuple[ApproachState, Decision]:
        tracks = self.tracks(axis)
        echoes, seen = self.look(tracks, state.echoes, observation, dt)
        gathered = self.gather(tracks, state.gathered, seen, *self.weigh(tracks, seen, observation.cells))
        told = Told.of(observation, seen)
        alarm, decision = self.decide(state.alarm, told, *self.best(tracks, gathered), dt)
        return ApproachState(echoes, gathered, alarm), decision

    def follow(
        self,
        axis: RangeAxis,
        state: ApproachState,
        sweeps: BlockSweeps,
        flags: UInt[Array, "logs sweeps"],
        dt: Float[Array, "logs sweeps"],
        motion: MotionSample | None = None,
    ) -> tuple[ApproachState, Decision]:
        # All logs side by side as the last axis, not by `vmap`, which would put them first wherever rows are picked;
        # and stage by stage, as the compiler works out again in each loop what several loops are made of.
        cells = row_major(each_sweep(lambda sweep: axis.averaged(finite(sweep), self.bins_per_cell(axis)))(sweeps()))
        cells, flags, dt = row_major(jnp.transpose(cells, (1, 2, 0))), row_major(flags.T), row_major(dt.T)
        state = jax.tree.map(lambda leaf: row_major(jnp.moveaxis(leaf, 0, -1)), state)
        tracks = self.tracks(axis)
        observed = jax.vmap(self.observed)(cells, flags)
        echoes, seen = jax.lax.scan(lambda held, now: self.look(tracks, held, *now), state.echoes, (observed, dt))
        # All sweeps in one product: the cells first.
        first = seen._replace(power=jnp.swapaxes(seen.power, 0, 1))
        weighed = tuple(
            row_major(jnp.swapaxes(one, 0, 1)) for one in self.weigh(tracks, first, jnp.swapaxes(cells, 0, 1))
        )

        def gather(held: Gathered, now: Any) -> tuple[Gathered, Any]:
            # The best so far, a sweep late: what a loop is handed has been written out, and what it works out itself is
            # worked out again for each who asks.
            seen, weighed = now
            return self.gather(tracks, held, seen, *weighed), self.best(tracks, held)

        gathered, late = jax.lax.scan(gather, state.gathered, (seen, weighed))
        best = jax.tree.map(
            lambda so_far, last: jnp.concatenate([so_far[1:], last[None]]), late, self.best(tracks, gathered)
        )
        decide = jax.vmap(self.decide)
        alarm, decisions = jax.lax.scan(
            lambda held, now: decide(held, *now),
            state.alarm,
            (Told.of(observed, seen), *best, dt),
        )
        after = ApproachState(echoes, gathered, alarm)
        return jax.tree.map(lambda leaf: jnp.moveaxis(leaf, -1, 0), after), jax.tree.map(jnp.transpose, decisions)

    def bins_per_cell(self, axis: RangeAxis) -> int:
        """At least two cells."""
        return max(1, min(round(self.cell_m / axis.bin_m), axis.bins // 2))

    def tracks(self, axis: RangeAxis) -> Tracks:
        """The bank's places and speeds on a range axis."""
        per_cell = self.bins_per_cell(axis)
        centres = axis.averaged(jnp.asarray(axis.range_m), per_cell)
        cells = centres.shape[0]
        ahead = jnp.asarray(self.farthest_m, float) - self.place_m * jnp.arange(self.places)
        range_m = jnp.sqrt(jnp.asarray(self.height_m, float) ** 2 + ahead**2)
        place = (range_m - centres[0]) * ((cells - 1) / (centres[-1] - centres[0]))
        inside = (place >= 0) & (place <= cells - 1) & (ahead > 0)
        # Linear between neighbours.
        at = jnp.maximum(1.0 - jnp.abs(jnp.clip(place, 0.0, cells - 1.0)[:, None] - jnp.arange(cells)), 0.0)
        around = at @ means_around(cells, max(1, round(0.5 * self.around_m / (per_cell * axis.bin_m))))
        along = jnp.arange(self.places) / (self.places - 1)
        tilt = jnp.asarray(self.tilt_far, float) + (self.tilt_near - jnp.asarray(self.tilt_far, float)) * along
        ratio = jnp.asarray(self.fastest_m_s, float) / self.slowest_m_s
        speeds = self.slowest_m_s * ratio ** (jnp.arange(self.speeds) / max(self.speeds - 1, 1))
        far = centres > jnp.sqrt(jnp.asarray(self.height_m, float) ** 2 + 0.25 * ahead[0] ** 2)
        return Tracks(ahead, at, around, tilt, cost(tilt), inside, far, speeds)

    def look(self, tracks: Tracks, state: Echoes, observation: ApproachObservation, dt: Numbers) -> tuple[Echoes, Seen]:
        """Hold a sweep to those before it. Of one log, or of many as a last axis of everything; and so the others."""
        gap = state.gap_s + dt
        tracking = state.tracking & (jnp.abs(gap) <= self.longest_gap_s)
        goes_on, fresh = observation.valid & tracking, observation.valid & ~tracking
        elapsed = jnp.where(tracking, jnp.maximum(dt, 0.0), 0.0)
        now = observation.cells**2
        # A sweep without data begins nothing: it would take the place of what is known.
        begins = fresh | (goes_on & state.stood & (state.age_s <= 0))
        before = jnp.where(begins, now, state.power)
        mean = jnp.where(begins, observation.cells, state.mean)
        stands = goes_on & state.stands
        age = jnp.where(fresh | stands, 0.0, state.age_s + elapsed)
        # A plain mean at first, a running one later.
        since = jnp.maximum(gap, 0.0)
        share = jnp.where(goes_on, since / (jnp.minimum(self.reference_s, age) + since + 1e-9), 0.0)
        power = before + share * (now - before)
        mean = mean + share * (observation.cells - mean)
        # Worked out for the next sweep: what all cells hang on is not to be worked out again for each of them.
        noise = self.noise_share * -largest_row(-power)
        known = age >= self.settle_s  # a mean of a few sweeps is as steady as they are
        after = Echoes(
            power=power,
            mean=mean,
            noise=noise,
            stands=known & self._stands(tracks, power, mean, noise),
            age_s=age,
            gap_s=jnp.where(observation.valid, 0.0, gap),
            tracking=tracking | observation.valid,
            stood=(state.stood & tracking) | stands,
        )
        return after, Seen(
            power=before,
            noise=state.noise,
            goes_on=tracking & ~stands,
            counts=goes_on & ~stands,
            elapsed_s=elapsed,
            settled=age >= jnp.where(after.stood, self.start_s, self.settle_s),
        )

    def _stands(self, tracks: Tracks, power: Cells, mean: Cells, noise: Any) -> Truths:
        """Whether the road's echoes keep their amplitudes. Of speckle that is driven over they are Rayleigh
        distributed, and the square of their mean is π/4 of the mean square (a little more of cells, which average); of
        what stands in noise it is more by nearly (1 − π/4) ρ², ρ the share of the road in the power (after Rice)."""
        # Every other cell says enough.
        power, mean, far = power[::2], mean[::2], tracks.far[::2]
        some = (power > 0) & over(far, noise)
        inverse = 1.0 / jnp.where(some, power, 1.0)
        weight = jnp.where(some, jnp.maximum(1.0 - noise * inverse, 0.0), 0.0) ** 2
        more = mean**2 * inverse - SPECKLE - self.stands * (1.0 - SPECKLE) * weight
        # Where noise alone is seen, nothing is known to stand.
        return tree(list(weight * more), jnp.add) > LEAST_STANDING

    def weigh(self, tracks: Tracks, seen: Seen, cells: Cells) -> tuple[Places, Places]:
        """What each place adds to the evidence of a whole look, and how many looks there are to a metre."""
        times = partial(jnp.tensordot, axes=1)
        expected = jnp.maximum(times(tracks.at, seen.power), self.fade_share * times(tracks.around, seen.power))
        some = expected > 0
        inverse = safe_divide(jnp.ones_like(expected), expected, 1.0)
        at_each = partial(over, logs=seen.noise)
        score = at_each(tracks.tilt) * times(tracks.at, cells) * jnp.sqrt(inverse) - at_each(tracks.cost)
        score = jnp.where(seen.counts & at_each(tracks.inside) & some, score, 0.0)
        return score, 1.0 / jnp.maximum(self.look_m * (1.0 - seen.noise * inverse), 1e-5)

    def gather(self, tracks: Tracks, state: Gathered, seen: Seen, score: Places, looks: Places) -> Gathered:
        """Move the evidence on and add to it."""
        speeds = over(tracks.speeds, seen.noise)
        evidence, travel = moved_on(state.evidence, state.travel, speeds * (seen.elapsed_s / self.place_m))
        # Where the road makes the echo a sweep is a part of a look; where noise does, each sweep is one.
        share = jnp.minimum((speeds * seen.elapsed_s)[:, None] * looks, 1.0)
        evidence = jnp.maximum(jnp.where(seen.goes_on, evidence, 0.0) + share * score, 0.0)
        return Gathered(evidence, jnp.where(seen.goes_on, travel, 0.0))

    def best(self, tracks: Tracks, state: Gathered) -> tuple[Numbers, CornerTrack]:
        """The most evidence there is on a track, and that track."""
        by_speed = zip(*largest_place(state.evidence), state.travel, tracks.speeds, strict=True)
        _, most, place, travel, speed = select_largest(list(by_speed))
        ahead = self.farthest_m - self.place_m * (place + travel)
        return most, CornerTrack(ahead, jnp.sqrt(jnp.asarray(self.height_m, float) ** 2 + ahead**2), speed)

    def decide(
        self,
        state: Alarm,
        told: Told,
        statistic: Scalar,
        corner: CornerTrack,
        dt: Scalar,
    ) -> tuple[Alarm, Decision]:
        """Whether that is a detection."""
        quiet = state.quiet_s + jnp.maximum(dt, 0.0)
        event = told.counts & told.settled & state.armed & (statistic > self.evidence)
        rearmed = (statistic < self.release * self.evidence) & (quiet >= self.refractory_s)
        valid = told.valid
        # Less evidence than that is of noise, whose track says nothing.
        foreseen = told.counts & told.settled & (statistic > self.release * self.evidence)
        way = corner.ahead_m + self.front_wheel_m - self.contact_m
        return Alarm(jnp.where(event, 0.0, quiet), ~event & (state.armed | rearmed)), Decision(
            range_m=corner.range_m,
            speed_m_s=jnp.where(valid & (statistic > 0), -corner.speed_m_s * corner.ahead_m / corner.range_m, 0.0),
            strength=jnp.where(valid, told.strength, 0.0),
            statistic=jnp.where(told.counts & told.settled, statistic, 0.0),
            impact_in_s=jnp.where(foreseen, jnp.maximum(way / corner.speed_m_s, 0.0), 0.0),
            valid=valid,
            saturated=told.saturated,
            event=event,
        )
