"""A detector's compiled file, `step.pyz`: what stands in it, and how it is read without being run.

A zip archive that Python runs as a program (PEP 441), with

- `artefact.json`: the header, `Header` by its fields, and the SHA-256 of the program;
- `step.vmfb`: the program in IREE's byte code, or `step.jaxexport`: in the form of `jax.export`;
- in the first case `__main__.py` and the modules of `jaxradar` that it runs.

Nothing in it is unpickled. The hash is compared before the program is loaded: a truncated one would load silently.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import lzma
import math
import stat
import struct
import zipfile
import zlib
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import numpy as np

from jaxradar._errors import ConfigError
from jaxradar.motion import MOTION_FIELDS

__all__ = [
    "DAMAGES",
    "DECISION",
    "FORMAT",
    "HEADER",
    "PROGRAMS",
    "Artefact",
    "Header",
    "is_artefact",
    "read_artefact",
    "units",
]

FORMAT = 1
HEADER = "artefact.json"
PROGRAMS = {"iree": "step.vmfb", "jax": "step.jaxexport"}
DECISION = ("range_m", "speed_m_s", "strength", "statistic", "impact_in_s", "valid", "saturated", "event")
DIGITS = 1e-6  # m: two axes whose bins lie no further apart are one

# What the archive's reader says of a damaged one: another compression, a password, places outside the file, too.
DAMAGES = (zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error, EOFError, RuntimeError, ValueError)


@dataclasses.dataclass(frozen=True)
class Header:
    """What a compiled detector is and takes.

    - `detector`: its name; `config`: the whole TOML; `threshold`, `statistic_name`, `statistic_unit`: of its statistic.
    - `range_m`: slant range of each bin in metres. `sweeps`: dtype of the amplitudes.
    - `vectors`: dtype of all vectors; `state`: the first one; `motion`: names of the inputs that tell the car's motion.
      Inputs are the amplitudes, the flags, the seconds since the sweep before, and those.
    - `decision`: names of the outputs. `target`: processor that it is compiled for. `kind`: a key of `PROGRAMS`.
    - `sensors`: those that it was made for, by their numbers; none where that was not said.
    - `versions`: of what made it.
    """

    detector: str
    config: str
    threshold: float
    statistic_name: str
    statistic_unit: str
    range_m: tuple[float, ...]
    sweeps: str
    vectors: str
    state: tuple[float, ...]
    motion: tuple[str, ...]
    decision: tuple[str, ...]
    target: str
    kind: str
    sensors: tuple[int, ...]
    versions: dict[str, str]

    @property
    def bins(self) -> int:
        """Of a sweep."""
        return len(self.range_m)

    @property
    def inputs(self) -> int:
        """Numbers that go in with each sweep."""
        return self.bins + 2 + len(self.motion)

    @property
    def first_state(self) -> np.ndarray:
        """(state,) before the first sweep."""
        return np.array(self.state, self.vectors)

    def check_axis(self, range_m: np.ndarray) -> None:
        """Raises `ConfigError`, with both, unless sweeps of this range axis are those it is compiled for."""
        own = np.array(self.range_m)
        if range_m.shape == own.shape and len(own) and np.abs(range_m - own).max() <= DIGITS:
            return
        raise ConfigError(
            f"the sweeps have {_shown(range_m)}, and the detector is compiled for {_shown(own)}; "
            "export it for these sweeps, with `jaxradar export --like` a log of theirs."
        )

    def check_amplitudes(self, dtype: np.dtype) -> None:
        """Raises `ConfigError` for amplitudes with a fraction where it is compiled for whole counts: it would be cut
        off without a word."""
        if not np.can_cast(dtype, np.dtype(self.sweeps), "same_kind"):
            raise ConfigError(
                f"the sweeps' amplitudes are {dtype}, and the detector is compiled for {self.sweeps}; "
                "export it for these sweeps, with `jaxradar export --like` a log of theirs."
            )


def units() -> dict[str, str]:
    """Of a decision's fields that have one."""
    return {"range_m": "m", "speed_m_s": "m/s", "strength": "counts", "impact_in_s": "s"}


