"""The alarm of the lab's acquisition program while driving (thesis, appendix C.1, lines 131 to 147, 253 to 275)."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp

from jaxradar._numerics import finite, first_argmax
from jaxradar._settings import bounded, setting, shape_setting
from jaxradar._types import Flag, Flags, RawSweep, Scalar, Setting, Sweep
from jaxradar.drive import FULL_SCALE
from jaxradar.systems.step.config import (
    Decision,
    MotionSample,
    RangeAxis,
    StepDetector,
    SweepPeak,
    is_saturated,
    usable,
)

__all__ = ["LabLiveDetector", "LabLiveState"]

VALUES_KEPT = 128  # REQ_DATA_NUM of the program


class LabLiveState(eqx.Module):
    """The distance that the program's global variable holds, whether it is one, its age, and the last byte sent."""

    distance_m: Scalar
    held: Flag
    elapsed_s: Scalar
    near: Flag


class LabLiveDetector(StepDetector[SweepPeak, LabLiveState]):
    """Byte 1 while the strongest echo is nearer than 0.15 m; a change from 0 to 1 is a detection.

    The raw maximum counts, the first of equals, if it is above 1000 counts; else there is no object.
    `correct_loss` brings back the correction that the program has commented out, a + a d/2 at d metres beyond the
    first bin, cut to whole counts.

    The program scales its index over the full sweep by length/128 and forgets where the sweep starts (11 times too
    far at 1446 bins), keeps the last distance when a read fails, and takes an object in the first bin for none.
    All three are mended here; `as_it_was` brings them back. On a log that was thinned to 128 bins only the missing
    start remains of the first, since the full sweep is not in the log.
    """

    name: ClassVar[str] = "lab-live"
    statistic_name: ClassVar[str] = "nearness"
    statistic_unit: ClassVar[str] = "1/m"
    float64: ClassVar[bool] = True

    nearest_m: Setting = setting(0.15, 1e-3, 1e3, "m", "an object nearer than this raises the alarm")
    least_counts: Setting = setting(1000.0, 0.0, 65535.0, "counts", "a maximum must be above this to be an object")
    correct_loss: bool = shape_setting(False, 0, 1, "", "apply the program's disabled loss correction")
    as_it_was: bool = shape_setting(False, 0, 1, "", "keep the program's faults in scale, start and stale distance")

    @property
    def threshold(self) -> Setting:
        return 1.0 / self.nearest_m

    def with_threshold(self, value: float) -> LabLiveDetector:
        return bounded(self, nearest_m=1.0 / value)

    def observe(self, axis: RangeAxis, sweep: RawSweep, flags: Flags) -> SweepPeak:
        amplitudes = finite(sweep)
        metres = self._metres(axis)
        if self.correct_loss:
            # The program writes the product back into its uint16 array; what C leaves undefined there is clipped.
            offset = metres if self.as_it_was else axis.range_m - axis.range_m[0]
            amplitudes = jnp.clip(jnp.floor(amplitudes + 0.5 * amplitudes * offset), 0.0, FULL_SCALE)
        peak = first_argmax(amplitudes)
        return SweepPeak(
            range_m=metres[peak],
            strength=amplitudes[peak],
            valid=usable(flags),
            saturated=is_saturated(flags),
        )

    def _metres(self, axis: RangeAxis) -> Sweep:
        if not self.as_it_was:
            return jnp.asarray(axis.range_m)
        step = (axis.range_m[-1] - axis.range_m[0]) / (axis.bins - 1)
        return jnp.arange(axis.bins) * (step * axis.bins / VALUES_KEPT)

    def init(self, axis: RangeAxis) -> LabLiveState:
        no = jnp.zeros((), bool)
        return LabLiveState(jnp.zeros(()), no, jnp.zeros(()), no)

    def track(
        self, axis: RangeAxis, state: LabLiveState, observation: SweepPeak, motion: MotionSample | None, dt: Scalar
    ) -> tuple[LabLiveState, Decision]:
        seen = observation.valid & (observation.strength > self.least_counts)
        distance, held = jnp.where(seen, observation.range_m, 0.0), seen
        if self.as_it_was:
            distance = jnp.where(observation.valid, distance, state.distance_m)
            held = distance != 0.0
        near = held & (distance < self.nearest_m)
        elapsed = state.elapsed_s + dt
        moved = seen & state.held & (elapsed > 0)
        speed = jnp.where(moved, (distance - state.distance_m) / jnp.where(moved, elapsed, 1.0), 0.0)
        # Nothing is nearer than a millimetre: a range of 0 has no inverse.
        nearness = jnp.where(held, 1.0 / jnp.maximum(distance, 1e-3), 0.0)
        after = LabLiveState(distance, held, jnp.where(seen, 0.0, elapsed), near)
        return after, Decision(
            range_m=distance,
            speed_m_s=speed,
            strength=observation.strength,
            statistic=nearness,
            impact_in_s=jnp.zeros_like(distance),
            valid=held,
            saturated=observation.saturated,
            event=near & ~state.near,
        )
