"""`jaxradar config`: a detector file to start from."""

from __future__ import annotations

import argparse
import sys
from typing import Any

from jaxradar.cli._options import add_command

__all__ = ["add_to"]

_DESCRIPTION = """\
Print a detector as TOML, each setting with its unit and meaning: a file to
change and to hand to --detector. A FILE.toml is printed with the settings that
it leaves out."""


def add_to(commands: Any) -> None:
    """Make the command known."""
    parser = add_command(
        commands,
        "config",
        _run,
        summary="print a detector's settings as a file to start from",
        description=_DESCRIPTION,
        example="jaxradar config default > mine.toml",
    )
    parser.add_argument("detector", metavar="NAME", help="default, thesis, range-rate, lab-live or a FILE.toml")


def _run(args: argparse.Namespace) -> int:
    from jaxradar.systems.step import dump_detector, load_detector

    sys.stdout.write(dump_detector(load_detector(args.detector)))
    return 0
