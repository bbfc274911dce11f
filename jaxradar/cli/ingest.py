"""`jaxradar import`: logs into a store, or a store into an archive."""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from pathlib import Path
from typing import Any

from jaxradar._errors import ConfigError
from jaxradar._program import shown, whole
from jaxradar.cli._options import add_command
from jaxradar.cli._output import progress

__all__ = ["add_to"]

_DESCRIPTION = """\
Bring logs into a store: a folder of drives in the package's own form, with a
catalogue. What reads logs reads a store, and many times faster than text.

Only what is new or changed is read; what a broken-off import did stays done. A
log that cannot be read is reported and in the catalogue, and stops nothing.

OUT that ends in .zip is the archive: one compressed file. PATH is then a store,
or logs, which go into a store beside it first (OUT without .zip).

Exit status: 0 all well, 1 some logs could not be read (the others were), 2
wrong usage."""


def add_to(commands: Any) -> None:
    """Make the command known."""
    parser = add_command(
        commands,
        "import",
        _run,
        summary="bring logs into a store",
        description=_DESCRIPTION,
        example="jaxradar import recordings/ -o store && jaxradar evaluate store",
    )
    parser.add_argument("paths", nargs="+", metavar="PATH", help="a log, a folder of logs, or a pattern")
    parser.add_argument("-o", "--output", required=True, metavar="OUT", help="the store, or NAME.zip for an archive")
    parser.add_argument("--workers", type=whole(1), metavar="N", help="processes (default: one for each core)")
    parser.add_argument("--overwrite", action="store_true", help="replace the archive if there is one")
    parser.add_argument("--json", action="store_true", help="print what was done as one JSON object")
    parser.add_argument("--quiet", action="store_true", help="no progress, and no sum at the end")


def _run(args: argparse.Namespace) -> int:
    from jaxradar.store import is_store

    out = Path(args.output)
    archive = out if out.suffix.lower() == ".zip" else None
    stores = [path for path in map(Path, args.paths) if is_store(path) and path.is_dir()]
    if archive is not None and stores and len(args.paths) > 1:
        raise ConfigError(f"an archive is made of one store, or of logs; got {len(args.paths)} paths, with a store.")
    store = stores[0] if archive is not None and stores else out.with_suffix("") if archive is not None else out
    done: Counter[str] = Counter()
    failed: list[str] = []
    if not (archive is not None and stores):
        _import(args, store, done, failed)
    if archive is not None:
        _pack(args, store, archive)
    if args.json:
        print(json.dumps({"store": str(archive or store), **{name: done[name] for name in _SAID}, "errors": failed}))
    elif not args.quiet:
        if done:
            print(", ".join(f"{done[name]} {text}" for name, text in _SAID.items() if done[name]) + ".")
        print(shown(archive or store))
    return 1 if done["failed"] or done["failed before"] else 0


_SAID = {
    "imported": "imported",
    "unchanged": "unchanged",
    "same": "touched and unchanged",
    "moved": "moved since they were imported, whose old drives were taken out",
    "failed": "could not be read",
    "failed before": "could not be read before and have not changed",
}


def _import(args: argparse.Namespace, store: Path, done: Counter[str], failed: list[str]) -> None:
    from jaxradar.ingest import import_each
    from jaxradar.logs import find_logs

    total = len(find_logs(args.paths))
    if not total:
        raise ConfigError(f"{', '.join(map(shown, args.paths))}: no logs there.")
    with progress("importing", total, quiet=args.quiet) as advance:
        for one in import_each(args.paths, store, workers=args.workers):
            done[one.done] += 1
            if one.done.startswith("failed"):
                failed.append(str(one.entry.error))
                print(f"jaxradar: {shown(failed[-1])}", file=sys.stderr)
            advance(1)


def _pack(args: argparse.Namespace, store: Path, archive: Path) -> None:
    from jaxradar.store import open_store, pack

    total = sum(entry.sweeps for entry in open_store(store).drives)
    with progress("packing", total, quiet=args.quiet) as advance:
        pack(store, archive, overwrite=args.overwrite, advance=advance)
