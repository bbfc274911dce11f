"""The page: its parts lie beside this module and are put together with the data."""

from __future__ import annotations

import html
import json
import os
from collections.abc import Sequence
from importlib import resources
from os import PathLike
from pathlib import Path

from jaxradar._errors import LogError
from jaxradar.evaluation import Evaluation, OperatingPoint
from jaxradar.report.data import page_data

__all__ = ["write_report"]

_SCRIPTS = ("data.js", "draw.js", "charts.js", "table.js", "detail.js", "main.js")


def write_report(
    evaluation: Evaluation,
    path: str | PathLike[str],
    *,
    curve: Sequence[OperatingPoint] = (),
    title: str = "Road steps",
) -> None:
    """Write an evaluation as one HTML page: a sum, hits over false alarms, and a table to sort and to filter, whose
    rows open to range, statistic, map and events.

    `curve`: as from `operating_curve`. Without `evaluate(..., pictures=True)` the rows show numbers alone. The page is
    written under another name and then renamed. Raises `LogError` if it cannot be written.
    """
    target = Path(path)
    data, blobs = page_data(evaluation, curve, title)
    page = (
        _part("page.html")
        .replace("{{title}}", html.escape(title))
        .replace("{{style}}", _part("page.css"))
        .replace("{{script}}", "\n".join(map(_part, _SCRIPTS)))
    )
    # Last, so that nothing of a log's name is taken for a place in the page.
    before, _, after = page.partition("{{data}}")
    # A name of a log must not end the element that it stands in.
    text = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    fresh = target.with_name(f".{target.name}.{os.getpid()}.new")
    try:
        with fresh.open("w", encoding="utf-8") as file:
            file.write(f'{before}<script type="application/json" id="data">{text}</script>\n')
            for blob in blobs:
                file.write(f'<script type="text/plain" class="blob">{blob}</script>\n')
            file.write(after)
        fresh.replace(target)
    except OSError as error:
        raise LogError(target, f"cannot be written: {error.strerror or error}.") from error
    finally:
        fresh.unlink(missing_ok=True)


def _part(name: str) -> str:
    return resources.files(__package__).joinpath(name).read_text(encoding="utf-8")
