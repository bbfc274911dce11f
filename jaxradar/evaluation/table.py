"""Results of many logs as tables."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from importlib.metadata import version
from os import PathLike
from pathlib import Path
from typing import Any

import pyarrow as pa  # type: ignore[import-untyped]

from jaxradar._errors import LogError
from jaxradar.evaluation.records import Failure, SeriesResult, record_of
from jaxradar.matching import MatchWindow, Summary, summarise
from jaxradar.systems.step import DetectorFile, StepDetector, dump_detector

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
    ]
)


@dataclass(frozen=True, eq=False)
class Evaluation:
    """What a detector found in many logs.

    - `results`: a `SeriesResult` for each sensor of each log, in the order of the logs.
    - `failures`: the logs that could not be evaluated.
    - `detector`: its settings, as TOML. `settings`: what is compared with which threshold, the matching window,
      versions.

    pandas, polars and whatever else takes Arrow tables takes this, one row for each result:
    `polars.DataFrame(found)`, `pyarrow.table(found)`, `found.to_pandas()`.
    """

    results: tuple[SeriesResult, ...]
    failures: tuple[Failure, ...]
    detector: str
    settings: Mapping[str, Any]

    @classmethod
    def of(
        cls, found: Iterable[SeriesResult | Failure], detector: StepDetector[Any, Any], window: MatchWindow
    ) -> Evaluation:
        """Out of what `evaluate_each` gives."""
        held = list(found)
        return cls(
            results=tuple(one for one in held if isinstance(one, SeriesResult)),
            failures=tuple(one for one in held if isinstance(one, Failure)),
            detector=dump_detector(DetectorFile(detector)),
            settings={
                "threshold": float(detector.threshold),
                "statistic": [detector.statistic_name, detector.statistic_unit],
                "window": asdict(window),
                "versions": {name: version(name) for name in ("jaxradar", "jax", "numpy")},
            },
        )

    def __len__(self) -> int:
        return len(self.results)

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
                **({} if one.score is None else vars(one.score)),
                "problems": one.log.problems,
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
                }
            ).cast(_EVENTS)
            for one in self.results
            if len(one.events)
        ]
        return pa.concat_tables(held) if held else _EVENTS.empty_table()

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
        lines += [json.dumps({"path": one.path, "error": one.error}) for one in self.failures]
        try:
            Path(path).write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
        except OSError as error:
            raise LogError(path, f"cannot be written: {error.strerror or error}.") from error
