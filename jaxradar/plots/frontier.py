"""Accuracy against time as pictures: error over time with the front, and error over SNR with the bound."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from jaxradar.pareto import CaseResult, Frontier, Point
from jaxradar.plots.style import BLACK, BLUE, GREEN, GREY, ORANGE, SKY, VERMILION, WIDTH_IN, styled, titled

__all__ = ["plot_case", "plot_levels"]

CLOSE = 1.1  # times the bound: what counts as meeting it
LABEL_GAP = 0.052  # of the picture's height, between two labels
LETTER = 0.012  # of the picture's width
ABOVE = 0.03  # clear of the error bars
INK = {ORANGE: "#8A5A00", GREY: "#333333"}  # what is too light for letters
MOST_CURVES = 5


def plot_case(frontier: Frontier, result: CaseResult) -> Figure:
    """Error over cost (the time of one item), both axes logarithmic, with the bound and the front. Raises `ValueError`
    where nobody had an answer."""
    if not result.points:
        raise ValueError(f"nobody had an answer in {result.case.name}.")
    with styled():
        figure = Figure(figsize=(WIDTH_IN, 0.62 * WIDTH_IN), layout="constrained")
        axes = figure.add_subplot()
        _scatter(axes, frontier, result)
        titled(figure, axes, _message(frontier, result), f"{frontier.title}: {result.case.about} ({result.case.name})")
    return figure


def plot_levels(frontier: Frontier) -> Figure | None:
    """Error over the level (SNR) of the first case's series: the bound, what theory says can be attained, and some
    candidates; None where fewer than three cases of it were measured."""
    series = frontier.results[0].case.series
    held = [one for one in frontier.results if series and one.case.series == series and one.points]
    if len(held) < 3:
        return None
    held.sort(key=lambda one: one.case.level or 0.0)
    with styled():
        figure = Figure(figsize=(WIDTH_IN, 0.6 * WIDTH_IN), layout="constrained")
        axes = figure.add_subplot()
        _draw_levels(axes, held)
        axes.set_ylabel(f"{frontier.error_name} ({frontier.unit})")
        titled(figure, axes, _level_message(held), f"{held[0].case.about}; 95 % intervals")
    return figure


def _draw_levels(axes: Axes, held: Sequence[CaseResult]) -> None:
    levels = [one.case.level or 0.0 for one in held]
    first = held[0].case
    left, right = levels[0] - 1.0, levels[-1] + 1.0
    if first.threshold is not None:
        axes.axvspan(min(left, first.threshold), first.threshold, color="#EFEFEF", zorder=0)
        axes.axvline(first.threshold, color=GREY, lw=0.8, ls="--", label="threshold of gross errors")
    axes.plot(levels, [one.bound or math.nan for one in held], color=BLACK, lw=1.6, label=first.bound_name + " bound")
    if first.attainable is not None:
        fine = np.linspace(min(left, first.threshold or left), right, 201)
        axes.plot(fine, [first.attainable(level) for level in fine], color=BLACK, lw=1.0, ls=":", label="attainable")
    for name, color, marker in zip(_curves(held), (VERMILION, BLUE, GREEN, ORANGE, SKY), "Dos^v", strict=False):
        errors = {one.case.level: point.error for one in held for point in one.points if point.candidate == name}
        y = np.array([(errors[level].low, errors[level].value, errors[level].high) for level in errors]).T
        x = [level or 0.0 for level in errors]
        axes.errorbar(x, y[1], yerr=np.abs(y[[0, 2]] - y[1]), color=color, marker=marker, ms=5, capsize=2, label=name)
    axes.set_yscale("log")
    _plain(axes)
    axes.set_xlim(min(left, first.threshold or left), right)
    axes.set_xlabel(first.level_name)
    axes.legend(loc="upper right")


def _curves(held: Sequence[CaseResult]) -> list[str]:
    """The default's, then those on the front of most of the levels, the most accurate of these first, then others."""
    points = [point for one in held for point in one.points if not point.peer]
    names = list(dict.fromkeys(point.candidate for point in sorted(points, key=lambda one: not one.default)))

    def rank(name: str) -> tuple[bool, int, float]:
        its = [point for point in points if point.candidate == name]
        return (
            not its[0].default,
            -sum(point.front for point in its),
            sum(math.log(max(p.error.value, 1e-300)) for p in its),
        )

    plain = [name for name in sorted(names, key=rank) if name.count(",") == 0]
    return plain[:MOST_CURVES]


def _level_message(held: Sequence[CaseResult]) -> str:
    """From which level on, without a gap, who is at the bound."""
    unit = held[0].case.level_name.rpartition("(")[2].rstrip(")")
    for name in _curves(held):
        meets = []
        for one in reversed(held):
            errors = [point.error.value for point in one.points if point.candidate == name]
            if not (errors and one.bound and errors[0] <= CLOSE * one.bound):
                break
            meets.append(one.case.level or 0.0)
        if len(meets) > 1:
            return f"From {meets[-1]:g} {unit} on, {name} is within {CLOSE - 1.0:.0%} of the bound"
    return "Nobody is near the bound at the two highest levels"


