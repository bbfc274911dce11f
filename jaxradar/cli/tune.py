"""`jaxradar tune`: settings of a detector out of logs whose truth is known."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jaxradar._errors import ConfigError
from jaxradar._program import number, shown, whole
from jaxradar.cli._options import add_command
from jaxradar.cli._output import plain, print_table, progress, ready_folder, spare_logs, write_json, write_text

if TYPE_CHECKING:
    from jaxradar.drive import Drive, SensorSeries
    from jaxradar.tuning import Fitted, Tuned

__all__ = ["add_to"]

# What a fit moves unless it is told: of each detector the settings that its alarms hang on.
_USUAL = {
    "default": tuple(
        f"approach.{one}" for one in ("evidence", "tilt_far", "tilt_near", "look_m", "reference_s", "noise_share")
    ),
    "approach": ("evidence", "tilt_far", "tilt_near", "look_m", "reference_s", "noise_share"),
    "shift": ("evidence", "window_s", "over_floor", "most_unexplained"),
    "range-rate": ("threshold_m_s", "exponent", "temperature"),
    "filtered-rate": ("threshold_m_s", "exponent", "temperature", "filter"),
    "thesis": ("threshold_m_s",),
}
_DESCRIPTION = """\
Fit settings of a detector to logs whose truth is known, by gradient: missed
steps, false alarms an hour and lateness, each at its price, are minimised on
three quarters of the drives by BFGS from several starts, as the decision goes
from soft to hard; what costs least on the last quarter is taken. The result is
a file for --detector that says where its values come from.

