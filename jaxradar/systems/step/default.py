"""The detector to use: what closes in on the car, and what moves while it stands."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, UInt

from jaxradar._settings import bounded, part, setting
from jaxradar._types import Flags, RawSweep, Scalar, Setting
from jaxradar.systems.step.approach import ApproachDetector
from jaxradar.systems.step.config import BlockSweeps, Decision, MotionSample, RangeAxis, StepDetector
from jaxradar.systems.step.shift import ShiftDetector

__all__ = ["DefaultDetector", "DefaultObservation", "DefaultState"]


SHOWN = 0.75  # of its threshold: so much evidence of a corner is seldom of noise


class DefaultObservation(NamedTuple):
    """What each part sees of one sweep, `ApproachObservation` and `ProfileObservation`; None of a part that is off."""

    approach: Any
    shift: Any


class DefaultState(NamedTuple):
    """What each part remembers, `ApproachState` and `ShiftState`, and the time since the last detection of either."""

    approach: Any
    shift: Any
    quiet_s: Scalar


class DefaultDetector(StepDetector[DefaultObservation, DefaultState]):
    """A step that closes in (`approach`), or a shift of the whole echo out of stillness (`shift`).

    The first works while the car drives, the second while it stands or glides over what reflects like a mirror; on a
    road that glitters there is no stillness, and the second is silent. Neither sees steps down. A detection is one of
    either, none within `refractory_s` of another. The statistic is the larger of the two parts' own over their
    thresholds, compared with `level`. Range, speed and strength are those of the echo that `shift` follows, and of the
    corner while there is more evidence of one.

    A part that is None costs nothing; in a file, `shift = false`.
    """

    name: ClassVar[str] = "default"
    statistic_name: ClassVar[str] = "evidence"
    statistic_unit: ClassVar[str] = "of a part's threshold"

    level: Setting = setting(1.0, 0.0, 1e3, "", "evidence of a part over its own threshold; above this is a step")
    refractory_s: Setting = setting(0.2, 0.0, 10.0, "s", "no second detection so soon after one")
    approach: ApproachDetector | None = part(ApproachDetector)
    # A car that pulls away lifts its nose, and the echo moves away: as a step down would make it.
    shift: ShiftDetector | None = part(ShiftDetector, still_s=1.0, sudden_s=0.0, most_left=0.6, steps_down=False)

    def __check_init__(self) -> None:
        if self.approach is None and self.shift is None:
            raise ValueError("`DefaultDetector(approach=..., shift=...)` needs one of the two.")

    @property
    def threshold(self) -> Setting:
        return self.level

    def with_threshold(self, value: float) -> DefaultDetector:
        return bounded(self, level=value)

    def observe(self, axis: RangeAxis, sweep: RawSweep, flags: Flags) -> DefaultObservation:
        approach, shift = self.approach, self.shift
        return DefaultObservation(
            None if approach is None else approach.observe(axis, sweep, flags),
            None if shift is None else shift.observe(axis, sweep, flags),
        )

    def init(self, axis: RangeAxis) -> DefaultState:
        approach, shift = self.approach, self.shift
        return DefaultState(
            None if approach is None else approach.init(axis),
            None if shift is None else shift.init(axis),
            jnp.asarray(self.refractory_s, float),
        )

    def track(
        self,
        axis: RangeAxis,
        state: DefaultState,
        observation: DefaultObservation,
        motion: MotionSample | None,
        dt: Scalar,
    ) -> tuple[DefaultState, Decision]:
        held, found = {}, []
        for name, one in self._parts():
            held[name], decision = one.track(axis, getattr(state, name), getattr(observation, name), motion, dt)
            found.append(decision)
        quiet, decision = self._combined(found, state.quiet_s, dt)
        return state._replace(**held, quiet_s=quiet), decision

    def follow(
        self,
        axis: RangeAxis,
        state: DefaultState,
        sweeps: BlockSweeps,
        flags: UInt[Array, "logs sweeps"],
        dt: Float[Array, "logs sweeps"],
        motion: MotionSample | None = None,
    ) -> tuple[DefaultState, Decision]:
        held, found = {}, []
        for name, one in self._parts():
            held[name], decision = one.follow(axis, getattr(state, name), sweeps, flags, dt, motion)
            found.append(decision)
        combine = jax.vmap(lambda quiet, decisions, elapsed: self._combined(decisions, quiet, elapsed))
        by_step = jax.tree.map(jnp.transpose, (found, dt))
        quiet, decision = jax.lax.scan(lambda before, now: combine(before, *now), state.quiet_s, by_step)
        return state._replace(**held, quiet_s=quiet), jax.tree.map(jnp.transpose, decision)

    def _parts(self) -> list[tuple[str, StepDetector[Any, Any]]]:
        """Those that are on, with their thresholds times `level`, and what hangs on them."""
        found: list[tuple[str, StepDetector[Any, Any]]] = []
        if self.approach is not None:
            raised = eqx.tree_at(lambda one: one.evidence, self.approach, self.approach.evidence * self.level)
            found.append(("approach", raised))
        if self.shift is not None:
            both = lambda one: (one.evidence, one.release)  # noqa: E731
            found.append(("shift", eqx.tree_at(both, self.shift, [one * self.level for one in both(self.shift)])))
        return found

    def _combined(self, found: list[Decision], quiet_s: Scalar, dt: Scalar) -> tuple[Scalar, Decision]:
        """`found`: of each part that is on."""
        quiet = quiet_s + jnp.maximum(dt, 0.0)
        own = [one.evidence for one in (self.approach, self.shift) if one is not None]
        shares = [one.statistic / jnp.maximum(other, 1e-9) for one, other in zip(found, own, strict=True)]
        shown, event, statistic = found[-1], found[-1].event, shares[-1]
        if self.approach is not None and self.shift is not None:
            # Weak evidence of a corner is of noise: the echo is shown then that `shift` follows.
            near = (shares[0] > SHOWN) & (shares[0] > shares[1])
            shown = jax.tree.map(lambda corner, echo: jnp.where(near, corner, echo), found[0], found[1])
            event, statistic = found[0].event | found[1].event, jnp.maximum(*shares)
        event = event & (quiet > self.refractory_s)
        return jnp.where(event, 0.0, quiet), Decision(
            range_m=shown.range_m,
            speed_m_s=shown.speed_m_s,
            strength=shown.strength,
            statistic=statistic,
            impact_in_s=found[0].impact_in_s,
            valid=shown.valid,
            saturated=shown.saturated,
            event=event,
        )
