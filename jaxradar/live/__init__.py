"""Sweeps as they come: from a sensor on the car, or from a recorded drive as if it were one.

A `Source` (`sweeps`) gives them, a `LiveDetector` (`detect`) decides on each, and the loop that does both, `run.run`,
tells its `Listener`s; `app` makes these of `options`, for the device and for `jaxradar live`.

Runs on the device: NumPy and the standard library alone. Acconeer's client is imported where it is asked for.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jaxradar.live.acconeer import AcconeerSource
    from jaxradar.live.acconeer_range import ActualRange
    from jaxradar.live.replay import Replay
    from jaxradar.live.sweeps import LiveSweep, Source

__all__ = ["AcconeerSource", "ActualRange", "LiveSweep", "Replay", "Source"]

# Imported at first use: the command line reads the options alone, without NumPy.
_HOMES = {
    "AcconeerSource": "acconeer",
    "ActualRange": "acconeer_range",
    "LiveSweep": "sweeps",
    "Replay": "replay",
    "Source": "sweeps",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
