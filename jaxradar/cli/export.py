"""`jaxradar export`: a detector as one file that runs on the device."""

from __future__ import annotations

import argparse
import json
import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jaxradar._errors import ConfigError
from jaxradar._program import shown, whole
from jaxradar.cli._options import add_command
from jaxradar.cli._output import spare_logs
from jaxradar.live.options import RUNTIME, sensor_numbers

if TYPE_CHECKING:
    import numpy as np

    from jaxradar.live.artefact import Artefact

__all__ = ["add_to"]

_DESCRIPTION = f"""\
Compile a detector for the sweeps of one sensor, into one file that holds the
whole program for the device. There it needs Python, numpy and IREE's runtime:

  pip install numpy pyserial '{RUNTIME}'
  python3 step.pyz --source acconeer

The sweeps are those of a log (--like), or said by --range and --bins. The
compiled program is held against JAX, sweep by sweep, before it is written;
--like gives it real ones. It needs IREE's compiler: pip install
'jaxradar[export]'."""


def add_to(commands: Any) -> None:
    """Make the command known."""
    parser = add_command(
        commands,
        "export",
        _run,
        summary="compile a detector for the device",
        description=_DESCRIPTION,
        example="jaxradar export mine.toml --like LOG -o step.pyz --target aarch64-cortex-a53",
    )
    parser.add_argument("detector", metavar="NAME", help="a detector or its FILE.toml")
    parser.add_argument("-o", "--output", metavar="FILE.pyz", required=True, help="file to write")
    parser.add_argument("--like", metavar="LOG", help="for sweeps like those of this log")
    parser.add_argument("--range", type=_range, metavar="M:M", help="or from the first bin to the last, as in 0.1:0.8")
    parser.add_argument("--bins", type=whole(2, 100_000), metavar="N", help="with --range: how many bins")
    parser.add_argument(
        "--sensors", type=sensor_numbers, metavar="N,N", help="of these sensors (default: those of the log)"
    )
    parser.add_argument(
        "--target",
        default="host",
        metavar="CPU",
        help="host, aarch64-cortex-a53 (Raspberry Pi 3), -a72 (4) or -a76 (5) (default: host)",
    )
    parser.add_argument(
        "--format",
        choices=("iree", "stablehlo"),
        default="iree",
        help="stablehlo: for `jaxradar live` where there is JAX (default: iree)",
    )
    parser.add_argument("--json", action="store_true", help="print what was made as JSON")


def _range(text: str) -> tuple[float, float]:
    found = re.fullmatch(r"([0-9.]+):([0-9.]+)", text)
    try:
        first, last = (float(found[1]), float(found[2])) if found else (0.0, 0.0)
    except ValueError:
        first = last = 0.0
    if not 0 <= first < last < math.inf:
        raise argparse.ArgumentTypeError(f"expected two ranges in metres such as 0.1:0.8, got {text!r}")
    return first, last


def _run(args: argparse.Namespace) -> int:
    from jaxradar.export import export_detector, write_archive
    from jaxradar.systems.step import load_detector

    target = Path(args.output)
    if target.suffix != ".pyz":
        raise ConfigError(f"--output {shown(args.output)} must end with .pyz.")
    if not target.absolute().parent.is_dir():
        raise ConfigError(f"--output {shown(args.output)}: there is no such folder.")
    if target.is_dir():
        raise ConfigError(f"--output {shown(args.output)} is a folder; expected a file.")
    file = load_detector(args.detector)
    range_m, sample, sensors = _sweeps(args)
    if args.like is not None:
        spare_logs("--output", args.output, [args.like])
    made = export_detector(
        file,
        range_m,
        sweeps=str(sample.dtype) if sample is not None else "uint16",
        target=args.target,
        kind="jax" if args.format == "stablehlo" else "iree",
        sensors=sensors,
        sample=sample,
    )
    _say(args, made, write_archive(target, made))
    return 0


def _sweeps(args: argparse.Namespace) -> tuple[np.ndarray, np.ndarray | None, tuple[int, ...]]:
    """Range axis, recorded sweeps if there are any, and the sensors."""
    import numpy as np

    if (args.like is None) == (args.range is None):
        raise ConfigError("expected either --like LOG or --range M:M --bins N.")
    if args.range is not None:
        if args.bins is None:
            raise ConfigError("--range needs --bins, how many bins there are.")
        return np.linspace(args.range[0], args.range[1], args.bins), None, args.sensors or ()
    if args.bins is not None:
        raise ConfigError("--bins goes with --range; the bins of --like are those of the log.")
    from jaxradar.logs import read_log

    drive = read_log(args.like)
    wanted = args.sensors or tuple(series.sensor for series in drive.sensors)
    chosen = [series for series in drive.sensors if series.sensor in wanted]
    have = [series.sensor for series in drive.sensors]
    if unknown := [number for number in wanted if number not in have]:
        raise ConfigError(f"{args.like}: has no sensor {unknown[0]}; expected some of {', '.join(map(str, have))}.")
    first = chosen[0]
    if any(not np.array_equal(one.range_m, first.range_m) or one.sweeps.dtype != first.sweeps.dtype for one in chosen):
        raise ConfigError(f"{shown(args.like)}: its sensors have sweeps of different kinds; choose by --sensors.")
    return first.range_m, np.asarray(first.sweeps), wanted


def _say(args: argparse.Namespace, made: Artefact, size: int) -> None:
    header = made.header
    if args.json:
        record = {"file": args.output, "bytes": size, "program_bytes": len(made.program), "sha256": made.sha256}
        known = {"detector": header.detector, "bins": header.bins, "target": header.target, "kind": header.kind}
        print(json.dumps(record | known | {"versions": header.versions}))
        return
    print(
        f"{shown(args.output)}: {header.detector} for {header.bins} bins from {header.range_m[0]:.4g} to "
        f"{header.range_m[-1]:.4g} m, {header.target}, {size / 1e3:.0f} kB."
    )
    name = shown(args.output)
    if header.kind == "iree":
        print(f"Copy it to the device and run it there: python3 {Path(name).name} --source acconeer")
    else:
        print(f"Run it where there is JAX: jaxradar live --detector {name} --source acconeer")
