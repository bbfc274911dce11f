"""`jaxradar frontier`: what accuracy costs in time, on this machine."""

from __future__ import annotations

import argparse
import json
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from jaxradar._errors import ConfigError
from jaxradar._toml import nearest
from jaxradar.cli._options import add_command, number, whole
from jaxradar.cli._output import console, plain, print_table, ready_folder, shown

if TYPE_CHECKING:
    from jaxradar.pareto import Frontier, Point

__all__ = ["add_to"]

_TASKS = ("range", "speed", "steps", "spacing")
_DESCRIPTION = """\
Measure what accuracy costs in time, on this machine: error and time of every
way of doing a task, who is on the front, and what theory bounds.

TASK is range (of one echo), speed (from ranges), steps (in the road), spacing
(of a simulated road's scatterers), or several; all if none is named. Written
to DIR for each task: TASK.json with all figures, and a picture of each case.
Times are of this machine as busy as it is: leave it alone meanwhile."""


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Make the command known."""
    parser = add_command(
        commands,
        "frontier",
        _run,
        summary="what accuracy costs in time",
        description=_DESCRIPTION,
        example="jaxradar frontier range -o frontier --quick",
    )
    parser.add_argument("tasks", nargs="*", metavar="TASK", help=f"any of {', '.join(_TASKS)} (default: all)")
    parser.add_argument("-o", "--output", metavar="DIR", required=True, help="folder for tables and pictures")
    parser.add_argument("--quick", action="store_true", help="fewer cases, candidates and rounds: under a minute")
    parser.add_argument("--rounds", type=whole(3, 10_000), metavar="N", help="of timing (default: 15, quick 5)")
    parser.add_argument("--case", metavar="NAME", help="print this case (default: each task's first)")
    parser.add_argument(
        "--error", type=number(0.0, above=True), metavar="E", help="also say who is cheapest with at most this error"
    )
    parser.add_argument(
        "--time-ns", type=number(0.0, above=True), metavar="NS", help="or most accurate in this time an item"
    )
    parser.add_argument("--json", action="store_true", help="print JSON instead of tables")


def _run(args: argparse.Namespace) -> int:
    for name in args.tasks:
        if name not in _TASKS:
            raise ConfigError(f"no task `{name}`{nearest(name, _TASKS)}; expected {', '.join(_TASKS)}.")
    folder = ready_folder(args.output, "--output")
    assert folder is not None  # argparse asks for it
    names = list(dict.fromkeys(args.tasks)) or list(_TASKS)
    for option, value in (("--error", args.error), ("--case", args.case)):
        if value is not None and len(names) > 1:
            raise ConfigError(f"{option} is of one task; name the task.")
    if args.case is not None:
        _check_case(names[0], args.case, args.quick)
    found = [_measured(name, args, place, len(names)) for place, name in enumerate(names)]
    records = []
    for one in found:
        record = plain(_with_choice(one, args))
        _write(one, record, folder)
        records.append(record)
    if args.json:
        print(json.dumps(records, allow_nan=False, indent=1))
        return 0
    for one in found:
        _print(one, args)
    print(f"Tables and pictures in {shown(folder)}")
    return 0


def _check_case(task: str, case: str, quick: bool) -> None:
    """Before minutes of measuring."""
    from jaxradar.tasks import TASKS

    known = [one.name for one in TASKS[task]().cases(quick)]
    if case not in known:
        raise ConfigError(f"no case {case!r}{nearest(case, known)}; expected one of {'; '.join(known)}.")


def _measured(name: str, args: argparse.Namespace, place: int, count: int) -> Frontier:
    from rich.progress import Progress

    from jaxradar.pareto import measure
    from jaxradar.tasks import TASKS

    visible = sys.stderr.isatty()
    if not visible:
        print(f"jaxradar: measuring {name} ({place + 1} of {count}) ...", file=sys.stderr)
    with Progress(console=console(sys.stderr), transient=True, disable=not visible) as progress:
        bar = progress.add_task(name, total=1.0)

        def told(what: str, share: float) -> None:
            progress.update(bar, completed=share, description=f"{name}: {what}")

        return measure(TASKS[name](), quick=args.quick, count=args.rounds, progress=told)


def _with_choice(found: Frontier, args: argparse.Namespace) -> dict[str, object]:
    from jaxradar.pareto import to_json

    record: dict[str, object] = to_json(found)
    chosen = _choice(found, args)
    return record if chosen is None else {**record, "chosen": chosen.candidate}


def _choice(found: Frontier, args: argparse.Namespace) -> Point | None:
    from jaxradar.pareto import choose

    if args.error is None and args.time_ns is None:
        return None
    time_s = None if args.time_ns is None else 1e-9 * args.time_ns
    return choose(found, error=args.error, time_s=time_s, case=args.case)


def _write(found: Frontier, record: object, folder: Path) -> None:
    from jaxradar.drivefile import staged
    from jaxradar.plots.frontier import plot_case, plot_levels
    from jaxradar.plots.style import save

    with staged(folder / f"{found.task}.json", overwrite=True) as stage:
        stage.write_text(json.dumps(record, allow_nan=False, indent=1) + "\n", encoding="utf-8")
    for place, result in enumerate(found.results):
        if result.points:
            name = found.task if not place else f"{found.task}-{_slug(result.case)}"
            save(plot_case(found, result), folder / f"{name}.png")
    levels = plot_levels(found)
    if levels is not None:
        save(levels, folder / f"{found.task}-snr.png")


def _slug(text: str) -> str:
    return re.sub(r"[^a-z0-9.]+", "-", text.lower().replace("%", " percent")).strip("-")


def _print(found: Frontier, args: argparse.Namespace) -> None:
    from jaxradar.pareto import table

    result = found.result(args.case)
    print(f"{found.title}. {result.case}: {result.about}.")
    if result.bound:
        print(f"{result.bound_name} bound: {result.bound:.3g} {found.unit}.")
    columns, rows = table(found, result)
    print_table(sys.stdout, columns, rows)
    print("* on the front   D the default")
    for name, why in result.failed.items():
        print(f"{name}: not measured: {why}")
    chosen = _choice(found, args)
    if chosen is not None:
        print(
            f"Within the budget: {chosen.candidate}, {chosen.error.value:.3g} {found.unit} "
            f"({chosen.error.low:.3g} to {chosen.error.high:.3g}) in {1e9 * chosen.batch.median:.3g} ns a {found.item}."
        )
    print()
