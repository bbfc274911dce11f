"""All sweeps laid over each other: where the echo is, how it varies, how far it stands out of the noise."""

from __future__ import annotations

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from jaxradar.drive import SensorSeries
from jaxradar.plots.style import BLUE, GREY, SKY, VERMILION, WIDTH_IN, styled, titled
from jaxradar.systems.step.result import StepTrace

__all__ = ["plot_sweeps"]

_MOST_LINES = 300
_MOST_SWEEPS = 5000


def plot_sweeps(series: SensorSeries, trace: StepTrace | None = None, *, source: str = "") -> Figure:
    """Amplitude over range: single sweeps faint, their mean and the range of 90 % of them strong, the sweeps at which
    `trace` has a detection apart.

    At most 5000 sweeps, evenly spaced, make the mean and 300 of them the faint lines. Raises `ValueError` for a series
    without valid sweeps.
    """
    valid = np.flatnonzero(~series.invalid)
    if not valid.size:
        raise ValueError("`plot_sweeps(series=...)` must hold at least one valid sweep; got none.")
    picked = valid[np.linspace(0, len(valid) - 1, min(len(valid), _MOST_SWEEPS)).astype(int)]
    sweeps = np.asarray(series.sweeps[picked], np.float64)
    faint = sweeps[np.linspace(0, len(sweeps) - 1, min(len(sweeps), _MOST_LINES)).astype(int)]
    mean = sweeps.mean(axis=0)
    low, high = np.percentile(sweeps, [5, 95], axis=0)
    range_m = series.range_m
    peak = int(mean.argmax())
    with styled():
        figure = Figure(figsize=(WIDTH_IN, 4.2), layout="constrained")
        panel = figure.subplots()
        lines = [np.column_stack([range_m, sweep]) for sweep in faint]
        drawn = LineCollection(lines, colors=GREY, linewidths=0.5, alpha=max(0.15, min(0.6, 40 / len(lines))))
        drawn.set_rasterized(True)
        panel.add_collection(drawn)
        panel.fill_between(
            range_m, low, high, color=SKY, alpha=0.55, linewidth=0, zorder=2, label="5 to 95 % of the sweeps"
        )
        panel.plot(range_m, mean, color=BLUE, linewidth=2.0, label=f"mean of {len(sweeps)} sweeps")
        events = [] if trace is None else [event.sweep for event in trace.events][:5]
        for number, sweep in enumerate(events):
            label = "at a detection" if number == 0 else None
            panel.plot(range_m, np.asarray(series.sweeps[sweep]), color=VERMILION, linewidth=1.1, label=label)
        panel.plot([], [], color=GREY, linewidth=0.8, label="single sweeps")
        panel.set_xlim(range_m[0], range_m[-1])
        panel.set_ylim(0, 1.08 * max(float(faint.max()), 1.0))
        panel.set_xlabel("slant range / m")
        panel.set_ylabel("amplitude / counts")
        panel.legend(loc="upper right")
        message = f"The mean echo peaks at {range_m[peak]:.3f} m with {mean[peak]:.0f} counts"
        titled(figure, panel, message, source)
    return figure
