"""What the programs of this package share, `jaxradar` and the one on the device: how they end, and what arguments are.

The standard library alone.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

from jaxradar._errors import ConfigError, JaxradarError

__all__ = ["INTERRUPTED", "Parser", "ended", "number", "shown", "whole"]

INTERRUPTED = 130  # as a shell says of a program that Ctrl-C ended
_PIPE_CLOSED = 141


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one sentence and where to read on, instead of the whole usage."""

    def error(self, message: str) -> NoReturn:
        """Leave with status 2."""
        self.exit(2, f"{self.prog}: {message}. See `{self.prog} --help`.\n")


def ended(name: str, body: Callable[[], int], at_interrupt: Callable[[], object] = lambda: None) -> int:
    """The exit status of a program: that of its `body`, 1 where some of it failed and 2 for wrong usage, said in one
    sentence on standard error; 130 after Ctrl-C, of which `at_interrupt` hears last; 141 where nobody reads on."""
    _ready_streams()
    try:
        status = _said(name, body)
        sys.stdout.flush()
    except BrokenPipeError:
        _drop_output()
        return _PIPE_CLOSED
    except KeyboardInterrupt:
        print(f"{name}: stopped.", file=sys.stderr, flush=True)
        at_interrupt()
        return INTERRUPTED
    except OSError as error:
        _drop_output()
        print(f"{name}: standard output: {error.strerror or error}.", file=sys.stderr)
        return 1
    return status


def _said(name: str, body: Callable[[], int]) -> int:
    try:
        return body()
    except SystemExit as leave:  # of a parser
        return leave.code if isinstance(leave.code, int) else 2
    except JaxradarError as error:
        print(f"{name}: {shown(str(error))}", file=sys.stderr)
        return 2 if isinstance(error, ConfigError) else 1
    except OSError as error:
        if error.filename is None:  # of a stream and not of a file
            raise
        print(f"{name}: {shown(str(error.filename))}: {error.strerror or error}.", file=sys.stderr)
        return 1


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


def shown(path: str | os.PathLike[str]) -> str:
    """A path, or a sentence that names one, as one line of text that every stream and figure takes: what is no UTF-8,
    a line end or a command to the terminal is escaped."""
    text = os.fspath(path)
    return "".join(sign if sign.isprintable() else sign.encode("unicode_escape").decode("ascii") for sign in text)


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
