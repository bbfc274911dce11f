"""Vectorised, differentiable signal processing for the range sensors of cars, in JAX.

Logs in and out:

- `read_log`, `write_log`: a log of any kind as a `Drive`, and back.
- `find_logs`: the logs that files, folders and patterns name.
- `Drive`: one drive as recorded.
- `SensorSeries`: all sweeps of one sensor, with their times, flags and range axis.
- `SweepFlag`: what the sensor, or the reader, said of one sweep.
- `Motion`, `Channel`: how the car moved; one quantity over time.
- `Mounting`: how the sensor sits on the car.
- `Truth`, `RoadStep`: every step that a drive went over; one of them.

Steps out:

- `load_detector`: a detector by name or from a TOML file, as a `DetectorFile`.
- `dump_detector`: a detector as commented TOML.
- `detect`: run a detector over a series.
- `detect_batch`: run it over thousands of series of one `RangeAxis`, which `stack` makes its inputs of.
- `time_steps`: the times between sweeps, which is one of these.
- `thin`: keep some of the range bins, as the lab's program does.
- `StepTrace`, `StepEvent`: all that a detector found out about a series; one detection.

Thousands of logs:

- `import_logs`: bring them into a store, which `open_store` opens as a `Store`.
- `evaluate`: run a detector over logs and stores, as an `Evaluation`; `write_report` makes a page of it.
- `detect_series`: run a detector over any number of series of any length.

Held against the truth:

- `match_steps`: match detections with steps, as a `Matching`.
- `MatchWindow`: how long before an impact a detection may come.
- `summarise`: many outcomes as one `Summary`.
- `propose_steps`: steps proposed from the acceleration.

Physics:

- `friis_power_ratio`, `free_space_loss`: received over transmitted power in free space, and its loss.

Drives and figures:

- `simulate`: drive through a scene, `load_scene` gives one by name or from a TOML file; the rest is in `jaxradar.sim`.
- `plot_drive`, `plot_sweeps`: figures of a series and of what was found in it.

More, each in a package of its own:

- `jaxradar.live`: sweeps as they come, from a sensor or from a recorded drive.
- `jaxradar.survey`: two sensors side by side, the height of a step, the mounting of a sensor out of a flat road.
- `jaxradar.tuning`: settings of a detector out of drives whose truth is known.
- `jaxradar.suite`: which steps a detector sees, and what it raises for nothing.
- `jaxradar.pareto`: accuracy against time, with the tasks of `jaxradar.tasks`.

What a user can get wrong is said in one sentence:

- `JaxradarError`: base of the three below.
- `LogError`: a log that cannot be read as what it claims to be.
- `ConfigError`: a setting that is unknown or outside its bounds.
- `SourceError`: live sweeps that do not come, or no longer.

Each name is imported when it is first used, so that `import jaxradar` is quick. No global setting of JAX is changed.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jaxradar._errors import ConfigError, JaxradarError, LogError, SourceError
    from jaxradar.drive import Channel, Drive, Motion, Mounting, RoadStep, SensorSeries, SweepFlag, Truth
    from jaxradar.evaluation import Evaluation, evaluate
    from jaxradar.ingest import import_logs
    from jaxradar.labels import propose_steps
    from jaxradar.logs import find_logs, read_log, write_log
    from jaxradar.matching import Matching, MatchWindow, Summary, match_steps, summarise
    from jaxradar.plots import plot_drive, plot_sweeps
    from jaxradar.report import write_report
    from jaxradar.sim import load_scene, simulate
    from jaxradar.store import Store, open_store
    from jaxradar.systems.step import (
        DetectorFile,
        RangeAxis,
        StepEvent,
        StepTrace,
        detect,
        detect_batch,
        detect_series,
        dump_detector,
        load_detector,
        stack,
        thin,
        time_steps,
    )
    from jaxradar.units import free_space_loss, friis_power_ratio

__all__ = [
    "Channel",
    "ConfigError",
    "DetectorFile",
    "Drive",
    "Evaluation",
    "JaxradarError",
    "LogError",
    "MatchWindow",
    "Matching",
    "Motion",
    "Mounting",
    "RangeAxis",
    "RoadStep",
    "SensorSeries",
    "SourceError",
    "StepEvent",
    "StepTrace",
    "Store",
    "Summary",
    "SweepFlag",
    "Truth",
    "detect",
    "detect_batch",
    "detect_series",
    "dump_detector",
    "evaluate",
    "find_logs",
    "free_space_loss",
    "friis_power_ratio",
    "import_logs",
    "load_detector",
    "load_scene",
    "match_steps",
    "open_store",
    "plot_drive",
    "plot_sweeps",
    "propose_steps",
    "read_log",
    "simulate",
    "stack",
    "summarise",
    "thin",
    "time_steps",
    "write_log",
    "write_report",
]

_HOMES = {
    "_errors": "ConfigError JaxradarError LogError SourceError",
    "drive": "Channel Drive Motion Mounting RoadStep SensorSeries SweepFlag Truth",
    "evaluation": "Evaluation evaluate",
    "ingest": "import_logs",
    "labels": "propose_steps",
    "logs": "find_logs read_log write_log",
    "matching": "MatchWindow Matching Summary match_steps summarise",
    "plots": "plot_drive plot_sweeps",
    "report": "write_report",
    "sim": "load_scene simulate",
    "store": "Store open_store",
    "units": "free_space_loss friis_power_ratio",
    "systems.step": "DetectorFile RangeAxis StepEvent StepTrace detect detect_batch detect_series dump_detector"
    " load_detector stack thin time_steps",
}


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version(__name__)
    for home, names in _HOMES.items():
        if name in names.split():
            value = getattr(importlib.import_module(f"{__name__}.{home}"), name)
            globals()[name] = value  # the next access finds it without coming here
            return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, "__version__"})
