"""`jaxradar info`: what a log holds."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING, Any

from jaxradar._errors import JaxradarError
from jaxradar._program import shown
from jaxradar.cli._options import add_command
from jaxradar.cli._output import Lines

if TYPE_CHECKING:
    from jaxradar.drive import Channel, Drive, SensorSeries

__all__ = ["add_to", "describe"]

_DESCRIPTION = """\
Say what logs hold: sensors, sweep rates and their jitter, range axes,
amplitudes, flags, motion, mounting, truth, and what was wrong with the log."""
_UNITS = {"acceleration_m_s2": "m/s²", "yaw_rate_rad_s": "rad/s", "speed_m_s": "m/s"}


def add_to(commands: Any) -> None:
    """Make the command known."""
    parser = add_command(
        commands,
        "info",
        _run,
        summary="say what a log holds",
        description=_DESCRIPTION,
        example="jaxradar info log/07_21_14_03_55",
    )
    parser.add_argument("paths", nargs="+", metavar="LOG", help="a log, a folder of logs, or a pattern")
    parser.add_argument("--json", action="store_true", help="one JSON object per log and line, on standard output")


def _run(args: argparse.Namespace) -> int:
    from jaxradar.cli._logs import all_logs
    from jaxradar.logs import read_log

    logs, empty = all_logs(args.paths)
    lines = Lines(sys.stdout if args.json else None)
    for given, problem in empty:
        lines.write({"path": given, "error": problem})
        print(f"jaxradar: {shown(problem)}", file=sys.stderr)
    failed = len(empty)
    for path in logs:
        try:
            said = describe(path, read_log(path))
        except JaxradarError as error:
            failed += 1
            lines.write({"path": path, "error": str(error)})
            print(f"jaxradar: {shown(str(error))}", file=sys.stderr)
            continue
        if args.json:
            lines.write(said)
        else:
            print("\n".join(_text(said)))
    return 1 if failed else 0


def describe(path: str, drive: Drive) -> dict[str, Any]:
    """All that `info` says of a drive, as JSON knows it."""
    motion = {name: getattr(drive.motion, name) for name in _UNITS}
    return {
        "path": path,
        "started_at": None if drive.started_at is None else drive.started_at.isoformat(),
        "sensors": [_sensor(series) for series in drive.sensors],
        "motion": {name: None if channel is None else _channel(channel) for name, channel in motion.items()},
        "mounting": None if drive.mounting is None else vars(drive.mounting),
        "truth": None if drive.truth is None else [vars(step) for step in drive.truth.steps],
        "problems": list(drive.problems),
    }


def _sensor(series: SensorSeries) -> dict[str, Any]:
    import numpy as np

    from jaxradar.drive import SweepFlag
    from jaxradar.units import NANOSECONDS

    gaps_s = np.diff(series.times_ns) / NANOSECONDS
    forwards = gaps_s[gaps_s > 0]
    counted = {flag.name: int(((series.flags & flag) != 0).sum()) for flag in SweepFlag if flag != SweepFlag.INVALID}
    held = series.sweeps[~series.invalid] if series.invalid.any() else series.sweeps
    return {
        "sensor": series.sensor,
        "sweeps": len(series),
        "duration_s": series.duration_s,
        "sweep_rate_hz": series.sweep_rate_hz,
        "interval_sd_s": float(forwards.std()) if forwards.size else None,
        "longest_interval_s": float(forwards.max()) if forwards.size else None,
        "times_not_increasing": int((gaps_s <= 0).sum()),
        "bins": len(series.range_m),
        "range_start_m": float(series.range_m[0]),
        "range_stop_m": float(series.range_m[-1]),
        "bin_m": series.bin_m,
        "dtype": series.sweeps.dtype.name,
        "amplitude_least": float(np.nanmin(held)) if held.size else None,
        "amplitude_greatest": float(np.nanmax(held)) if held.size else None,
        "invalid_sweeps": int(series.invalid.sum()),
        "flags": {str(name).lower(): count for name, count in counted.items()},
        "spec": dict(series.spec),
    }


def _channel(channel: Channel) -> dict[str, Any]:
    import numpy as np

    finite = channel.values[np.isfinite(channel.values)]
    return {
        "samples": len(channel.values),
        "least": float(finite.min()) if finite.size else None,
        "greatest": float(finite.max()) if finite.size else None,
    }


def _text(said: dict[str, Any]) -> list[str]:
    lines = [shown(said["path"]), f"  started     {said['started_at'] or 'not said'}"]
    for sensor in said["sensors"]:
        lines += _sensor_text(sensor)
    for name, channel in said["motion"].items():
        if channel is not None:
            span = (
                "" if channel["least"] is None else f", {channel['least']:g} to {channel['greatest']:g} {_UNITS[name]}"
            )
            lines.append(f"  motion      {name}: {channel['samples']} samples{span}")
    if all(channel is None for channel in said["motion"].values()):
        lines.append("  motion      not recorded")
    lines.append(f"  mounting    {_known(said['mounting'])}")
    steps = said["truth"]
    if steps is None:
        lines.append("  truth       not known")
    else:
        lines.append(f"  truth       {len(steps)} step{'' if len(steps) == 1 else 's'}")
        lines += [f"              {_known(step)}" for step in steps]
    return lines + [f"  problem     {shown(problem)}" for problem in said["problems"]]


def _sensor_text(sensor: dict[str, Any]) -> list[str]:
    rate = "no rate" if sensor["sweep_rate_hz"] is None else f"{sensor['sweep_rate_hz']:.2f} Hz"
    sweeps = f"{sensor['sweeps']} sweep{'' if sensor['sweeps'] == 1 else 's'}"
    lines = [f"  sensor {sensor['sensor']:<5}{sweeps} in {sensor['duration_s']:.3f} s, {rate}"]
    if sensor["interval_sd_s"] is not None:
        jitter, longest = 1e3 * sensor["interval_sd_s"], 1e3 * sensor["longest_interval_s"]
        lines.append(f"intervals vary by {jitter:.2f} ms (standard deviation), the longest is {longest:.1f} ms")
    if sensor["times_not_increasing"]:
        lines.append(f"times that stand still or go back: {sensor['times_not_increasing']}")
    axis = f"{sensor['range_start_m']:.4f} to {sensor['range_stop_m']:.4f} m, {1e3 * sensor['bin_m']:.3f} mm a bin"
    lines.append(f"{sensor['bins']} range bins, {axis}")
    if sensor["amplitude_least"] is not None:
        span = f"{sensor['amplitude_least']:g} to {sensor['amplitude_greatest']:g}"
        lines.append(f"amplitudes {span} counts, {sensor['dtype']}")
    flags = [f"{name} {count}" for name, count in sensor["flags"].items() if count]
    lines.append(f"invalid sweeps: {sensor['invalid_sweeps']}" + (f" (flags: {', '.join(flags)})" if flags else ""))
    lines += [f"{name} = {shown(str(value))}" for name, value in sensor["spec"].items() if value is not None]
    return lines[:1] + ["              " + line for line in lines[1:]]


def _known(values: dict[str, Any] | None) -> str:
    held = {name: value for name, value in (values or {}).items() if value is not None}
    return ", ".join(f"{name} {_numbers(value)}" for name, value in held.items()) or "not known"


def _numbers(value: Any) -> str:
    """A number, or several of which some may not be known."""
    if isinstance(value, tuple | list):
        return " ".join("–" if one is None else f"{one:g}" for one in value)
    return f"{value:g}"
