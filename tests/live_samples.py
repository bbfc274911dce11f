"""Drives, and what is made of them sweep by sweep, for the tests of compiled and of live detection."""

from __future__ import annotations

import fcntl
import functools
import os
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from step_samples import echo, series

from jaxradar.drive import Channel, Drive, SensorSeries, SweepFlag, kept_bins
from jaxradar.drivefile import read_drive, write_drive
from jaxradar.live import LiveSweep, Replay
from jaxradar.live.artefact import Header
from jaxradar.live.detect import LiveDecision, LiveDetector
from jaxradar.systems.step import DetectorFile, StepTrace, detect, load_detector

FLOATS = ("range_m", "speed_m_s", "strength", "statistic", "impact_in_s")
# Of the real recordings, thinned to 128 bins as in the lab.
RECORDED_M = np.linspace(0.2, 0.8, 1240)[kept_bins(1240, 128)]
FLAGS = ("valid", "saturated", "event")


def once(name: str, make: Callable[[Path], Any]) -> Path:
    """A file or folder of that name, made by the first worker of this run that asks for it."""
    folder = Path(os.environ["JAXRADAR_TESTS_SHARED"])
    with (folder / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (folder / name).exists():
            make(folder / name)
    return folder / name


def _simulated(path: Path) -> None:
    from jaxradar.sim import load_scene, simulate

    write_drive(simulate(load_scene(path.stem), 0), path)


@functools.cache
def ready_drive(scene: str = "kerb-down") -> Drive:
    """A ready scene, with yaw rate, and with all that can befall a sweep: lost, silent, saturated, late, at once."""
    drive = read_drive(once(f"{scene}.drive", _simulated))
    one = drive.sensors[0]
    sweeps, flags, times = one.sweeps.copy(), one.flags.copy(), one.times_ns.copy()
    flags[60:64] |= np.uint16(SweepFlag.MISSED_DATA)
    flags[90] |= np.uint16(SweepFlag.COMMUNICATION_ERROR)
    sweeps[120:123] = 0
    sweeps[150:155, 40:60] = 65535
    flags[150:155] |= np.uint16(SweepFlag.SATURATED)
    times[200:] += 500_000_000
    times[230] = times[229]
    times[240] = times[239] - 1_000_000
    yaw = Channel(times[::10].copy(), np.linspace(-0.2, 0.2, len(times[::10])))
    return replace(
        drive,
        sensors=(replace(one, sweeps=sweeps, flags=flags, times_ns=times),),
        motion=replace(drive.motion, yaw_rate_rad_s=yaw),
    )


def wandering(sensors: tuple[int, ...] = (1, 3), count: int = 90) -> Drive:
    """An echo that jumps now and then, at other sweeps for each sensor, in whole microseconds and counts."""
    parts = []
    for number in sensors:
        jumped = np.cumsum(np.arange(count) % (17 + number) == 5)
        one = series([echo(0.3 + 0.03 * place) for place in jumped])
        parts.append(replace(one, sensor=number, times_ns=one.times_ns + 1_000_000 * number - 1_000_000 * sensors[0]))
    return Drive(tuple(parts))


def eager(name: str, sample: SensorSeries) -> Any:
    """A detector by its name that finds something: its threshold is half of the largest statistic on a sample."""
    detector = load_detector(name).detector
    return detector.with_threshold(0.5 * float(detect(detector, sample).statistic.max()))


def wanted(name: str) -> Any:
    """The detector of an exported file: those of a ready scene find something there."""
    recorded = name.removeprefix("recorded-")
    return eager(name, _sample(name)) if recorded == name else load_detector(recorded).detector


def _sample(name: str) -> SensorSeries:
    return (wandering() if name == "thesis" else ready_drive()).sensors[0]


# What is compiled once for all tests, by name: a detector and the range axis that it is for.
EXPORTS: dict[str, Callable[[], tuple[DetectorFile, np.ndarray]]] = {
    name: lambda name=name: (DetectorFile(wanted(name)), _sample(name).range_m)
    for name in ("thesis", "filtered-rate", "default")
} | {
    name: lambda name=name: (DetectorFile(wanted(name)), RECORDED_M)
    for name in ("recorded-filtered-rate", "recorded-default")
}


def exported(name: str) -> Path:
    """One of `EXPORTS` as a file that runs on this machine; skips the test where there is no IREE."""
    from jaxradar.export import export_detector, write_archive

    pytest.importorskip("iree.compiler", reason="IREE's compiler is not installed")
    pytest.importorskip("iree.runtime", reason="IREE's runtime is not installed")
    return once(f"{name}.pyz", lambda path: write_archive(path, export_detector(*EXPORTS[name]())))


def live_detector(detector: Any, sample: SensorSeries) -> LiveDetector:
    """As `jaxradar live --detector NAME` makes it: by JAX."""
    from jaxradar.export import JaxStep
    from jaxradar.export.make import header_of
    from jaxradar.systems.step import RangeAxis
    from jaxradar.systems.step.packed import PackedStep

    step = PackedStep(detector, RangeAxis.of(sample.range_m), sample.sweeps.dtype)
    header = header_of(DetectorFile(detector), step, kind="jax", target="host", sensors=(), versions={})
    return LiveDetector(header, JaxStep.of_step(step))


def compiled_detector(path: Any) -> tuple[Header, LiveDetector]:
    """Out of an exported file, run by IREE; begun anew."""
    from jaxradar.live.app import load

    header, program = load(str(path))
    return header, LiveDetector(header, program)


def taken(detector: LiveDetector, drive: Drive) -> dict[int, list[LiveDecision]]:
    """All decisions on a drive, of each sensor in its order."""
    found: dict[int, list[LiveDecision]] = {one.sensor: [] for one in drive.sensors}
    with Replay(drive, pace=None) as source:
        for live in source:
            found[live.sensor].append(detector.take(live))
    return found


def through(detector: LiveDetector, sweeps: Iterable[LiveSweep]) -> list[LiveDecision]:
    return [detector.take(live) for live in sweeps]


def assert_as_detected(found: list[LiveDecision], trace: StepTrace, tolerance: float = 1e-5) -> None:
    """Flags equal; numbers within `tolerance` of the largest of their kind."""
    for name in FLAGS:
        wanted = np.isin(np.arange(len(found)), [event.sweep for event in trace.events])
        wanted = wanted if name == "event" else getattr(trace, name)
        np.testing.assert_array_equal([getattr(one, name) for one in found], wanted, err_msg=name)
    for name in FLOATS:
        numbers = np.array([getattr(one, name) for one in found])
        held = np.array(trace.valid) if name in ("range_m", "speed_m_s", "strength") else np.ones(len(found), bool)
        wanted = np.asarray(getattr(trace, name))[held]
        assert np.isfinite(numbers).all(), name
        largest = max(np.abs(wanted).max(initial=0.0), 1e-9)
        np.testing.assert_allclose(numbers[held], wanted, rtol=0, atol=tolerance * largest, err_msg=name)
    assert [one.place for one in found] == list(range(len(found)))


def assert_same_events(found: list[dict[str, Any]], wanted: list[dict[str, Any]]) -> None:
    """Of two records of detections: the same fields, whole numbers equal, others but for rounding."""
    assert len(found) == len(wanted)
    for one, other in zip(found, wanted, strict=True):
        assert {key: value is None for key, value in one.items()} == {
            key: value is None for key, value in other.items()
        }
        assert (one["sensor"], one["sweep"]) == (other["sensor"], other["sweep"])
        given = {key: value for key, value in one.items() if value is not None}
        assert given == pytest.approx({key: other[key] for key in given}, rel=1e-5)
