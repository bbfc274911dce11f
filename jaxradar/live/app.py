"""Live detection as a program: what `python3 step.pyz` runs, and `jaxradar live` with more sources and detectors.

From the options to a run: `options` parses, `sources` makes the source, `listeners_of` says who listens, `run` owns the
loop. Here the source is opened and closed, and signals end it.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from jaxradar._errors import ConfigError, JaxradarError
from jaxradar._program import Parser, ended
from jaxradar.live.artefact import Header, read_artefact
from jaxradar.live.detect import LiveDetector
from jaxradar.live.options import PORT, RULES, add_live_options, check_options
from jaxradar.live.printed import CLEAR, InJson, InWords
from jaxradar.live.program import Program
from jaxradar.live.run import Listener, run
from jaxradar.live.sources import DEVICE_SOURCES, source_of
from jaxradar.live.sweeps import Source

# What only some runs want is imported by those: a device's processor takes its time for each module.
if TYPE_CHECKING:
    from jaxradar.live.recording import Recording
    from jaxradar.live.serving import EventLog
    from jaxradar.live.telling import Telling

__all__ = ["detect_live", "listeners_of", "load", "main", "print_unit"]

_ENDED_BY_SIGNAL = 128  # and its number, as a shell says
_ENDS = (signal.SIGINT, signal.SIGTERM, *([signal.SIGHUP] if hasattr(signal, "SIGHUP") else []))
_SWITCH_S = 1e-4  # or a thread that writes keeps the loop waiting for up to 5 ms, Python's own interval


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
    if args.print_unit:
        check_options(args)
        return print_unit([sys.executable, str(Path(own or "step.pyz").resolve())], argv)
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
    """Who listens to the run, as the options have it: what others say is printed and logged, the board comes first of
    all that take time, and what is printed at the end comes when the others have told what they came to."""
    shows = not (args.quiet or args.json) and sys.stderr.isatty()
    printed = InJson() if args.json else InWords(CLEAR if shows else "")
    log = _event_log(args.events) if args.events is not None else None

    def say(sentence: str) -> None:
        printed.say(sentence)
        if log is not None:
            log.say(sentence)

    recording = _recording(args, say) if args.record is not None else None
    telling = _telling(args, recording, say) if args.link is not None else None
    listeners: list[Listener | None] = [printed, log, telling, recording]
    if "NOTIFY_SOCKET" in os.environ:
        from jaxradar.live.serving import Serving

        listeners.append(Serving())
    if shows:
        from jaxradar.live.display import Display

        listeners.append(Display([one.state for one in (telling, recording) if one is not None]))
    return [one for one in listeners if one is not None]


def _event_log(path: str) -> EventLog:
    from jaxradar.live.serving import EventLog

    return EventLog(Path(path))


def _recording(args: argparse.Namespace, say: Callable[[str], None]) -> Recording:
    from jaxradar.live.recording import Recording

    return Recording(
        Path(args.record),
        accelerations=args.link is not None,
        rotate_bytes=None if args.rotate_mb is None else round(1e6 * args.rotate_mb),
        rotate_s=None if args.rotate_min is None else 60.0 * args.rotate_min,
        say=say,
    )


def _telling(args: argparse.Namespace, recording: Recording | None, say: Callable[[str], None]) -> Telling:
    from jaxradar.live.telling import Telling
    from jaxradar.live.wires import Framed, Nucleo

    wire = Framed() if args.link == "framed" else Nucleo(args.count or 1.0)
    heard = {} if recording is None else {"accelerated": recording.accelerated}
    return Telling(args.port or PORT, wire, rule=args.rule or RULES[0], hold_s=args.hold, say=say, **heard)


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
                if source.period_s is not None:
                    _be_quick()
                run(
                    source,
                    detector,
                    listeners_of(args),
                    most=args.sweeps,
                    again=not source.waits,
                    stop=lambda: came,
                )
        except JaxradarError:
            if not came:  # what a signal broke off is no failure
                raise
    return _ENDED_BY_SIGNAL + came[0] if came else 0


def _be_quick() -> None:
    """For sweeps that come at their own pace."""
    sys.setswitchinterval(_SWITCH_S)


def print_unit(program: Sequence[str], argv: Sequence[str] | None) -> int:
    """Print a unit that runs a program with the arguments of this one. Returns the exit status."""
    from jaxradar.live.systemd import unit

    arguments = [word for word in (sys.argv[1:] if argv is None else argv) if word != "--print-unit"]
    print(unit([*program, *arguments], Path(program[-1]).name), end="")
    return 0


@contextlib.contextmanager
def _closed_by_signals(source: Source) -> Iterator[list[int]]:
    """Signals that ask for an end close the source, which ends the loop in good order; gives the numbers of those that
    came."""
    came: list[int] = []

    def close(number: int, _: object) -> None:
        came.append(number)
        source.close()

    before = {one: signal.signal(one, close) for one in _ENDS}
    try:
        yield came
    finally:
        for one, handler in before.items():
            signal.signal(one, handler)
