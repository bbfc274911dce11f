"""`jaxradar bench-detection`: how many steps a detector sees, how early, and what it raises for nothing."""

from __future__ import annotations

import argparse
import itertools
import json
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jaxradar._errors import ConfigError
from jaxradar._program import number, shown, whole
from jaxradar.cli._options import add_command
from jaxradar.cli._output import plain, ready_folder, told_shares, write_json

if TYPE_CHECKING:
    from jaxradar.drive import SensorSeries
    from jaxradar.suite import HeightErrors, Oblique, ObliqueCell, StepCell, Suite
    from jaxradar.systems.step import StepDetector

    Detectors = Mapping[str, StepDetector[Any, Any]]

__all__ = ["add_to"]

SEED = 10  # earlier ones were looked at while settings were chosen
PARTS = ("drives", "oblique", "heights")
SHARE = 10  # oblique steps and heights take longer, and are driven over a tenth as often

_DESCRIPTION = """\
Drive simulated cars over steps of every height, at every speed, over smooth,
wet, dry and rough roads, and over roads without a step, pulling away and
braking among them; and say of each detector how many steps it sees with 80 %
of the lead that geometry allows, how early, and how often it alarms for
nothing, with 95 % intervals. The drives are never those that anything was
tuned on. Then what two sensors recover of oblique steps that one reports too
late, and how well the height of a step is told. --standing adds recordings of
a car that stands, as they are and with steps put in. Written to DIR:
detection.json with all figures, and pictures. The whole takes hours on two
cores; --quick a few minutes."""
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
    parser.add_argument(
        "--only", action="append", choices=PARTS, help="this part of what is simulated alone; again for another"
    )
    parser.add_argument("--json", action="store_true", help="print JSON instead of tables")


def _run(args: argparse.Namespace) -> int:
    from jaxradar.cli._suite_tables import print_heights, print_oblique, print_recorded, print_suite
    from jaxradar.suite import measure_recordings, oblique_total, recorded_record, suite_record
    from jaxradar.systems.step import load_detector

    names = list(dict.fromkeys(args.detector or ["default", "thesis"]))
    detectors = {shown(name): load_detector(name).detector for name in names}
    stems = _stems(list(detectors))
    folder = ready_folder(args.output, "--output")
    assert folder is not None
    recordings = _standing(args.standing)
    wanted = args.only or PARTS
    corners = [(name, one) for name, one in detectors.items() if _follows_corners(one)]
    record: dict[str, Any] = {"seed": args.seed}

    def keep(part: dict[str, Any]) -> None:
        record.update(part)
        write_json(folder / "detection.json", plain(record))  # what is done stays if the rest is cut off

    tables: list[Callable[[], None]] = []
    if "drives" in wanted:
        suite = _drives(detectors, args)
        keep(suite_record(suite))
        _draw(suite, stems, folder)
        tables.append(partial(print_suite, suite))
    for name, one in corners if "oblique" in wanted else ():
        oblique = _oblique(one, args)
        total = oblique_total(list(oblique.values()))
        told = [{"cell": cell.name, **found.record()} for cell, found in oblique.items()]
        keep({"oblique": {**record.get("oblique", {}), name: {"all": total.record(), "cells": told}}})
        tables.append(partial(print_oblique, name, oblique, total))
    for name, one in corners if "heights" in wanted else ():
        heights = _heights(one, args)
        told = [{"cell": cell.name, "impact_known": known, **held.record()} for (cell, known), held in heights.items()]
        keep({"heights": {**record.get("heights", {}), name: told}})
        tables.append(partial(print_heights, name, heights))
    if recordings:
        with told_shares("standing recordings", f"{len(recordings)} standing recordings") as hear:
            recorded = measure_recordings(detectors, recordings, hear)
        keep({"standing": {name: recorded_record(one) for name, one in recorded.items()}})
        tables.append(partial(print_recorded, recorded, len(recordings)))
    if args.json:
        print(json.dumps(plain(record), allow_nan=False, indent=1))
        return 0
    for table in tables:
        table()
    print(f"Figures and pictures in {shown(folder)}")
    return 0