Beside each value stands how well the drives determine it. One that they do not
determine is named, and so are those that they determine only in combination:
leave it out, or one of these, or bring drives that say more."""
_EXAMPLE = """\
jaxradar tune drives/ -o mine.toml
  jaxradar tune drives/ -o mine.toml --detector range-rate \\
      --settings threshold_m_s,temperature --report fit"""


def add_to(commands: Any) -> None:
    """Make the command known."""
    parser = add_command(
        commands, "tune", _run, summary="fit a detector's settings to logs", description=_DESCRIPTION, example=_EXAMPLE
    )
    parser.add_argument("paths", nargs="+", metavar="PATH", help="logs with truth, as `jaxradar evaluate` takes them")
    parser.add_argument("-o", "--output", required=True, metavar="FILE", help="the detector's file, .toml")
    parser.add_argument("--detector", default="default", metavar="NAME", help="to begin with (default: default)")
    parser.add_argument("--settings", metavar="A,B", help="settings to move, PART.NAME in a part (default: up to six)")
    parser.add_argument("--sensor", type=whole(0), metavar="N", help="this sensor alone (default: each drive's first)")
    parser.add_argument("--missed", type=number(0.0), default=1.0, metavar="C", help="cost of missing all steps (1)")
    parser.add_argument(
        "--false-alarm", type=number(0.0), default=0.01, metavar="C", help="of each false alarm an hour (0.01)"
    )
    parser.add_argument("--late", type=number(0.0), default=0.5, metavar="C", help="of each second of lateness (0.5)")
    parser.add_argument("--starts", type=whole(1, 64), default=4, metavar="N", help="points to begin from (default: 4)")
    parser.add_argument(
        "--steps",
        type=whole(1, 10_000),
        default=32,
        metavar="N",
        help="of the solver, from each start in each of 4 stages (default: 32)",
    )
    parser.add_argument(
        "--seed", type=whole(0), default=0, metavar="N", help="of the split, the starts and the batches (default: 0)"
    )
    parser.add_argument("--report", metavar="DIR", help="folder for fit.json and fit.png")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")


def _run(args: argparse.Namespace) -> int:
    from jaxradar.systems.step import DetectorFile, dump_detector, load_detector
    from jaxradar.tuning import Costs, Plan, Space, examples_of, split, tune, uncertainty

    if not args.output.endswith(".toml"):
        raise ConfigError(f"--output {shown(args.output)} must end with .toml.")
    spare_logs("--output", args.output, args.paths)
    file = load_detector(args.detector)
    names = _settings(args.settings, file.detector.name)
    Space.of(file.detector, names)  # before minutes of reading
    costs = Costs(args.missed, args.false_alarm, args.late)
    folder = ready_folder(args.report, "--report")
    drives = _read(args)
    holds_step = [drive.truth is not None and bool(drive.truth.steps) for drive, _ in drives]
    fitted_to, kept = split(len(drives), args.seed, kinds=holds_step)
    examples, validation = (examples_of([drives[place] for place in places]) for places in (fitted_to, kept))
    for what, held in (("to fit to", examples), ("kept for validation", validation)):
        if not held.real.any():
            raise ConfigError(
                f"there is no step to be seen in the {held.logs} drives {what}; bring more drives with steps."
            )
    plan = Plan(starts=args.starts, steps=args.steps, seed=args.seed)
    if not sys.stderr.isatty():
        print(f"jaxradar: fitting {len(names)} settings to {len(fitted_to)} drives ...", file=sys.stderr)
    with progress("fitting", len(plan.temperatures)) as advance:
        tuned = tune(
            file.detector, names, examples, validation, costs=costs, plan=plan, progress=lambda done, total: advance(1)
        )
    fitted = uncertainty(tuned, file.detector, examples, costs)
    provenance = {**_provenance(args, costs, len(fitted_to), len(kept)), **_scores(tuned, fitted)}
    text = dump_detector(DetectorFile(tuned.detector, file.mounting, provenance))
    write_text(Path(args.output), text)
    record = plain(
        {
            **provenance,
            "settings": [vars(one) for one in fitted],
            "starts": [{"costs": one.costs.tolist(), "outcomes": one.outcomes} for one in tuned.starts],
            "taken": tuned.best,
        }
    )
    if folder is not None:
        from jaxradar.plots.style import save
        from jaxradar.plots.tuning import plot_fit

        write_json(folder / "fit.json", record)
        save(plot_fit(tuned), folder / "fit.png")
    if args.json:
        print(json.dumps(record, allow_nan=False, indent=1))
    else:
        _print(tuned, fitted, args.output)
    return 0


def _settings(given: str | None, detector: str) -> tuple[str, ...]:
    if given is not None:
        return tuple(one.strip() for one in given.split(",") if one.strip())
    if detector not in _USUAL:
        raise ConfigError(f"say which --settings of `{detector}` are to be moved.")
    return _USUAL[detector]


def _read(args: argparse.Namespace) -> list[tuple[Drive, SensorSeries]]:
    """Drives with truth, all with the range axis of the first."""
    from jaxradar.cli._logs import all_logs
    from jaxradar.logs import read_log

    paths, empty = all_logs(args.paths)
    if empty:
        raise ConfigError(empty[0][1])
    held: list[tuple[Drive, SensorSeries]] = []
    untold: list[str] = []
    begun = ""  # the log whose axis all must have
    with progress("reading", len(paths)) as advance:
        for path in paths:
            drive = read_log(path)
            advance(1)
            if drive.truth is None:
                untold.append(path)
                continue
            try:
                series = drive.sensors[0] if args.sensor is None else drive.series(args.sensor)
            except (KeyError, IndexError):
                wanted = "sensor" if args.sensor is None else f"sensor {args.sensor}"
                raise ConfigError(f"{path}: has no {wanted}.") from None
            first, begun = held[0][1] if held else series, begun or path
            if series.sweeps.dtype != first.sweeps.dtype or series.range_m.tobytes() != first.range_m.tobytes():
                raise ConfigError(f"{path}: has another range axis than {begun}; tune to logs of one axis at a time.")
            held.append((drive, series))
    if untold:
        print(f"jaxradar: {len(untold)} logs without truth are left out, {shown(untold[0])} first.", file=sys.stderr)
    steps = sum(len(drive.truth.steps) for drive, _ in held if drive.truth is not None)
    if len(held) < 4 or not steps:
        raise ConfigError(
            f"expected 4 logs or more whose truth is known, with a step among them; got {len(held)} with {steps} steps."
        )
    return held


def _provenance(args: argparse.Namespace, costs: Any, fitted: int, kept: int) -> dict[str, Any]:
    from importlib.metadata import version

    return {
        "tuned_by": "jaxradar tune",
        "data": [shown(one) for one in args.paths],
        "drives": fitted,
        "drives_kept_for_validation": kept,
        "seed": args.seed,
        **{f"cost_{name}": value for name, value in vars(costs).items()},
        "versions": [f"{name} {version(name)}" for name in ("jaxradar", "jax", "optimistix")],
    }


def _scores(tuned: Tuned, fitted: tuple[Fitted, ...]) -> dict[str, Any]:
    return {
        "cost_before": tuned.before,
        "cost_after": tuned.after,
        "fitted": [one.name for one in fitted],
        "not_determined": [one.name for one in fitted if not one.determined],
    }


def _print(tuned: Tuned, fitted: tuple[Fitted, ...], output: str) -> None:
    print_table(
        sys.stdout,
        ["setting", "value", "standard deviation"],
        [[one.name, f"{one.value:.4g}", _known(one)] for one in fitted],
    )
    print(f"Cost on the drives kept for validation: {tuned.before:.4g} before, {tuned.after:.4g} after.")
    if not tuned.after < tuned.before:
        print("Nothing costs less than the detector as it is: its settings are kept.")
    for sentence in _troubles(tuned):
        print(sentence)
    print(f"Written to {shown(output)}; use it as --detector {shown(output)}")


def _known(one: Fitted) -> str:
    if one.determined:
        return f"{one.sd:.2g}"
    if one.together:
        return f"determined by these drives only together with {', '.join(one.together)}"
    return "not determined by these drives"


def _troubles(tuned: Tuned) -> Iterator[str]:
    """What went wrong in the last stage, why it matters and what to do."""
    ended = [one.outcomes[-1] for one in tuned.starts]
    count, taken = len(ended), ended[tuned.best]
    starts = f"{count} {'start' if count == 1 else 'starts'}"
    late, broken = ended.count("out of steps"), ended.count("not finite")
    if late:
        matters = (
            "The settings that were taken are of such a start and may still get better"
            if taken == "out of steps"
            else "The one that was taken converged, but another might have come to cost less"
        )
        yield f"{late} of {starts} stopped before they converged. {matters}; give --steps more."
    if broken:
        yield (
            f"{broken} of {starts} came to where the cost is no number, and stayed where they were before. If it is "
            "most of them, check the logs for amplitudes that are no numbers, or leave a setting out."
        )
