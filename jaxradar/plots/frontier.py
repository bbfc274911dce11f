"""Accuracy against time as pictures: error over time with the front, and error over SNR with the bound."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxradar.estimate.bounds import threshold_snr_db, total_error_m
from jaxradar.pareto import CaseResult, Frontier, Point
from jaxradar.plots.style import BLACK, BLUE, GREEN, GREY, ORANGE, SKY, VERMILION, WIDTH_IN, styled, titled

__all__ = ["plot_case", "plot_levels"]

CLOSE = 1.1  # times the bound: what counts as meeting it
LABEL_GAP = 0.052  # of the picture's height, between two labels
MOST_CURVES = 5


def plot_case(frontier: Frontier, result: CaseResult) -> Figure:
    """Error over the time of one item, both axes logarithmic, with the bound and the front."""
    with styled():
        figure = Figure(figsize=(WIDTH_IN, 0.62 * WIDTH_IN), layout="constrained")
        axes = figure.add_subplot()
        _scatter(axes, frontier, result)
        titled(figure, axes, _message(frontier, result), f"{frontier.title}: {result.about}, {result.case}")
    return figure


def plot_levels(frontier: Frontier) -> Figure | None:
    """RMS error over SNR for the front of the first case and the default, with the bound and the region where gross
    errors keep everybody from it; None where fewer than three cases differ in SNR alone."""
    first = frontier.results[0]
    same = {key: value for key, value in first.setting.items() if key != "snr_db"}
    held = sorted(
        (
            one
            for one in frontier.results
            if {key: value for key, value in one.setting.items() if key != "snr_db"} == same
            and one.case.split(" ")[0] == first.case.split(" ")[0]
            and "," not in one.case
        ),
        key=lambda one: one.setting.get("snr_db", math.nan),
    )
    if "snr_db" not in first.setting or len(held) < 3:
        return None
    with styled():
        figure = Figure(figsize=(WIDTH_IN, 0.6 * WIDTH_IN), layout="constrained")
        axes = figure.add_subplot()
        _draw_levels(axes, held, same)
        axes.set_ylabel(f"{frontier.error_name} ({frontier.unit})")
        titled(
            figure,
            axes,
            "Far below the threshold of gross errors nobody meets the bound; above it the pulse fit does",
            first.about,
        )
    return figure


def _draw_levels(axes: Axes, held: Sequence[CaseResult], setting: dict[str, float]) -> None:
    levels = [one.setting["snr_db"] for one in held]
    shape = setting["fwhm_m"], setting["bin_m"]
    fine = np.linspace(levels[0], levels[-1], 101)
    threshold = threshold_snr_db(*shape, setting["window_m"], CLOSE)
    axes.axvspan(
        min(levels[0], threshold) - 1.0, threshold, color="#EFEFEF", zorder=0, label="gross errors: no one can"
    )
    axes.plot(levels, [one.bound or math.nan for one in held], color=BLACK, lw=1.6, label=held[0].bound_name + " bound")
    total = [1e3 * total_error_m(level, *shape, setting["window_m"]) for level in fine]
    axes.plot(fine, total, color=BLACK, lw=1.0, ls=":", label="bound with gross errors")
    for name, color, marker in zip(_curves(held), (BLUE, VERMILION, GREEN, ORANGE, SKY), "oDs^v", strict=False):
        errors = {one.setting["snr_db"]: point.error for one in held for point in one.points if point.candidate == name}
        x = sorted(errors)
        y = np.array([(errors[level].low, errors[level].value, errors[level].high) for level in x]).T
        axes.errorbar(x, y[1], yerr=np.abs(y[[0, 2]] - y[1]), color=color, marker=marker, ms=5, capsize=2, label=name)
    axes.set_yscale("log")
    axes.set_xlim(levels[0] - 1.0, levels[-1] + 1.0)
    axes.set_xlabel("SNR in one bin, 20 log₁₀(A/σ) (dB)")
    axes.legend(loc="upper right")


def _curves(held: Sequence[CaseResult]) -> list[str]:
    """The default's, the best at the first level with more than gross errors, and what people would take first."""
    names = [point.candidate for point in held[0].points]
    wanted = ["pulse fit", "default", "soft-argmax ±0.5", "parabola", "arg-max"]
    return [name for name in wanted if name in names][:MOST_CURVES] or names[:MOST_CURVES]


