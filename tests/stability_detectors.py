"""The step detectors in the table: hard series of sweeps, hard times, every setting at its bounds; NumPy oracles."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import equinox as eqx
import hard_inputs as hard
import jax
import jax.numpy as jnp
import numpy as np
import stability_oracles as oracles
from approach_oracle import approach
from stability_case import Case, Inputs, scalars

from jaxradar.drive import SweepFlag
from jaxradar.systems.step import (
    DETECTORS,
    ApproachDetector,
    Decision,
    DefaultDetector,
    FilteredRateDetector,
    InnovationDetector,
    LabLiveDetector,
    RangeAxis,
    RangeRateDetector,
    ShiftDetector,
    ThesisDetector,
    event_weights,
    run,
)
from jaxradar.systems.step.range_rate import PEAKS

SWEEPS = 8
BIN_M = 0.007
RUN = ("systems.step.run", "systems.step.run_batch", "systems.step.RangeAxis")


def axis_of(bins: int) -> RangeAxis:
    return RangeAxis.of(0.2 + BIN_M * np.arange(bins))


def tunable(detector: Any) -> dict[str, dataclasses.Field]:
    fields = dataclasses.fields(detector)
    # Weights have tests of their own, in test_step_filtered.py.
    skipped = ("static", "weights")
    return {one.name: one for one in fields if "low" in one.metadata and not any(map(one.metadata.get, skipped))}


def series_of(sweep: np.ndarray) -> np.ndarray:
    """The sweep stands, steps by a bin, by two, is gone once and comes back."""
    moves = (0, 0, 1, 1, 3, 3, 0, 0)
    made = np.stack([np.roll(sweep, move) for move in moves[:SWEEPS]])
    made[5] = 0.0
    return made


def inputs_of(detector: Any, bins: int) -> Inputs:
    """Every sweep; every time step, setting at its bounds and temperature of the decision with an ordinary echo."""
    usual = {name: float(getattr(detector, name)) for name in tunable(detector)}
    given = hard.sweeps(bins)
    # Both square amplitudes, and second derivatives square them again: as far as float32 holds that.
    if isinstance(detector, ShiftDetector | ApproachDetector):
        given |= {"huge": given["echo"] * 2.0**44, "tiny": given["echo"] * 2.0**-40}

    def one(sweep: str = "echo", step_s: float = 0.01, temperature: float = 0.1, **moved: float) -> tuple[Any, ...]:
        counts = series_of(given[sweep])
        dt = np.full(SWEEPS, np.float32(step_s), np.float64)
        dt[0] = 0.0
        flags = np.where((counts == hard.FULL_SCALE).any(axis=1), int(SweepFlag.SATURATED), 0).astype(np.uint16)
        settings = ({**usual, **moved}).values()
        return (counts, dt, flags, np.float32(temperature), *(np.float64(np.float32(value)) for value in settings))

    made = {name: one(name) for name in given}
    made |= {f"time steps: {name}": one(step_s=step) for name, step in hard.STEPS_S.items()}
    made |= {f"soft decision at {value:g}": one(temperature=value) for value in hard.TEMPERATURES}
    for name, field in tunable(detector).items():
        for end in ("low", "high"):
            made[f"{name} at its {end}"] = one(**{name: field.metadata[end]})
    return made


def decided(detector: Any, bins: int, *arguments: Any) -> dict[str, Any]:
    sweeps, dt, flags, temperature, *settings = arguments
    names = list(tunable(detector))
    moved = eqx.tree_at(lambda one: [getattr(one, name) for name in names], detector, settings)
    decisions = run(moved, axis_of(bins), sweeps, flags, dt)
    return vars(decisions) | {"weight": event_weights(moved, decisions, temperature)}


# In NumPy: what one sweep says, and what remembers.

Place = Callable[[np.ndarray, np.ndarray, dict[str, float]], tuple[float, float, bool]]


def range_rate(
    place: Place, weights: list[float], counts: np.ndarray, dt: np.ndarray, settings: dict[str, float]
) -> dict[str, Any]:
    """`place`: slant range, strength and whether there is an echo. `weights`: of the differences before the newest."""
    before = [(0.0, 0.0)] * len(weights)
    rows: list[tuple[float, float, float, bool]] = []
    last_m, elapsed, seen = 0.0, 0.0, False
    range_m = np.asarray(axis_of(counts.shape[1]).range_m)
    for sweep, step in zip(counts, dt, strict=True):
        elapsed += step
        now_m, strength, valid = place(sweep, range_m, settings)
        known = valid and seen and elapsed > 0
        newest = (now_m - last_m, elapsed) if known else (0.0, 0.0)
        rise, wait = (newest[i] + sum(w * one[i] for w, one in zip(weights, before, strict=True)) for i in (0, 1))
        speed = rise / wait if known and wait > 0 else 0.0
        if valid:
            before = [newest, *before][: len(weights)]
            last_m, elapsed, seen = now_m, 0.0, True
        rows.append((last_m, speed, strength, valid))
    ranges, speeds, strengths, valid_ones = map(np.array, zip(*rows, strict=True))
    return {
        "range_m": ranges,
        "speed_m_s": speeds,
        "statistic": np.abs(speeds),
        "strength": strengths,
        "valid": valid_ones,
    }


def _between(position: float, range_m: np.ndarray) -> float:
    return float(np.interp(position, np.arange(len(range_m)), range_m))


def place_by_peak(peak: str, sweep: np.ndarray, range_m: np.ndarray, settings: dict[str, float]) -> Any:
    exponent = settings["exponent"]
    values, gain = oracles.finite(sweep), (2 * range_m) ** exponent
    selected = int(np.argmax(np.maximum(values, 0) * np.float32(gain)))
    half = min(max(1, round(0.5 * 0.045 / BIN_M)), (len(values) - 1) // 2)
    if peak == "matched filter":
        found = oracles.matched_filter(sweep, 0.04 / BIN_M, equal=0.0)
        return _between(float(np.ravel(found["position"])[0]), range_m), found["amplitude"], found["found"]
    if peak == "soft-argmax over all bins":
        position = oracles.soft_mean(values, settings["temperature"], np.log(2 * range_m), exponent)
        return _between(position if values.max() > 0 else 0.0, range_m), values.max(), values.max() > 0
    if peak == "arg-max":
        return range_m[selected], values[selected], values[selected] > 0
    start, taps = oracles.window(values, selected, half)
    if peak == "soft-argmax":
        position = start + oracles.soft_mean(taps, settings["temperature"])
    else:
        position = float(oracles.parabola(taps, selected - start, reach=half)["position"]) + start
    return _between(position if taps.max() > 0 else 0.0, range_m), taps.max(), taps.max() > 0


def place_by_thesis(sweep: np.ndarray, range_m: np.ndarray, settings: dict[str, float]) -> Any:
    values = oracles.finite(sweep)
    compensated = np.maximum(values, 0) * (2 * range_m) ** settings["exponent"]
    at = int(np.argmax(compensated))
    return range_m[at], values[at], compensated[at] > 0


def lab_live(counts: np.ndarray, dt: np.ndarray, settings: dict[str, float]) -> dict[str, Any]:
    range_m = np.asarray(axis_of(counts.shape[1]).range_m)
    values = oracles.finite(counts)
    at, strength = values.argmax(axis=1), values.max(axis=1)
    held = strength > settings["least_counts"]
    distance = np.where(held, range_m[at], 0.0)
    nearness = np.where(held, 1 / np.maximum(distance, 1e-3), 0.0)
    return {"range_m": distance, "statistic": nearness, "valid": held, "strength": strength}


def shift(counts: np.ndarray, dt: np.ndarray, flags: np.ndarray, settings: dict[str, float]) -> dict[str, Any]:
    """Strength and evidence of the shift detector; the range of a track that has just begun."""
    bins, made = counts.shape[1], ShiftDetector()
    range_m = np.asarray(axis_of(bins).range_m)
    per_cell = max(1, min(round(made.cell_m / BIN_M), bins // 2))
    cells_of = lambda values: values[: bins // per_cell * per_cell].reshape(-1, per_cell).mean(axis=1)  # noqa: E731
    centres = cells_of(range_m)
    cell_m = (centres[-1] - centres[0]) / (len(centres) - 1)
    reach = max(1, min(round(made.reach_m / (per_cell * BIN_M)), len(centres) - 1))
    reference, gap, tracking, out = np.zeros(len(centres)), 0.0, False, []
    still = jumping = 1e6
    age = 0.0
    for sweep, step in zip(counts, dt, strict=True):
        cells = cells_of(oracles.finite(sweep))
        floor = oracles.noise_floor(cells)
        ends = np.pad(cells, 1, mode="edge")
        over = np.maximum((ends[:-2] + cells + ends[2:]) / 3 - floor["level"], 0)
        strength = over[int(np.argmax(over * (2 * centres) ** settings["exponent"]))]
        profile = np.maximum(cells - 1.1 * floor["level"], 0)
        valid = strength > max(0, settings["over_floor"] * floor["level"], settings["over_scatter"] * floor["scatter"])
        gap += step
        tracking &= abs(gap) <= settings["longest_gap_s"]
        statistic = explained = 0.0
        left = np.inf
        share = 1.0 if valid else 0.0
        fresh = valid and not tracking
        lost = fresh and age > 0
        if valid and tracking:
            shift = oracles.profile_shift(profile, reference, reach)
            left = shift["unexplained_moved"][0]
            explained = shift["unexplained_still"] - left
            if abs(np.ravel(shift["cells"])[0] * cell_m) >= settings["least_shift_m"]:
                statistic = max(explained, 0.0)
            share = 1 - np.exp(-max(gap, 0.0) / settings["window_s"])
        rises = explained > settings["restless"] * settings["evidence"]
        jumping = 0.0 if rises and still >= settings["still_s"] else jumping + max(step, 0.0)
        still = 0.0 if rises or lost else still + max(step, 0.0)
        age = 0.0 if fresh else age + max(step, 0.0)
        if settings["still_s"] > 0 and jumping > settings["sudden_s"]:
            statistic = 0.0
        if left > min(settings["most_unexplained"], settings["most_left"] * explained):
            statistic = 0.0
        if age < settings["settle_s"] or gap <= 0:
            statistic = 0.0
        reference = reference + share * (profile - reference)
        if valid:
            gap, tracking = 0.0, True
        out.append((strength, statistic, valid))
    strengths, statistics, valid_ones = map(np.array, zip(*out, strict=True))
    return {"strength": strengths, "statistic": statistics, "valid": valid_ones}


def closing_in(
    detector: Any, counts: np.ndarray, dt: np.ndarray, flags: np.ndarray, settings: dict[str, float]
) -> dict[str, Any]:
    bins = counts.shape[1]
    range_m = np.asarray(axis_of(bins).range_m)
    usable = (flags & int(SweepFlag.INVALID)) == 0
    per_cell = max(1, min(round(detector.cell_m / BIN_M), bins // 2))
    cells = np.array([oracles.finite(row)[: bins // per_cell * per_cell] for row in counts])
    strength = cells.reshape(len(counts), -1, per_cell).mean(axis=2).max(axis=1)
    shapes = {one.name: getattr(detector, one.name) for one in dataclasses.fields(detector)}
    statistic, _ = approach(counts, dt, usable, range_m, BIN_M, {**shapes, **settings})
    valid = usable & (strength > 0)
    return {"strength": np.where(valid, strength, 0.0), "statistic": statistic, "valid": valid}


def answer_of(detector: Any, counts: Any, dt: Any, flags: Any, temperature: Any, *settings: Any) -> dict[str, Any]:
    held = dict(zip(tunable(detector), map(float, settings), strict=True))
    if isinstance(detector, LabLiveDetector):
        return lab_live(counts, dt, held)
    if isinstance(detector, ApproachDetector):
        return closing_in(detector, counts, dt, flags, held)
    if isinstance(detector, ShiftDetector):
        return shift(counts, dt, flags, held)
    peak = place_by_thesis if isinstance(detector, ThesisDetector) else partial(place_by_peak, detector.peak)
    return range_rate(peak, [float(one) for one in getattr(detector, "filter", ())], counts, dt, held)


def detector_cases() -> Iterator[Case]:
    for name, kind in DETECTORS.items():
        if kind in (DefaultDetector, InnovationDetector):  # its parts are here; test_step_innovation.py
            continue
        peaks = PEAKS if kind is RangeRateDetector else (None,)
        for peak in peaks:
            detector = kind() if peak is None else kind(peak=peak)
            if kind is FilteredRateDetector:
                detector = FilteredRateDetector(filter=(2.0, 0.5, -0.1))
            if kind is ShiftDetector:  # else the few sweeps are over before it has settled
                detector = ShiftDetector(settle_s=0.0)
            if kind is ApproachDetector:
                detector = ApproachDetector(settle_s=0.0, start_s=0.0, speeds=3, places=9, place_m=0.06)
            settings = tuple(range(4, 4 + len(tunable(detector))))
            for bins in (2, 16, 128) if peak in (None, "soft-argmax") else (2, 16):
                # The function needs the axis, so each length is a case of its own.
                yield Case(
                    name=f"{name}{f', {peak}' if peak else ''}, {bins} bins",
                    covers=(f"systems.step.{kind.__name__}", *RUN),
                    function=partial(decided, detector, bins),
                    inputs=lambda _, detector=detector, bins=bins: inputs_of(detector, bins),
                    answer=partial(answer_of, detector),
                    scale={
                        "range_m": "1",
                        "speed_m_s": "steps",
                        "statistic": "steps" if "rate" in detector.statistic_name else "1",
                        "strength": "largest",
                    },
                    bound=2e-5,
                    bound64=1e-6 if peak == "matched filter" else 1e-9,  # its oracle takes differences
                    quick=(None,) if bins == 16 and (name == "thesis" or peak == "soft-argmax") else (),
                    smooth=(0, 1, 3, *settings),
                    settings=settings,
                    dtypes=("float64",) if detector.float64 else ("float32", "float64"),
                )
    yield Case(
        "event_weights",
        ("systems.step.event_weights",),
        _weights,
        lambda _: scalars((0.0, 0.699, 0.7, 5.0, 65535.0, 1e9, 1e30), (0.0, 0.7, 1e3), (1e-6, *hard.TEMPERATURES)),
        lambda statistic, threshold, temperature: {
            "weight": np.array([oracles.sigmoid((statistic - threshold) / temperature), 0.0])
        },
        {"weight": "1"},
        bound=1e-6,
        smooth=(0, 1, 2),
        settings=(1, 2),
    )


def _weights(statistic: Any, threshold: Any, temperature: Any) -> dict[str, Any]:
    """Of a valid sweep, and of one that is not."""
    none, no = jnp.zeros_like(statistic), jnp.zeros((), bool)
    both = jax.vmap(lambda valid: Decision(none, none, none, statistic, none, valid, no, no))(jnp.array([True, False]))
    moved = eqx.tree_at(lambda one: one.threshold_m_s, RangeRateDetector(), threshold)
    return {"weight": event_weights(moved, both, temperature)}
