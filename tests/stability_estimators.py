"""The estimators of the largest echo in the table: found by walking, so that a new one is in it once exported."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import equinox as eqx
import hard_inputs as hard
import numpy as np
import stability_oracles as oracles
from public_names import public_names
from stability_case import Case, Inputs, crossed

from jaxradar.signal import peaks

# Estimators of one signature, found by walking: a new one is in the table as soon as it is exported.

ORACLES: dict[str, Callable[..., Any]] = {
    "ArgMax": lambda made, sweep, near: oracles.arg_max(sweep, near, made.half_width),
    "Parabola": lambda made, sweep, near: oracles.parabola(sweep, near, made.reach),
    "SoftArgmax": lambda made, sweep, near, temperature: oracles.soft_argmax(sweep, temperature, near, made.half_width),
    "MatchedFilter": lambda made, sweep, near: oracles.matched_filter(sweep, made.fwhm, near, made.half_width),
    "PulseFit": lambda made, sweep, near, fwhm: oracles.pulse_fit(sweep, fwhm, near, made.half_width, made.search),
}
# How far a position may be off, as a share of the axis, in float32.
DEAR = ("MatchedFilter", "PulseFit", "SoftArgmax")  # seconds to compile for each length
POSITION_BOUND = {"ArgMax": 0.0, "Parabola": 1e-4, "SoftArgmax": 3e-4, "MatchedFilter": 1e-4}


def hard_settings(made: Any, name: str) -> tuple[float, ...]:
    if name == "temperature":
        return hard.TEMPERATURES
    if name == "fwhm":  # what is narrower is 0 at the window's ends, as `PulseFit.of_width` never is
        return (round(made.half_width / 1.5, 3), 100.0)
    return (float(getattr(made, name)),)


VARIANTS: dict[str, tuple[dict[str, Any], ...]] = {
    "ArgMax": ({}, {"half_width": 8}),
    "Parabola": ({}, {"reach": 3}),
    "SoftArgmax": ({}, {"half_width": 8}),
    "MatchedFilter": ({}, {"half_width": 12}),
    "PulseFit": ({}, {"half_width": 4, "search": 3}),
}


def estimator_kinds() -> dict[str, type[peaks.PeakEstimator]]:
    found = {name.rsplit(".", 1)[1]: one for name, one in public_names().items() if name.startswith("signal.")}
    return {
        name: one
        for name, one in found.items()
        if inspect.isclass(one) and issubclass(one, peaks.PeakEstimator) and not inspect.isabstract(one)
    }


def _estimate(made: Any, names: tuple[str, ...], near: bool, sweep: Any, *rest: Any) -> dict[str, Any]:
    settings = rest[1:] if near else rest
    if names:
        made = eqx.tree_at(lambda one: [getattr(one, name) for name in names], made, list(settings))
    peak = made(sweep, rest[0]) if near else made(sweep)
    return {"position": peak.position, "amplitude": peak.amplitude, "found": peak.found}


def _estimator_inputs(made: Any, names: tuple[str, ...], near: bool, bins: int) -> Inputs:
    given = hard.sweeps(bins)
    settings = {name: hard_settings(made, name) for name in names}
    if not near:
        return crossed(given, **settings)
    few = {name: given[name] for name in ("echo", "two equal echoes", "ramp", "all zero", "NaN beside the echo")}
    places = {"first": 0, "third": bins // 3, "last": bins - 1}
    return {
        f"{name} near the {place}": (one[0], np.int32(at), *one[1:])
        for name, one in crossed(few, **settings).items()
        for place, at in places.items()
    }


def _estimator_answer(kind: str, made: Any, near: bool, sweep: np.ndarray, *rest: Any) -> dict[str, Any]:
    at, settings = (int(rest[0]), rest[1:]) if near else (None, rest)
    if kind in ORACLES:
        return ORACLES[kind](made, np.float64(sweep), at, *map(float, settings))
    known = oracles.arg_max(np.float64(sweep), at)
    return {"found": known["found"]}  # no oracle: what holds for all of them


def estimator_cases() -> Iterator[Case]:
    for kind, made_by in sorted(estimator_kinds().items()):
        covers = next(name for name, one in public_names().items() if one is made_by)
        for options in VARIANTS.get(kind, ({},)):
            made = made_by(**options)
            fields = [one.name for one in dataclasses.fields(made) if not one.metadata.get("static")]
            names = tuple(name for name in fields if getattr(made, name) is not None)
            for near in (False, True) if options else (False,):
                label = ", ".join([kind, *(f"{key} {value}" for key, value in options.items()), *["near"] * near])
                places = tuple(range(1 + near, 1 + near + len(names)))
                yield Case(
                    name=label,
                    covers=(covers,),
                    function=partial(_estimate, made, names, near),
                    inputs=partial(_estimator_inputs, made, names, near),
                    answer=partial(_estimator_answer, kind, made, near),
                    scale={
                        "position": "bins, or what rounding leaves" if kind == "MatchedFilter" else "bins",
                        "amplitude": "largest",
                    },
                    bound=POSITION_BOUND.get(kind, 1e-3),
                    bound64=1e-7,
                    sizes=(3, 17, 128) if near else hard.SIZES,
                    quick=() if near or options else (17,) if kind in DEAR else (128,),
                    smooth=(0, *places),
                    settings=places,
                )
