"""The table of what must stay stable: public functions, their hard inputs, their oracles and their bounds.

A `Case` is one function of one input, all of whose hard inputs of one shape go through one program. `public_names`
walks the modules; what is neither in a case nor in `NOT_NUMERIC` fails `test_stability.py`.
"""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import math
import pkgutil
from collections.abc import Callable, Iterator
from functools import partial
from itertools import product
from typing import Any

import equinox as eqx
import hard_inputs as hard
import jax
import jax.numpy as jnp
import numpy as np
import stability_oracles as oracles

import jaxradar._numerics as numerics
from jaxradar import signal, units
from jaxradar.signal import cells as cells_of
from jaxradar.signal import clutter, correlate, differences, peaks, pulses, soft

Inputs = dict[str, tuple[Any, ...]]
POSITION_KEYS = ("position", "cells")


@dataclasses.dataclass(frozen=True, eq=False)
class Case:
    """`function`: of the arrays of one input, gives named numbers and flags. `inputs`: by size, or None as the size.

    `answer`: what the oracle says of one input. `scale`: what the error of each number is divided by, in words for the
    report; `bound`: on that error in float32, `bound64` in float64. `smooth`: the arguments to differentiate by,
    `settings`: those of them, scalars, that tuning bends (a second derivative). `undefined`: inputs whose answer is
    open, only to be finite.
    """

    name: str
    covers: tuple[str, ...]
    function: Callable[..., dict[str, Any]]
    inputs: Callable[[Any], Inputs]
    answer: Callable[..., dict[str, Any]]
    scale: dict[str, str]
    bound: float
    bound64: float = 1e-9
    sizes: tuple[Any, ...] = (None,)
    quick: tuple[Any, ...] = (None,)  # the sizes of the plain run and of the golden file
    smooth: tuple[int, ...] = (0,)
    settings: tuple[int, ...] = ()
    undefined: frozenset[str] = frozenset()
    dtypes: tuple[str, ...] = ("float32", "float64")

    def scale_of(self, key: str, arguments: tuple[Any, ...], wanted: Any) -> float:
        kind, first = self.scale[key], np.asarray(arguments[0], np.float64)
        if kind == "1":
            return 1.0
        if kind == "bins":
            return float(first.shape[0])
        if kind == "largest":
            return max(float(np.abs(oracles.finite(first)).max()), 1e-300)
        if kind == "largest step in the shortest time":
            steps = np.abs(np.asarray(arguments[1]))
            largest = max(float(np.abs(np.diff(first)).max(initial=0.0)), 1e-7 * float(np.abs(first).max()))
            return largest / float(np.min(steps, where=steps > 0, initial=1.0)) or 1.0
        if kind == "steps":  # of so many metres in the shortest time
            steps = np.asarray(arguments[1])
            return 1.0 / float(np.min(steps, where=steps > 0, initial=1.0))
        assert kind == "itself"
        return np.maximum(np.abs(np.asarray(wanted)), 1e-300)


def stacked(inputs: Inputs, dtype: Any) -> tuple[np.ndarray, ...]:
    """All inputs of one shape as one batch; whole numbers stay as they are."""
    columns = zip(*inputs.values(), strict=True)
    with np.errstate(over="ignore"):
        return tuple(
            np.stack([np.asarray(one) if np.issubdtype(np.asarray(one).dtype, np.integer) else np.asarray(one, dtype)
                      for one in column])
            for column in columns
        )  # fmt: skip


def loss(case: Case, *arguments: Any) -> Any:
    """One number through which everything that the function gives flows."""
    given = case.function(*arguments)
    whole = [one for one in given.values() if jnp.issubdtype(jnp.asarray(one).dtype, jnp.floating)]
    return sum(jnp.sum(one) for one in whole)


def bend(case: Case, *arguments: Any) -> Any:
    """Second derivatives by all settings, each after itself and after the others."""
    places = case.settings

    def slopes(*moved: Any) -> Any:
        given = list(arguments)
        for place, one in zip(places, moved, strict=True):
            given[place] = one
        return jax.grad(partial(loss, case), argnums=places)(*given)

    return jax.jacfwd(slopes, argnums=tuple(range(len(places))))(*(arguments[place] for place in places))


def derivatives(case: Case, *arguments: Any) -> dict[str, Any]:
    """Gradient and second derivative of one input: one program."""
    return {
        "gradient": jax.grad(partial(loss, case), argnums=case.smooth)(*arguments) if case.smooth else (),
        "bend": bend(case, *arguments) if case.settings else (),
    }


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