def _shown(range_m: np.ndarray) -> str:
    if not len(range_m):
        return "no bins"
    return f"{len(range_m)} bins from {range_m[0]:.6g} to {range_m[-1]:.6g} m"


@dataclasses.dataclass(frozen=True)
class Artefact:
    """A compiled detector: its header and its program."""

    header: Header
    program: bytes

    @property
    def sha256(self) -> str:
        """Of the program."""
        return hashlib.sha256(self.program).hexdigest()

    def header_text(self) -> str:
        """The header as JSON."""
        record = {"format": FORMAT, **dataclasses.asdict(self.header), "units": units(), "sha256": self.sha256}
        return json.dumps(record, indent=1) + "\n"


def is_artefact(path: str | PathLike[str]) -> bool:
    """Whether a file is an archive with a header."""
    try:
        if not Path(path).is_file():  # a device may never end
            return False
        with zipfile.ZipFile(path) as archive:
            return HEADER in archive.namelist()
    except (OSError, *DAMAGES):
        return False


def read_artefact(path: str | PathLike[str]) -> Artefact:
    """Header and program of a file; nothing in it is run.

    Raises `ConfigError` for a file that cannot be read or is none, that another format has, and whose program is not
    the one that its header names.
    """
    name = fspath(path)
    try:
        if not stat.S_ISREG(mode := Path(name).stat().st_mode) and not stat.S_ISDIR(mode):
            raise ConfigError(f"{name}: is a device or a pipe; expected a file that `jaxradar export` made.")
        with zipfile.ZipFile(Path(name)) as archive:
            return _read(name, archive)
    except OSError as error:
        raise ConfigError(
            f"{name}: cannot be read: {error.strerror or error}; expected a file that `jaxradar export` made."
        ) from None
    except DAMAGES:
        raise ConfigError(f"{name}: is damaged, or no compiled detector; export it again.") from None


def _read(name: str, archive: zipfile.ZipFile) -> Artefact:
    if HEADER not in archive.namelist():
        raise ConfigError(f"{name}: holds no compiled detector; expected a file that `jaxradar export` made.")
    try:
        record = json.loads(archive.read(HEADER))
    except ValueError:
        record = None
    if not isinstance(record, dict) or record.get("format") != FORMAT:
        found = record.get("format") if isinstance(record, dict) else None
        raise ConfigError(f"{name}: its format is {found!r}, and this program reads {FORMAT}; export it again.")
    try:
        values: dict[str, Any] = {}
        for field in dataclasses.fields(Header):
            value = record[field.name]
            values[field.name] = tuple(value) if isinstance(value, list) else value
        header = _header(values)
        program = archive.read(PROGRAMS[header.kind])
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise ConfigError(f"{name}: its header or its program is not whole ({error}); export it again.") from None
    made = Artefact(header, program)
    if made.sha256 != record.get("sha256"):
        raise ConfigError(f"{name}: its program is not the one that its header names; export it again.")
    return made


def _header(values: dict[str, Any]) -> Header:
    """Of its fields. Raises `TypeError` or `ValueError` where they are not what a detector is run by."""
    numbers = (values["threshold"], *values["range_m"], *values["state"], *values["sensors"])
    if wrong := [number for number in numbers if not isinstance(number, int | float) or not math.isfinite(number)]:
        raise TypeError(f"expected a number, got {wrong[0]!r}")
    texts = [values[name] for name in ("detector", "config", "statistic_name", "statistic_unit", "target")]
    if wrong := [text for text in texts if not isinstance(text, str)]:
        raise TypeError(f"expected a text, got {wrong[0]!r}")
    sweeps, vectors, decision = values["sweeps"], values["vectors"], values["decision"]
    if sweeps not in ("uint16", "float32", "float64") or vectors not in ("float32", "float64"):
        raise ValueError(f"sweeps of {sweeps!r} in vectors of {vectors!r}")
    if decision != DECISION or values["motion"] not in ((), MOTION_FIELDS):
        raise ValueError(f"decisions of {decision!r} by motion of {values['motion']!r}")
    return Header(**values)
