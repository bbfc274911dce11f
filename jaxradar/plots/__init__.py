"""Figures of drives and of what a detector says of them. Results in, `matplotlib.figure.Figure` out.

    plot_drive(series, trace, motion=..., matching=...)    map of amplitude, followed range, statistic, acceleration
    plot_sweeps(series, trace)                             all sweeps laid over each other

Matplotlib's objects alone are used, no pyplot: no window, no global figure, no global setting is touched. A figure has
a fixed size whatever the log's length: a day of sweeps is drawn from as many of them as the picture has columns.
"""

from jaxradar.plots.overlay import plot_sweeps
from jaxradar.plots.style import save
from jaxradar.plots.timeline import plot_drive

__all__ = ["plot_drive", "plot_sweeps", "save"]
