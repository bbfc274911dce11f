"""`jaxradar simulate`: drives that nobody drove."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jaxradar._errors import ConfigError
from jaxradar._program import number, shown, whole
from jaxradar.cli._options import add_command
from jaxradar.cli._output import console, plain, print_table, ready_folder

if TYPE_CHECKING:
    from jaxradar.sim import RoadScene, Significance, Tolerance

__all__ = ["add_to"]

_DESCRIPTION = """\
Simulate drives through a scene and write them as logs with their truth.

SCENE is the name of a scene that comes with the package (--list shows them) or
a TOML file (--print shows one to start from). The same scene and seed give the
same bytes. --explain measures what each effect of the scene contributes to the
record and what it costs; --significant leaves out those that do not matter."""


def add_to(commands: Any) -> None:
    """Make the command known."""
    parser = add_command(
        commands,
        "simulate",
        _run,
        summary="make drives from a scene",
        description=_DESCRIPTION,
        example="jaxradar simulate trial -o drives -n 100 --seed 7",
    )
    parser.add_argument("scene", nargs="?", metavar="SCENE", help="a scene's name or its TOML file")
    parser.add_argument("-o", "--output", metavar="DIR", help="folder to write the drives to")
    parser.add_argument("-n", "--number", type=whole(1), default=1, metavar="N", help="how many drives (default: 1)")
    parser.add_argument("--seed", type=whole(0), default=0, metavar="N", help="other random draws (default: 0)")
    parser.add_argument(
        "--form",
        choices=("csv", "drive"),
        default="csv",
        help="folders of the lab's CSV, or the binary form (default: csv)",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace drives that stand there already")
    parser.add_argument("--explain", action="store_true", help="print what each effect contributes and costs")
    parser.add_argument("--json", action="store_true", help="with --explain: print it as JSON")
    parser.add_argument("--significant", action="store_true", help="leave out the effects that do not matter")
    parser.add_argument(
        "--level-db", type=number(), default=-40.0, metavar="DB", help="what matters: more than this (default: -40)"
    )
    parser.add_argument("--range-mm", type=number(0.0), default=0.1, metavar="MM", help="or than this (default: 0.1)")
    parser.add_argument("--time-ms", type=number(0.0), default=0.05, metavar="MS", help="or than this (default: 0.05)")
    parser.add_argument(
        "--acceleration", type=number(0.0), default=0.05, metavar="M_S2", help="or than this (default: 0.05)"
    )
    parser.add_argument(
        "--list", action="store_true", help="list the scenes that come with the package, and what scenes are made of"
    )
    parser.add_argument(
        "--print", action="store_true", dest="show", help="print the scene as TOML, all of its settings"
    )


def _run(args: argparse.Namespace) -> int:
    from jaxradar.sim import Tolerance, dump_scene, load_scene

    if args.list:
        _list()
        return 0
    if args.scene is None:
        raise ConfigError("expected a SCENE; `jaxradar simulate --list` shows those that come with the package.")
    scene = load_scene(args.scene)
    if args.show:
        print(dump_scene(scene), end="")
        return 0
    if not (args.output or args.explain):
        raise ConfigError("expected --output DIR for the drives, or --explain, or --print.")
    folder = ready_folder(args.output, "--output")
    if args.explain or args.significant:
        found = _measured(scene, Tolerance(args.level_db, args.range_mm, args.time_ms, args.acceleration), args.seed)
        if args.explain:
            _explain(found, args.json)
        if args.significant:
            scene = found.scene
    if folder is not None:
        _write(scene, Path(args.scene).stem, folder, args)
    return 0


def _write(scene: RoadScene, name: str, folder: Path, args: argparse.Namespace) -> None:
    from rich.progress import track

    from jaxradar.logs import write_log
    from jaxradar.sim import drive_seeds, simulate_each

    digits = max(3, len(str(args.number - 1)))
    suffix = ".drive" if args.form == "drive" else ""
    notes: set[str] = set()
    quiet = args.number == 1 or not sys.stderr.isatty()
    drives = simulate_each([scene] * args.number, drive_seeds(args.seed, args.number))
    shown_drives = track(
        drives, "drives", total=args.number, console=console(sys.stderr), transient=True, disable=quiet
    )
    for place, drive in enumerate(shown_drives):
        target = folder / f"{name}-{place:0{digits}}{suffix}"
        notes.update(write_log(drive, target, overwrite=args.overwrite))
    for note in sorted(notes):
        print(f"jaxradar: {shown(folder)}: {shown(note)}", file=sys.stderr)
    print(f"{args.number} drive{'' if args.number == 1 else 's'} in {shown(folder)}")


def _list() -> None:
    from jaxradar.sim import EFFECTS, ELEMENTS, SURFACES, ready_scenes

    effects = {name: kind.explains for name, kind in EFFECTS.items()}
    elements = {name: _first_sentence(kind.__doc__ or "") for name, kind in ELEMENTS.items()}
    for title, held in (
        ("Scenes", ready_scenes()),
        ("Elements of a road ([[road]])", elements),
        ("Effects ([[effects]]), and what each explains", effects),
    ):
        width = max(map(len, held))
        print(f"{title}:")
        for name, text in held.items():
            print(f"  {name:{width}}  {text}")
        print()
    print(f"Surfaces ([surface]): {', '.join(SURFACES)}, none")


def _first_sentence(text: str) -> str:
    return " ".join(text.split()).partition(". ")[0].partition(": ")[0].partition(" (")[0].rstrip(".")


def _measured(scene: RoadScene, tolerance: Tolerance, seed: int) -> Significance:
    from rich.progress import Progress

    from jaxradar.sim import significant

    variants = len(scene.effects) + 2
    what = f"compiling {variants} variants of the scene"
    if not sys.stderr.isatty():
        print(f"jaxradar: {what} ...", file=sys.stderr)
    with Progress(console=console(sys.stderr), transient=True, disable=not sys.stderr.isatty()) as progress:
        task = progress.add_task(what, total=variants)
        return significant(scene, tolerance, seed, lambda: progress.advance(task))


def _explain(found: Significance, as_json: bool) -> None:
    if as_json:
        bare = {"operations": found.bare_operations, "microseconds": found.bare_microseconds}
        effects = [
            {**{key: value for key, value in asdict(one).items() if key != "difference"}, **asdict(one.difference)}
            for one in found.table
        ]
        together = None if found.together is None else asdict(found.together)
        print(json.dumps(plain({"bare": bare, "effects": effects, "together": together}), indent=1))
        return
    columns = ("effect", "level dB", "range mm", "time ms", "m/s²", "operations", "µs a sweep", "kept")
    rows = [
        (
            one.effect,
            f"{one.difference.level_db:.1f}",
            f"{one.difference.range_mm:.3f}",
            f"{one.difference.time_ms:.3f}",
            f"{one.difference.acceleration_m_s2:.3f}",
            f"{one.operations:.0f}",
            f"{one.microseconds:.2f}",
            "yes" if one.kept else "no",
        )
        for one in found.table
    ]
    rows.append(("(without any)", "", "", "", "", f"{found.bare_operations:.0f}", f"{found.bare_microseconds:.2f}", ""))
    print_table(sys.stdout, columns, rows)
    print()
    for one in found.table:
        print(f"{one.effect}: {one.why}.")
    if found.together is not None:
        print(f"All that is dropped, together: {found.together.figures()}.")