def _drives(detectors: Detectors, args: argparse.Namespace) -> Suite:
    from jaxradar.suite import grid, run_suite, variations

    cells = [*grid(), *variations()]
    if args.quick:
        cells = list(grid(speeds_kmh=(10.0, 30.0), heights_m=(-0.04, 0.01, 0.02, 0.03, 0.05)))
    hours, count = args.hours or (0.5 if args.quick else 20.0), _count(args, 1)
    with told_shares("driving", f"{len(cells)} cells of {count} drives, {hours:g} hours without a step") as told:
        return run_suite(detectors, cells, count, hours, args.seed, told)


def _oblique(detector: StepDetector[Any, Any], args: argparse.Namespace) -> dict[ObliqueCell, Oblique]:
    from jaxradar.suite import measure_oblique, oblique_grid

    cells = list(oblique_grid())[:: 6 if args.quick else 1]
    count = _count(args, SHARE)
    with told_shares("oblique steps", f"{len(cells)} cells of {count} drives over oblique steps") as told:
        return {
            cell: measure_oblique(cell, detector, count, args.seed, _hear(told, cell.name, place, len(cells), count))
            for place, cell in enumerate(cells)
        }


def _heights(detector: StepDetector[Any, Any], args: argparse.Namespace) -> dict[tuple[StepCell, bool], HeightErrors]:
    from jaxradar.suite import heights_grid, measure_heights

    cells = list(heights_grid())[:: 8 if args.quick else 1]
    count = _count(args, SHARE)
    found: dict[tuple[StepCell, bool], HeightErrors] = {}
    with told_shares("heights", f"{len(cells)} cells of {count} drives whose steps are measured, twice") as told:
        for place, (cell, known) in enumerate(itertools.product(cells, (True, False))):
            hear = _hear(told, cell.name, place, 2 * len(cells), count)
            found[cell, known] = measure_heights(cell, None if known else detector, count, args.seed, told=hear)
    return found


def _hear(told: Callable[[str, float], None], name: str, place: int, of: int, count: int) -> Callable[[int], None]:
    return lambda done: told(name, (place + done / count) / of)


def _count(args: argparse.Namespace, share: int) -> int:
    """Of the drives of each cell, one in so many."""
    return max(2, (args.drives or (40 if args.quick else 1000)) // share)


def _follows_corners(detector: StepDetector[Any, Any]) -> bool:
    from jaxradar.survey.pair import corner_detector

    try:
        corner_detector(detector)
    except ConfigError:
        return False
    return True


def _draw(suite: Suite, stems: Mapping[str, str], folder: Path) -> None:
    from jaxradar.plots.detection import plot_heights, plot_roc
    from jaxradar.plots.style import save

    for name, stem in stems.items():
        save(plot_heights(suite, name), folder / f"heights-{stem}.png")
    save(plot_roc(suite), folder / "roc.png")


def _stems(names: Sequence[str]) -> dict[str, str]:
    """What the pictures of each detector are called. Raises `ConfigError` for two that would be called alike."""
    by_stem: dict[str, str] = {}
    for name in names:
        other = by_stem.setdefault(Path(name).stem, name)
        if other != name:
            raise ConfigError(
                f"--detector {shown(other)} and {shown(name)} would have one name; give the files other names."
            )
    return {name: stem for stem, name in by_stem.items()}


def _standing(paths: Sequence[str]) -> list[SensorSeries]:
    from jaxradar.cli._logs import all_logs
    from jaxradar.logs import read_log

    logs, empty = all_logs(paths)
    if empty:
        raise ConfigError(empty[0][1])
    return [series for log in logs for series in read_log(log).sensors]
