"""Pictures of the detection suite: who sees how many steps over their height, and at what price in false alarms."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import cycle

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxradar.plots.style import BLUE, GREEN, GREY, ORANGE, VERMILION, WIDTH_IN, styled, titled
from jaxradar.suite import CellScore, StepCell, Suite

__all__ = ["plot_heights", "plot_roc"]

_LOOKS = ((VERMILION, "o"), (BLUE, "s"), (GREEN, "^"), (ORANGE, "D"), (GREY, "v"))


def plot_heights(suite: Suite, detector: str) -> Figure:
    """Share of steps that a detector sees in time over their height, for each road a panel and for each speed a curve;
    the bars are 95 % intervals."""
    held = {cell: one for cell, one in suite.cells[detector].items() if not cell.variation}
    roads = list(dict.fromkeys(cell.road for cell in held))
    speeds = sorted({cell.speed_kmh for cell in held})
    with styled():
        figure = Figure(figsize=(WIDTH_IN, 0.55 * WIDTH_IN), layout="constrained")
        panels = figure.subplots(1, len(roads), sharey=True, squeeze=False)[0]
        for panel, road in zip(panels, roads, strict=True):
            for speed, (color, marker) in zip(speeds, cycle(_LOOKS), strict=False):
                _curve(
                    [(c, s) for c, s in held.items() if c.road == road and c.speed_kmh == speed], panel, color, marker
                )
            panel.set_title(road, loc="left")
            panel.set_xlabel("height of the step (mm)")
            panel.set_ylim(-3, 103)
        panels[0].set_ylabel("steps seen in time (%)")
        panels[-1].legend(loc="upper left")
        figure.suptitle(
            f"{detector}: steps seen early enough, of each height, on {len(roads)} roads",
            x=0.012,
            ha="left",
            fontsize=12.5,
            fontweight="bold",
        )
    return figure


def _curve(held: Sequence[tuple[StepCell, CellScore]], panel: Axes, color: str, marker: str) -> None:
    ordered = sorted(held, key=lambda one: one[0].height_m)
    label = f"{ordered[0][0].speed_kmh:g} km/h" if ordered else None
    # Steps down and steps up are different things: no line leads from the one to the other.
    for some in ([one for one in ordered if one[0].height_m < 0], [one for one in ordered if one[0].height_m > 0]):
        if not some:
            continue
        x = [1e3 * cell.height_m for cell, _ in some]
        y = np.array([(one.in_time.low, one.in_time.value, one.in_time.high) for _, one in some]).T * 100.0
        errors = np.abs(y[[0, 2]] - y[1])
        panel.errorbar(x, y[1], yerr=errors, color=color, marker=marker, ms=5, capsize=2, label=label)
        label = None


def plot_roc(suite: Suite) -> Figure:
    """Share of steps seen in time over false alarms an hour, for each detector, with its own threshold marked."""
    with styled():
        figure = Figure(figsize=(WIDTH_IN, 0.55 * WIDTH_IN), layout="constrained")
        axes = figure.add_subplot()
        for (name, rows), (color, marker) in zip(suite.roc.items(), cycle(_LOOKS), strict=False):
            axes.plot(rows[:, 1], 100.0 * rows[:, 2], color=color, label=name)
            own = int(np.argmin(np.abs(np.log(np.maximum(rows[:, 0], 1e-9)))))
            if math.isfinite(rows[own, 0]) and rows[:, 0].min() <= 1.0 <= rows[:, 0].max():
                axes.plot(rows[own, 1], 100.0 * rows[own, 2], color=color, marker=marker, ms=8, ls="")
        axes.axvline(1.0, color="#555555", lw=0.8, ls="--")
        axes.annotate("one an hour", (1.0, 2.0), xytext=(4, 0), textcoords="offset points", color="#555555")
        axes.set_xscale("log")
        axes.set_ylim(-3, 103)
        axes.set_xlabel("false alarms an hour (half seconds without a step above the threshold)")
        axes.set_ylabel("steps seen in time (%)")
        axes.legend(loc="center left")
        titled(figure, axes, _verdict(suite), f"{suite.roc_of}; all roads")
    return figure


def _verdict(suite: Suite) -> str:
    """What each detector sees at one false alarm an hour, as far as there was time to say."""
    said = []
    for name, rows in suite.roc.items():
        rare = rows[rows[:, 1] <= 1.0]
        if len(rare) and np.isfinite(rare[:, 2]).any():
            said.append(f"{name} {100.0 * float(np.nanmax(rare[:, 2])):.0f} %")
    if not said:
        return "Steps seen over false alarms"
    return f"Seen at one false alarm an hour: {', '.join(said)}"
