"""A step moves the range of the road by what the car on its springs does not: the innovation of a filter of that range.

Over an even road the range of the echo follows the body: it heaves and pitches, slowly, and where the body's vertical
acceleration is known, as that says. A Kalman filter of range and rate, driven by that acceleration, foretells each
sweep's range; what it did not foretell, over its own standard deviation, is white noise of variance 1 as long as the
road is even, and has a mean once it is not (Willsky and Jones, IEEE Trans. Automatic Control 21, 1976). On it runs a
sequential test: two one-sided CUSUMs (Page, Biometrika 41, 1954), or the largest standardised sum of the latest
innovations (the window-limited generalised likelihood ratio of Lai, J. Royal Statistical Society B 57, 1995).
"""

from __future__ import annotations

import math
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxradar._settings import bounded, choice_setting, setting, shape_setting
from jaxradar._types import Flag, Flags, RawSweep, Scalar, Setting, Value
from jaxradar.estimate.kalman import Gaussian, constant_velocity, position_model, predict, update
from jaxradar.systems.step.config import Decision, MotionSample, RangeAxis, StepDetector, SweepPeak
from jaxradar.systems.step.shift import FAR_S, ShiftDetector

__all__ = ["InnovationDetector", "InnovationState", "SequentialTest"]

MEAN_OF_NORMAL = math.sqrt(2.0 / math.pi)  # of the magnitude of a standard normal variable
START_M, START_M_S = 0.03, 0.1  # how far off a range may be that the filter begins with, and how fast it may change


class SequentialTest(eqx.Module):
    """`up`, `down`: the two cumulative sums. `latest`: innovations, the newest first, none for the CUSUM."""

    up: Scalar
    down: Scalar
    latest: Float[Array, " window"]


class InnovationState(eqx.Module):
    """`estimate`: range and rate, m and m/s. `test`: the running sums. `typical`: running mean magnitude of the
    whitened innovations, over `scaled_s` so far. `age_s`: time since the filter began, `gap_s`: since the last valid
    sweep, `quiet_s`: since the last detection. `tracking`: whether there is anything to go on from, `armed`: whether
    the statistic has been low since the last detection; `moves`: whether the car was known to."""

    estimate: Gaussian
    test: SequentialTest
    typical: Scalar
    scaled_s: Scalar
    age_s: Scalar
    gap_s: Scalar
    quiet_s: Scalar
    tracking: Flag
    armed: Flag
    moves: Flag


