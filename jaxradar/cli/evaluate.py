"""`jaxradar evaluate`: many logs, one detector, a table and JSON lines."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from jaxradar._errors import ConfigError, JaxradarError
from jaxradar.cli._options import add_command, add_selection, check_part, number
from jaxradar.cli._output import Stream, console, json_lines, print_table, ready_folder, shown

if TYPE_CHECKING:
    from jaxradar.cli._detect import Outcome

__all__ = ["add_to", "print_outcomes"]

_DESCRIPTION = """\
Run a detector over recorded logs and hold what it finds against the truth.

A PATH is a log (a folder of <sensor>.csv, one CSV file, an Acconeer .h5, a
.drive), a folder with logs somewhere in it, or a pattern. The truth stands in
truth.json inside a log folder, or in NAME.truth.json beside a log file.

A detection hits a step if it comes at most the matching window before the
impact; the earliest there counts and gives the lead, later ones count as
nothing, any other is a false alarm. A sweep is invalid if the log says so or
the detector finds no echo in it.

Exit status: 0 all well, 1 some logs could not be evaluated (the others were),
2 wrong usage, or an option that fits none of the logs."""


def add_to(commands: Any) -> None:
    """Make the command known."""
    parser = add_command(
        commands,
        "evaluate",
        _run,
        summary="run a detector over logs and compare with the truth",
        description=_DESCRIPTION,
        example="jaxradar evaluate log/ --detector thesis --thin 128 --json results.jsonl",
    )
    parser.add_argument("paths", nargs="+", metavar="PATH", help="a log, a folder of logs, or a pattern")
    add_selection(parser)
    parser.add_argument(
        "--window", type=number(0), default=0.25, metavar="S", help="matching window in seconds (default: 0.25)"
    )
    parser.add_argument(
        "--window-metres",
        type=number(0),
        default=1.0,
        metavar="M",
        help="or the time for so much road at the speed of the impact, if that is longer (default: 1)",
    )
    parser.add_argument("--json", metavar="FILE", help="one JSON object per sensor and line; - is standard output")
    parser.add_argument("--figures", metavar="DIR", help="also draw each series into this folder")
    parser.add_argument("--quiet", action="store_true", help="no table and no progress")


def _run(args: argparse.Namespace) -> int:
    check_part(args.start, args.stop)
    from jaxradar.cli._detect import Selection, all_logs, detect_in, figure_files, record_of
    from jaxradar.evaluation import MatchWindow
    from jaxradar.logs import read_log
    from jaxradar.systems.step import load_detector

    detector = load_detector(args.detector).detector
    selection = Selection(args.sensor, args.start, args.stop, args.thin)
    window = MatchWindow(args.window, args.window_metres)
    logs, empty = all_logs(args.paths)
    outcomes: list[Outcome] = []
    failures: list[JaxradarError | OSError | str] = []
    names: set[str] = set()
    with json_lines(args.json, logs) as lines:
        figures = ready_folder(args.figures, "--figures")

        def fail(path: str, error: JaxradarError | OSError | str) -> None:
            failures.append(error)
            lines.write({"path": path, "error": _sentence(error)})
            print(f"jaxradar: {shown(_sentence(error))}", file=sys.stderr)

        for given, problem in empty:
            fail(given, problem)
        with _progress(logs, quiet=args.quiet) as paths:
            for path in paths:
                try:
                    for outcome in detect_in(path, read_log(path), detector, selection, window):
                        if figures is not None:
                            figure_files(outcome, figures, detector.name, names)
                        lines.write(record_of(outcome))
                        outcomes.append(outcome)
                except BrokenPipeError:
                    raise
                except (JaxradarError, OSError) as error:
                    fail(path, error)
    if not args.quiet:
        print_outcomes(sys.stderr if args.json == "-" else sys.stdout, outcomes)
    if not failures:
        return 0
    return 2 if not outcomes and all(isinstance(error, ConfigError) for error in failures) else 1


def _sentence(error: JaxradarError | OSError | str) -> str:
    if isinstance(error, OSError):
        return f"{error.filename or 'input or output'}: {error.strerror or error}."
    return str(error)


@contextmanager
def _progress(logs: Sequence[str], *, quiet: bool) -> Iterator[Iterator[str]]:
    """The logs one after the other, with a bar on standard error if that is a terminal."""
    if quiet or len(logs) < 2 or not sys.stderr.isatty():
        yield iter(logs)
        return
    from rich.progress import Progress

    with Progress(console=console(sys.stderr), transient=True) as bar:
        task = bar.add_task("evaluating", total=len(logs))

        def each() -> Iterator[str]:
            for path in logs:
                yield path
                bar.advance(task)

        yield each()


def print_outcomes(file: Stream, outcomes: Sequence[Outcome], names: Sequence[str] = ()) -> None:
    """The table, what the reader had to say of the logs, and the sum of all whose truth is known.

    `names` stand in the first column instead of the logs' own.
    """
    from jaxradar.evaluation import summarise

    if not outcomes:
        return
    paths = [shown(outcome.path) for outcome in outcomes]
    # What all have in common tells nothing apart; it would push the numbers out of a window of 80 columns.
    common = os.path.commonpath([os.path.dirname(os.path.abspath(path)) for path in paths])  # noqa: PTH100, PTH120
    apart = paths if common == os.path.sep else [os.path.relpath(path, common) for path in paths]
    short = list(names) or apart
    rows = []
    for name, outcome in zip(short, outcomes, strict=True):
        trace, matching = outcome.trace, outcome.matching
        row = [name, outcome.series.sensor, len(outcome.series), int((~trace.valid).sum()), len(trace.events)]
        if matching is None:
            row += ["?"] * 4
        else:
            lead = " ".join(f"{1e3 * lead_s:.0f}" for lead_s in matching.lead_s[:3])
            more = "…" if len(matching.lead_s) > 3 else ""
            row += [matching.hits, matching.misses, matching.false_alarms, lead + more or "–"]
        rows.append([str(cell) for cell in row])
    columns = ("log", "sensor", "sweeps", "invalid", "found", "hit", "missed", "false", "lead ms")
    print_table(file, columns, rows)
    said = dict.fromkeys((name, text) for name, one in zip(short, outcomes, strict=True) for text in one.drive.problems)
    for name, text in said:
        print(f"{name}: {shown(text)}", file=file)
    known = [(one.matching, one.series.duration_s) for one in outcomes if one.matching is not None]
    if known and not names:
        print(_sum(summarise(known)), file=file)


def _sum(total: Any) -> str:
    steps = total.hits + total.misses
    seen = f"{total.hits} of {steps} steps seen" if steps else "no steps"
    if total.median_lead_s is not None:
        seen += f", median lead {1e3 * total.median_lead_s:.0f} ms"
    rate = total.false_alarms_per_hour
    hourly = "" if rate is None else f" ({rate:,.{0 if rate >= 10 else 1}f} per hour)"
    return f"Truth known for {total.duration_s:.1f} s: {seen}, false alarms: {total.false_alarms}{hourly}."
