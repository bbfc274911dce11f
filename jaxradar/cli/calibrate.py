"""`jaxradar calibrate`: how a sensor sits, out of a stretch of flat road."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jaxradar._errors import ConfigError, JaxradarError
from jaxradar._program import number, shown, whole
from jaxradar.cli._options import add_command, check_part
from jaxradar.cli._output import Lines, spare_logs, write_text

if TYPE_CHECKING:
    from jaxradar.drive import SensorSeries
    from jaxradar.survey import Calibration
    from jaxradar.systems.step import DetectorFile

__all__ = ["add_to"]

_DESCRIPTION = """\
Find out how high a sensor sits and at what angle it looks at the road, from
sweeps over a flat stretch, driven over rather than stood on. Prints both with
their standard deviation, and the tables of a detector's file that say so; -o
writes the whole file."""


def add_to(commands: Any) -> None:
    """Make the command known."""
    parser = add_command(
        commands,
        "calibrate",
        _run,
        summary="find a sensor's height and angle from a flat road",
        description=_DESCRIPTION,
        example="jaxradar calibrate log/07_21_14_03_55 --start 2 --stop 6 -o mine.toml",
    )
    parser.add_argument("paths", nargs="+", metavar="LOG", help="a log, a folder of logs, or a pattern")
    parser.add_argument("--sensor", type=whole(0), metavar="N", help="this sensor alone (default: all)")
    parser.add_argument("--start", type=number(), metavar="S", help="the road is flat from here on, in seconds")
    parser.add_argument("--stop", type=number(), metavar="S", help="up to here")
    parser.add_argument("-o", "--output", metavar="FILE", help="write a detector's file, .toml, for this mounting")
    parser.add_argument("--detector", default="default", metavar="NAME", help="of that file (default: default)")
    parser.add_argument("--json", action="store_true", help="one JSON object per sensor and line, on standard output")


def _run(args: argparse.Namespace) -> int:
    from jaxradar.cli._logs import all_logs
    from jaxradar.evaluation import Selection
    from jaxradar.logs import read_log
    from jaxradar.survey import calibrate
    from jaxradar.systems.step import load_detector

    check_part(args.start, args.stop)
    selection = Selection(args.sensor, args.start, args.stop)
    if args.output is not None:
        spare_logs("--output", args.output, args.paths)
        if not args.output.endswith(".toml"):
            raise ConfigError(f"--output {shown(args.output)} must end with .toml.")
    file = load_detector(args.detector)
    logs, empty = all_logs(args.paths)
    lines = Lines(sys.stdout if args.json else None)
    for given, problem in empty:
        lines.write({"path": given, "error": problem})
        print(f"jaxradar: {shown(problem)}", file=sys.stderr)
    failed = len(empty)
    made: list[tuple[str, Calibration]] = []
    for path in logs:
        try:
            for part in selection.of(path, read_log(path)):
                found = _calibrated(calibrate, path, part.series)
                made.append((f"{path}, sensor {part.series.sensor}", found))
                if args.json:
                    lines.write({"path": path, "sensor": part.series.sensor, **_record(found)})
                else:
                    print("\n".join(_text(made[-1][0], found)))
        except JaxradarError as error:
            failed += 1
            lines.write({"path": path, "error": str(error)})
            print(f"jaxradar: {shown(str(error))}", file=sys.stderr)
    if args.output is not None and made:
        if len(made) > 1:
            raise ConfigError(f"--output takes the mounting of one sensor; there are {len(made)}. Choose by --sensor.")
        _write(args.output, file, *made[0])
    return 1 if failed else 0


def _calibrated(calibrate: Callable[[SensorSeries], Calibration], path: str, series: SensorSeries) -> Calibration:
    try:
        return calibrate(series)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None


def _write(target: str, file: DetectorFile, source: str, found: Calibration) -> None:
    from dataclasses import replace

    from jaxradar.drive import Mounting
    from jaxradar.systems.step import DetectorFile, dump_detector, with_mounting

    mounting = replace(file.mounting or Mounting(), height_m=found.height_m, angle_deg=found.angle_deg)
    provenance = {
        **file.provenance,
        "calibrated_on": shown(source),
        "height_sd_m": found.height_sd_m,
        "angle_sd_deg": found.angle_sd_deg,
    }
    write_text(Path(target), dump_detector(DetectorFile(with_mounting(file.detector, mounting), mounting, provenance)))
    print(f"Written to {shown(target)}; use it as --detector {shown(target)}", file=sys.stderr)


def _record(found: Calibration) -> dict[str, Any]:
    names = ("height_m", "height_sd_m", "angle_deg", "angle_sd_deg", "misfit", "sweeps", "determined")
    return {name: getattr(found, name) for name in names}


def _text(source: str, found: Calibration) -> list[str]:
    lines = [
        f"# {shown(source)}, {found.sweeps} sweeps",
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
        "[approach]",
        f"height_m = {found.height_m:.4f}",
    ]
