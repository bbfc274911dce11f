"""Sweeps as they come: from a sensor on the car, or from a recorded drive as if it were one.

Runs on the device: NumPy and the standard library alone. Acconeer's client is imported where it is asked for.
"""

from jaxradar.live.acconeer import AcconeerSource
from jaxradar.live.acconeer_range import ActualRange
from jaxradar.live.replay import Replay
from jaxradar.live.sweeps import LiveSweep, Source

__all__ = ["AcconeerSource", "ActualRange", "LiveSweep", "Replay", "Source"]
