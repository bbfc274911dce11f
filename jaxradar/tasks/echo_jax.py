"""Our own ways to the range of an echo: every estimator, several windows, four types of number, thinned or not."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxradar._numerics import compiled
from jaxradar.pareto import Candidate, Data, Program
from jaxradar.signal.peaks import ArgMax, MatchedFilter, Parabola, PeakEstimator, SoftArgmax
from jaxradar.signal.pulse_fit import PulseFit
from jaxradar.systems.step import RangeAxis, ShiftDetector

if TYPE_CHECKING:
    from jaxradar.tasks.echo import EchoInputs

__all__ = ["Build", "jax_candidate", "jax_candidates"]

TYPES: dict[str, Any] = {
    "float16": jnp.float16,
    "bfloat16": jnp.bfloat16,
    "float32": jnp.float32,
    "float64": jnp.float64,
}
DEFAULT, SLOW = "default's fit", "matched filter, all bins"
FEW = 200_000  # bins for the slow one
Build = Callable[[float, float], PeakEstimator]  # from the width in bins that is known, and a bin in metres


def _taps(width: float, share: float) -> int:
    return max(1, round(share * width))


def _default(width: float, bin_m: float) -> PeakEstimator:
    # Its axis is only asked for the size of a bin and for how many there are.
    return ShiftDetector().estimator(RangeAxis.of(bin_m * np.arange(4096)))


def _estimators(quick: bool) -> dict[str, Build]:
    """Windows count in widths of the pulse."""
    held: dict[str, Build] = {
        "arg-max": lambda width, bin_m: ArgMax(),
        "parabola": lambda width, bin_m: Parabola(),
        "soft-argmax ±0.5": lambda width, bin_m: SoftArgmax(0.1, half_width=_taps(width, 0.5)),
        "soft-argmax, all bins": lambda width, bin_m: SoftArgmax(0.1),
        "pulse fit from a bin": lambda width, bin_m: PulseFit(width, _taps(width, 1.1), 1),
        "pulse fit": lambda width, bin_m: PulseFit(width, _taps(width, 1.1), _taps(width, 1.2)),
        DEFAULT: _default,
    }
    if not quick:
        held |= {
            "pulse fit, template ×0.5": lambda width, bin_m: PulseFit(
                0.5 * width, _taps(width, 0.5 * 1.5), _taps(width, 1.2)
            ),
            "parabola ±0.3": lambda width, bin_m: Parabola(_taps(width, 0.3)),
            "soft-argmax ±1.1": lambda width, bin_m: SoftArgmax(0.1, half_width=_taps(width, 1.1)),
            "parabola ±0.6": lambda width, bin_m: Parabola(_taps(width, 0.6)),
            "soft-argmax ±0.5, soft": lambda width, bin_m: SoftArgmax(0.3, half_width=_taps(width, 0.5)),
            "soft-argmax ±1.1, soft": lambda width, bin_m: SoftArgmax(0.3, half_width=_taps(width, 1.1)),
            "pulse fit, template ×0.3": lambda width, bin_m: PulseFit(
                0.3 * width, _taps(width, 0.3 * 1.5), _taps(width, 1.2)
            ),
            "pulse fit, template ×1.5": lambda width, bin_m: PulseFit(
                1.5 * width, _taps(width, 1.5 * 1.5), _taps(width, 1.2)
            ),
            "matched filter ±1.5": lambda width, bin_m: MatchedFilter(width, half_width=_taps(width, 1.5)),
            SLOW: lambda width, bin_m: MatchedFilter(width),
        }
    return held


def jax_candidates(quick: bool) -> Sequence[Candidate]:
    """Every estimator in single precision; the arg-max and the fit in the other types, and on every second bin."""
    estimators = _estimators(quick)
    found = [jax_candidate(name, build, most=FEW if name == SLOW else None) for name, build in estimators.items()]
    found.append(Candidate("default, all it observes", _prepare_default, {"detector": "default"}))
    fit = "pulse fit"
    for name in (fit,) if quick else ("arg-max", "soft-argmax ±0.5", fit):
        types = ("float16",) if quick else ("float16", "bfloat16", "float64")
        found += [jax_candidate(name, estimators[name], dtype) for dtype in types]
    for step in (2,) if quick else (2, 4):
        found.append(jax_candidate(fit, estimators[fit], thin=step))
    return found


def jax_candidate(name: str, build: Build, dtype: str = "float32", thin: int = 1, most: int | None = None) -> Candidate:
    """An estimator on sweeps of a type of number, every `thin`-th bin of them; of so many sweeps as make up `most` bins
    if it is slow."""
    extra = [*([dtype] if dtype != "float32" else []), *([f"every {thin}. bin"] if thin > 1 else [])]
    settings: dict[str, float | str] = {"estimator": name, "dtype": dtype, "thin": thin}
    return Candidate(
        ", ".join([name, *extra]), partial(_prepare, build, dtype, thin, most), settings, default=name == DEFAULT
    )


def _positions(estimator: PeakEstimator, sweeps: Any, bin_m: Any) -> Any:
    return bin_m * jax.vmap(estimator)(sweeps).position


def _position(estimator: PeakEstimator, sweep: Any, bin_m: Any) -> Any:
    return bin_m * estimator(sweep).position


# Estimators are arguments: another width does not recompile.
_batch, _single = compiled(_positions), compiled(_position)


def _prepare(build: Build, dtype: str, thin: int, most: int | None, data: Data) -> Program | None:
    inputs: EchoInputs = data.inputs
    if thin > 1 and inputs.fwhm / thin < 2.0:
        return None  # there would be too little left of the pulse
    double = dtype == "float64"
    most = None if most is None else max(most // inputs.sweeps.shape[1], 1)
    with jax.enable_x64(double):
        estimator = build(inputs.fwhm / thin, inputs.bin_m * thin)
        sweeps = jnp.asarray(np.ascontiguousarray(inputs.sweeps[:most, ::thin]), TYPES[dtype])
        one = sweeps[len(sweeps) // 2]
        bin_m = np.asarray(inputs.bin_m * thin, np.float64 if double else np.float32)

    def call(program: Callable[..., Any], values: Any) -> Any:
        with jax.enable_x64(double):
            return program(estimator, values, bin_m)

    return Program(lambda: call(_batch, sweeps), len(sweeps), lambda: call(_single, one))


def _observed(detector: ShiftDetector, axis: RangeAxis, sweep: Any) -> Any:
    return detector.observe(axis, sweep, jnp.uint16(0)).range_m


_observe_all, _observe = compiled(jax.vmap(_observed, in_axes=(None, None, 0))), compiled(_observed)


def _prepare_default(data: Data) -> Program:
    """The default detector's whole look at a sweep: cells, floor, selection, refinement, validity."""
    inputs: EchoInputs = data.inputs
    detector, sweeps = ShiftDetector(), jnp.asarray(inputs.sweeps)
    axis = RangeAxis.of(inputs.bin_m * np.arange(sweeps.shape[1]))
    one = sweeps[len(sweeps) // 2]
    return Program(lambda: _observe_all(detector, axis, sweeps), data.items, lambda: _observe(detector, axis, one))
