"""`jaxradar config`: a detector file to start from."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING, Any

from jaxradar._errors import ConfigError
from jaxradar._program import number
from jaxradar.cli._options import add_command

if TYPE_CHECKING:
    from jaxradar.systems.step import DetectorFile

__all__ = ["add_to"]

_DESCRIPTION = """\
Print a detector as TOML, each setting with its unit and meaning: a file to
change and to hand to --detector. A FILE.toml is printed with the settings that
it leaves out.

With --false-alarms-per-hour the threshold follows from theory instead. Of
thesis, range-rate or a FILE.toml of these: so many false alarms while nothing
moves, for Gaussian noise of the range and bins much finer than it. Of
approach: at most so many, on a road of speckle and noise. The file says under
[provenance] where the threshold comes from."""

_EXAMPLE = """\
jaxradar config default > mine.toml
  jaxradar config range-rate --false-alarms-per-hour 1 \\
      --rate 100 --range-noise-mm 0.49 > mine.toml"""

# What the arguments of `from_false_alarm_rate` are called here, and what the values are multiplied by.
_OPTIONS = {
    "rate_hz": ("--rate", 1.0),
    "sd_m": ("--range-noise-mm", 1e-3),
    "correlation": ("--noise-correlation", 1.0),
}


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
    parser.add_argument("detector", metavar="NAME", help="of a detector, or a FILE.toml")
    parser.add_argument(
        "--false-alarms-per-hour",
        type=number(0, above=True),
        metavar="N",
        help="set the threshold by theory; needs --rate",
    )
    parser.add_argument("--rate", type=number(0, above=True), metavar="HZ", help="sweeps per second")
    parser.add_argument(
        "--range-noise-mm",
        type=number(0, above=True),
        metavar="MM",
        help="standard deviation of the range of one sweep, nothing moving: of all but approach",
    )
    parser.add_argument(
        "--noise-correlation",
        type=number(),
        metavar="RHO",
        help="of the ranges of neighbouring sweeps, between -1 and 1 (default: 0)",
    )


def _run(args: argparse.Namespace) -> int:
    from jaxradar.systems.step import dump_detector, load_detector

    given = {
        name: (option, getattr(args, option[2:].replace("-", "_")), factor)
        for name, (option, factor) in _OPTIONS.items()
        if getattr(args, option[2:].replace("-", "_")) is not None
    }
    if given and args.false_alarms_per_hour is None:
        raise ConfigError(f"{next(iter(given.values()))[0]} says nothing without --false-alarms-per-hour.")
    file = load_detector(args.detector)
    if args.false_alarms_per_hour is not None:
        file = _by_theory(file, args.false_alarms_per_hour, given)
    sys.stdout.write(dump_detector(file))
    return 0


def _by_theory(file: DetectorFile, per_hour: float, given: dict[str, tuple[str, float, float]]) -> DetectorFile:
    """The same detector with the threshold that belongs to the rate of false alarms. `given`: of each argument its
    option, its value there, and a factor."""
    import inspect
    from dataclasses import replace

    from jaxradar._settings import declared
    from jaxradar.systems.step import DETECTORS

    held = file.detector
    if not held.theory:
        known = ", ".join(name for name, kind in DETECTORS.items() if kind.theory)
        raise ConfigError(
            f"there is no theory of the false alarms of `{held.name}`; --false-alarms-per-hour is for {known}."
        )
    derive = type(held).from_false_alarm_rate  # type: ignore[attr-defined]
    takes = {name: one for name, one in inspect.signature(derive).parameters.items() if name in _OPTIONS}
    missing = [_OPTIONS[name][0] for name, one in takes.items() if one.default is one.empty and name not in given]
    if missing:
        raise ConfigError(f"--false-alarms-per-hour needs {' and '.join(missing)}.")
    for name, (option, _, _) in given.items():
        if name not in takes:
            raise ConfigError(f"{option} says nothing of the false alarms of `{held.name}`.")
    # The setting that is the threshold follows; all others stay.
    settings = {name: getattr(held, name) for name in declared(type(held))}
    threshold = next(name for name, value in settings.items() if value is held.threshold)
    del settings[threshold]
    try:
        detector = derive(per_hour, **{name: value * by for name, (_, value, by) in given.items()}, **settings)
    except ValueError as error:
        sentence = str(error).replace("`per_hour`", "--false-alarms-per-hour")
        for name in takes:
            if _OPTIONS[name][1] == 1.0:  # one in millimetres is no other name for one in metres
                sentence = sentence.replace(f"`{name}`", _OPTIONS[name][0])
        raise ConfigError(f"no threshold by theory: {sentence}") from None
    provenance = {
        **file.provenance,
        threshold: f"from theory: {held.theory}",
        "false_alarms_per_hour": per_hour,
        **{
            "rate_hz" if name == "rate_hz" else option[2:].replace("-", "_"): value
            for name, (option, value, _) in given.items()
        },
    }
    return replace(file, detector=detector, provenance=provenance)
