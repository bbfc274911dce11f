"""`jaxradar config`: a detector file to start from."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING, Any

from jaxradar._errors import ConfigError
from jaxradar.cli._options import add_command, number

if TYPE_CHECKING:
    from jaxradar.systems.step import DetectorFile

__all__ = ["add_to"]

_DESCRIPTION = """\
Print a detector as TOML, each setting with its unit and meaning: a file to
change and to hand to --detector. A FILE.toml is printed with the settings that
it leaves out.

With --false-alarms-per-hour the threshold of thesis, range-rate or a FILE.toml
of these follows from theory instead: so many false alarms while nothing moves,
for Gaussian noise of the range and bins much finer than it. The file says
under [provenance] where the threshold comes from."""

_EXAMPLE = """\
jaxradar config default > mine.toml
  jaxradar config range-rate --false-alarms-per-hour 1 \\
      --rate 100 --range-noise-mm 0.49 > mine.toml"""

# What the arguments of `from_false_alarm_rate` are called here; one in millimetres is no other name for one in metres.
_OPTIONS = {"per_hour": "--false-alarms-per-hour", "rate_hz": "--rate", "correlation": "--noise-correlation"}


def add_to(commands: Any) -> None:
    """Make the command known."""
    parser = add_command(
        commands,
        "config",
        _run,
        summary="print a detector's settings as a file to start from",
        description=_DESCRIPTION,
        example=_EXAMPLE,
    )
    parser.add_argument("detector", metavar="NAME", help="default, thesis, range-rate, lab-live or a FILE.toml")
    parser.add_argument(
        "--false-alarms-per-hour",
        type=number(0, above=True),
        metavar="N",
        help="set the threshold by theory; needs the next two",
    )
    parser.add_argument("--rate", type=number(0, above=True), metavar="HZ", help="sweeps per second")
    parser.add_argument(
        "--range-noise-mm",
        type=number(0, above=True),
        metavar="MM",
        help="standard deviation of the range of one sweep, nothing moving",
    )
    parser.add_argument(
        "--noise-correlation",
        type=number(),
        metavar="RHO",
        help="of the ranges of neighbouring sweeps, between -1 and 1 (default: 0)",
    )


def _run(args: argparse.Namespace) -> int:
    from jaxradar.systems.step import dump_detector, load_detector

    asked = args.false_alarms_per_hour is not None
    needed = {"--rate": args.rate, "--range-noise-mm": args.range_noise_mm}
    given = [
        name for name, value in {**needed, "--noise-correlation": args.noise_correlation}.items() if value is not None
    ]
    missing = [name for name, value in needed.items() if value is None]
    if given and not asked:
        raise ConfigError(f"{given[0]} says nothing without --false-alarms-per-hour.")
    if asked and missing:
        raise ConfigError(f"--false-alarms-per-hour needs {' and '.join(missing)}.")
    file = load_detector(args.detector)
    sys.stdout.write(dump_detector(_by_theory(file, args) if asked else file))
    return 0


def _by_theory(file: DetectorFile, args: argparse.Namespace) -> DetectorFile:
    """The same detector with the threshold that belongs to the rate of false alarms."""
    from dataclasses import replace

    from jaxradar._settings import declared
    from jaxradar.systems.step import DETECTORS
    from jaxradar.systems.step.range_rate_base import RangeRateBase

    held = file.detector
    if not isinstance(held, RangeRateBase):
        known = [name for name, kind in DETECTORS.items() if issubclass(kind, RangeRateBase)]
        raise ConfigError(
            f"there is no theory of the false alarms of `{held.name}`; "
            f"--false-alarms-per-hour is for {', '.join(known[:-1])} and {known[-1]}."
        )
    settings = {name: getattr(held, name) for name in declared(type(held)) if name != "threshold_m_s"}
    correlation = 0.0 if args.noise_correlation is None else args.noise_correlation
    wanted = args.false_alarms_per_hour
    try:
        detector = type(held).from_false_alarm_rate(
            wanted,
            rate_hz=args.rate,
            sd_m=1e-3 * args.range_noise_mm,
            correlation=correlation,
            **settings,
        )
    except ValueError as error:
        sentence = str(error)
        for name, option in _OPTIONS.items():
            sentence = sentence.replace(f"`{name}`", option)
        raise ConfigError(f"no threshold by theory: {sentence}") from None
    provenance = {
        **file.provenance,
        "threshold_m_s": "from theory: false alarms of |difference of two sweeps| in Gaussian noise of the range",
        "false_alarms_per_hour": wanted,
        "rate_hz": args.rate,
        "range_noise_mm": args.range_noise_mm,
        "noise_correlation": correlation,
    }
    return replace(file, detector=detector, provenance=provenance)
