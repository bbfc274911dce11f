"""Accuracy against time as pictures: error over time with the front, and error over SNR with the bound."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from jaxradar.estimate.bounds import threshold_snr_db, total_error_m
from jaxradar.pareto import CaseResult, Frontier, Point, time_text
from jaxradar.plots.style import BLACK, BLUE, GREEN, GREY, ORANGE, SKY, VERMILION, WIDTH_IN, styled, titled

__all__ = ["plot_case", "plot_levels"]

CLOSE = 1.1  # times the bound: what counts as meeting it
LABEL_GAP = 0.052  # of the picture's height, between two labels
ABOVE = 0.03  # clear of the error bars
INK = {ORANGE: "#8A5A00", GREY: "#333333"}  # what is too light for letters
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
            "Above the threshold the pulse fit is at the bound; below it nobody is",
            f"{first.about}; 95 % intervals",
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
    _plain(axes)
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
    named = _named(result)
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
        if point.candidate in named:
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
    axes.margins(0.08, 0.14)
    axes.set_xlabel(f"time a {frontier.item} in a batch, and 10 to 90 % of the rounds")
    axes.set_ylabel(f"{frontier.error_name} ({frontier.unit}), and 95 % interval")
    axes.xaxis.set_major_formatter(FuncFormatter(lambda ns, _: _time(ns)))
    _plain(axes)
    _label(axes, labels)
    axes.figure.legend(loc="outside lower center", ncols=5)


def _plain(axes: Axes) -> None:
    """Numbers that people read, at 1, 2 and 5."""
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())


def _time(ns: float) -> str:
    for factor, unit in ((1e9, "s"), (1e6, "ms"), (1e3, "µs")):
        if ns >= factor:
            return f"{ns / factor:g} {unit}"
    return f"{ns:g} ns"


def _named(result: CaseResult) -> set[str]:
    """The default, all others' ways, and of the front whoever is clearly better than the last that was named."""
    names = {point.candidate for point in result.points if point.default or point.peer}
    best = math.inf
    for point in sorted(result.front, key=lambda one: one.batch.median):
        if point.error.value < 0.9 * best:
            names.add(point.candidate)
            best = point.error.value
    return names


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
        place = up + ABOVE
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
            color=INK.get(color, color),
            ha="right" if left else "left",
            va="center",
            arrowprops={"arrowstyle": "-", "lw": 0.4, "color": GREY} if place - up > ABOVE else None,
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
    text = f"Within {CLOSE - 1.0:.0%} of the bound in {time_text(meets.batch.median)} a {frontier.item}"
    equal = [point.batch.median for point in theirs if point.error.value <= target]
    return text + (f"; others take {min(equal) / meets.batch.median:.3g} times as long" if equal else "")
