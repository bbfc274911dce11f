"""Live detection as a program: what `python3 step.pyz` runs, and `jaxradar live` with more sources and detectors."""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from jaxradar._errors import ConfigError, JaxradarError
from jaxradar.drive import Drive
from jaxradar.live.artefact import Header, read_artefact
from jaxradar.live.detect import LiveDecision, LiveDetector
from jaxradar.live.options import BINS, HOST, SENSORS, add_live_options
from jaxradar.live.program import Program
from jaxradar.live.run import Tally, event_record, run
from jaxradar.live.sweeps import Source
from jaxradar.units import NANOSECONDS

__all__ = ["DEVICE_SOURCES", "acconeer_of", "detect_live", "main", "read_device_log", "replay_of"]

DEVICE_SOURCES = {
    "replay": "a recorded log, in the package's binary form or the lab's CSV",
    "acconeer": "Acconeer's exploration server, on this host (localhost) or WHERE",
}
_ENDED_BY_SIGNAL = 128


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message}. See `{self.prog} --help`.\n")


def main(argv: Sequence[str] | None = None, *, own: str | None = None) -> int:
    """The program on the device; `own`: the file that holds it and its detector."""
    name = Path(own).name if own else "jaxradar.live"
    parser = _Parser(
        prog=name,
        description="Find road steps in the sweeps of a radar as they come, with the detector in this file.",
        epilog=f"example:\n  python3 {name} --source replay LOG\n  python3 {name} --source acconeer",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    add_live_options(parser, DEVICE_SOURCES)
    parser.add_argument("--detector", metavar="FILE", help="another compiled detector (default: the one in this file)")
    args = parser.parse_args(argv)
    try:
        file = args.detector or own
        if file is None:
            raise ConfigError("expected --detector, a file that `jaxradar export` made.")
        header, program = load(file)
        return detect_live(args, device_source(args, header), lambda _: LiveDetector(header, program))
    except JaxradarError as error:
        print(f"{name}: {error}", file=sys.stderr)
        return 2 if isinstance(error, ConfigError) else 1
    except BrokenPipeError:
        _drop_output()
        return _ENDED_BY_SIGNAL + signal.SIGPIPE
    except OSError as error:
        if error.filename is None:  # of a stream and not of a file
            _drop_output()
        place = "standard output" if error.filename is None else error.filename
        print(f"{name}: {place}: {error.strerror or error}.", file=sys.stderr)
        return 1


def _drop_output() -> None:
    """Nobody takes what is left of the output. Python would try again, and complain, when it closes the stream."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def load(file: str) -> tuple[Header, Program]:
    """A compiled detector out of its file, which is read and not run."""
    artefact = read_artefact(file)
    header = artefact.header
    if header.kind != "iree":
        raise ConfigError(f"{file}: is compiled for JAX; run it with `jaxradar live --detector`.")
    return header, Program.of_artefact(artefact)


def device_source(args: argparse.Namespace, header: Header) -> Source:
    """The source that the options name."""
    if args.source == "acconeer":
        return acconeer_of(args, header.sensors, header.bins)
    if args.where is None:
        raise ConfigError("--source replay needs a log: --source replay LOG.")
    return replay_of(args, read_device_log(Path(args.where)))


def acconeer_of(args: argparse.Namespace, sensors: tuple[int, ...], bins: int | None) -> Source:
    """The exploration server that the options name; `sensors` and `bins`: of the detector, where it says so."""
    from jaxradar.live.acconeer import AcconeerSource

    return AcconeerSource(
        args.where or HOST,
        sensors=args.sensors or sensors or SENSORS,
        start_m=args.start_m,
        length_m=args.length_m,
        rate_hz=args.rate_hz,
        running_average=args.running_average,
        bins=bins or BINS,
    )


def replay_of(args: argparse.Namespace, drive: Drive) -> Source:
    """A drive at the pace that the options name."""
    from jaxradar.live.replay import Replay

    return Replay(drive, None if args.fast else args.pace, sensors=args.sensors)


def read_device_log(path: Path) -> Drive:
    """A log in one of the two forms that NumPy alone reads. Raises `JaxradarError` for what is none."""
    from jaxradar.drivefile import is_drive_folder, read_drive

    if not path.exists():
        raise ConfigError(f"{path}: there is no such file or folder.")
    if is_drive_folder(path):
        return read_drive(path)
    from jaxradar.labcsv import looks_like_radar, read_lab_csv

    if path.is_dir() or looks_like_radar(path):
        return read_lab_csv(path)
    raise ConfigError(
        f"{path}: is neither the package's binary form nor the lab's CSV; other logs, and scenes, are read by the full "
        "package, with `jaxradar live`."
    )


def detect_live(args: argparse.Namespace, source: Source, detector_of: Callable[[Source], LiveDetector]) -> int:
    """Through the source to its end, or until a signal; detections on standard output as they come.

    `detector_of`: what gives the detector once the source is open, and its range axis known. Returns the exit status.
    """
    tally = Tally()
    said = _json_line if args.json else _line
    out: Callable[[str], Any] = lambda text: print(text, flush=True)  # noqa: E731

    def each(decision: LiveDecision) -> None:
        if decision.event:
            out(said(decision, detector.header))
        if args.sweeps is not None and tally.sweeps >= args.sweeps:
            source.close()

    def summarize(misfits: int) -> None:
        if args.json:
            out(json.dumps({"summary": tally.record() | {"missed": source.missed, "misfits": misfits}}))
        else:
            print(_summary(tally, source.missed, misfits), file=sys.stderr)

    ended: list[int] = []

    def stop(number: int, _: object) -> None:
        ended.append(number)
        source.close()

    before = {one: signal.signal(one, stop) for one in (signal.SIGINT, signal.SIGTERM)}
    try:
        with source:
            detector = detector_of(source)
            detector.header.check_axis(source.range_m)
            detector.header.check_amplitudes(source.dtype)
            for problem in (*source.problems, *_blind(source, detector.header)):
                print(problem, file=sys.stderr)
            if ended:  # before it was open: that begins anew
                source.close()
            run(source, detector, tally, each)
    except JaxradarError:
        if tally.sweeps:
            summarize(detector.misfits)
        if not ended:  # what a signal broke off is no failure
            raise
    else:
        summarize(detector.misfits)  # while signals are still taken: of two, the second must not cost it
    finally:
        for one, handler in before.items():
            signal.signal(one, handler)
    return _ENDED_BY_SIGNAL + ended[0] if ended else 0


def _blind(source: Source, header: Header) -> list[str]:
    if not header.motion or source.tells_motion:
        return []
    return [f"{header.detector} goes by the car's motion too, of which this source tells nothing: by the sweeps alone."]


def _json_line(decision: LiveDecision, header: Header) -> str:
    return json.dumps({"event": event_record(decision, header.threshold)})


def _line(decision: LiveDecision, header: Header) -> str:
    time_s, threshold = decision.time_ns / NANOSECONDS, header.threshold
    impact = f", impact in {decision.impact_in_s * 1e3:.0f} ms" if decision.impact_in_s else ""
    return (
        f"{time_s:10.3f} s  sensor {decision.sensor}: step {decision.range_m:.3f} m away{impact} "
        f"({header.statistic_name} {decision.statistic:.3g}, above {threshold:.3g})"
    )


def _summary(tally: Tally, missed: int, misfits: int) -> str:
    seconds = (tally.last_ns - tally.first_ns) / NANOSECONDS
    parts = [f"{tally.sweeps} sweeps in {seconds:.1f} s", f"{tally.events} detection{'' if tally.events == 1 else 's'}"]
    parts += [f"{count} {what}" for count, what in ((missed, "missed"), (misfits, "of a wrong length")) if count]
    if tally.sweeps:
        parts.append(f"{tally.took_us(0.5):.0f} µs a sweep (99 %: {tally.took_us(0.99):.0f})")
    return ", ".join(parts) + "."