def public_names() -> dict[str, Any]:
    """All that the modules offer, by dotted name below the package."""
    modules = [f"jaxradar.signal.{one.name}" for one in pkgutil.iter_modules(signal.__path__)]
    found = {}
    for module in (*modules, "jaxradar.units", "jaxradar._numerics", "jaxradar.systems.step"):
        loaded = importlib.import_module(module)
        found |= {f"{module.removeprefix('jaxradar.')}.{name}": getattr(loaded, name) for name in loaded.__all__}
    found["sim.render"] = importlib.import_module("jaxradar.sim").render
    return found


ABSTRACT = "abstract: its concrete classes are in the table"
CARRIER = "holds results and computes nothing"
HOST = "runs on the host in integers or float64, nothing to differentiate"
NOT_NUMERIC: dict[str, str] = {
    "signal.peaks.Peak": CARRIER,
    "signal.peaks.PeakEstimator": ABSTRACT,
    "signal.peaks.WindowEstimator": ABSTRACT,
    "signal.clutter.NoiseFloor": CARRIER,
    "signal.correlate.ProfileShift": CARRIER,
    "signal.pulse_fit.NARROWEST": "a constant",
    "signal.pulses.SIGMA_PER_FWHM": "a constant",
    "units.SPEED_OF_LIGHT_M_S": "a constant",
    "units.WAVELENGTH_60_GHZ_M": "a constant",
    "_numerics.as_scalar": "changes a type, never a value",
    "_numerics.compiled": "how a program is compiled",
    "_numerics.cpu_shaped": "how a program is traced",
    "_numerics.operations": "counts what a program does",
    "_numerics.reductions": "how a program is traced",
    "_numerics.row_major": "where values lie in memory",
    "systems.step.DETECTORS": "a table of names",
    "systems.step.Decision": CARRIER,
    "systems.step.DetectorFile": CARRIER,
    "systems.step.MotionSample": CARRIER,
    "systems.step.StepDetector": ABSTRACT,
    "systems.step.StepEvent": CARRIER,
    "systems.step.StepTrace": CARRIER,
    "systems.step.detect": HOST + "; what it compiles is `run`",
    "systems.step.dump_detector": "writes a file",
    "systems.step.load_detector": "reads a file",
    "systems.step.precision": "a context",
    "systems.step.thin": HOST,
    "systems.step.time_steps": HOST,
}


def as_before(inputs: dict[str, np.ndarray]) -> Inputs:
    return {name: (one,) for name, one in inputs.items()}


