"""Live detection as a program: what `python3 step.pyz` runs, and `jaxradar live` with more sources and detectors.

From the options to a run: `options` parses, `sources` makes the source, `listeners_of` says who listens, `run` owns the
loop. Here the source is opened and closed, and signals end it.
"""

from __future__ import annotations

import argparse
import contextlib
import signal
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from jaxradar._errors import ConfigError, JaxradarError
from jaxradar._program import Parser, ended
from jaxradar.live.artefact import Header, read_artefact
from jaxradar.live.detect import LiveDetector
from jaxradar.live.options import add_live_options
from jaxradar.live.printed import InJson, InWords
from jaxradar.live.program import Program
from jaxradar.live.run import Listener, run
from jaxradar.live.sources import DEVICE_SOURCES, source_of
from jaxradar.live.sweeps import Source

__all__ = ["detect_live", "listeners_of", "load", "main"]

_ENDED_BY_SIGNAL = 128  # and its number, as a shell says


def main(argv: Sequence[str] | None = None, *, own: str | None = None) -> int:
    """The program on the device; `own`: the file that holds it and its detector. Returns the exit status: 0 all well,
    1 some of it failed, 2 usage, as the package's own command line has it."""
    name = Path(own).name if own else "jaxradar.live"
    return ended(name, lambda: _main(name, argv, own))


def _main(name: str, argv: Sequence[str] | None, own: str | None) -> int:
    parser = Parser(
        prog=name,
        description="Find road steps in the sweeps of a radar as they come, with the detector in this file.",
        epilog=f"example:\n  python3 {name} --source replay LOG\n  python3 {name} --source acconeer",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    add_live_options(parser, {kind: what.about for kind, what in DEVICE_SOURCES.items()})
    parser.add_argument("--detector", metavar="FILE", help="another compiled detector (default: the one in this file)")
    args = parser.parse_args(argv)
    file = args.detector or own
    if file is None:
        raise ConfigError("expected --detector, a file that `jaxradar export` made.")
    header, program = load(file)
    return detect_live(args, source_of(args, DEVICE_SOURCES, header), lambda _: LiveDetector(header, program))


def load(file: str) -> tuple[Header, Program]:
    """A compiled detector out of its file, which is read and not run.

    Raises `ConfigError` where it is none, or is not one that IREE's runtime here runs.
    """
    artefact = read_artefact(file)
    header = artefact.header
    if header.kind != "iree":
        raise ConfigError(f"{file}: is compiled for JAX; run it with `jaxradar live --detector`.")
    return header, Program.of_artefact(artefact)


def listeners_of(args: argparse.Namespace) -> list[Listener]:
    """Who listens to the run, as the options have it."""
    return [InJson() if args.json else InWords()]


def detect_live(args: argparse.Namespace, source: Source, detector_of: Callable[[Source], LiveDetector]) -> int:
    """Through the source to its end, or until a signal. Returns the exit status.

    `detector_of`: what gives the detector once the source is open, and its range axis known.
    """
    with _closed_by_signals(source) as came:
        try:
            with source:
                detector = detector_of(source)
                if came:  # before it was open, which begins anew
                    source.close()
                run(source, detector, listeners_of(args), most=args.sweeps)
        except JaxradarError:
            if not came:  # what a signal broke off is no failure
                raise
    return _ENDED_BY_SIGNAL + came[0] if came else 0


@contextlib.contextmanager
def _closed_by_signals(source: Source) -> Iterator[list[int]]:
    """SIGINT and SIGTERM close the source, which ends the loop in good order; gives the numbers of those that came."""
    came: list[int] = []

    def close(number: int, _: object) -> None:
        came.append(number)
        source.close()

    before = {one: signal.signal(one, close) for one in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield came
    finally:
        for one, handler in before.items():
            signal.signal(one, handler)
