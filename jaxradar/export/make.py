"""A detector as an artefact: compiled, held against JAX, and described."""

from __future__ import annotations

import logging
from importlib.metadata import version
from typing import Any

import numpy as np
from jaxtyping import Float

from jaxradar._errors import ConfigError
from jaxradar.export.check import check_sweeps, differing, reference
from jaxradar.export.iree import CompilerError, check_target, compile_program, compiler_version
from jaxradar.live.artefact import Artefact, Header
from jaxradar.systems.step import DetectorFile, RangeAxis, dump_detector
from jaxradar.systems.step.packed import DECISION_FIELDS, PackedStep

__all__ = ["export_detector", "header_of"]

MOST_DIFFERENT = 0.01  # of the sweeps: as many as may hold two equal echoes, of which rounding picks another
_log = logging.getLogger(__name__)


def export_detector(
    file: DetectorFile,
    range_m: Float[np.ndarray, " bins"],
    *,
    sweeps: str = "uint16",
    target: str = "host",
    kind: str = "iree",
    sensors: tuple[int, ...] = (),
    sample: np.ndarray | None = None,
) -> Artefact:
    """A detector compiled for sweeps of one range axis, (bins,) metres.

    `sweeps`: dtype of the amplitudes; `target`: a key of `jaxradar.export.iree.TARGETS`; `kind`: "iree", or "jax" for
    those who have JAX where it runs; `sensors`: what the file is to say of them; `sample`: (sweeps, bins) recorded
    sweeps which the compiled program is held against JAX on, beside made ones.

    Raises `ConfigError` for an unknown target, without the compiler, and where what it makes does not do what JAX does,
    and `ValueError` for an unknown kind.
    """
    check_target(target)
    if kind not in _PROGRAMS:
        raise ValueError(f"`export_detector(kind=...)` must be one of {', '.join(_PROGRAMS)}; got {kind!r}.")
    step = PackedStep(file.detector, RangeAxis.of(np.asarray(range_m, np.float64)), np.dtype(sweeps))
    program, versions = _PROGRAMS[kind](step, target, sample)
    header = header_of(file, step, kind=kind, target=target, sensors=sensors, versions=versions)
    return Artefact(header, program)


def header_of(
    file: DetectorFile,
    step: PackedStep,
    *,
    kind: str,
    target: str,
    sensors: tuple[int, ...],
    versions: dict[str, str],
) -> Header:
    """What a detector's one-sweep program is and takes."""
    detector = file.detector
    return Header(
        detector=detector.name,
        config=dump_detector(file),
        threshold=float(detector.threshold),
        statistic_name=detector.statistic_name,
        statistic_unit=detector.statistic_unit,
        range_m=tuple(np.asarray(step.axis.range_m, np.float64).tolist()),
        sweeps=str(step.sweeps),
        vectors=str(step.dtype),
        state=tuple(step.initial().tolist()),
        motion=step.motion,
        decision=DECISION_FIELDS,
        target=target,
        kind=kind,
        sensors=sensors,
        versions={"jaxradar": version("jaxradar"), "jax": version("jax"), **versions},
    )


def _iree(step: PackedStep, target: str, sample: np.ndarray | None) -> tuple[bytes, dict[str, str]]:
    """Compiled for this machine first, whatever the target: that can be held against JAX here."""
    versions = {"iree": compiler_version()}
    text = step.lowered().as_text()
    inputs = check_sweeps(step, sample)
    expected = reference(step, inputs)
    for single in (True, False):
        try:
            here = compile_program(text, "host", single=single)
            different = differing(step, here, inputs, expected)
            if different > MOST_DIFFERENT:
                raise CompilerError(f"what it made says something else than JAX of {different:.1%} of the sweeps.")
            return here if target == "host" else compile_program(text, target, single=single), versions
        except CompilerError as error:
            if not single:
                raise ConfigError(f"IREE's compiler does not take this detector: {str(error)[:300]}") from None
            _log.warning("the program is compiled the usual way, which is slower: %s", str(error)[:300])
    raise AssertionError("unreachable")


def _jax(step: PackedStep, target: str, sample: np.ndarray | None) -> tuple[bytes, dict[str, str]]:
    try:
        import flatbuffers  # noqa: F401  (of `jax.export`)
    except ImportError:
        raise ConfigError("the form stablehlo needs flatbuffers; `pip install 'jaxradar[export]'` has it.") from None
    return step.exported(), {}


_PROGRAMS: dict[str, Any] = {"iree": _iree, "jax": _jax}
