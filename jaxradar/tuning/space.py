"""Settings between bounds as a vector without bounds, which a solver may move as it likes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxradar._errors import ConfigError
from jaxradar._settings import Settings, declared, parts
from jaxradar._toml import nearest
from jaxradar.systems.step import StepDetector

__all__ = ["Space"]

# A value on its bound has no place in the vector: it begins this share of the span inside.
_INSIDE = 1e-4


class Space(eqx.Module):
    """The settings of a detector that are tuned, `names`, with their bounds, each (settings,) float64.

    A setting v between `low` and `high` stands in the vector as log((v − low) / (high − v)): near its lower bound a
    step of the vector is a change by so many natural logarithms of v − low, whatever the unit and the upper bound.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    low: np.ndarray
    high: np.ndarray

    @classmethod
    def of(cls, detector: StepDetector[Any, Any], names: Sequence[str]) -> Space:
        """Settings of a part are written `part.setting`. Raises `ConfigError` for a name that is no setting of the
        detector, or one that sets a shape."""
        known = _known(detector)
        free = [name for name, one in known.items() if not one.metadata.get("static") and "low" in one.metadata]
        for name in names:
            if name in known and name not in free:
                raise ConfigError(
                    f"`{name}` of the detector `{detector.name}` sets a shape or a choice, and has no slope."
                )
            if name not in free:
                raise ConfigError(
                    f"the detector `{detector.name}` has no setting `{name}`{nearest(name, free)}; "
                    f"expected {', '.join(free)}."
                )
        if not names or len(set(names)) != len(names):
            raise ConfigError(f"expected settings to tune, each once; got {', '.join(names) or 'none'}.")
        bounds = np.array([[known[name].metadata["low"], known[name].metadata["high"]] for name in names])
        return cls(tuple(names), bounds[:, 0], bounds[:, 1])

    def vector(self, detector: StepDetector[Any, Any]) -> Float[np.ndarray, " settings"]:
        """Where a detector stands."""
        values = np.array([float(_get(detector, name)) for name in self.names])
        share = np.clip((values - self.low) / (self.high - self.low), _INSIDE * 1e-3, 1.0 - _INSIDE)
        return np.log(share / (1.0 - share))

    def values(self, vector: Float[Array | np.ndarray, " settings"]) -> Float[Array, " settings"]:
        """The settings of a point, always between their bounds."""
        low, high = jnp.asarray(self.low, float), jnp.asarray(self.high, float)
        # From the nearer bound: far out the sum of the other bound and a small number would be that bound.
        near, far = jax.nn.sigmoid(vector), jax.nn.sigmoid(-jnp.asarray(vector))
        span = high - low
        return jnp.where(jnp.asarray(vector) < 0, low + span * near, high - span * far)

    def detector(
        self, base: StepDetector[Any, Any], vector: Float[Array | np.ndarray, " settings"]
    ) -> StepDetector[Any, Any]:
        """`base` with the settings of a point, which may be traced."""
        values = self.values(vector)
        return eqx.tree_at(
            lambda held: [_get(held, name) for name in self.names],
            base,
            [values[place] for place in range(len(self.names))],
        )

    def detector_at(
        self, base: StepDetector[Any, Any], vector: Float[np.ndarray, " settings"]
    ) -> StepDetector[Any, Any]:
        """The same with plain numbers, within their bounds to the last digit."""
        values = np.clip(np.asarray(self.values(np.asarray(vector, np.float64)), np.float64), self.low, self.high)
        return eqx.tree_at(
            lambda held: [_get(held, name) for name in self.names], base, [np.asarray(value) for value in values]
        )

    def steps(self, vector: Float[np.ndarray, " settings"]) -> Float[np.ndarray, " settings"]:
        """How much each setting changes for a small step of the vector, per unit of it."""
        share = 1.0 / (1.0 + np.exp(-np.asarray(vector, np.float64)))
        return (self.high - self.low) * share * (1.0 - share)


def _known(detector: StepDetector[Any, Any]) -> dict[str, Any]:
    """All settings by name, those of a part that is on as `part.setting`."""
    known: dict[str, Any] = dict(declared(type(detector)))
    for part in parts(type(detector)):
        held = getattr(detector, part)
        if isinstance(held, Settings):
            known |= {f"{part}.{name}": one for name, one in declared(type(held)).items()}
    return known


def _get(detector: Any, name: str) -> Any:
    for one in name.split("."):
        detector = getattr(detector, one)
    return detector
