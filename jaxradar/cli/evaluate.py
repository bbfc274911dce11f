"""`jaxradar evaluate`: many logs, one detector, a table, JSON lines and a report."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jaxradar._errors import ConfigError, LogError
from jaxradar._program import number, shown
from jaxradar.cli._options import add_command, add_selection, check_part
from jaxradar.cli._output import Stream, json_lines, print_table, progress, ready_folder, spare_logs

if TYPE_CHECKING:
    from jaxradar.cluster import Here
    from jaxradar.evaluation import Evaluation, SeriesResult

__all__ = ["add_to", "print_results"]

MOST_ROWS = 200  # of the table: more are for a report
MOST_ROC_LOGS = 500  # which are gone through once for each threshold

_DESCRIPTION = """\
Run a detector over recorded logs and hold what it finds against the truth.

A PATH is a log (a folder of <sensor>.csv, one CSV file, an Acconeer .h5, a
.drive), a folder with logs somewhere in it, a store or its archive (`jaxradar
import`), or a pattern. The truth stands in
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
    parser.add_argument("--report", metavar="FILE", help="a page to look at: FILE.html, which needs nothing beside it")
    parser.add_argument(
        "--cluster",
        metavar="WHERE",
        help="tcp://HOST:PORT of a Dask scheduler, or local:N processes; the same logs must be there (default: here)",
    )
    parser.add_argument("--figures", metavar="DIR", help="also draw each series into this folder")
    parser.add_argument("--quiet", action="store_true", help="no table and no progress")


def _run(args: argparse.Namespace) -> int:
    check_part(args.start, args.stop)
    if args.cluster is not None and args.figures is not None:
        raise ConfigError("--figures draws on this machine; leave out --cluster.")
    if args.report is not None and args.json not in (None, "-") and _same(args.report, args.json):
        raise ConfigError("--report and --json would be one file; give each its own.")
    from jaxradar.cli._detect import figure_files
    from jaxradar.cli._logs import all_logs
    from jaxradar.cluster import cluster_of
    from jaxradar.evaluation import Evaluation, Failure, Selection, Settings, evaluate_parts, failure_record, record_of
    from jaxradar.matching import MatchWindow
    from jaxradar.systems.step import load_detector

    settings = Settings(
        load_detector(args.detector).detector,
        Selection(args.sensor, args.start, args.stop, args.thin),
        MatchWindow(args.window, args.window_metres),
        pictures=args.report is not None,
        figures=args.figures is not None,
    )
    logs, empty = all_logs(args.paths)
    rows = _Rows()
    failures: list[Failure] = []
    kept: list[SeriesResult] = []
    names: set[str] = set()
    # The workers serve the results and the curve.
    with ExitStack() as held, json_lines(args.json, logs) as lines:
        figures = ready_folder(args.figures, "--figures")
        if args.report is not None:
            _check_report(args.report, logs)

        def fail(one: Failure) -> None:
            failures.append(one)
            lines.write(failure_record(one))
            print(f"jaxradar: {shown(one.error)}", file=sys.stderr)

        for given, problem in empty:
            fail(Failure(given, problem))
        workers = held.enter_context(cluster_of(args.cluster))
        with progress("evaluating", len(logs), quiet=args.quiet) as advance:
            for one in evaluate_parts(logs, settings, workers, advance):
                if isinstance(one, Failure):
                    fail(one)
                    continue
                if args.report is not None:
                    kept.append(replace(one, drawn=None))  # drawn already
                if figures is not None:
                    figure_files(one, figures, settings.detector.name, names)
                lines.write(record_of(one))
                rows.add(one)
        if args.report is not None:
            _write_report(args, Evaluation.of([*kept, *failures], settings), workers)
    if not args.quiet:
        rows.print(sys.stderr if args.json == "-" else sys.stdout)
    if not failures:
        return 0
    return 2 if not rows.count and all(one.wrong_option for one in failures) else 1


def _same(one: str, other: str) -> bool:
    return os.path.realpath(one) == os.path.realpath(other)


