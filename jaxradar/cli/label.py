"""`jaxradar label`: truth to start from, out of the acceleration."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from jaxradar._errors import LogError
from jaxradar._program import number, shown
from jaxradar.cli._options import add_command

__all__ = ["add_to"]

_DESCRIPTION = """\
Propose the truth of a log from its vertical acceleration: a step for each
bump, its impact a little before the acceleration passes a threshold, counted
from the median of the recording in either direction.

The proposal is written beside the log, to be read and edited before anything
is judged by it: truth.json inside a folder, NAME.truth.json beside a file; a
.drive holds its truth itself. What stands there is kept unless --overwrite."""


def add_to(commands: Any) -> None:
    """Make the command known."""
    parser = add_command(
        commands,
        "label",
        _run,
        summary="propose the truth of a log from its acceleration",
        description=_DESCRIPTION,
        example="jaxradar label log/07_21_14_03_55 --acceleration 15 --delay 0.018",
    )
    parser.add_argument("log", metavar="LOG", help="a log with acceleration")
    parser.add_argument("-o", "--output", metavar="FILE", help="where to write instead")
    parser.add_argument(
        "--acceleration", type=number(0, above=True), default=15.0, metavar="A", help="threshold in m/s² (default: 15)"
    )
    parser.add_argument(
        "--delay",
        type=number(0),
        default=0.018,
        metavar="S",
        help="from the tyre's contact to the threshold, in seconds (default: 0.018)",
    )
    parser.add_argument(
        "--hold-off", type=number(0), default=0.5, metavar="S", help="bumps closer than this are one (default: 0.5)"
    )
    parser.add_argument("--overwrite", action="store_true", help="replace what stands there")


def _run(args: argparse.Namespace) -> int:
    from jaxradar.drive import Truth
    from jaxradar.drivefile import DriveWriter, is_drive_folder, staged
    from jaxradar.labcsv import truth_path, truth_text
    from jaxradar.labels import propose_steps
    from jaxradar.logs import read_log

    log = Path(args.log)
    drive = read_log(log)
    channel = drive.motion.acceleration_m_s2
    if channel is None or not channel.values.size:
        raise LogError(log, "holds no acceleration to propose steps from.")
    steps = propose_steps(channel, threshold_m_s2=args.acceleration, delay_s=args.delay, hold_off_s=args.hold_off)
    if args.output is None and is_drive_folder(log):
        if drive.truth is not None and not args.overwrite:
            raise LogError(log, f"says already what the truth is ({len(drive.truth.steps)} steps); see --overwrite.")
        with DriveWriter.reopen(log) as writer:
            writer.set(truth=Truth(steps))
        target = log
    else:
        target = truth_path(log) if args.output is None else Path(args.output)
        text = truth_text(replace(drive, truth=Truth(steps)))
        assert text is not None
        with staged(target, overwrite=args.overwrite) as stage:
            stage.write_text(text, encoding="utf-8")
    found = ", ".join(f"{step.impact_s:.3f} s" for step in steps) or "none"
    print(f"Impacts where the acceleration passes {args.acceleration:g} m/s²: {found}.")
    print(f"Written to {shown(target)}; look at it, and edit it, before you judge by it.")
    return 0