def crossed(inputs: dict[str, np.ndarray], **settings: tuple[float, ...]) -> Inputs:
    """Each input with each of the settings' hard values."""
    return {
        ", ".join([name, *(f"{key} {value:g}" for key, value in zip(settings, values, strict=True))]): (
            one,
            *(np.float32(value) for value in values),
        )
        for name, one in inputs.items()
        for values in product(*settings.values())
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
            names = tuple(one.name for one in dataclasses.fields(made) if not one.metadata.get("static"))
            for near in (False, True) if options else (False,):
                label = ", ".join([kind, *(f"{key} {value}" for key, value in options.items()), *["near"] * near])
                places = tuple(range(1 + near, 1 + near + len(names)))
                yield Case(
                    name=label,
                    covers=(covers,),
                    function=partial(_estimate, made, names, near),
                    inputs=partial(_estimator_inputs, made, names, near),
                    answer=partial(_estimator_answer, kind, made, near),
                    scale={"position": "bins", "amplitude": "largest"},
                    bound=POSITION_BOUND.get(kind, 1e-3),
                    bound64=1e-7,
                    sizes=(3, 17, 128) if near else hard.SIZES,
                    quick=() if near or options else (17,) if kind in DEAR else (128,),
                    smooth=(0, *places),
                    settings=places,
                )


def scalars(*columns: tuple[float, ...]) -> Inputs:
    return {
        " and ".join(f"{value:g}" for value in values): tuple(np.float64(np.float32(value)) for value in values)
        for values in product(*columns)
    }


def signal_cases() -> Iterator[Case]:
    yield Case(
        "soft_position",
        ("signal.soft.soft_position",),
        lambda values, temperature, log_gain, exponent: {
            "position": soft.soft_position(values, temperature, log_gain, exponent)[0],
            "found": soft.soft_position(values, temperature, log_gain, exponent)[1],
        },
        lambda bins: {
            name: (*one[:2], np.float32(np.log(2 * np.linspace(0.1, 0.9, bins))), one[2])
            for name, one in crossed(hard.sweeps(bins), temperature=hard.TEMPERATURES, exponent=(0.0, 2.0, 6.0)).items()
        },
        lambda values, temperature, log_gain, exponent: {
            "position": oracles.soft_mean(values, temperature, log_gain, exponent),
            "found": bool(oracles.finite(values).max() > 0),
        },
        {"position": "bins"},
        bound=6e-4,
        sizes=hard.SIZES,
        quick=(17,),
        smooth=(0, 1, 2, 3),
        settings=(1, 3),
    )
    yield Case(
        "vertex",
        ("signal.peaks.vertex",),
        lambda left, middle, right: dict(zip(("offset", "height"), peaks.vertex(left, middle, right), strict=True)),
        lambda _: {
            name: one
            for name, one in scalars(*((0.0, 1e-30, 1.0, 100.0, 101.0, 65535.0, 1e30),) * 3).items()
            if one[1] >= max(one[0], one[2])
        },
        oracles.vertex,
        {"offset": "1", "height": "itself"},
        bound=3e-7,
        smooth=(0, 1, 2),
    )
    yield Case(
        "window_at",
        ("signal.peaks.window_at",),
        lambda sweep, centre: dict(zip(("start", "taps"), peaks.window_at(sweep, centre, 1), strict=True)),
        lambda bins: {
            f"{name} at {at}": (one, np.int32(at))
            for name, one in hard.profiles(bins).items()
            for at in (-5, 0, bins // 2, bins - 1, bins + 5)
        },
        lambda sweep, centre: dict(zip(("start", "taps"), oracles.window(sweep, int(centre), 1), strict=True)),
        {"start": "1", "taps": "largest"},
        bound=0.0,
        sizes=(3, 16, 17, 128, 1448),
        quick=(17,),
    )
    yield Case(
        "gaussian_pulse",
        ("signal.pulses.gaussian_pulse",),
        lambda offset: {"height": pulses.gaussian_pulse(offset, 8.0)},
        lambda _: scalars((0.0, -0.0, 1e-30, -3.3, 8.0, 40.0, 1e4, -1e9, 1e15)),
        lambda offset: {"height": oracles.gaussian(offset, 8.0)},
        {"height": "1"},
        bound=3e-7,
    )
    yield Case(
        "noise_floor",
        ("signal.clutter.noise_floor",),
        lambda cells: {"level": (floor := clutter.noise_floor(cells)).level, "scatter": floor.scatter},
        lambda cells: as_before(
            {
                name: one
                for name, one in hard.sweeps(cells).items()
                if np.isfinite(one).all() and name not in (hard.SUBNORMAL,)
            }
        ),
        oracles.noise_floor,
        {"level": "largest", "scatter": "largest"},
        bound=1e-6,
        sizes=hard.SIZES,
        quick=(17,),
    )
    yield Case(
        "subtract_floor",
        ("signal.clutter.subtract_floor",),
        lambda cells, level: {"over": clutter.subtract_floor(cells, level)},
        lambda cells: crossed(hard.profiles(cells), level=(0.0, 100.0, 1e30)),
        lambda cells, level: {"over": np.maximum(cells - 1.1 * level, 0.0)},
        {"over": "largest"},
        bound=3e-7,
        sizes=hard.SIZES,
        quick=(17,),
        smooth=(0, 1),
        settings=(1,),
    )
    yield Case(
        "strongest_cell",
        ("signal.cells.strongest_cell",),
        lambda cells, level: dict(zip(("place", "strength"), cells_of.strongest_cell(cells, level), strict=True)),
        lambda cells: crossed(hard.profiles(cells), level=(0.0, 50.0)),
        oracles.strongest_cell,
        {"place": "bins", "strength": "largest"},
        bound=1e-4,
        sizes=(1, 2, 3, 16, 17),
        quick=(17,),
        smooth=(0, 1),
        settings=(1,),
    )
    pairs = lambda cells: {  # noqa: E731
        f"{a} against {b}": (hard.profiles(cells)[a], hard.profiles(cells)[b])
        for a in hard.profiles(cells)
        for b in ("all zero", "echo", "two equal echoes", "echo at the last bin", "alternating", "huge", "tiny")
    }
    reach = lambda cells: max(1, min(6, len(cells) - 1))  # noqa: E731
    yield Case(
        "profile_shift",
        ("signal.correlate.profile_shift",),
        lambda profile, reference: vars(correlate.profile_shift(profile, reference, reach(profile))),
        pairs,
        lambda profile, reference: oracles.profile_shift(profile, reference, reach(profile)),
        {"cells": "1", "unexplained_still": "1", "unexplained_moved": "1"},
        bound=1e-3,  # of a cell, where the correlation is nearly flat
        sizes=(1, 2, 3, 17, 128),
        quick=(17,),
        smooth=(0, 1),
    )
    yield Case(
        "shifted_correlations",
        ("signal.correlate.shifted_correlations",),
        lambda profile, reference: {"correlations": correlate.shifted_correlations(profile, reference, reach(profile))},
        pairs,
        lambda profile, reference: {"correlations": oracles.correlations(profile, reference, reach(profile))},
        {"correlations": "1"},
        bound=1e-6,
        sizes=(1, 2, 3, 17, 128),
        quick=(17,),
        smooth=(0, 1),
    )


VALUES = (0.0, -0.0, 1e-30, -1e-30, 0.7, -5.0, 65535.0, -1e9, 1e30, -1e30)


def _reduced(values: Any) -> dict[str, Any]:
    index, top = numerics.first_largest(values)
    selected, chosen, carried = numerics.select_largest([(values[0], values[-1]), (values[-1], values[0])])
    return {
        "total": numerics.total(values),
        "totals": numerics.totals(lambda one: (one, 0.5 * one), values)[1],
        "summed": numerics.summed([tuple(one) for one in numerics.sliced(values)], values.shape[-1])[0],
        "largest": numerics.largest(values),
        "largest_of": numerics.largest_of(lambda one: 0.5 * one, values),
        "smallest": numerics.smallest(values),
        "first_argmax": numerics.first_argmax(values),
        "first_largest": index,
        "top": top,
        "value_at": numerics.value_at(values, index),
        "select_largest": selected,
        "chosen": chosen,
        "carried": carried,
    }


def _reduced_in_numpy(values: np.ndarray) -> dict[str, Any]:
    at, ends = int(np.argmax(values)), [values[0], values[-1]]
    return {
        "total": math.fsum(values),
        "totals": 0.5 * math.fsum(values),
        "summed": math.fsum(values),
        "largest": values.max(),
        "largest_of": 0.5 * values.max(),
        "smallest": values.min(),
        "first_argmax": at,
        "first_largest": at,
        "top": values[at],
        "value_at": values[at],
        "select_largest": int(ends[1] > ends[0]),
        "chosen": max(ends),
        "carried": min(ends),
    }


def numeric_cases() -> Iterator[Case]:
    yield Case(
        "safe_divide",
        ("_numerics.safe_divide",),
        lambda above, below: {"ratio": numerics.safe_divide(above, below)},
        lambda _: {
            name: one
            for name, one in scalars(VALUES, VALUES).items()
            if one[1] == 0 or max(abs(one[0]), 1.0) / min(one[1] ** 2, abs(one[1])) < 1e37 or one[0] == 0
            if one[1] == 0 or one[0] == 0 or abs(one[0] / one[1]) > 1e-37
        },
        lambda above, below: {"ratio": 0.0 if below == 0 else above / below},
        {"ratio": "itself"},
        bound=3e-7,
        smooth=(0, 1),
    )
    yield Case(
        "safe_sqrt",
        ("_numerics.safe_sqrt",),
        lambda value: {"root": numerics.safe_sqrt(value)},
        lambda _: scalars(VALUES),
        lambda value: {"root": math.sqrt(max(value, 0.0))},
        {"root": "itself"},
        bound=3e-7,
    )
    yield Case(
        "soft_exceeds",
        ("_numerics.soft_exceeds",),
        lambda *one: {"share": numerics.soft_exceeds(*one)},
        lambda _: scalars((*VALUES, 0.699, 0.701, 1e5), (0.0, 0.7, 1e3), (1e-6, *hard.TEMPERATURES)),
        lambda value, threshold, temperature: {"share": oracles.sigmoid((value - threshold) / temperature)},
        {"share": "1"},
        bound=1e-6,
        smooth=(0, 1, 2),
        settings=(1, 2),
    )
    for name, floor in (("finite", -np.inf), ("nonnegative", 0.0)):
        yield Case(
            name,
            (f"_numerics.{name}",),
            lambda sweep, name=name: {"sweep": getattr(numerics, name)(sweep)},
            lambda bins: as_before(hard.sweeps(bins)),
            lambda sweep, floor=floor: {"sweep": np.maximum(oracles.finite(sweep), floor)},
            {"sweep": "largest"},
            bound=0.0,
            sizes=hard.SIZES,
            quick=(17,),
            undefined=frozenset({hard.SUBNORMAL}),
        )
    yield Case(
        "reductions",
        tuple(
            f"_numerics.{name}"
            for name in (
                *("total", "totals", "summed", "sliced", "largest", "largest_of", "smallest", "first_argmax"),
                *("first_largest", "value_at", "select_largest"),
            )
        ),
        _reduced,
        lambda bins: as_before(
            {name: one for name, one in hard.sweeps(bins).items() if np.isfinite(one).all() and name != hard.SUBNORMAL}
        ),
        _reduced_in_numpy,
        # The error of a sum is relative to the sum of the sizes.
        dict.fromkeys(_reduced_in_numpy(np.ones(2)), "itself"),
        bound=2e-6,
        bound64=1e-14,
        sizes=hard.SIZES,
        quick=(128,),
    )
    yield Case(
        "packed_largest",
        ("_numerics.packed_largest",),
        lambda values: dict(zip(("index", "top"), numerics.packed_largest(values), strict=True)),
        lambda bins: as_before(hard.profiles(bins)),
        lambda values: {"index": int(np.argmax(values)), "top": values.max()},
        {"index": "1", "top": "largest"},
        bound=0.0,
        bound64=1e-12,
        sizes=hard.SIZES,
        quick=(17,),
        dtypes=("float64",),
    )
    turns = (*VALUES, 0.25, 0.5, 0.75, -2.25, 1000.125, 2.0**22 + 0.5, 1e9)
    yield Case(
        "cosine_sine",
        ("_numerics.cosine_sine",),
        lambda turns: dict(zip(("cosine", "sine"), numerics.cosine_sine(turns), strict=True)),
        lambda _: scalars(turns),
        lambda turns: {
            "cosine": math.cos(2 * math.pi * math.fmod(turns, 1.0)),
            "sine": math.sin(2 * math.pi * math.fmod(turns, 1.0)),
        },
        {"cosine": "1", "sine": "1"},
        bound=5e-7,
        bound64=1e-14,
    )
    yield Case(
        "angle_of",
        ("_numerics.angle_of",),
        lambda across, along: {"angle": numerics.angle_of(across, along)},
        lambda _: (
            {
                f"{angle:g}": (np.float64(np.float32(math.sin(angle))), np.float64(np.float32(math.cos(angle))))
                for angle in (0.0, 1e-30, 1e-6, 0.5, -1.0, math.pi / 2, -math.pi / 2, 2.0, -3.0, math.pi)
            }
            | {"origin": (0.0, 0.0)}
        ),
        lambda across, along: {"angle": math.atan2(across, along)},
        {"angle": "1"},
        bound=2e-6,
        # Of a vector whose length is 1 as float32 says; straight backwards the answer is only finite.
        bound64=3e-7,
        smooth=(0, 1),
        undefined=frozenset({f"{math.pi:g}"}),
    )


def unit_cases() -> Iterator[Case]:
    wavelength = 299_792_458.0 / 60e9
    loss_of = lambda distance: (4 * math.pi * distance / wavelength) ** 2  # noqa: E731
    distances = scalars((1e-6, 0.1, 0.5, 1.0, 1e3, 1e9))
    for name, function, wanted in (
        ("free_space_loss", units.free_space_loss, loss_of),
        ("friis_power_ratio", units.friis_power_ratio, lambda distance: 1.0 / loss_of(distance)),
    ):
        yield Case(
            name,
            (f"units.{name}",),
            lambda distance, function=function: {"ratio": function(distance)},
            lambda _: distances,
            lambda distance, wanted=wanted: {"ratio": wanted(distance)},
            {"ratio": "itself"},
            bound=1e-6,
            bound64=1e-14,
        )


def difference_cases() -> Iterator[Case]:
    ways: dict[str, tuple[Any, Any]] = {
        "backward_difference": (differences.backward_difference, oracles.backward_difference),
        "three_point_difference": (differences.three_point_difference, oracles.three_point_difference),
        **{
            f"fitted_slope, order {order}": (
                partial(differences.fitted_slope, window=5, order=order),
                partial(oracles.fitted_slope, window=5, order=order),
            )
            for order in (1, 2)
        },
    }
    for name, (function, wanted) in ways.items():
        yield Case(
            name,
            (f"signal.differences.{name.partition(',')[0]}",),
            lambda values, dt, function=function: {"slope": function(values, dt)},
            hard.tracks,
            lambda values, dt, wanted=wanted: {"slope": wanted(values, dt)},
            {"slope": "largest step in the shortest time"},
            bound=1e-5,
            sizes=(1, 2, 3, 12),
            quick=(12,),
            smooth=(0, 1),
        )


def all_cases() -> dict[str, Case]:
    from stability_detectors import detector_cases

    made = [
        *estimator_cases(),
        *signal_cases(),
        *numeric_cases(),
        *unit_cases(),
        *difference_cases(),
        *detector_cases(),
    ]
    return {case.name: case for case in made}
