"""What it costs. Run by hand, never by pytest:

    python benches/run.py                              # everything; minutes
    python benches/run.py batch --quick                # one section, small
    python benches/run.py -o report.txt --json report.json
    python benches/run.py --compare report.json        # with an earlier run's JSON

Progress goes to standard error, the report to standard output and the file of -o. Exits with 1 if a result was wrong
(it is then not timed), with 2 if an argument was.
"""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from pathlib import Path
from typing import NoReturn

import report
from measure import say
from settings import Settings

# Each section is a module of `sections` with `measure`, imported when it is asked for.
SECTIONS = {
    "batch": "batch",
    "bins": "bins",
    "gradient": "gradient",
    "tuning": "tuning",
    "compile": "compiling",
    "scenes": "scenes",
    "store": "store",
    "acconeer": "acconeer",
    "live": "live",
    "car": "car",
    "gpu": "gpu",
}
FEWEST, MOST = 3, 10_000
MOST_OTHERS = 0.05


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        """One sentence; the usage is for --help."""
        print(f"run.py: {message.rstrip('.')}.", file=sys.stderr)
        sys.exit(2)


def _arguments(argv: list[str]) -> argparse.Namespace:
    parser = _Parser(
        prog="run.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )
    parser.add_argument("sections", nargs="*", metavar="SECTION", help=f"any of {', '.join(SECTIONS)}; all if none")
    parser.add_argument("--quick", action="store_true", help="small batches, to see whether everything runs")
    parser.add_argument("--rounds", type=int, metavar="N", help="measurements of each candidate; 15, with --quick 7")
    parser.add_argument("-o", dest="output", metavar="FILE", help="write the report to this file too")
    parser.add_argument("--json", metavar="FILE", help="write it as JSON, for a later --compare")
    parser.add_argument("--compare", metavar="FILE", help="an earlier run's JSON to compare ratios with")
    arguments = parser.parse_args(argv)
    for name in arguments.sections:
        if name not in SECTIONS:
            parser.error(f"there is no section {name!r}; expected any of {', '.join(SECTIONS)}")
    if arguments.rounds is None:
        arguments.rounds = 7 if arguments.quick else 15
    if not FEWEST <= arguments.rounds <= MOST:
        parser.error(f"--rounds must be between {FEWEST} and {MOST}; got {arguments.rounds}")
    for path in (arguments.output, arguments.json):
        # Now and not after minutes of measuring.
        if path is not None and (Path(path).is_dir() or not Path(path).resolve().parent.is_dir()):
            parser.error(f"{path} cannot be written; expected a file in a folder that is there")
    if arguments.compare is not None:
        try:
            arguments.compare = report.read(arguments.compare)
        except ValueError as error:
            parser.error(str(error))
    return arguments


def main(argv: list[str]) -> int:
    arguments = _arguments(argv)
    settings = Settings(arguments.quick, arguments.rounds)
    # Before any peer starts its threads: one that spins while it waits takes the core from the next candidate.
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    head = report.header(["python", "benches/run.py", *argv])
    others = report.Others()
    sections = []
    for name in arguments.sections or SECTIONS:
        say(f"section {name}")
        if name != "gpu" and not head["device"].startswith("cpu"):
            # A program is traced in one form for all of a process, that of JAX's default device.
            why = "skipped: JAX runs on another device here; set JAX_PLATFORMS=cpu for what the processor does"
            sections.append(report.Section(name, why, ()))
            continue
        sections.append(importlib.import_module(f"sections.{SECTIONS[name]}").measure(settings))
    share = others.share()
    if share is not None:
        head["others"] = f"{share:.0%} of the cores' time went to other processes meanwhile" + (
            "; TOO MUCH for figures to be kept" if share > MOST_OTHERS else ""
        )
    as_json = report.to_json(head, sections)
    if arguments.compare is not None:
        sections.append(report.compare(arguments.compare, head, sections))
    text = report.render(head, sections)
    print(text, end="")
    for path, content in ((arguments.output, text), (arguments.json, as_json)):
        if path is not None:
            Path(path).write_text(content)
    return int(any(section.failed for section in sections))


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except KeyboardInterrupt:
        sys.exit(130)
