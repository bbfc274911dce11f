"""Scalars and reductions in the table: guarded arithmetic, sums and maxima, angles, losses on the way."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import hard_inputs as hard
import numpy as np
import stability_oracles as oracles
from stability_case import Case, as_before, scalars

import jaxradar._numerics as numerics
from jaxradar import units

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
        flat=frozenset({"largest_of", "top"}),
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
