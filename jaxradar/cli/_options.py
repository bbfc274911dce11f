"""Options that several commands share, and the kinds of number that they take."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from typing import Any

from jaxradar._errors import ConfigError

__all__ = ["add_command", "add_selection", "check_part", "number", "whole"]


def number(least: float | None = None, *, above: bool = False) -> Callable[[str], float]:
    """A finite number, at least (or `above`) `least`."""

    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        fits = math.isfinite(value) and (least is None or value > least or (value == least and not above))
        if not fits:
            bound = "" if least is None else f" {'>' if above else '>='} {least:g}"
            raise argparse.ArgumentTypeError(f"expected a number{bound}, got {text!r}")
        return value

    return parse


def whole(least: int, most: int = 2**63 - 1) -> Callable[[str], int]:
    """A whole number from `least` to `most`."""

    def parse(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = least - 1
        if value < least:
            raise argparse.ArgumentTypeError(f"expected a whole number >= {least}, got {text!r}")
        if value > most:
            raise argparse.ArgumentTypeError(f"expected a whole number <= {most}, got {text!r}")
        return value

    return parse


def add_command(
    commands: Any, name: str, run: Callable[[argparse.Namespace], int], *, summary: str, description: str, example: str
) -> argparse.ArgumentParser:
    """A command's own parser, with an example at the end of its help."""
    parser: argparse.ArgumentParser = commands.add_parser(
        name,
        help=summary,
        description=description,
        epilog=f"example:\n  {example}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.set_defaults(run=run)
    return parser


def add_selection(parser: argparse.ArgumentParser) -> None:
    """Which detector looks at which part of a log."""
    parser.add_argument(
        "--detector",
        default="default",
        metavar="NAME",
        help="default, one of its parts approach and shift, innovation, filtered-rate, range-rate, thesis, lab-live, "
        "or a FILE.toml (default: default)",
    )
    parser.add_argument("--sensor", type=whole(0), metavar="N", help="this sensor alone (default: all)")
    parser.add_argument("--start", type=number(), metavar="S", help="from here on, in seconds since the first sweep")
    parser.add_argument("--stop", type=number(), metavar="S", help="up to here")
    parser.add_argument(
        "--thin", type=whole(2), metavar="N", help="keep N range bins, picked as the lab's program does"
    )


def check_part(start_s: float | None, stop_s: float | None) -> None:
    """Refuse a part that ends before it begins."""
    if start_s is not None and stop_s is not None and start_s > stop_s:
        raise ConfigError(f"--start {start_s:g} must not be after --stop {stop_s:g}.")
