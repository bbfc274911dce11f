"""Results of many logs as tables."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version
from os import PathLike
from pathlib import Path
from typing import Any

import pyarrow as pa  # type: ignore[import-untyped]

from jaxradar._errors import LogError
from jaxradar.evaluation.records import Failure, SeriesResult, failure_record, record_of
from jaxradar.evaluation.selection import Settings
from jaxradar.matching import Summary, summarise
from jaxradar.systems.step import DetectorFile, dump_detector

__all__ = ["Evaluation"]

_SERIES = pa.schema(
    [
        ("path", pa.string()),
        ("sensor", pa.int32()),
        ("sweeps", pa.int64()),
        ("duration_s", pa.float64()),
        ("sweep_rate_hz", pa.float64()),
        ("invalid_sweeps", pa.int64()),
        ("detections", pa.int64()),
        ("hits", pa.int64()),
        ("misses", pa.int64()),
        ("false_alarms", pa.int64()),
        ("lead_s", pa.list_(pa.float64())),
        ("problems", pa.list_(pa.string())),
    ]
)
_EVENTS = pa.schema(
    [
        ("path", pa.string()),
        ("sensor", pa.int32()),
        ("time_s", pa.float64()),
        ("range_m", pa.float64()),
        ("strength", pa.float64()),
        ("statistic", pa.float64()),
        ("threshold", pa.float64()),
        ("sweep", pa.int64()),
        ("impact_in_s", pa.float64()),
    ]
)
_STEPS = pa.schema(
    [
        ("path", pa.string()),
        ("sensor", pa.int32()),
        ("impact_s", pa.float64()),
        ("height_m", pa.float64()),
        ("lead_s", pa.float64()),
    ]
)
_COUNTS = ("hits", "misses", "false_alarms", "lead_s")


@dataclass(frozen=True, eq=False)
class Evaluation:
    """What a detector found in many logs.

    - `results`: a `SeriesResult` for each sensor of each log, in the order of the logs.
    - `failures`: the logs that could not be evaluated.
    - `settings`: the detector, the part of each log, the matching window. `versions`: of what made it, by name.

    pandas, polars and whatever else takes Arrow tables takes this, one row for each result:
    `polars.DataFrame(found)`, `pyarrow.table(found)`, `found.to_pandas()`.
    """

    results: tuple[SeriesResult, ...]
    failures: tuple[Failure, ...]
    settings: Settings
    versions: Mapping[str, str]

    @classmethod
    def of(cls, found: Iterable[SeriesResult | Failure], settings: Settings) -> Evaluation:
        """Out of what `evaluate_each` gives with these settings."""
        held = list(found)
        return cls(
            results=tuple(one for one in held if isinstance(one, SeriesResult)),
            failures=tuple(one for one in held if isinstance(one, Failure)),
            settings=settings,
            versions={name: version(name) for name in ("jaxradar", "jax", "numpy")},
        )

    def __len__(self) -> int:
        return len(self.results)

    @property
    def detector(self) -> str:
        """All its settings, as TOML."""
        return dump_detector(DetectorFile(self.settings.detector))

    @cached_property
    def summary(self) -> Summary:
        """All whose truth is known, together."""
        return summarise((one.score, one.duration_s) for one in self.results if one.score is not None)

    def to_arrow(self) -> Any:
        """A `pyarrow.Table`, one row for each result; null where the truth is not known."""
        rows = [
            {
                **{name: getattr(one, name) for name in ("path", "sensor", "sweeps", "duration_s", "sweep_rate_hz")},
                "invalid_sweeps": one.invalid_sweeps,
                "detections": len(one.events),
                **({} if one.score is None else {name: getattr(one.score, name) for name in _COUNTS}),
                "problems": one.problems,
            }
            for one in self.results
        ]
        return pa.Table.from_pylist(rows, schema=_SERIES)

    def events(self) -> Any:
        """A `pyarrow.Table`, one row for each detection."""
        held = [
            pa.table(
                {
                    "path": pa.repeat(one.path, len(one.events)),
                    "sensor": pa.repeat(one.sensor, len(one.events)),
                    **{name: getattr(one.events, name) for name in ("time_s", "range_m", "strength", "statistic")},
                    "threshold": pa.repeat(one.events.threshold, len(one.events)),
                    "sweep": one.events.sweep,
                    "impact_in_s": pa.array(one.events.impact_in_s, from_pandas=True),
                }
            ).cast(_EVENTS)
            for one in self.results
            if len(one.events)
        ]
        return pa.concat_tables(held) if held else _EVENTS.empty_table()

    def steps(self) -> Any:
        """A `pyarrow.Table`, one row for each step whose truth is known; `lead_s` is null where it was missed."""
        rows = [
            (one.path, one.sensor, step.impact_s, step.height_m, lead)
            for one in self.results
            if one.score is not None
            for step, lead in zip(one.score.steps, one.score.leads_s, strict=True)
        ]
        return pa.Table.from_pylist([dict(zip(_STEPS.names, row, strict=True)) for row in rows], schema=_STEPS)

    def to_pandas(self) -> Any:
        """A `pandas.DataFrame` of the same; needs pandas."""
        return self.to_arrow().to_pandas()

    def to_polars(self) -> Any:
        """A `polars.DataFrame` of the same; needs polars."""
        import polars  # type: ignore[import-not-found, unused-ignore]

        return polars.DataFrame(self.to_arrow())

    def __arrow_c_stream__(self, requested_schema: Any = None) -> Any:
        """The Arrow PyCapsule interface, by which data frames take this without a copy."""
        return self.to_arrow().__arrow_c_stream__(requested_schema)

    def write_json(self, path: str | PathLike[str]) -> None:
        """One JSON object for each result and failure, in lines. Raises `LogError` if the file cannot be written."""
        lines = [json.dumps(record_of(one)) for one in self.results]
        lines += [json.dumps(failure_record(one)) for one in self.failures]
        try:
            Path(path).write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
        except OSError as error:
            raise LogError(path, f"cannot be written: {error.strerror or error}.") from error
