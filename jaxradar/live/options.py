"""The options of live detection, which the package's command line and a compiled detector's own share."""

from __future__ import annotations

import argparse
from collections.abc import Mapping

from jaxradar._errors import ConfigError
from jaxradar._program import number, whole

__all__ = ["BINS", "HOST", "RUNTIME", "SENSORS", "add_live_options", "check_options", "sensor_numbers"]

# As the lab's program sets them (thesis, appendix C.1).
RATE_HZ, START_M, LENGTH_M, BINS, SENSORS = 100.0, 0.1, 0.7, 128, (1, 3)
HOST = "localhost"  # the exploration server's, on the device itself
RUNTIME = "iree-base-runtime>=3.13,<3.14"  # what pip calls the runtime of compiled detectors

# What the board and its line can be told to be; the modules that know them are imported where they are used.
WIRES = ("nucleo", "framed")
RULES = ("detector", "distance", "distance-mended")
PORT = "/dev/ttyACM0"
_GO_WITH = {"link": ("port", "rule", "hold", "count"), "record": ("rotate_mb", "rotate_min")}
_OF_REPLAY = {"--pace": "pace", "--fast": "fast"}
_OF_SERVER = {
    "--from": "start_m",
    "--length": "length_m",
    "--rate": "rate_hz",
    "--running-average": "running_average",
}


def sensor_numbers(text: str) -> tuple[int, ...]:
    """Different numbers of sensors, from text such as `1,3`."""
    parts = text.split(",")
    numbers = tuple(int(part) if part.strip().isdecimal() else -1 for part in parts)
    if min(numbers) < 0 or len(set(numbers)) != len(numbers):
        raise argparse.ArgumentTypeError(f"expected sensor numbers such as 1,3, got {text!r}")
    return numbers


def add_live_options(parser: argparse.ArgumentParser, sources: Mapping[str, str]) -> None:
    """`sources`: what each kind of source is made of, by its name."""
    words = "; ".join(f"{name}: {what}" for name, what in sources.items())
    places = ["the log", *(["the scene"] if "scene" in sources else []), "or the server's host"]
    parser.add_argument("--source", required=True, choices=tuple(sources), metavar="KIND", help=words)
    parser.add_argument("where", nargs="?", metavar="WHERE", help=", ".join(places))
    parser.add_argument(
        "--sensors",
        type=sensor_numbers,
        metavar="N,N",
        help="these sensors (default: all; of a server those of the compiled detector, or 1,3)",
    )
    parser.add_argument("--sweeps", type=whole(1), metavar="N", help="end after so many sweeps, of all sensors")
    parser.add_argument("--json", action="store_true", help="detections, and at the end a summary, as JSON lines")
    parser.add_argument("--quiet", action="store_true", help="no display; where no terminal is, there is none anyway")
    parser.add_argument("--print-unit", action="store_true", help="print a systemd unit for this command, and end")
    board = parser.add_argument_group("a board that is told of steps")
    board.add_argument("--link", choices=WIRES, help="how it is talked to: the lab's single bytes, or frames")
    board.add_argument("--port", metavar="DEVICE", help=f"its serial line (default: {PORT})")
    board.add_argument(
        "--rule",
        choices=RULES,
        help="what it is told: detections (the default), or an echo nearer than 0.15 m by the lab's rule, as it was or "
        "with its faults mended",
    )
    board.add_argument(
        "--hold",
        type=number(0.0, above=True),
        metavar="S",
        help="tell a detection for so long (default: to its impact)",
    )
    board.add_argument(
        "--count",
        type=number(0.0, above=True),
        metavar="M/S2",
        help="what a count of the acceleration from it means, nucleo (default: 1)",
    )
    disk = parser.add_argument_group("what is kept")
    disk.add_argument("--record", metavar="DIR", help="all sweeps, as drives in this folder")
    disk.add_argument(
        "--rotate-mb",
        type=number(0.0, above=True),
        metavar="MB",
        help="begin the next drive after so much (default: 1074)",
    )
    disk.add_argument(
        "--rotate-min", type=number(0.0, above=True), metavar="MIN", help="or after so many minutes (default: 60)"
    )
    disk.add_argument("--events", metavar="FILE", help="detections and faults, appended as JSON lines")
    replay = parser.add_argument_group("what was recorded or simulated")
    pace = replay.add_mutually_exclusive_group()
    pace.add_argument("--pace", type=number(0.0, above=True), metavar="X", help="X times as fast (default: 1)")
    pace.add_argument("--fast", action="store_true", help="as fast as it goes")
    server = parser.add_argument_group("a server")
    of_server = {  # each with its default, which `sources` takes where none is given
        "--from": (number(0.0), "M", f"nearest range in metres (default: {START_M:g})"),
        "--length": (number(0.0, above=True), "M", f"so many metres from there (default: {LENGTH_M:g})"),
        "--rate": (number(0.0, above=True), "HZ", f"sweeps a second of each sensor (default: {RATE_HZ:g})"),
        "--running-average": (number(0.0), "X", "the sensor's own over sweeps, 0 to below 1 (default: 0)"),
    }
    for name, (kind, metavar, about) in of_server.items():
        server.add_argument(name, type=kind, dest=_OF_SERVER[name], metavar=metavar, help=about)


def check_options(args: argparse.Namespace) -> None:
    """Raises `ConfigError` for an option that the source which the others name has not, instead of passing it over."""
    for option, names in _GO_WITH.items():
        for name in names:
            if getattr(args, name) is not None and getattr(args, option) is None:
                raise ConfigError(f"--{name.replace('_', '-')} goes with --{option}, which is not there.")
    for name in ("port", "record", "events"):
        if getattr(args, name) == "":
            raise ConfigError(f"--{name} is empty; expected a name.")
    if args.count is not None and args.link != "nucleo":
        raise ConfigError("--count goes with --link nucleo; frames have a unit of their own.")
    if args.hold is not None and args.rule not in (None, "detector"):
        raise ConfigError(f"--hold is of detections; --rule {args.rule} says at each sweep anew what it is.")
    server = args.source == "acconeer"
    for option, name in (_OF_REPLAY if server else _OF_SERVER).items():
        if getattr(args, name) not in (None, False):
            raise ConfigError(
                f"{option} is not for --source {args.source}; it goes with "
                f"{'what was recorded' if server else '--source acconeer'}."
            )