def _scatter(axes: Axes, frontier: Frontier, result: CaseResult) -> None:
    positive = [point.error.value for point in result.points if point.error.value > 0]
    floor = 0.5 * min(positive, default=1.0)  # an error of 0 has no place on a logarithmic axis
    labels = []
    named = _named(result)
    for point in result.points:
        x, y = point.cost.value, max(point.error.value, floor)
        color, marker, size = _look(point)
        low, high = max(point.error.low, 0.2 * y), min(point.error.high, 20.0 * y)
        axes.errorbar(
            x,
            y,
            xerr=[[x - point.cost.low], [point.cost.high - x]],
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
    if len(front) > 1:
        axes.step(
            [point.cost.value for point in front],
            np.minimum.accumulate([max(point.error.value, floor) for point in front]),
            where="post",
            color=BLUE,
            lw=1.0,
            alpha=0.7,
            label="front",
        )
    if result.bound:
        axes.axhline(result.bound, color=BLACK, lw=1.4, label=f"{result.case.bound_name} bound")
    kinds = {
        (BLUE, "o"): "jaxradar",
        (VERMILION, "D"): "jaxradar's default",
        (ORANGE, "s"): "others",
        (GREY, "o"): "beaten",
    }
    shown = {_look(point)[:2] for point in result.points}
    for (color, marker), name in kinds.items():
        if (color, marker) in shown:
            axes.plot([], [], color=color, marker=marker, ls="none", label=name)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.margins(0.08, 0.14)
    if frontier.cost_unit == "s":
        axes.set_xlabel(f"{frontier.cost_name} a {frontier.item} in a batch, and 10 to 90 % of the rounds")
    else:
        axes.set_xlabel(f"{frontier.cost_name} ({frontier.cost_unit})")
    axes.set_ylabel(f"{frontier.error_name} ({frontier.unit}), and 95 % interval")
    costs = [point.cost.value for point in result.points]
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if max(costs) < 30.0 * min(costs) else (1.0,)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda cost, _: _tick(frontier, cost)))
    axes.xaxis.set_minor_formatter(NullFormatter())
    _plain(axes)
    _label(axes, labels, [(point.cost.value, max(point.error.value, floor)) for point in result.points])
    axes.figure.legend(loc="outside lower center", ncols=6, columnspacing=1.4)


def _plain(axes: Axes) -> None:
    """Numbers that people read, at 1, 2 and 5."""
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())


def _tick(frontier: Frontier, cost: float) -> str:
    if frontier.cost_unit != "s":
        return f"{cost:g}"
    for unit, factor in (("s", 1.0), ("ms", 1e3), ("µs", 1e6)):
        if cost * factor >= 0.999:
            return f"{cost * factor:g} {unit}"
    return f"{1e9 * cost:g} ns"


def _named(result: CaseResult) -> set[str]:
    """The default, all others' ways, and of the front whoever is clearly better than the last that was named."""
    names = {point.candidate for point in result.points if point.default or point.peer}
    best = math.inf
    for point in sorted(result.front, key=lambda one: one.cost.value):
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


def _label(axes: Axes, labels: Sequence[tuple[float, float, str, str]], points: Sequence[tuple[float, float]]) -> None:
    """Beside the points, from the lowest up, each far enough above the one before it where they would overlap, and
    over no other point."""
    axes.autoscale_view()
    (x0, x1), (y0, y1) = np.log(axes.get_xlim()), np.log(axes.get_ylim())

    def placed(x: float, y: float) -> tuple[float, float]:
        return (math.log(x) - x0) / (x1 - x0), (math.log(y) - y0) / (y1 - y0)

    marks = [placed(*point) for point in points]
    taken: list[tuple[float, float]] = []
    for x, y, text, color in sorted(labels, key=lambda one: one[1]):
        across, up = placed(x, y)
        left = across > 0.72
        width = LETTER * len(text)
        ends = (across - width, across) if left else (across, across + width)
        place = up + ABOVE
        while any(abs(place - other) < LABEL_GAP and abs(across - there) < 0.3 for there, other in taken) or any(
            abs(place - other) < 0.5 * LABEL_GAP and ends[0] < there < ends[1] for there, other in marks
        ):
            place += 0.5 * LABEL_GAP
        taken.append((across, place))
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
        best = min(result.front or result.points, key=lambda point: (point.error.value, point.cost.value))
        cost = frontier.cost_text(best.cost.value)
        return f"Least error: {best.candidate}, {best.error.value:.3g} {frontier.unit} in {cost}"
    meets = min(point.cost.value for point in ours if point.error.value <= target)
    text = f"Within {CLOSE - 1.0:.0%} of the bound in {frontier.cost_text(meets)}"
    equal = [(point.cost.value, point.candidate) for point in theirs if point.error.value <= target]
    if not equal:
        return text
    least, theirs_is = min(equal)
    return f"{text}; {theirs_is} takes {float(f'{least / meets:.2g}'):g} times that"
