"""Options that several commands share."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

from jaxradar._errors import ConfigError
from jaxradar._program import number, whole

__all__ = ["add_command", "add_selection", "check_part"]


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
