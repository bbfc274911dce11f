"""How a fit went: the cost on drives kept for validation, stage by stage, of each start."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from jaxradar.plots.style import BLUE, SKY, VERMILION, WIDTH_IN, styled, titled
from jaxradar.tuning import Tuned

__all__ = ["plot_fit"]


def plot_fit(tuned: Tuned) -> Figure:
    """Cost over stages; the first start is the detector as it was."""
    with styled():
        figure = Figure(figsize=(WIDTH_IN, 0.5 * WIDTH_IN), layout="constrained")
        axes = figure.add_subplot()
        for place, one in enumerate(tuned.starts):
            own = place == 0
            label = "from the detector as it was" if own else "from elsewhere" if place == 1 else None
            axes.plot(np.arange(len(one.costs)), one.costs, color=BLUE if own else SKY, marker="o", ms=4, label=label)
        axes.axhline(tuned.after, color=VERMILION, lw=1.0, ls="--", label="taken")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set_ylim(bottom=0.0)
        axes.set_xlabel("stage of the fit, the decision colder in each")
        axes.set_ylabel("cost on drives kept for validation")
        axes.legend(loc="upper right")
        titled(
            figure,
            axes,
            f"The fit brings the cost from {tuned.before:.3g} to {tuned.after:.3g}",
            ", ".join(tuned.space.names),
        )
    return figure
