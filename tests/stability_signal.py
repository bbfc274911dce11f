"""What works on sweeps and ranges, in the table: soft positions, floors, cells, shifts, differences."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import hard_inputs as hard
import numpy as np
import stability_oracles as oracles
from stability_case import Case, as_before, crossed, scalars

from jaxradar.signal import cells as cells_of
from jaxradar.signal import clutter, correlate, differences, peaks, pulses, soft


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
