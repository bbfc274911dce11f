"""What the package offers, by walking it, and which of it has no numbers to go wrong in a program."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator
from typing import Any

import jaxradar

# Packages whose functions are not looked up one by one.
ELSEWHERE: dict[str, str] = {
    "_errors": "exceptions",
    "_program": "how a program ends, and what its arguments are",
    "_settings": "reads and checks settings",
    "_toml": "reads and writes text",
    "_types": "types",
    "_cache": "where programs are kept",
    "_machine": "counts cores",
    "_worker": "what a worker does first",
    "cli": "the command line",
    "cluster": "sends work elsewhere",
    "drive": "holds recordings",
    "drivefile": "reads and writes files",
    "estimate": "on the host in float64, but for `kalman`, values and slopes of all of which are in its own tests: "
    "test_estimate_*.py",
    "evaluation": "what `detect_series` finds, counted on the host: test_evaluation.py",
    "export": "compiles what is held against JAX on the host: test_export*.py",
    "ingest": "reads and writes files",
    "labcsv": "reads and writes files",
    "labels": "runs on the host in float64: test_cli_logs.py",
    "live": "hands on what sensors say: test_live_*.py",
    "logs": "reads and writes files",
    "matching": "runs on the host in float64: test_matching.py",
    "motion": "holds recordings, and looks values up on the host: test_step_motion.py",
    "pareto": "measures programs on the host: test_pareto.py",
    "plots": "draws",
    "report": "writes a page",
    "sim": "all of it flows through `render`: test_stability_scenes.py, test_sim_gradients.py",
    "suite": "drives and counts on the host: test_suite.py",
    "store": "reads and writes files",
    "tuning": "slopes of the whole cost against central differences: test_tuning.py",
    "tasks": "makes inputs and programs to measure: test_tasks.py",
}


def offering_modules() -> Iterator[str]:
    """Modules below the package by their dotted names: of a package that names what it offers the package alone."""
    facades: list[str] = []
    for found in pkgutil.walk_packages(jaxradar.__path__, "jaxradar."):
        name = found.name.removeprefix("jaxradar.")
        if name == "__main__" or any(name.startswith(f"{facade}.") for facade in facades):
            continue
        loaded = importlib.import_module(found.name)
        if hasattr(loaded, "__all__"):
            facades.append(name)
            yield name
        else:
            assert found.ispkg, f"{name} does not say what it offers"


def public_names() -> dict[str, Any]:
    """All that is offered, but by the packages of `ELSEWHERE`, by dotted name below the package."""
    found = {}
    for module in offering_modules():
        if module.partition(".")[0] not in ELSEWHERE:
            loaded = importlib.import_module(f"jaxradar.{module}")
            found |= {f"{module}.{name}": getattr(loaded, name) for name in loaded.__all__}
    return found


ABSTRACT = "abstract: its concrete classes are in the table"
CARRIER = "holds results and computes nothing"
HOST = "runs on the host in integers or float64, nothing to differentiate"
NOT_NUMERIC: dict[str, str] = {
    "signal.peaks.Peak": CARRIER,
    "signal.peaks.PeakEstimator": ABSTRACT,
    "signal.peaks.WindowEstimator": ABSTRACT,
    "signal.clutter.NoiseFloor": CARRIER,
    "signal.correlate.ProfileShift": CARRIER,
    "signal.pulse_fit.NARROWEST": "a constant",
    "signal.pulses.SIGMA_PER_FWHM": "a constant",
    "units.NANOSECONDS": "a constant",
    "units.SPEED_OF_LIGHT_M_S": "a constant",
    "units.WAVELENGTH_60_GHZ_M": "a constant",
    "_numerics.as_scalar": "changes a type, never a value",
    "_numerics.compiled": "how a program is compiled",
    "_numerics.compiled_filtered": "how a program is compiled",
    "_numerics.cpu_shaped": "how a program is traced",
    "_numerics.operations": "counts what a program does",
    "_numerics.reductions": "how a program is traced",
    "_numerics.largest_row": "`largest` along another axis: test_numerics.py",
    "_numerics.tree": "how a program is traced",
    "_numerics.written_out": "the same values, made earlier: test_step_packed.py",
    "_numerics.row_major": "where values lie in memory",
    "systems.step.DETECTORS": "a table of names",
    "systems.step.Decision": CARRIER,
    "systems.step.DefaultDetector": "its parts are in the table; how it joins them: test_step_approach.py",
    "systems.step.DetectorFile": CARRIER,
    "systems.step.MotionSample": CARRIER,
    "systems.step.StepDetector": ABSTRACT,
    "systems.step.StepEvent": CARRIER,
    "systems.step.StepTrace": CARRIER,
    "systems.step.SweepBatch": CARRIER,
    "survey.Beam": "holds settings; what uses them is `ground_profile`: test_survey_mounting.py",
    "survey.Ground": CARRIER,
    "survey.HeightFinder": "holds settings; what uses them is `step_height`",
    "survey.StepHeight": CARRIER,
    "survey.Calibration": CARRIER,
    "survey.PairEvent": CARRIER,
    "survey.SensorPair": "holds settings; what uses them is `pair_events`",
    "survey.calibrate": HOST + ": test_survey_mounting.py",
    "survey.detect_pair": HOST + "; what it compiles is `run`: test_survey_pair.py",
    "survey.pair_events": HOST + ": test_survey_pair.py",
    "survey.step_height": HOST + ": test_survey_height.py",
    "survey.step_heights": HOST + ": test_survey_height.py",
    "systems.step.detect": HOST + "; what it compiles is `run`",
    "systems.step.detect_series": HOST + "; what it compiles is `run_batch`'s blocks: test_step_lanes.py",
    "systems.step.dump_detector": "writes a file",
    "systems.step.load_detector": "reads a file",
    "systems.step.motion_at": HOST + ": test_step_motion.py",
    "systems.step.precision": "a context",
    "systems.step.stack": HOST,
    "systems.step.thin": HOST,
    "systems.step.with_mounting": HOST,
    "systems.step.time_steps": HOST,
}
