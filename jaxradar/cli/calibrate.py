"""`jaxradar calibrate`: how a sensor sits, out of a stretch of flat road."""

from __future__ import annotations

import argparse
import math
import sys
from typing import TYPE_CHECKING, Any

from jaxradar._errors import ConfigError, JaxradarError
from jaxradar.cli._options import add_command, check_part, number, whole
from jaxradar.cli._output import Lines, shown

if TYPE_CHECKING:
    from jaxradar.drive import SensorSeries
    from jaxradar.survey import Calibration

__all__ = ["add_to"]

_DESCRIPTION = """\
Find out how high a sensor sits and at what angle it looks at the road, from
sweeps over a flat stretch, driven over rather than stood on. Prints both with
their standard deviation, and the lines to put into truth and detector files."""


def add_to(commands: Any) -> None:
    """Make the command known."""
    parser = add_command(
        commands,
        "calibrate",
        _run,
        summary="find a sensor's height and angle from a flat road",
        description=_DESCRIPTION,
        example="jaxradar calibrate log/07_21_14_03_55 --start 2 --stop 6",
    )
    parser.add_argument("paths", nargs="+", metavar="LOG", help="a log, a folder of logs, or a pattern")
    parser.add_argument("--sensor", type=whole(0), metavar="N", help="this sensor alone (default: all)")
    parser.add_argument("--start", type=number(), metavar="S", help="the road is flat from here on, in seconds")
    parser.add_argument("--stop", type=number(), metavar="S", help="up to here")
    parser.add_argument("--json", action="store_true", help="one JSON object per sensor and line, on standard output")


def _run(args: argparse.Namespace) -> int:
    from jaxradar.cli._logs import all_logs
    from jaxradar.logs import read_log
    from jaxradar.survey import calibrate

    check_part(args.start, args.stop)
    logs, empty = all_logs(args.paths)
    lines = Lines(sys.stdout if args.json else None)
    for given, problem in empty:
        lines.write({"path": given, "error": problem})
        print(f"jaxradar: {shown(problem)}", file=sys.stderr)
    failed = len(empty)
    for path in logs:
        try:
            held = [one for one in read_log(path).sensors if args.sensor in (None, one.sensor)]
            if not held:
                raise ConfigError(f"{path}: has no sensor {args.sensor}.")
            for series in held:
                found = calibrate(_part(series, args.start, args.stop))
                if args.json:
                    lines.write({"path": path, "sensor": series.sensor, **_record(found)})
                else:
                    print("\n".join(_text(path, series.sensor, found)))
        except JaxradarError as error:
            failed += 1
            lines.write({"path": path, "error": str(error)})
            print(f"jaxradar: {shown(str(error))}", file=sys.stderr)
    return 1 if failed else 0


def _part(series: SensorSeries, start_s: float | None, stop_s: float | None) -> SensorSeries:
    import dataclasses

    times = series.times_s
    use = (times >= (-math.inf if start_s is None else start_s)) & (times <= (math.inf if stop_s is None else stop_s))
    return dataclasses.replace(
        series, times_ns=series.times_ns[use], sweeps=series.sweeps[use], flags=series.flags[use]
    )


def _record(found: Calibration) -> dict[str, Any]:
    names = ("height_m", "height_sd_m", "angle_deg", "angle_sd_deg", "misfit", "sweeps", "determined")
    return {name: getattr(found, name) for name in names}


def _text(path: str, sensor: int, found: Calibration) -> list[str]:
    lines = [
        f"# {shown(path)}, sensor {sensor}, {found.sweeps} sweeps",
        f"# height {1e3 * found.height_m:.1f} ± {1e3 * found.height_sd_m:.1f} mm, "
        f"angle {found.angle_deg:.1f} ± {found.angle_sd_deg:.1f}° (one standard deviation)",
    ]
    if not found.determined:
        lines.append("# these sweeps do not tell the angle: it stands here as it was believed before")
    if found.misfit > 4.0:
        lines.append(
            f"# the echo is not that of a flat road (misfit {found.misfit:.1f}, 1 expected): look for a better part"
        )
    return [
        *lines,
        "[mounting]",
        f"height_m = {found.height_m:.4f}",
        f"angle_deg = {found.angle_deg:.1f}",
        "# in a detector's file, of `approach`:",
        f"height_m = {found.height_m:.4f}",
    ]
