"""`jaxradar demo`: the whole way on a drive that nobody drove."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

from jaxradar._errors import LogError
from jaxradar._program import shown, whole
from jaxradar.cli._options import add_command
from jaxradar.cli._output import ready_folder
from jaxradar.cli.evaluate import print_results

if TYPE_CHECKING:
    from jaxradar.drive import Drive
    from jaxradar.evaluation import SeriesResult
    from jaxradar.sim import RoadScene

__all__ = ["add_to"]

_WIDTH = 79

_DESCRIPTION = """\
Simulate the thesis's trial on a wet road (2 s at 30 km/h towards a step of
40 mm), run the thesis's rule and the default detector over it, print a table
and draw figures. Needs no data."""


def add_to(commands: Any) -> None:
    """Make the command known."""
    parser = add_command(
        commands,
        "demo",
        _run,
        summary="see it work, without any data",
        description=_DESCRIPTION,
        example="jaxradar demo -o jaxradar-demo",
    )
    parser.add_argument(
        "-o", "--output", default="jaxradar-demo", metavar="DIR", help="folder to write to (default: jaxradar-demo)"
    )
    parser.add_argument(
        "--scene",
        default="trial-wet",
        metavar="SCENE",
        help="another scene, by name or file; `jaxradar simulate --list` names them (default: trial-wet)",
    )
    parser.add_argument("--seed", type=whole(0), default=0, metavar="N", help="another drive (default: 0)")


def _run(args: argparse.Namespace) -> int:
    folder = ready_folder(args.output, "--output")
    assert folder is not None
    from jaxradar.cli._detect import draw_drive, draw_sweeps, results_of
    from jaxradar.evaluation import Settings
    from jaxradar.logs import read_log, write_log
    from jaxradar.sim import dump_scene, load_scene, simulate
    from jaxradar.systems.step import load_detector

    scene = load_scene(args.scene)
    log = folder / "log"
    # What is made here is known by the scene beside it: a recording of the user's may bear the same name.
    marker = folder / "scene.toml"
    if log.exists() and not marker.exists():
        raise LogError(log, "was not written by a demo and is left alone; give another --output.")
    made = simulate(scene, args.seed)
    marker.write_text(dump_scene(scene), encoding="utf-8")
    write_log(made, log, overwrite=True)
    # From here on, what anybody's log would go through.
    drive = read_log(log)
    names = ("thesis", "default")
    results, figures = [], []
    for name in names:
        (result,) = results_of(str(log), Settings(load_detector(name).detector, figures=True))
        results.append(result)
        figures.append(draw_drive(result, folder / f"{name}.png", name))
    figures.append(draw_sweeps(results[-1], folder / "sweeps.png"))

    print(fill(_story(args.scene, scene, drive), _WIDTH))
    print()
    print_results(sys.stdout, results, names)
    print()
    print(fill(_verdict(results, scene, drive), _WIDTH))
    print("\nWritten:")
    for path in (marker, log, *figures):
        print(f"  {shown(path)}")
    print("\nNext:")
    for command in (
        f"jaxradar info {_quoted(log)}",
        f"jaxradar evaluate {_quoted(log)} --detector lab-live --json -",
        "jaxradar config default > mine.toml     # then: --detector mine.toml",
        "jaxradar simulate --list",
        "jaxradar evaluate YOUR_LOGS --figures figures",
    ):
        print(f"  {command}")
    return 0


def _quoted(path: Path) -> str:
    import shlex

    return shlex.quote(shown(path))


def _story(name: str, scene: RoadScene, drive: Drive) -> str:
    text = (
        f"A simulated drive, the scene `{name}`: {scene.radar.rate_hz:.0f} sweeps a second for "
        f"{scene.duration_s:g} s, {3.6 * float(scene.motion.speed_m_s):.0f} km/h at the start, the radar "
        f"{float(scene.mount.height_m):g} m above the road."
    )
    for step in drive.truth.steps if drive.truth is not None else ():
        felt = "" if step.hard_s is None else f", and at {step.hard_s:.3f} s the body feels 15 m/s²"
        text += f" A front tyre meets {1e3 * (step.height_m or 0.0):.0f} mm at {step.impact_s:.3f} s{felt}."
    return text


def _verdict(results: list[SeriesResult], scene: RoadScene, drive: Drive) -> str:
    """What the alarms are worth, without praise for a hit that chance alone would give."""
    thesis = len(results[0].events)
    steps = len(drive.truth.steps) if drive.truth is not None else 0
    text = f"{thesis} alarms of the thesis's rule for {steps} step{'' if steps == 1 else 's'}."
    if thesis > 10 * steps + 10:
        text += (
            " One bin of range from one sweep to the next is more than its 0.7 m/s, and each sweep of a road that goes "
            "by shows another speckle: beside so many, a hit is luck."
        )
    hits = results[1].score.hits if results[1].score is not None else 0
    if hits < steps and scene.surface is not None:
        text += (
            " The default detector misses what does not stand out of the road's own echoes: on dry asphalt nobody who "
            "has amplitudes alone sees such a step in time."
        )
    return text
