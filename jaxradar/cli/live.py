"""`jaxradar live`: a detector on sweeps as they come."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING, Any

from jaxradar.cli._options import add_command
from jaxradar.live.options import add_live_options, check_options
from jaxradar.live.sources import ACCONEER, SourceKind, replayed, source_of

if TYPE_CHECKING:
    from jaxradar.live.artefact import Header
    from jaxradar.live.detect import Step
    from jaxradar.live.sweeps import Source

__all__ = ["add_to"]

_DESCRIPTION = """\
Find road steps in the sweeps of a radar as they come: of a sensor behind
Acconeer's exploration server (pip install 'jaxradar[acconeer]', in an
environment of its own), of a log replayed at its own pace, or of a scene that
is simulated. Detections are printed as they are made.

--detector is a name, a FILE.toml, or a file that `jaxradar export` made, which
is read and not run. On a device without JAX such a file is the whole program:
python3 step.pyz takes the same options."""


def add_to(commands: Any) -> None:
    """Make the command known."""
    parser = add_command(
        commands,
        "live",
        _run,
        summary="find steps in sweeps as they come",
        description=_DESCRIPTION,
        example="jaxradar live --source replay LOG\n  jaxradar live --source acconeer --detector step.pyz",
    )
    add_live_options(parser, {kind: what.about for kind, what in _SOURCES.items()})
    parser.add_argument(
        "--detector", default="default", metavar="NAME", help="a detector, FILE.toml or FILE.pyz (default: default)"
    )


def _run(args: argparse.Namespace) -> int:
    from jaxradar.live.app import detect_live, print_unit
    from jaxradar.live.artefact import is_artefact
    from jaxradar.live.detect import LiveDetector

    if args.print_unit:
        check_options(args)
        return print_unit([sys.executable, "-m", "jaxradar", "live"], sys.argv[2:])
    if is_artefact(args.detector) or args.detector.endswith(".pyz"):
        header, step = _compiled(args.detector)
        return detect_live(args, source_of(args, _SOURCES, header), lambda _: LiveDetector(header, step))
    return detect_live(
        args, source_of(args, _SOURCES, None), lambda source: LiveDetector(*_made(args.detector, source))
    )


def _compiled(path: str) -> tuple[Header, Step]:
    from jaxradar.live.artefact import read_artefact
    from jaxradar.live.program import Program

    artefact = read_artefact(path)
    header = artefact.header
    if header.kind == "iree":
        return header, Program.of_artefact(artefact)
    from jaxradar.export import JaxStep

    return header, JaxStep.of_artefact(artefact)


def _made(detector: str, source: Source) -> tuple[Header, Step]:
    """A detector by its name or file, compiled by JAX for an open source."""
    from jaxradar.export import JaxStep
    from jaxradar.export.make import header_of
    from jaxradar.systems.step import RangeAxis, load_detector
    from jaxradar.systems.step.packed import PackedStep

    file = load_detector(detector)
    step = PackedStep(file.detector, RangeAxis.of(source.range_m), source.dtype)
    return header_of(file, step, kind="jax", target="host", sensors=source.sensors, versions={}), JaxStep.of_step(step)


def _replayed(args: argparse.Namespace, _: Header | None) -> Source:
    from jaxradar.logs import read_log

    return replayed(args, read_log(args.where))


def _simulated(args: argparse.Namespace, _: Header | None) -> Source:
    from jaxradar.sim import load_scene, simulate

    return replayed(args, simulate(load_scene(args.where), seed=0))


_SOURCES = {
    "replay": SourceKind("a recorded log", _replayed, "LOG"),
    "scene": SourceKind("a scene's name or its TOML file, simulated", _simulated, "SCENE"),
    "acconeer": ACCONEER,
}
