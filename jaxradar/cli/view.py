"""`jaxradar view`: one log as figures."""

from __future__ import annotations

import argparse
from typing import Any

from jaxradar._errors import LogError
from jaxradar._program import shown
from jaxradar.cli._options import add_command, add_selection, check_part
from jaxradar.cli._output import ready_folder

__all__ = ["add_to"]

_DESCRIPTION = """\
Draw a log as PNG figures, two for each sensor: the map of amplitude over time
and range with the followed range, the detector's statistic with its threshold
and detections, and the acceleration if it was recorded; and all sweeps laid
over each other."""


def add_to(commands: Any) -> None:
    """Make the command known."""
    parser = add_command(
        commands,
        "view",
        _run,
        summary="draw a log and what a detector sees in it",
        description=_DESCRIPTION,
        example="jaxradar view log/07_21_14_03_55 --start 15 --stop 35 -o figures",
    )
    parser.add_argument("log", metavar="LOG", help="a log")
    parser.add_argument("-o", "--output", default="jaxradar-figures", metavar="DIR", help="default: jaxradar-figures")
    add_selection(parser)


def _run(args: argparse.Namespace) -> int:
    check_part(args.start, args.stop)
    from jaxradar.cli._detect import figure_files, results_of
    from jaxradar.cli._logs import all_logs
    from jaxradar.evaluation import Selection, Settings
    from jaxradar.systems.step import load_detector

    detector = load_detector(args.detector).detector
    logs, empty = all_logs([args.log])
    if empty or len(logs) > 1:
        count = len(logs) or "no"
        raise LogError(args.log, f"holds {count} logs; expected one log, `jaxradar evaluate --figures` draws many.")
    selection = Selection(args.sensor, args.start, args.stop, args.thin)
    results = results_of(logs[0], Settings(detector, selection, figures=True))
    folder = ready_folder(args.output, "--output")
    assert folder is not None
    names: set[str] = set()
    written = [path for result in results for path in figure_files(result, folder, detector.name, names)]
    if not written:
        raise LogError(args.log, "holds no sweep that could be drawn.")
    for path in written:
        print(shown(path))
    return 0
