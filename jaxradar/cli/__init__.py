"""The command line: it parses, calls and prints. What takes long to import is imported by the command that needs it."""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from jaxradar._cache import keep_compiled_programs
from jaxradar._errors import ConfigError, JaxradarError
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
from jaxradar.cli._output import shown

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
_INTERRUPTED = 130  # as a shell says of a program that Ctrl-C ended
_PIPE_CLOSED = 141


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        """One sentence and where to read on, instead of the whole usage."""
        self.exit(2, f"{self.prog}: {message}. See `{self.prog} --help`.\n")


class _Version(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        from importlib.metadata import version

        print(f"jaxradar {version('jaxradar')}")
        parser.exit(0)


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="jaxradar",
        description="Road steps out of the recordings of a car's range sensors.",
        epilog="`jaxradar demo` needs no data and shows what the rest is about.",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and leave")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True, parser_class=_Parser)
    for command in _COMMANDS:
        command.add_to(commands)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit status: 0 all well, 1 some of it failed, 2 usage.

    None is the program itself: the arguments are `sys.argv`, and Ctrl-C ends the process here.
    """
    _ready_streams()
    try:
        status = _run(argv)
        sys.stdout.flush()
        if argv is None and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, signal.SIG_DFL)  # all is said: Ctrl-C while Python ends shows no traceback
    except BrokenPipeError:
        _drop_output()
        return _PIPE_CLOSED
    except KeyboardInterrupt:
        print("jaxradar: stopped.", file=sys.stderr, flush=True)
        if argv is None:
            os._exit(_INTERRUPTED)  # XLA's threads crash on the usual way out of a compilation that was broken off
        return _INTERRUPTED
    except OSError as error:
        _drop_output()
        print(f"jaxradar: standard output: {error.strerror or error}.", file=sys.stderr)
        return 1
    return status


def _ready_streams() -> None:
    """Standard output and error that take any text."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed by the caller
            setattr(sys, name, Path(os.devnull).open("w", encoding="utf-8"))  # noqa: SIM115
        stream = getattr(sys, name)
        if hasattr(stream, "reconfigure"):
            # A terminal that knows no "²", and a file name that is no text, must not end a run.
            stream.reconfigure(errors="backslashreplace")


def _drop_output() -> None:
    """Nobody takes what is left of the output. Python would try again, and complain, when it closes the stream."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _run(argv: Sequence[str] | None) -> int:
    try:
        arguments = _parser().parse_args(argv)
    except SystemExit as leave:
        return leave.code if isinstance(leave.code, int) else 2
    if argv is None:  # the program itself, whose environment is its own
        keep_compiled_programs()
    try:
        return int(arguments.run(arguments))
    except JaxradarError as error:
        print(f"jaxradar: {shown(str(error))}", file=sys.stderr)
        return 2 if isinstance(error, ConfigError) else 1
    except OSError as error:
        if error.filename is None:  # of a stream and not of a file
            raise
        print(f"jaxradar: {shown(str(error.filename))}: {error.strerror or error}.", file=sys.stderr)
        return 1
