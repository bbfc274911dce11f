"""When sweeps are taken, and what the recorder writes down of it."""

from __future__ import annotations

from typing import Any, ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import PRNGKeyArray

from jaxradar._settings import setting
from jaxradar._types import Setting
from jaxradar.sim.clock import Clock
from jaxradar.sim.road.effect import RoadEffect

__all__ = ["CpuClock", "DroppedSweeps", "LateSweeps", "TimeJitter"]


class TimeJitter(RoadEffect):
    """Sweeps that do not come evenly; their recorded times are the true ones. 1 ms is assumed for a host that asks for
    each sweep; table C.1 shows steps of 9 to 20 ms at a nominal 10."""

    name: ClassVar[str] = "time-jitter"
    stage: ClassVar[str] = "clock"
    explains: ClassVar[str] = "uneven times in the lab's logs (table C.1)"

    sd_s: Setting = setting(0.001, 0.0, 1.0, "s", "standard deviation; cut off at 0.45 periods, so order is kept")

    def __call__(self, value: Clock, context: Any, key: PRNGKeyArray) -> Clock:
        late = jnp.asarray(self.sd_s) * jax.random.normal(key, value.taken_s.shape, jnp.float32)
        late = jnp.clip(late, -0.45 * context, 0.45 * context)
        return value._replace(taken_s=value.taken_s + late, recorded_s=value.recorded_s + late)


class LateSweeps(RoadEffect):
    """Some sweeps are read late: a busy host writes them down after they were taken (assumed)."""

    name: ClassVar[str] = "late-sweeps"
    stage: ClassVar[str] = "clock"
    explains: ClassVar[str] = "speeds too low and then too high around a stall of the host"

    share: Setting = setting(0.01, 0.0, 1.0, "", "of the sweeps")
    delay_s: Setting = setting(0.004, 0.0, 10.0, "s", "how late their recorded time is")

    def __call__(self, value: Clock, context: Any, key: PRNGKeyArray) -> Clock:
        late = jax.random.uniform(key, value.taken_s.shape, jnp.float32) < self.share
        return value._replace(recorded_s=value.recorded_s + jnp.where(late, jnp.asarray(self.delay_s), 0.0))


class DroppedSweeps(RoadEffect):
    """Some sweeps are missing from the log; 1 % is assumed."""

    name: ClassVar[str] = "dropped-sweeps"
    stage: ClassVar[str] = "clock"
    explains: ClassVar[str] = "gaps in recorded times"
    smooth: ClassVar[bool] = False

    share: Setting = setting(0.01, 0.0, 1.0, "", "of the sweeps")

    def __call__(self, value: Clock, context: Any, key: PRNGKeyArray) -> Clock:
        lost = jax.random.uniform(key, value.kept.shape, jnp.float32) < self.share
        return value._replace(kept=value.kept & ~lost)


class CpuClock(RoadEffect):
    """Times as the lab's program writes them (thesis, listing C.1): the radar's are a 16-bit count of loops over 50,
    which falls back to 0 at 1310.7 s, the acceleration's are processor time, which stands still while the program
    waits."""

    name: ClassVar[str] = "cpu-clock"
    stage: ClassVar[str] = "clock"
    explains: ClassVar[str] = "radar and acceleration that drift apart in the lab's logs"
    smooth: ClassVar[bool] = False

    loops_per_s: Setting = setting(50.0, 1.0, 1e4, "Hz", "what the program takes for its loop's rate")
    busy: Setting = setting(0.6, 0.001, 1.0, "", "share of the time that the program computes (assumed)")

    def __call__(self, value: Clock, context: Any, key: PRNGKeyArray) -> Clock:
        count = jnp.mod(jnp.arange(value.recorded_s.shape[0]), 65536)
        return value._replace(recorded_s=count / jnp.asarray(self.loops_per_s), motion_pace=jnp.asarray(self.busy))
