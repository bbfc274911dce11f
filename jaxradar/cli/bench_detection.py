"""`jaxradar bench-detection`: how many steps a detector sees, how early, and what it raises for nothing."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jaxradar._errors import ConfigError
from jaxradar.cli._options import add_command, number, whole
from jaxradar.cli._output import plain, print_table, ready_folder, shown, told_shares, write_json

if TYPE_CHECKING:
    from jaxradar.drive import SensorSeries
    from jaxradar.estimate.intervals import Estimate
    from jaxradar.suite import Recorded, Suite

__all__ = ["add_to"]

SEED = 10  # earlier ones were looked at while settings were chosen

_DESCRIPTION = """\
Drive simulated cars over steps of every height, at every speed, over smooth,
wet, dry and rough roads, and over roads without a step, pulling away and
braking among them; and say of each detector how many steps it sees with 80 %
of the lead that geometry allows, how early, and how often it alarms for
nothing, with 95 % intervals. The drives are never those that anything was
tuned on. --standing adds recordings of a car that stands, as they are and with
steps put in. Written to DIR: detection.json with all figures, and pictures.
The whole takes half an hour; --quick a few minutes."""
_EXAMPLE = """\
jaxradar bench-detection -o detection --quick
  jaxradar bench-detection -o detection --detector mine.toml"""


def add_to(commands: Any) -> None:
    """Make the command known."""
    parser = add_command(
        commands,
        "bench-detection",
        _run,
        summary="which steps a detector sees, and what it raises for nothing",
        description=_DESCRIPTION,
        example=_EXAMPLE,
    )
    parser.add_argument("-o", "--output", required=True, metavar="DIR", help="folder for figures and pictures")
    parser.add_argument(
        "--detector",
        action="append",
        metavar="NAME",
        help="a detector or a FILE.toml; again for another (default: default and thesis)",
    )
    parser.add_argument("--quick", action="store_true", help="few drives of few cells, half an hour without a step")
    parser.add_argument("--drives", type=whole(2), metavar="N", help="of each cell (default: 1000, quick 40)")
    parser.add_argument(
        "--hours", type=number(0.0, above=True), metavar="H", help="without a step (default: 20, quick 0.5)"
    )
    parser.add_argument("--seed", type=whole(0), default=SEED, metavar="N", help=f"of the drives (default: {SEED})")
    parser.add_argument(
        "--standing",
        action="append",
        default=[],
        metavar="PATH",
        help="recordings of a car that stands, as they are and with steps put in; again for more",
    )
    parser.add_argument("--json", action="store_true", help="print JSON instead of tables")


def _run(args: argparse.Namespace) -> int:
    from jaxradar.plots.detection import plot_heights, plot_roc
    from jaxradar.plots.style import save
    from jaxradar.suite import grid, measure_recordings, recorded_record, run_suite, suite_record, variations
    from jaxradar.systems.step import load_detector

    names = list(dict.fromkeys(args.detector or ["default", "thesis"]))
    detectors = {shown(name): load_detector(name).detector for name in names}
    stems = _stems(list(detectors))
    folder = ready_folder(args.output, "--output")
    assert folder is not None
    recordings = _standing(args.standing)
    cells = [*grid(), *variations()]
    if args.quick:
        cells = list(grid(speeds_kmh=(10.0, 30.0), heights_m=(-0.04, 0.01, 0.02, 0.03, 0.05)))
    drives = args.drives or (40 if args.quick else 1000)
    hours = args.hours or (0.5 if args.quick else 20.0)
    with told_shares("driving", f"{len(cells)} cells of {drives} drives, {hours:g} hours without a step") as told:
        suite = run_suite(detectors, cells, drives, hours, args.seed, told)
        recorded = measure_recordings(detectors, recordings, told) if recordings else {}
    record = plain({**suite_record(suite), "standing": {name: recorded_record(one) for name, one in recorded.items()}})
    write_json(folder / "detection.json", record)
    for name, stem in stems.items():
        save(plot_heights(suite, name), folder / f"heights-{stem}.png")
    save(plot_roc(suite), folder / "roc.png")
    if args.json:
        print(json.dumps(record, allow_nan=False, indent=1))
        return 0
    _print_quiet(suite)
    for name in detectors:
        _print_cells(suite, name, usual=True)
    for name in detectors:
        _print_cells(suite, name, usual=False)
    if recorded:
        _print_recorded(recorded, len(recordings))
    print(f"Figures and pictures in {shown(folder)}")
    return 0


def _stems(names: Sequence[str]) -> dict[str, str]:
    """What the pictures of each detector are called. Raises `ConfigError` for two that would be called alike."""
    stems = {name: Path(name).stem for name in names}
    for name, stem in stems.items():
        alike = [other for other, one in stems.items() if one == stem]
        if len(alike) > 1:
            raise ConfigError(
                f"--detector {shown(name)} and {shown(alike[1])} would have one name; give the files other names."
            )
    return stems


def _standing(paths: Sequence[str]) -> list[SensorSeries]:
    from jaxradar.cli._logs import all_logs
    from jaxradar.logs import read_log

    logs, empty = all_logs(paths)
    if empty:
        raise ConfigError(empty[0][1])
    return [series for log in logs for series in read_log(log).sensors]


def _print_quiet(suite: Suite) -> None:
    roads = list(next(iter(suite.quiet.values())))
    hours = sum(one.hours for one in next(iter(suite.quiet.values())).values())
    print(f"\nFalse alarms an hour, with 95 % intervals, in {hours:.1f} hours without a step")
    rows = [
        [name, *(_range(held[road].per_hour, 1.0, ".2g") for road in roads), f"{suite.thresholds[name]:.2f}"]
        for name, held in suite.quiet.items()
    ]
    print_table(sys.stdout, ["detector", *roads, "x threshold for 1/h"], rows)


def _print_cells(suite: Suite, detector: str, usual: bool) -> None:
    """One row for each road and speed, or for each variation; one column for each height."""
    held = {cell: one for cell, one in suite.cells[detector].items() if bool(cell.variation) != usual}
    if not held:
        return
    print(f"\n{detector}: steps seen with 80 % of the possible lead, in %, and what at least (95 %)")
    if usual:
        heights = sorted({cell.height_m for cell in held})
        rows = []
        for road, speed in dict.fromkeys((cell.road, cell.speed_kmh) for cell in held):
            of = {cell.height_m: one for cell, one in held.items() if (cell.road, cell.speed_kmh) == (road, speed)}
            rows.append([f"{road}, {speed:g} km/h", *(_least(of[height].in_time) for height in heights)])
        print_table(sys.stdout, ["", *(f"{1e3 * height:+g} mm" for height in heights)], rows)
        return
    rows = [[cell.name, _least(one.in_time), *_leads(one.lead_s)] for cell, one in held.items()]
    print_table(sys.stdout, ["", "seen", "lead 5 %", "50 %", "95 %, ms"], rows)


def _least(one: Estimate) -> str:
    return f"{100 * one.value:.3g} ({100 * one.low:.3g})"


def _range(one: Estimate, scale: float, form: str) -> str:
    return f"{scale * one.value:{form}} ({scale * one.low:{form}}–{scale * one.high:{form}})"


def _leads(leads: tuple[Estimate, ...]) -> list[str]:
    return [f"{1e3 * one.value:.0f}" for one in leads] if leads else ["", "", ""]


def _print_recorded(recorded: Mapping[str, Recorded], count: int) -> None:
    rates = list(next(iter(recorded.values())).alarms)
    seconds = next(iter(recorded.values())).seconds
    print(f"\n{count} recordings of a car that stands: detections at their own rate and with other times")
    columns = [f"{'own rate' if rate is None else f'{rate:g} Hz'}, {seconds[rate]:.0f} s" for rate in rates]
    rows = [[name, *(str(one.alarms[rate]) for rate in rates)] for name, one in recorded.items()]
    print_table(sys.stdout, ["detector", *columns], rows)
    held = next(iter(recorded.values())).injected
    if not held:
        return
    print("\nSteps put into them, found within 40 ms, in %, and what at least (95 %, each recording counted once)")
    heights = sorted({height for _, height in held})
    rows = [
        [f"{name}, {rate:g} Hz", *(_least(one.injected[rate, height]) for height in heights)]
        for name, one in recorded.items()
        for rate in sorted({rate for rate, _ in held})
    ]
    print_table(sys.stdout, ["detector", *(f"{1e3 * height:g} mm" for height in heights)], rows)
