"""`jaxradar convert`: a log from one form into another."""

from __future__ import annotations

import argparse
import os
import sys
from typing import Any

from jaxradar._errors import ConfigError
from jaxradar._program import shown
from jaxradar.cli._options import add_command

__all__ = ["add_to"]

_DESCRIPTION = """\
Write a log in another form. The name of OUT says which: NAME.drive, NAME.csv
(one sensor, no motion), or a name without suffix for a folder of the lab's CSV.
What that form cannot hold is said on standard error."""


def add_to(commands: Any) -> None:
    """Make the command known."""
    parser = add_command(
        commands,
        "convert",
        _run,
        summary="write a log in another form",
        description=_DESCRIPTION,
        example="jaxradar convert recording.h5 recording.drive",
    )
    parser.add_argument("source", metavar="IN", help="a log")
    parser.add_argument("target", metavar="OUT", help="the log to write")
    parser.add_argument("--overwrite", action="store_true", help="replace OUT if it is such a log already")


def _run(args: argparse.Namespace) -> int:
    from jaxradar.logs import read_log, write_log

    if os.path.realpath(args.source) == os.path.realpath(args.target):
        raise ConfigError(f"IN and OUT are the same log, {shown(args.source)}.")
    drive = read_log(args.source)
    for problem in drive.problems:
        print(f"jaxradar: {shown(args.source)}: {shown(problem)}", file=sys.stderr)
    for sentence in write_log(drive, args.target, overwrite=args.overwrite):
        print(f"jaxradar: {shown(args.target)}: {shown(sentence)}", file=sys.stderr)
    print(shown(args.target))
    return 0