class InnovationDetector(StepDetector[SweepPeak, InnovationState]):
    """A sequential test on what a Kalman filter of the road's range did not foretell.

    The range is that of the strongest echo, as in `ShiftDetector`. The filter's state is range and rate, the
    acceleration white noise: `heave_m2_s3` strong where nothing is known of the motion, `known_m2_s3` beside the
    vertical acceleration of the body, `lift` of which moves the range, where it is. Where the car is known to move, a
    sweep is as noisy as speckle makes it. Innovations beyond `most` standard deviations count as so many: a single
    sweep in which another echo is the strongest neither moves the filter nor detects. Real noise drifts: where the
    running mean magnitude of the innovations is above what `range_noise_m` makes of it, that is their scale.

    `test = "cusum"`: the larger of two sums, S = max(0, S ± z − `reference`); `test = "glr"`: the largest
    |sum of the last k|/√k, k up to `window`. After a detection sums and filter begin anew, at the range then.

    For a car that stands. Where it drives, the echo below the sensor moves when it is over the step, which is too late,
    and speckle moves it in every sweep: on simulated roads, 64 drives a cell at 10 to 40 km/h, steps of -20 to 30 mm
    were seen in time by 0 % at a threshold of one false alarm an hour, and `DefaultDetector` gains nothing by it.
    """

    name: ClassVar[str] = "innovation"
    statistic_name: ClassVar[str] = "test of the innovation"
    statistic_unit: ClassVar[str] = "standard deviations"
    theory: ClassVar[str] = "false alarms of a sequential test on white innovations"
    uses_motion: ClassVar[bool] = True

    limit: Setting = setting(12.7, 0.0, 1e6, "", "a test statistic above this is a step")
    release: Setting = setting(0.5, 0.0, 1.0, "", "it must fall below this share of it before the next detection")
    reference: Setting = setting(0.5, 0.0, 10.0, "", "of the CUSUM, half the shift that it is quickest for")
    most: Setting = setting(3.0, 0.5, 1e3, "", "an innovation of more standard deviations counts as so many")
    range_noise_m: Setting = setting(0.002, 1e-6, 1.0, "m", "standard deviation of the range of a single sweep")
    moving_noise_m: Setting = setting(0.03, 1e-6, 1.0, "m", "and of one whose speckle is another one than before")
    creep_m_s: Setting = setting(0.02, 0.0, 100.0, "m/s", "so it is where the car is known to be faster than this")
    look_m: Setting = setting(0.07, 1e-4, 1.0, "m", "the road's speckle is another one after so much of the way")
    heave_m2_s3: Setting = setting(0.05, 0.0, 1e4, "m²/s³", "power density of the body's acceleration, not known")
    known_m2_s3: Setting = setting(0.1, 0.0, 1e4, "m²/s³", "and of its error where it is known")
    lift: Setting = setting(1.0, -10.0, 10.0, "", "how far the range grows for a metre that the body rises")
    scale_s: Setting = setting(0.5, 1e-3, 100.0, "s", "time constant of the running scale of the innovations")
    settle_s: Setting = setting(0.15, 0.0, 10.0, "s", "no detection so soon after the filter has begun")
    refractory_s: Setting = setting(0.2, 0.0, 10.0, "s", "no second detection so soon after one")
    longest_gap_s: Setting = setting(0.3, 1e-3, 10.0, "s", "a longer time between valid sweeps begins a new track")
    over_floor: Setting = setting(0.58, 0.0, 100.0, "", "an echo must rise this many floor levels above the floor")
    over_scatter: Setting = setting(11.0, 0.0, 1e3, "", "and this many standard deviations of the floor's noise")
    exponent: Setting = setting(0.0, 0.0, 6.0, "", "the echo is selected on amplitudes times (2r)^exponent")
    template_m: Setting = setting(0.02, 1e-3, 1.0, "m", "width of the Gaussian that refines the range")
    test: str = choice_setting("cusum", ("cusum", "glr"), "the sequential test")
    window: int = shape_setting(16, 1, 1000, "sweeps", "the longest sum of the GLR")
    cell_m: float = shape_setting(0.02, 2e-3, 1.0, "m", "size of a range cell")
    window_m: float = shape_setting(0.06, 1e-3, 1.0, "m", "width of the window that refines the range")

    @property
    def threshold(self) -> Setting:
        return self.limit

    def with_threshold(self, value: float) -> InnovationDetector:
        return bounded(self, limit=value)

    @classmethod
    def from_false_alarm_rate(
        cls, per_hour: float = 1.0, *, rate_hz: float, sd_m: float, **settings: Any
    ) -> InnovationDetector:
        """With the threshold from theory: so many false alarms an hour where innovations are white and Gaussian
        (`estimate.detection.cusum_threshold` with half the rate for each side, or `glr_threshold`).

        `sd_m`: of the range of a single sweep over a still road, the setting `range_noise_m`. Speckle is neither white
        nor Gaussian: the same place of a road is seen in several sweeps, and its range errs alike in all of them.
        Raises `ValueError` for what no threshold answers.
        """
        from jaxradar.estimate.detection import cusum_threshold, glr_threshold  # SciPy takes long to import

        if "limit" in settings:
            raise ValueError("`limit` follows from the rate of false alarms; leave it out.")
        made = cls(**{**settings, "range_noise_m": sd_m})
        if made.test == "cusum":
            try:
                limit = cusum_threshold(0.5 * per_hour, rate_hz, float(made.reference))
            except ValueError:
                raise ValueError(
                    f"`per_hour` must be above 0, and less than there are alarms at a threshold of 0; got {per_hour}."
                ) from None
            return bounded(made, limit=limit)
        return bounded(made, limit=glr_threshold(per_hour, rate_hz, made.window))

    def observe(self, axis: RangeAxis, sweep: RawSweep, flags: Flags) -> SweepPeak:
        seen = self.echo().observe(axis, sweep, flags)
        return SweepPeak(seen.range_m, seen.strength, seen.valid, seen.saturated)

    def echo(self) -> ShiftDetector:
        """What finds the range of a sweep."""
        return ShiftDetector(
            over_floor=self.over_floor,
            over_scatter=self.over_scatter,
            exponent=self.exponent,
            template_m=self.template_m,
            cell_m=self.cell_m,
            window_m=self.window_m,
        )

    def init(self, axis: RangeAxis) -> InnovationState:
        zero, no = jnp.zeros(()), jnp.zeros((), bool)
        begin = Gaussian(jnp.zeros(2), jnp.eye(2))
        test = SequentialTest(zero, zero, jnp.zeros(self.window if self.test == "glr" else 0))
        return InnovationState(begin, test, zero, zero, zero, zero, jnp.asarray(FAR_S, float), no, ~no, no)

    def track(
        self,
        axis: RangeAxis,
        state: InnovationState,
        observation: SweepPeak,
        motion: MotionSample | None,
        dt: Scalar,
    ) -> tuple[InnovationState, Decision]:
        seen = observation.valid
        elapsed, gap = jnp.maximum(dt, 0.0), state.gap_s + dt
        tracking = state.tracking & (jnp.abs(gap) <= self.longest_gap_s)
        compared, fresh = seen & tracking & (gap > 0), seen & ~tracking
        ahead = self.foretell(state.estimate, motion, jnp.where(tracking, elapsed, 0.0))
        scale = jnp.maximum(state.typical / MEAN_OF_NORMAL, 1.0)
        noise, moves = self.noise(motion, gap)
        age = state.age_s + elapsed
        settled = compared & (age >= self.settle_s)
        estimate, white = self.take_in(ahead, observation.range_m, noise * scale, compared, settled)
        # What is scaled already tells the running scale how far it is off.
        scaled = jnp.where(fresh, 0.0, state.scaled_s)
        share = jnp.where(settled, elapsed / (jnp.minimum(self.scale_s, scaled) + elapsed + 1e-9), 0.0)
        typical = state.typical + share * (jnp.minimum(jnp.abs(white), self.most) * scale - state.typical)
        test, statistic = self.sum_up(state.test, jnp.clip(white, -self.most, self.most), settled)

        quiet = state.quiet_s + elapsed
        event = settled & state.armed & (statistic > self.limit)
        rearmed = (statistic < self.release * self.limit) & (quiet >= self.refractory_s)
        # Where a car comes to rest its speckle stands still too, and the range stays wrong by as much.
        begins = fresh | event | (seen & state.moves & ~moves)
        estimate = self._begun(begins, observation.range_m, estimate)
        after = InnovationState(
            estimate=estimate,
            test=jax.tree.map(lambda one: jnp.where(begins, 0.0, one), test),
            typical=jnp.where(fresh, 0.0, typical),
            scaled_s=scaled + jnp.where(settled, elapsed, 0.0),
            age_s=jnp.where(begins, 0.0, age),
            gap_s=jnp.where(seen, 0.0, gap),
            quiet_s=jnp.where(event, 0.0, quiet),
            tracking=tracking | seen,
            armed=~event & (state.armed | rearmed),
            moves=jnp.where(seen, moves, state.moves),
        )
        return after, Decision(
            range_m=estimate.mean[0],
            speed_m_s=jnp.where(compared, estimate.mean[1], 0.0),
            strength=jnp.where(seen, observation.strength, 0.0),
            statistic=jnp.where(settled, statistic, 0.0),
            impact_in_s=jnp.zeros_like(statistic),
            valid=seen,
            saturated=observation.saturated,
            event=event,
        )

    def foretell(self, estimate: Gaussian, motion: MotionSample | None, elapsed: Scalar) -> Gaussian:
        """Range and rate so much later."""
        density, pushed = jnp.asarray(self.heave_m2_s3, float), jnp.zeros(1)
        if motion is not None:
            density = jnp.where(motion.acceleration_known, self.known_m2_s3, density)
            pushed = jnp.reshape(self.lift * motion.acceleration_m_s2, 1)
        return predict(estimate, constant_velocity(elapsed, density, control=True), pushed)

    def noise(self, motion: MotionSample | None, elapsed: Scalar) -> tuple[Value, Flag]:
        """Standard deviation of a range, and whether the car is known to move: then speckle moves the middle of the
        echo, and sweeps closer than its length err alike, so that each counts as a part of one look."""
        standing = jnp.asarray(self.range_noise_m, float)
        if motion is None:
            return standing, jnp.zeros((), bool)
        speed = jnp.abs(motion.speed_m_s)
        moves = motion.speed_known & (speed > self.creep_m_s)
        way = jnp.where(moves & (elapsed > 0), speed * elapsed, self.look_m)
        looked = jnp.maximum(self.moving_noise_m, standing) * jnp.sqrt(jnp.maximum(self.look_m / way, 1.0))
        return jnp.where(moves, looked, standing), moves

    def take_in(
        self, ahead: Gaussian, range_m: Scalar, noise: Scalar, compared: Flag, settled: Flag
    ) -> tuple[Gaussian, Value]:
        """The filter after a range, and its innovation over the standard deviation of that; once it has settled, an
        innovation of more than `most` of them moves the filter as so many."""
        sd = jnp.sqrt(ahead.root[0, 0] ** 2 + noise * noise)  # the root is triangular
        value = jnp.where(compared, range_m - ahead.mean[0], 0.0)
        inside = jnp.where(settled, jnp.clip(value, -self.most * sd, self.most * sd), value)
        estimate, _ = update(ahead, (ahead.mean[0] + inside)[None], position_model(noise, 2), compared)
        return estimate, value / sd

    def sum_up(self, test: SequentialTest, white: Scalar, counts: Flag) -> tuple[SequentialTest, Value]:
        """The test after one more innovation, and its statistic."""
        if self.test == "cusum":
            up = jnp.where(counts, jnp.maximum(test.up + white - self.reference, 0.0), test.up)
            down = jnp.where(counts, jnp.maximum(test.down - white - self.reference, 0.0), test.down)
            return SequentialTest(up, down, test.latest), jnp.maximum(up, down)
        latest = jnp.where(counts, jnp.concatenate([white[None], test.latest[:-1]]), test.latest)
        sums = jnp.abs(jnp.cumsum(latest)) / jnp.sqrt(1.0 + jnp.arange(self.window))
        return SequentialTest(test.up, test.down, latest), jnp.max(sums)

    def _begun(self, begins: Flag, range_m: Scalar, estimate: Gaussian) -> Gaussian:
        """Anew at a range, where it begins."""
        mean = jnp.stack([range_m, jnp.zeros_like(range_m)])
        root = jnp.diag(jnp.array([START_M, START_M_S]))
        return jax.tree.map(lambda new, old: jnp.where(begins, new, old), Gaussian(mean, root), estimate)
