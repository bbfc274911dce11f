"""The options of live detection, which the package's command line and a compiled detector's own share."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable

__all__ = ["BINS", "HOST", "SENSORS", "add_live_options"]

# As the lab's program sets them (thesis, appendix C.1).
RATE_HZ, START_M, LENGTH_M, BINS, SENSORS = 100.0, 0.1, 0.7, 128, (1, 3)
HOST = "localhost"  # the exploration server's, on the device itself


def _number(least: float, *, above: bool = True) -> Callable[[str], float]:
    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not (math.isfinite(value) and (value > least if above else value >= least)):
            raise argparse.ArgumentTypeError(f"expected a number {'>' if above else '>='} {least:g}, got {text!r}")
        return value

    return parse


def _whole(text: str) -> int:
    value = int(text) if text.isdecimal() else 0
    if value < 1:
        raise argparse.ArgumentTypeError(f"expected a whole number >= 1, got {text!r}")
    return value


def _sensors(text: str) -> tuple[int, ...]:
    parts = text.split(",")
    numbers = tuple(int(part) if part.strip().isdecimal() else -1 for part in parts)
    if min(numbers) < 0 or len(set(numbers)) != len(numbers):
        raise argparse.ArgumentTypeError(f"expected sensor numbers such as 1,3, got {text!r}")
    return numbers


def add_live_options(parser: argparse.ArgumentParser, sources: dict[str, str]) -> None:
    """`sources`: what each kind of source is made of, by its name."""
    words = "; ".join(f"{name}: {what}" for name, what in sources.items())
    parser.add_argument("--source", required=True, choices=tuple(sources), metavar="KIND", help=words)
    parser.add_argument("where", nargs="?", metavar="WHERE", help="the log, the scene or the server's host")
    parser.add_argument("--sensors", type=_sensors, metavar="N,N", help="these sensors (default: all; of a server 1,3)")
    pace = parser.add_mutually_exclusive_group()
    pace.add_argument("--pace", type=_number(0.0), default=1.0, metavar="X", help="replay X times as fast (default: 1)")
    pace.add_argument("--fast", action="store_true", help="replay as fast as it goes")
    parser.add_argument("--sweeps", type=_whole, metavar="N", help="end after so many sweeps")
    parser.add_argument("--json", action="store_true", help="detections, and at the end a summary, as JSON lines")
    server = parser.add_argument_group("of a server")
    server.add_argument("--from", type=_number(0.0, above=False), default=START_M, dest="start_m", metavar="M")
    server.add_argument("--length", type=_number(0.0), default=LENGTH_M, dest="length_m", metavar="M")
    server.add_argument("--rate", type=_number(0.0), default=RATE_HZ, dest="rate_hz", metavar="HZ")
    server.add_argument(
        "--running-average", type=_number(0.0, above=False), default=0.0, metavar="X", help="of the sensor (default: 0)"
    )
