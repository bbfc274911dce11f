"""The report of a run: tables of text, the same as JSON, and the comparison with an earlier run; used by `run.py`."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from measure import Spread

from jaxradar.pareto import machine

__all__ = ["Others", "Row", "Section", "compare", "header", "read", "render", "to_json"]

COLUMNS = 120


@dataclass
class Row:
    """`key` names it from run to run, `cells` are printed (if any), `numbers` kept, `ratio` compared between runs."""

    key: str
    cells: Sequence[str]
    numbers: dict[str, Any] = field(default_factory=dict)
    ratio: Spread | None = None


@dataclass
class Section:
    """One table with notes below it. `failed`: something in it came out wrong."""

    name: str
    title: str
    columns: Sequence[str]
    words: int = 1  # columns from the left that hold words
    rows: list[Row] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    failed: bool = False


class Others:
    """How busy other processes keep the cores while this one measures: on a busy machine no figure means much."""

    def __init__(self) -> None:
        self.start = self._now()

    @staticmethod
    def _now() -> tuple[float, float, float] | None:
        """Seconds so far: of all cores, of these those that anyone used, of these our own and our children's."""
        try:
            ticks = [float(word) for word in Path("/proc/stat").read_text().split("\n", 1)[0].split()[1:9]]
        except OSError:
            return None
        second = os.sysconf("SC_CLK_TCK")
        return sum(ticks) / second, (sum(ticks) - ticks[3] - ticks[4]) / second, sum(os.times()[:4])

    def share(self) -> float | None:
        """Of all cores' time since this was made; None where the system does not say."""
        now = self._now()
        if now is None or self.start is None or now[0] <= self.start[0]:
            return None
        total, used, own = (end - begin for end, begin in zip(now, self.start, strict=True))
        return max(0.0, (used - own) / total)


def _commit() -> str:
    def git(*arguments: str) -> str:
        command = ["git", "-C", str(Path(__file__).parent), *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()

    try:
        return git("rev-parse", "--short=12", "HEAD") + (" with changes" if git("status", "--porcelain") else "")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def header(command: Sequence[str]) -> dict[str, str]:
    packages = ("jaxradar", "jax", "jaxlib", "numpy", "numba")
    return {**machine(packages), "commit": _commit(), "command": " ".join(command)}


def _table(columns: Sequence[str], rows: Sequence[Sequence[str]], words: int) -> list[str]:
    widths = [max(len(row[i]) for row in [columns, *rows]) for i in range(len(columns))]
    lines = []
    for row in [columns, *rows]:
        sized = zip(row, widths, strict=True)
        cells = [cell.ljust(width) if i < words else cell.rjust(width) for i, (cell, width) in enumerate(sized)]
        lines.append("  ".join(cells).rstrip())
    lines.insert(1, "-" * min(COLUMNS, max(map(len, lines))))
    return lines


def _wrapped(note: str) -> list[str]:
    if len(note) <= COLUMNS:
        return [note]
    lines, line = [], ""
    for word in note.split():
        if line and len(line) + 1 + len(word) > COLUMNS:
            lines.append(line)
            line = " "
        line = f"{line} {word}" if line else word
    return [*lines, line]


def render(head: dict[str, str], sections: Sequence[Section]) -> str:
    """The text report, no line longer than 120 characters unless a name is."""
    lines = [f"{key + ':':10}{value}" for key, value in head.items()]
    for section in sections:
        lines += ["", f"== {section.name}: {section.title}", ""]
        if section.rows:
            lines += _table(section.columns, [row.cells for row in section.rows if row.cells], section.words)
        for note in section.notes:
            lines += _wrapped(note)
    return "\n".join(lines) + "\n"


def to_json(head: dict[str, str], sections: Sequence[Section]) -> str:
    return json.dumps({"format": 1, "header": head, "sections": [asdict(section) for section in sections]}, indent=1)


def read(path: str) -> dict[str, Any]:
    """An earlier run's JSON. Raises `ValueError` with a sentence that says why it cannot be used."""
    try:
        old = json.loads(Path(path).read_text())
    except OSError as error:
        raise ValueError(f"{path}: {(error.strerror or str(error)).lower()}.") from None
    except ValueError:
        raise ValueError(f"{path}: not JSON; expected what an earlier run wrote with --json.") from None
    if not isinstance(old, dict) or old.get("format") != 1:
        raise ValueError(f"{path}: not a report of these benches; expected what an earlier run wrote with --json.")
    return old


def compare(old: dict[str, Any], head: dict[str, str], sections: Sequence[Section]) -> Section:
    """Ratio of ratios, new over old, of each row that both runs have: more than 1 is slower, whatever the machine."""
    earlier = {
        (section["name"], row["key"]): Spread(**row["ratio"])
        for section in old["sections"]
        for row in section["rows"]
        if row["ratio"]
    }
    before_head = old["header"]
    title = f"with {before_head['date']}, commit {before_head['commit']}"
    result = Section("compare", title, ["row", "old", "new", "new/old", ""])
    for section in sections:
        for row in section.rows:
            before = earlier.get((section.name, row.key))
            if row.ratio is None or before is None:
                continue
            verdict = "LOSS" if row.ratio.low > before.high else "gain" if row.ratio.high < before.low else ""
            change = row.ratio.median / before.median
            cells = [f"{section.name}: {row.key}", f"{before.median:.3g}", f"{row.ratio.median:.3g}", f"{change:.2f}"]
            result.rows.append(Row(f"{section.name}: {row.key}", [*cells, verdict], {"change": change}))
    result.notes.append(
        "Each figure is a time relative to another candidate's in the same rounds, not an absolute time. LOSS and "
        "gain: the spreads (10th to 90th percentile) of the two runs do not touch."
    )
    for key in ("cpu", "device", "versions", "command"):
        if before_head.get(key) != head.get(key):
            result.notes.append(f"{key}: {before_head.get(key)} then, {head.get(key)} now.")
    return result
