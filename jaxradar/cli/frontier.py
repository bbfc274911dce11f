"""`jaxradar frontier`: what accuracy costs in time, on this machine."""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jaxradar._errors import ConfigError
from jaxradar._program import number, shown, whole
from jaxradar._toml import nearest
from jaxradar.cli._options import add_command
from jaxradar.cli._output import plain, print_table, ready_folder, told_shares, write_json

if TYPE_CHECKING:
    from jaxradar.pareto import Frontier

__all__ = ["add_to"]

# As in `jaxradar.tasks`, which takes a second to import.
_TASKS = ("range", "speed", "steps", "spacing")
_DESCRIPTION = """\
Measure what accuracy costs in time, on this machine: error and time of every
way of doing a task, who is on the front, and what theory bounds.

TASK is range (of one echo), speed (from ranges), steps (in the road), spacing
(of a simulated road's scatterers), several of them, or all. Written to DIR for
each task: TASK.json with all figures, and a picture of each case.
Times are of this machine as busy as it is: leave it alone meanwhile."""
_EXAMPLE = """\
jaxradar frontier range -o frontier --quick
  jaxradar frontier range -o frontier --case "recorded 40 dB" --error 0.3"""


def add_to(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Make the command known."""
    parser = add_command(
        commands, "frontier", _run, summary="what accuracy costs in time", description=_DESCRIPTION, example=_EXAMPLE
    )
    parser.add_argument("tasks", nargs="*", metavar="TASK", help=f"any of {', '.join(_TASKS)}, or all (default: range)")
    parser.add_argument("-o", "--output", metavar="DIR", help="folder for figures and pictures")
    parser.add_argument("--quick", action="store_true", help="fewer cases, candidates and rounds: under a minute")
    parser.add_argument("--rounds", type=whole(3, 10_000), metavar="N", help="of timing (default: 11, quick 5)")
    parser.add_argument("--case", metavar="NAME", help="measure this case alone (default: all; --list names them)")
    parser.add_argument(
        "--error",
        type=number(0.0, above=True),
        metavar="E",
        help="say who is cheapest with at most this error, in the task's unit (mm, m/s, %%)",
    )
    parser.add_argument(
        "--time-ns", type=number(0.0, above=True), metavar="NS", help="or most accurate in this time an item"
    )
    parser.add_argument("--list", action="store_true", help="list the tasks and their cases")
    parser.add_argument("--json", action="store_true", help="print JSON instead of tables")


def _run(args: argparse.Namespace) -> int:
    from jaxradar.pareto import to_json

    for name in args.tasks:
        if name not in (*_TASKS, "all"):
            raise ConfigError(f"no task `{name}`{nearest(name, _TASKS)}; expected {', '.join(_TASKS)} or all.")
    names = list(_TASKS) if "all" in args.tasks else list(dict.fromkeys(args.tasks)) or [_TASKS[0]]
    if args.list:
        _list(names if args.tasks else _TASKS, args.quick)
        return 0
    if args.output is None:
        raise ConfigError("expected --output DIR for figures and pictures, or --list.")
    for option, value in (("--error", args.error), ("--case", args.case)):
        if value is not None and len(names) > 1:
            raise ConfigError(f"{option} is of one task; name the task.")
    folder = ready_folder(args.output, "--output")
    assert folder is not None
    status, records = 0, []
    for place, name in enumerate(names):
        found = _measured(name, args, place, len(names))
        record = plain(to_json(found))
        said, met = _choice(found, args, record)
        _write(found, record, folder)
        records.append(record)
        if not args.json:
            _print(found, args)
            print(said)
        elif not met:
            print(f"jaxradar: {said}", file=sys.stderr)
        status |= not met
    if args.json:
        print(json.dumps(records, allow_nan=False, indent=1))
    else:
        print(f"Figures and pictures in {shown(folder)}")
    return status


def _list(names: Sequence[str], quick: bool) -> None:
    from jaxradar.tasks import TASKS

    for name in names:
        task = TASKS[name]()
        print(f"{name}: {task.title}")
        for case in task.cases(quick):
            print(f'  "{case.name}": {case.about}')


def _measured(name: str, args: argparse.Namespace, place: int, count: int) -> Frontier:
    from jaxradar.pareto import measure
    from jaxradar.tasks import TASKS

    cases = None if args.case is None else [args.case]
    with told_shares(name, f"measuring {name} ({place + 1} of {count})") as told:
        return measure(
            TASKS[name](),
            cases=cases,
            quick=args.quick,
            count=args.rounds,
            progress=lambda what, share: told(f"{name}: {what}", share),
        )


def _choice(found: Frontier, args: argparse.Namespace, record: dict[str, Any]) -> tuple[str, bool]:
    """Who meets the budget, if one was asked for, as a sentence and in the record; whether that was well."""
    from jaxradar.pareto import choose

    if args.error is None and args.time_ns is None:
        return "", True
    cost = None if args.time_ns is None else 1e-9 * args.time_ns
    try:
        point = choose(found, error=args.error, cost=cost, case=args.case)
    except ConfigError as error:
        return str(error), False
    record["chosen"] = point.candidate
    return (
        f"Within the budget: {point.candidate}, {point.error.value:.3g} {found.unit} ({point.error.low:.3g} to "
        f"{point.error.high:.3g}) in {found.cost_text(point.cost.value)} a {found.item}.\n"
    ), True


def _write(found: Frontier, record: object, folder: Path) -> None:
    from jaxradar.plots.frontier import plot_case, plot_levels
    from jaxradar.plots.style import save

    write_json(folder / f"{found.task}.json", record)
    for result in found.results:
        if result.points:
            save(plot_case(found, result), folder / f"{found.task}-{_slug(result.case.name)}.png")
    levels = plot_levels(found)
    if levels is not None:
        save(levels, folder / f"{found.task}-levels.png")


def _slug(text: str) -> str:
    return re.sub(r"[^a-z0-9.]+", "-", text.lower().replace("%", " percent")).strip("-")


def _print(found: Frontier, args: argparse.Namespace) -> None:
    from jaxradar.pareto import table

    result = found.result(args.case)
    print(f"{found.title}. {result.case.name}: {result.case.about}.")
    if result.bound:
        print(f"{result.case.bound_name} bound: {result.bound:.3g} {found.unit}.")
    columns, rows = table(found, result)
    print_table(sys.stdout, columns, rows)
    print("* on the front   D the default")
    for name, why in result.failed.items():
        print(f"{name}: not measured: {why}")