def _check_report(target: str, logs: Sequence[str]) -> None:
    """Before the work is done, not after it."""
    spare_logs("--report", target, logs)
    path = Path(target)
    try:
        there = path.exists()
        if there and not path.is_file():
            raise ConfigError(f"--report {shown(target)} is no file; expected the name of a page, such as report.html.")
        with path.open("a", encoding="utf-8"):
            pass
        if not there:  # what fails later leaves no empty page
            path.unlink()
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise ConfigError(f"--report {shown(target)} cannot be written: {reason}.") from None


def _write_report(args: argparse.Namespace, found: Evaluation, workers: Here) -> None:
    from jaxradar.evaluation import operating_curve
    from jaxradar.report import write_report

    known = len({one.path for one in found.results if one.score is not None})
    curve: tuple[Any, ...] = ()
    if known:
        with progress("ROC", min(known, MOST_ROC_LOGS), quiet=args.quiet) as advance:
            try:
                curve = operating_curve(found, most_logs=MOST_ROC_LOGS, cluster=workers, advance=advance)
            except LogError as error:  # what was found before is not lost with it
                print(f"jaxradar: no curve: {shown(str(error))}", file=sys.stderr)
    write_report(found, args.report, curve=curve)


class _Rows:
    """What is printed of results that come one after the other."""

    def __init__(self) -> None:
        self.count = 0
        self._held: list[SeriesResult] = []
        self._known: list[Any] = []

    def add(self, result: SeriesResult) -> None:
        self.count += 1
        if len(self._held) < MOST_ROWS:
            self._held.append(result)
        if result.score is not None:
            self._known.append((result.score, result.duration_s))

    def print(self, file: Stream) -> None:
        print_results(file, self._held, known=self._known)
        if self.count > len(self._held):
            more = self.count - len(self._held)
            print(f"... and {more:,} more: --report and --json hold all of them.", file=file)


def print_results(
    file: Stream, results: Sequence[SeriesResult], names: Sequence[str] = (), known: Sequence[Any] = ()
) -> None:
    """The table, what the reader had to say of the logs, and the sum of all whose truth is `known`.

    `names` stand in the first column instead of the logs' own.
    """
    from jaxradar.logs import below_common_folder
    from jaxradar.matching import summarise

    if not results:
        return
    paths = [shown(one.path) for one in results]
    # What all have in common tells nothing apart; it would push the numbers out of a window of 80 columns.
    short = list(names) or below_common_folder(paths)[1]
    rows = []
    for name, one in zip(short, results, strict=True):
        row = [name, one.sensor, one.sweeps, one.invalid_sweeps, len(one.events)]
        if one.score is None:
            row += ["?"] * 4
        else:
            score = one.score
            lead = " ".join(f"{1e3 * lead_s:.0f}" for lead_s in score.lead_s[:3])
            more = "…" if len(score.lead_s) > 3 else ""
            row += [score.hits, score.misses, score.false_alarms, lead + more or "–"]
        rows.append([str(cell) for cell in row])
    columns = ("log", "sensor", "sweeps", "invalid", "found", "hit", "missed", "false", "lead ms")
    print_table(file, columns, rows)
    said = dict.fromkeys((name, text) for name, one in zip(short, results, strict=True) for text in one.problems)
    for name, text in said:
        print(f"{name}: {shown(text)}", file=file)
    if known:
        print(_sum(summarise(known)), file=file)


def _sum(total: Any) -> str:
    steps = total.hits + total.misses
    seen = f"{total.hits} of {steps} steps seen" if steps else "no steps"
    if total.median_lead_s is not None:
        seen += f", median lead {1e3 * total.median_lead_s:.0f} ms"
    rate = total.false_alarms_per_hour
    hourly = "" if rate is None else f" ({rate:,.{0 if rate >= 10 else 1}f} per hour)"
    return f"Truth known for {total.duration_s:.1f} s: {seen}, false alarms: {total.false_alarms}{hourly}."
