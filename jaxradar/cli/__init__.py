"""The command line: it parses, calls and prints. What takes long to import is imported by the command that needs it."""

from __future__ import annotations

import argparse
import os
import signal
from collections.abc import Sequence
from typing import NoReturn

from jaxradar._cache import keep_compiled_programs
from jaxradar._program import INTERRUPTED, Parser, ended
from jaxradar.cli import (
    bench_detection,
    calibrate,
    config,
    convert,
    demo,
    evaluate,
    export,
    frontier,
    info,
    ingest,
    label,
    live,
    simulate,
    tune,
    view,
)

__all__ = ["main"]

_COMMANDS = (
    demo,
    info,
    view,
    ingest,
    evaluate,
    label,
    calibrate,
    simulate,
    tune,
    frontier,
    bench_detection,
    export,
    live,
    convert,
    config,
)


class _Version(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        from importlib.metadata import version

        print(f"jaxradar {version('jaxradar')}")
        parser.exit(0)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="jaxradar",
        description="Road steps out of the recordings of a car's range sensors.",
        epilog="`jaxradar demo` needs no data and shows what the rest is about.",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and leave")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True, parser_class=Parser)
    for command in _COMMANDS:
        command.add_to(commands)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit status: 0 all well, 1 some of it failed, 2 usage.

    None is the program itself: the arguments are `sys.argv`, and Ctrl-C ends the process here.
    """
    if argv is None:
        # XLA's threads crash on the usual way out of a compilation that was broken off.
        status = ended("jaxradar", lambda: _run(argv), at_interrupt=lambda: os._exit(INTERRUPTED))
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, signal.SIG_DFL)  # all is said: Ctrl-C while Python ends shows no traceback
        return status
    return ended("jaxradar", lambda: _run(argv))


def _run(argv: Sequence[str] | None) -> int:
    arguments = _parser().parse_args(argv)
    if argv is None:  # the program itself, whose environment is its own
        keep_compiled_programs()
    return int(arguments.run(arguments))
