"""`jaxradar demo`: the whole way on a drive that nobody drove."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any

from jaxradar._errors import LogError
from jaxradar.cli._options import add_command, whole
from jaxradar.cli._output import ready_folder, shown
from jaxradar.cli.evaluate import print_outcomes

if TYPE_CHECKING:
    from jaxradar.cli._detect import Outcome
    from jaxradar.drive import Drive
    from jaxradar.sim import DemoScene

__all__ = ["add_to"]

_WIDTH = 79

_DESCRIPTION = """\
Make a small synthetic drive over a step (2 s at 30 km/h, a step of 40 mm), run
the thesis's rule and the default detector over it, print a table and draw
figures. Needs no data."""


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
    parser.add_argument("--seed", type=whole(0), default=0, metavar="N", help="another drive (default: 0)")


def _run(args: argparse.Namespace) -> int:
    folder = ready_folder(args.output, "--output")
    assert folder is not None
    from jaxradar.cli._detect import Selection, detect_in, draw_drive, draw_sweeps
    from jaxradar.evaluation import MatchWindow
    from jaxradar.logs import read_log, write_log
    from jaxradar.sim import DemoScene, demo_drive
    from jaxradar.systems.step import load_detector

    scene = DemoScene()
    log = folder / "log"
    made = demo_drive(args.seed, scene)
    if log.exists() and not _is_demo(log, made):
        raise LogError(log, "was not written by a demo and is left alone; give another --output.")
    write_log(made, log, overwrite=True)
    # From here on, what anybody's log would go through.
    drive = read_log(log)
    names = ("thesis", "default")
    outcomes, figures = [], []
    for name in names:
        (outcome,) = detect_in(str(log), drive, load_detector(name).detector, Selection(), MatchWindow())
        outcomes.append(outcome)
        figures.append(draw_drive(outcome, folder / f"{name}.png", name))
    figures.append(draw_sweeps(outcomes[-1], folder / "sweeps.png"))

    print(fill(_story(scene, drive.sensors[0].sweep_rate_hz), _WIDTH))
    print()
    print_outcomes(sys.stdout, outcomes, names)
    print()
    print(fill(_verdict(outcomes[0], scene), _WIDTH))
    print("\nWritten:")
    for path in (log, *figures):
        print(f"  {shown(path)}")
    print("\nNext:")
    for command in (
        f"jaxradar info {_quoted(log)}",
        f"jaxradar evaluate {_quoted(log)} --detector lab-live --json -",
        "jaxradar config default > mine.toml     # then: --detector mine.toml",
        "jaxradar evaluate YOUR_LOGS --figures figures",
    ):
        print(f"  {command}")
    return 0


def _is_demo(log: Path, made: Drive) -> bool:
    """Whether a demo wrote what stands there: a recording of the user's may bear the same name."""
    from jaxradar.logs import read_log

    try:
        held = read_log(log)
    except LogError:
        return False
    return (held.truth, held.mounting) == (made.truth, made.mounting)


def _quoted(path: Path) -> str:
    import shlex

    return shlex.quote(shown(path))


def _story(scene: DemoScene, rate_hz: float | None) -> str:
    early_ms = 1e3 * (scene.impact_s - scene.face_s)
    return (
        f"A synthetic drive: {3.6 * scene.speed_m_s:.0f} km/h, {rate_hz or 0:.0f} sweeps a second, the radar "
        f"{scene.height_m:g} m above the road, one step of {1e3 * scene.step_m:.0f} mm. Its face comes under the beam "
        f"{early_ms:.0f} ms before a front tyre touches it at {scene.impact_s:g} s."
    )


def _verdict(thesis: Outcome, scene: DemoScene) -> str:
    """What the thesis's rule did, without praise for a hit that it could not have earned."""
    text = (
        f"The thesis's rule raised {len(thesis.trace.events)} alarms: multiplying by the range squared lifts noise at "
        "the far end over the echo, and one bin of range from one sweep to the next is already 0.7 m/s."
    )
    lead_s = thesis.matching.lead_s if thesis.matching is not None else ()
    if lead_s and lead_s[0] > scene.impact_s - scene.face_s + 1e-3:
        text += (
            f" The alarm that counts as its hit came {1e3 * lead_s[0]:.0f} ms before the impact, when the step could "
            "not be seen yet: luck."
        )
    return text
