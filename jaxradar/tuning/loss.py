"""What a detector costs on drives whose truth is known, smooth enough to be differentiated."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxradar._errors import ConfigError
from jaxradar._types import Scalar, Setting
from jaxradar.systems.step import Decision, StepDetector, run_batch
from jaxradar.tuning.examples import Examples

__all__ = ["Costs", "Outcome", "smooth_outcome"]

_NEVER = -1e4  # a logit
_TINY = 1e-9  # steps, or hours: drives may hold none


@dataclasses.dataclass(frozen=True)
class Costs:
    """What is bad by how much: the loss is their sum.

    - `missed`: of missing every step. `false_alarm`: of each false alarm an hour. `late`: of each second by which
      steps that are seen are seen after the beginning of their window.

    Raises `ConfigError` unless all are finite and at least 0, and one is above 0.
    """

    missed: float = 1.0
    false_alarm: float = 0.01
    late: float = 0.5

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (math.isfinite(value) and value >= 0):
                raise ConfigError(f"the cost `{name}` must be finite and >= 0; got {value}.")
        if not any(vars(self).values()):
            raise ConfigError("at least one cost must be above 0.")

    def total(self, missed: Any, late_s: Any, false: Any, steps: Any, hours: Any) -> Any:
        """Of sums over some drives: misses and lateness a step, false alarms an hour, of so many of either. Linear in
        the sums, so that drives may be gone through in parts."""
        return (self.missed * missed + self.late * late_s) / (steps + _TINY) + self.false_alarm * false / (
            hours + _TINY
        )


class Outcome(eqx.Module):
    """What is to be expected of a detector, each (logs,): misses, hits, the sum over the hits of the seconds since the
    beginning of the step's window, and false alarms."""

    missed: Float[Array, " logs"]
    seen: Float[Array, " logs"]
    late_s: Float[Array, " logs"]
    false: Float[Array, " logs"]

    def cost(self, hours: Float[Array | np.ndarray, " logs"], costs: Costs) -> Scalar:
        """Of all logs together: misses and lateness a step, false alarms an hour."""
        steps = jnp.sum(self.missed + self.seen)
        missed, late_s, false = (jnp.sum(one) for one in (self.missed, self.late_s, self.false))
        return jnp.asarray(costs.total(missed, late_s, false, steps, jnp.sum(jnp.asarray(hours))))


def smooth_outcome(detector: StepDetector[Any, Any], examples: Examples, temperature: Setting) -> Outcome:
    """What is to be expected of a detector whose threshold is blurred, by a factor of about exp(`temperature`).

    A sweep is a detection with the probability w = 1 / (1 + (threshold / statistic)^(1 / temperature)), whatever the
    others are: none where the statistic is 0, however hot it is. Then a step is missed with the product of 1 − w over
    its window, and seen first at a sweep with w times that product over those before. Each detection outside is a false
    alarm; of a detector that is `merged` only one that follows none, w(t)(1 − w(t−1)). As the temperature falls, all
    tend to what is counted of detections without hysteresis and refractory time.
    """
    decisions: Decision = run_batch(detector, *examples.batch)
    least = jnp.finfo(decisions.statistic.dtype).tiny
    some = decisions.valid & (decisions.statistic > least)
    ratio = jnp.log(jnp.where(some, decisions.statistic, 1.0)) - jnp.log(jnp.maximum(detector.threshold, least))
    logit = jnp.where(some, ratio / temperature, _NEVER)
    weight, log_quiet = jax.nn.sigmoid(logit), jax.nn.log_sigmoid(-logit)
    window = jnp.asarray(examples.window)
    quiet = jnp.where(window, log_quiet[:, None], 0.0)
    before = jnp.cumsum(jnp.pad(quiet[..., :-1], ((0, 0), (0, 0), (1, 0))), axis=-1)
    first = jnp.where(window, weight[:, None] * jnp.exp(before), 0.0)
    missed = jnp.where(examples.real, jnp.exp(jnp.sum(quiet, axis=-1)), 0.0)
    longest = jnp.max(jnp.where(window, examples.lead_s, 0.0), axis=-1, keepdims=True)
    late = jnp.sum(first * (longest - examples.lead_s), axis=(1, 2))
    alarms = weight * (1.0 - jnp.pad(weight[:, :-1], ((0, 0), (1, 0)))) if detector.merged else weight
    false = jnp.sum(jnp.where(examples.false, alarms, 0.0), axis=-1)
    missed = jnp.sum(missed, axis=-1)
    return Outcome(missed, jnp.sum(jnp.where(examples.real, 1.0, 0.0), axis=-1) - missed, late, false)
