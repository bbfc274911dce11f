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
        """Settings of a part are written `part.setting`; of some weights, `weights` are all and `weights[2]` is the
        third. Raises `ConfigError` for a name that is no setting of the detector, or one that sets a shape."""
        known = _known(detector)
        free = {name: one for name, one in known.items() if not one.metadata.get("static") and "low" in one.metadata}
        each: dict[str, list[str]] = {
            name: [f"{name}[{place}]" for place in range(len(_get(detector, name)))] if _many(one) else [name]
            for name, one in free.items()
        }
        single = {place: name for name, places in each.items() for place in places}
        found: list[str] = []
        for name in names:
            if name in known and name not in free:
                raise ConfigError(
                    f"`{name}` of the detector `{detector.name}` sets a shape or a choice, and has no slope."
                )
            whole = name.split("[")[0]
            if name not in each and name not in single and whole in free and _many(free[whole]):
                raise ConfigError(
                    f"`{whole}` of the detector `{detector.name}` has {len(each[whole])} values, "
                    f"{each[whole][0]} to {each[whole][-1]}; got `{name}`."
                )
            if name not in each and name not in single:
                raise ConfigError(
                    f"the detector `{detector.name}` has no setting `{name}`{nearest(name, free)}; "
                    f"expected {', '.join(free)}."
                )
            found += each.get(name, [name])
        if not found or len(set(found)) != len(found):
            raise ConfigError(f"expected settings to tune, each once; got {', '.join(names) or 'none'}.")
        bounds = np.array([[free[single[name]].metadata[end] for end in ("low", "high")] for name in found])
        return cls(tuple(found), bounds[:, 0], bounds[:, 1])

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
        return self._replaced(base, self.values(vector), jnp)

    def detector_at(
        self, base: StepDetector[Any, Any], vector: Float[np.ndarray, " settings"]
    ) -> StepDetector[Any, Any]:
        """The same with plain numbers, within their bounds to the last digit."""
        values = np.clip(np.asarray(self.values(np.asarray(vector, np.float64)), np.float64), self.low, self.high)
        return self._replaced(base, values, np)

    def _replaced(self, base: StepDetector[Any, Any], values: Any, numpy: Any) -> StepDetector[Any, Any]:
        """`values` in their places; those of one setting's weights together."""
        leaves: dict[str, Any] = {}
        for name, value in zip(self.names, values, strict=True):
            whole, place = _place(name)
            if place is None:
                leaves[whole] = numpy.asarray(value)
            else:
                held = leaves.get(whole, numpy.asarray(_get(base, whole), values.dtype))
                leaves[whole] = numpy.where(np.arange(len(held)) == place, value, held)
        return eqx.tree_at(lambda held: [_get(held, name) for name in leaves], base, list(leaves.values()))

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


def _many(setting: Any) -> bool:
    return "weights" in setting.metadata


def _place(name: str) -> tuple[str, int | None]:
    """A setting's name, and which of its weights where it is one of them."""
    whole, _, place = name.removesuffix("]").partition("[")
    return whole, int(place) if place else None


def _get(detector: Any, name: str) -> Any:
    whole, place = _place(name)
    for one in whole.split("."):
        detector = getattr(detector, one)
    return detector if place is None else detector[place]
