"""One look for all figures: legible when shown 800 pixels wide, and without relying on red against green."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib import font_manager
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxradar.drivefile import staged

__all__ = [
    "BLACK",
    "BLUE",
    "GREEN",
    "GREY",
    "MAP",
    "ORANGE",
    "SKY",
    "VERMILION",
    "WIDTH_IN",
    "save",
    "styled",
    "titled",
]

# Okabe and Ito, "Color Universal Design" (2008).
BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
BLUE, VERMILION = "#0072B2", "#D55E00"
GREY = "#8A8A8A"
MAP = "viridis"
WIDTH_IN = 8.0
DPI = 150

_CJK = ("Noto Sans CJK JP", "IPAexGothic", "IPAGothic", "TakaoGothic", "Yu Gothic", "Hiragino Sans", "MS Gothic")
_INSTALLED = [name for name in _CJK if name in {font.name for font in font_manager.fontManager.ttflist}]

_STYLE: dict[Any, Any] = {
    # Names of logs come in any script; matplotlib's own font is tried first, glyph by glyph, then what is installed.
    "font.family": ["DejaVu Sans", *_INSTALLED],
    "font.size": 10.5,
    "axes.titlesize": 10.5,
    "axes.labelsize": 10.5,
    "xtick.labelsize": 9.5,
    "ytick.labelsize": 9.5,
    "legend.fontsize": 9,
    "legend.frameon": True,
    "legend.framealpha": 0.9,
    "legend.edgecolor": "none",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#E4E4E4",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.2,
    "figure.facecolor": "white",
}


@contextmanager
def styled() -> Iterator[None]:
    """Matplotlib's settings inside this block alone; what the user set otherwise stays out of the figure."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_STYLE)
        yield


def titled(figure: Figure, axes: Axes, message: str, source: str) -> None:
    """The message in bold over the figure, what it was made of in grey beneath it."""
    # A file name may hold a dollar sign, which is no mathematics.
    axes.set_title(source, loc="left", color="#555555", fontsize=9.5, parse_math=False)
    figure.suptitle(message, x=0.012, ha="left", fontsize=12.5, fontweight="bold")


def save(figure: Figure, path: Path) -> None:
    """Write a PNG 1200 pixels wide in place of what was there. Raises `LogError` if it cannot be written."""
    with styled(), warnings.catch_warnings(), staged(path, overwrite=True) as stage:
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)  # a name in a script without a font
        figure.savefig(stage, format="png", dpi=DPI)
