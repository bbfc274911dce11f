"""The source that the options name. Each kind is imported where it is asked for."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from jaxradar._errors import ConfigError, LogError
from jaxradar.live.options import BINS, HOST, LENGTH_M, RATE_HZ, SENSORS, START_M, check_options

if TYPE_CHECKING:
    from jaxradar.drive import Drive
    from jaxradar.live.artefact import Header
    from jaxradar.live.sweeps import Source

__all__ = ["ACCONEER", "DEVICE_SOURCES", "SourceKind", "read_device_log", "replayed", "source_of"]


class SourceKind(NamedTuple):
    """One kind of source.

    - `about`: for the help, what it is made of.
    - `make`: makes it of the options and of the compiled detector's header, None where there is none yet.
    - `place`: what has to be said to find it, empty if nothing has.
    """

    about: str
    make: Callable[[argparse.Namespace, Header | None], Source]
    place: str = ""


def source_of(args: argparse.Namespace, kinds: Mapping[str, SourceKind], header: Header | None) -> Source:
    """The source that the options name, not open yet.

    Raises `ConfigError` for options that do not go together, and what its `make` raises.
    """
    kind = kinds[args.source]
    check_options(args)
    if kind.place and args.where is None:
        raise ConfigError(f"--source {args.source} needs a {kind.place.lower()}: --source {args.source} {kind.place}.")
    return kind.make(args, header)


def replayed(args: argparse.Namespace, drive: Drive) -> Source:
    """A drive at the pace that the options name."""
    from jaxradar.live.replay import Replay

    return Replay(drive, None if args.fast else args.pace or 1.0, sensors=args.sensors)


def read_device_log(path: Path) -> Drive:
    """A log in one of the two forms that NumPy alone reads. Raises `LogError` for what is none."""
    from jaxradar.drivefile import is_drive_folder, read_drive

    if not path.exists():
        raise LogError(path, "cannot be read: No such file or directory.")
    if path.suffix == ".drive" or is_drive_folder(path):
        return read_drive(path)
    from jaxradar.labcsv import looks_like_radar, read_lab_csv

    if path.is_dir() or path.suffix.lower() == ".csv" or looks_like_radar(path):
        return read_lab_csv(path)
    raise LogError(
        path,
        "is neither the lab's CSV nor a .drive, which is all that is read here; where the whole package is, "
        "`jaxradar convert LOG NAME.drive` makes one of other logs.",
    )


def _acconeer(args: argparse.Namespace, header: Header | None) -> Source:
    from jaxradar.live.acconeer import AcconeerSource

    def given(value: float | None, otherwise: float) -> float:
        return otherwise if value is None else value

    return AcconeerSource(
        args.where or HOST,
        sensors=args.sensors or (header.sensors if header else ()) or SENSORS,
        start_m=given(args.start_m, START_M),
        length_m=given(args.length_m, LENGTH_M),
        rate_hz=given(args.rate_hz, RATE_HZ),
        running_average=given(args.running_average, 0.0),
        bins=header.bins if header else BINS,
    )


ACCONEER = SourceKind("Acconeer's exploration server, on this host (localhost) or WHERE", _acconeer)
DEVICE_SOURCES = {
    "replay": SourceKind(
        "a recorded log, the lab's CSV or a .drive",
        lambda args, _: replayed(args, read_device_log(Path(args.where))),
        "LOG",
    ),
    "acconeer": ACCONEER,
}
