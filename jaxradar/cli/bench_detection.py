"""`jaxradar bench-detection`: how many steps a detector sees, how early, and what it raises for nothing."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jaxradar.cli._options import add_command, number, whole
from jaxradar.cli._output import console, plain, print_table, ready_folder, shown

if TYPE_CHECKING:
    from jaxradar.estimate.intervals import Estimate
    from jaxradar.suite import Suite

__all__ = ["add_to"]

_DESCRIPTION = """\
Drive simulated cars over steps of every height, at every speed, over smooth,
wet, dry and rough roads, and over roads without a step, pulling away and
braking among them; and say of each detector how many steps it sees with 80 %
of the lead that geometry allows, how early, and how often it alarms for
nothing, with 95 % intervals. The drives are never those that anything was
tuned on. Written to DIR: detection.json with all figures, and pictures.
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
    parser.add_argument("--seed", type=whole(0), default=0, metavar="N", help="of the drives (default: 0)")
    parser.add_argument("--json", action="store_true", help="print JSON instead of tables")


def _run(args: argparse.Namespace) -> int:
    from jaxradar.plots.detection import plot_heights, plot_roc
    from jaxradar.plots.style import save
    from jaxradar.suite import grid, run_suite, suite_record, variations
    from jaxradar.systems.step import load_detector

    names = list(dict.fromkeys(args.detector or ["default", "thesis"]))
    detectors = {shown(name): load_detector(name).detector for name in names}
    folder = ready_folder(args.output, "--output")
    assert folder is not None
    cells = [*grid(), *variations()]
    if args.quick:
        cells = list(grid(speeds_kmh=(10.0, 30.0), heights_m=(-0.04, 0.01, 0.02, 0.03, 0.05)))
    drives = args.drives or (40 if args.quick else 1000)
    hours = args.hours or (0.5 if args.quick else 20.0)
    from rich.progress import Progress

    visible = sys.stderr.isatty()
    if not visible:
        print(f"jaxradar: {len(cells)} cells of {drives} drives, {hours:g} hours without a step ...", file=sys.stderr)
    with Progress(console=console(sys.stderr), transient=True, disable=not visible) as progress:
        bar = progress.add_task("driving", total=1.0)
        told = lambda what, share: progress.update(bar, completed=share, description=what)  # noqa: E731
        suite = run_suite(detectors, cells, drives, hours, args.seed, told)
    record = plain(suite_record(suite))
    _write(folder / "detection.json", record)
    for name in detectors:
        save(plot_heights(suite, name), folder / f"heights-{Path(name).stem}.png")
    save(plot_roc(suite), folder / "roc.png")
    if args.json:
        print(json.dumps(record, allow_nan=False, indent=1))
        return 0
    _print_quiet(suite)
    for name in detectors:
        _print_cells(suite, name, usual=True)
    for name in detectors:
        _print_cells(suite, name, usual=False)
    print(f"Figures and pictures in {shown(folder)}")
    return 0


def _write(path: Path, record: object) -> None:
    from jaxradar.drivefile import staged

    with staged(path, overwrite=True) as stage:
        stage.write_text(json.dumps(record, allow_nan=False, indent=1) + "\n", encoding="utf-8")


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