def _scatter(axes: Axes, frontier: Frontier, result: CaseResult) -> None:
    positive = [point.error.value for point in result.points if point.error.value > 0]
    floor = 0.5 * min(positive, default=1.0)  # an error of 0 has no place on a logarithmic axis
    labels = []
    for point in result.points:
        x, y = 1e9 * point.batch.median, max(point.error.value, floor)
        color, marker, size = _look(point)
        low, high = max(point.error.low, 0.2 * y), min(point.error.high, 20.0 * y)
        axes.errorbar(
            x,
            y,
            xerr=[[x - 1e9 * point.batch.low], [1e9 * point.batch.high - x]],
            yerr=[[max(y - low, 0.0)], [max(high - y, 0.0)]],
            color=color,
            marker=marker,
            ms=size,
            lw=0.8,
            ls="none",
            zorder=4 if point.front or point.default else 3,
            alpha=1.0 if point.front or point.default or point.peer else 0.55,
        )
        if point.front or point.default or point.peer:
            labels.append((x, y, point.candidate, color))
    front = result.front
    axes.step(
        [1e9 * point.batch.median for point in front],
        np.minimum.accumulate([max(point.error.value, floor) for point in front]),
        where="post",
        color=BLUE,
        lw=1.0,
        alpha=0.7,
        label="front",
    )
    if result.bound:
        axes.axhline(result.bound, color=BLACK, lw=1.4, label=f"{result.bound_name} bound")
    for color, marker, name in (
        (BLUE, "o", "jaxradar"),
        (VERMILION, "D", "jaxradar's default"),
        (ORANGE, "s", "others"),
    ):
        axes.plot([], [], color=color, marker=marker, ls="none", label=name)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.margins(0.08, 0.12)
    axes.set_xlabel(f"time a {frontier.item} in a batch (ns), with 10 to 90 % of the rounds")
    axes.set_ylabel(f"{frontier.error_name} ({frontier.unit}), with 95 % interval")
    _label(axes, labels)
    axes.legend(loc="upper right")


def _look(point: Point) -> tuple[str, str, float]:
    if point.default:
        return VERMILION, "D", 8.0
    if point.peer:
        return ORANGE, "s", 6.0
    return (BLUE, "o", 6.0) if point.front else (GREY, "o", 4.5)


def _label(axes: Axes, labels: Sequence[tuple[float, float, str, str]]) -> None:
    """Beside the points, from the lowest up, each far enough above the one before it where they would overlap."""
    axes.autoscale_view()
    (x0, x1), (y0, y1) = np.log(axes.get_xlim()), np.log(axes.get_ylim())
    taken: list[tuple[float, float]] = []
    for x, y, text, color in sorted(labels, key=lambda one: one[1]):
        across, up = (math.log(x) - x0) / (x1 - x0), (math.log(y) - y0) / (y1 - y0)
        place = up
        while any(abs(place - other) < LABEL_GAP and abs(across - there) < 0.3 for there, other in taken):
            place += 0.5 * LABEL_GAP
        taken.append((across, place))
        left = across > 0.72
        axes.annotate(
            text,
            (x, y),
            xytext=(across + (-0.015 if left else 0.015), place),
            textcoords="axes fraction",
            fontsize=8,
            color="#333333" if color == GREY else color,
            ha="right" if left else "left",
            va="center",
            arrowprops={"arrowstyle": "-", "lw": 0.4, "color": GREY} if place - up > 0.5 * LABEL_GAP else None,
        )


def _message(frontier: Frontier, result: CaseResult) -> str:
    """What the picture says, in figures of its own."""
    target = CLOSE * result.bound if result.bound else None
    ours = [point for point in result.points if not point.peer]
    theirs = [point for point in result.points if point.peer]
    if target is None or not any(point.error.value <= target for point in ours):
        best = min(result.points, key=lambda point: (point.error.value, point.batch.median))
        return (
            f"Least error: {best.candidate}, {best.error.value:.3g} {frontier.unit} in {1e9 * best.batch.median:.3g} ns"
        )
    meets = min((point for point in ours if point.error.value <= target), key=lambda point: point.batch.median)
    text = f"Within {CLOSE - 1.0:.0%} of the bound in {1e9 * meets.batch.median:.3g} ns a {frontier.item}"
    equal = [point.batch.median for point in theirs if point.error.value <= target]
    return text + (f"; others take {min(equal) / meets.batch.median:.3g} times as long" if equal else "")
