"""One sweep's work as one program of plain vectors: what is compiled for the device, and run there sweep by sweep."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.dtypes import canonicalize_dtype
from jaxtyping import Array, Float

from jaxradar._numerics import reductions
from jaxradar.drive import SWEEP_DTYPES
from jaxradar.motion import MOTION_FIELDS
from jaxradar.systems.step.config import Decision, MotionSample, RangeAxis, StepDetector
from jaxradar.systems.step.pipeline import precision

__all__ = ["DECISION_FIELDS", "PackedStep"]

DECISION_FIELDS = tuple(field.name for field in dataclasses.fields(Decision))


@dataclasses.dataclass(frozen=True)
class PackedStep:
    """`observe` and `track` of a detector on one range axis, with vectors in and out.

    Inputs, (inputs,): the sweep's amplitudes, its flags, the seconds since the sweep before, and for a detector that
    uses it the car's motion, `MOTION_FIELDS`. State, (state,): as `initial` begins it. Out: the state after, and
    `DECISION_FIELDS`. All are float32, of a detector that needs double precision float64: either holds amplitudes of
    16 bits, flags and whole numbers of bins exactly.

    `sweeps`: the dtype of the recorded amplitudes, as which they enter the detector. Raises `ValueError` for one that
    no sweep has.
    """

    detector: StepDetector[Any, Any]
    axis: RangeAxis
    sweeps: np.dtype = SWEEP_DTYPES[0]

    def __post_init__(self) -> None:
        if self.sweeps not in SWEEP_DTYPES:
            raise ValueError(f"`PackedStep(sweeps=...)` must be uint16, float32 or float64; got {self.sweeps}.")

    @property
    def dtype(self) -> np.dtype:
        """Of all vectors."""
        return np.dtype(np.float64 if self.detector.float64 else np.float32)

    @property
    def motion(self) -> tuple[str, ...]:
        """Names of the inputs that tell the car's motion; none of a detector that does not use it."""
        return MOTION_FIELDS if self.detector.uses_motion else ()

    @property
    def inputs(self) -> int:
        """Numbers that go in with each sweep."""
        return self.axis.bins + 2 + len(self.motion)

    def initial(self) -> np.ndarray:
        """(state,) the state before the first sweep."""
        with precision(self.detector):
            leaves = jax.tree.leaves(self.detector.init(self.axis))
            return np.concatenate([np.ravel(np.asarray(leaf)).astype(self.dtype) for leaf in leaves])

    def __call__(
        self, state: Float[Array, " state"], inputs: Float[Array, " inputs"]
    ) -> tuple[Float[Array, " state"], Float[Array, " decision"]]:
        """One sweep. Pure; traced inside `precision(detector)`."""
        bins = self.axis.bins
        observation = self.detector.observe(
            self.axis, inputs[:bins].astype(canonicalize_dtype(self.sweeps)), inputs[bins].astype(np.uint16)
        )
        motion = None
        if self.detector.uses_motion:
            moved = inputs[bins + 2 :]
            motion = MotionSample(
                **{
                    name: moved[place] > 0 if name.endswith("_known") else moved[place]
                    for place, name in enumerate(MOTION_FIELDS)
                }
            )
        after, decision = self.detector.track(self.axis, self._unpacked(state), observation, motion, inputs[bins + 1])
        return self._packed(after), self._packed(decision)

    def lowered(self) -> jax.stages.Lowered:
        """As JAX hands it to a compiler: constants worked out, in the form that wants no particular processor."""
        with precision(self.detector), reductions("plain"):
            return self.program().lower(*self._shapes())

    def exported(self) -> bytes:
        """As `jax.export` writes it: for where there is JAX but not this package's detectors."""
        from jax import export

        with precision(self.detector), reductions("plain"):
            return bytes(export.export(self.program())(*self._shapes()).serialize())

    def _shapes(self) -> tuple[jax.ShapeDtypeStruct, jax.ShapeDtypeStruct]:
        return (
            jax.ShapeDtypeStruct(self.initial().shape, self.dtype),
            jax.ShapeDtypeStruct((self.inputs,), self.dtype),
        )

    def program(self) -> Any:
        """Jit-compiled, as `__call__`; traced inside `precision(detector)`."""

        def step(*vectors: Array) -> tuple[Array, Array]:
            with jax.ensure_compile_time_eval():
                return self(*vectors)

        return jax.jit(step)

    def _packed(self, tree: Any) -> Array:
        leaves = jax.tree.leaves(tree)
        return jnp.concatenate([jnp.ravel(jnp.asarray(leaf)).astype(self.dtype) for leaf in leaves])

    def _unpacked(self, state: Array) -> Any:
        like = jax.eval_shape(lambda: self.detector.init(self.axis))
        leaves, structure = jax.tree.flatten(like)
        ends = np.cumsum([0, *(leaf.size for leaf in leaves)]).tolist()
        parts = [
            state[low:high].reshape(leaf.shape).astype(leaf.dtype)
            for low, high, leaf in zip(ends[:-1], ends[1:], leaves, strict=True)
        ]
        return jax.tree.unflatten(structure, parts)
