"""Detectors compiled for the device: what they decide, held against JAX, and what is made when that does not hold."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live_samples import (
    EXPORTS,
    assert_as_detected,
    compiled_detector,
    exported,
    ready_drive,
    taken,
    wandering,
    wanted,
)
from step_samples import RANGE_M

from jaxradar._errors import ConfigError
from jaxradar.drive import SweepFlag
from jaxradar.export import TARGETS, archive_bytes, export_detector, iree, make
from jaxradar.export.check import check_sweeps, differing, reference
from jaxradar.export.iree import CompilerError, compile_program
from jaxradar.live.artefact import read_artefact
from jaxradar.live.program import Program
from jaxradar.systems.step import DetectorFile, RangeAxis, detect, dump_detector, load_detector
from jaxradar.systems.step.packed import DECISION_FIELDS, PackedStep

NAMES = ("thesis", "filtered-rate", "default")


def drive_of(name: str) -> Any:
    return wandering() if name == "thesis" else ready_drive()


@pytest.mark.parametrize("name", NAMES)
def test_the_compiled_detector_decides_as_the_package(name: str) -> None:
    _, detector = compiled_detector(exported(name))
    drive = drive_of(name)
    found = taken(detector, drive)
    for one in drive.sensors:
        trace = detect(wanted(name), one)
        assert trace.events
        assert_as_detected(found[one.sensor], trace)
    assert detector.misfits == 0


@pytest.mark.parametrize("name", NAMES)
def test_a_compiled_detector_is_small(name: str) -> None:
    file = exported(name)
    assert file.stat().st_size <= 300_000
    assert len(read_artefact(file).program) <= 100_000
    assert file.stat().st_mode & 0o100


@pytest.mark.parametrize("name", NAMES)
def test_the_header_says_what_it_is(name: str) -> None:
    file, range_m = EXPORTS[name]()
    header = read_artefact(exported(name)).header
    assert header.detector == name
    assert header.config == dump_detector(file)
    np.testing.assert_array_equal(header.range_m, range_m)
    step = PackedStep(file.detector, RangeAxis.of(range_m))
    np.testing.assert_array_equal(header.first_state, step.initial())
    assert (header.first_state.dtype, header.inputs) == (step.dtype, step.inputs)
    assert header.threshold == float(file.detector.threshold)
    assert (header.sweeps, header.target, header.kind, header.sensors) == ("uint16", "host", "iree", ())
    assert set(header.versions) == {"jaxradar", "jax", "iree"}


def test_instances_share_the_program_and_not_the_state() -> None:
    artefact = read_artefact(exported("filtered-rate"))
    header = artefact.header
    first = Program(artefact.program, header.first_state, header.inputs, len(header.decision))
    sweeps = ready_drive().sensors[0].sweeps
    for row in sweeps[:20]:
        first.inputs[: header.bins] = row
        first.inputs[header.bins + 1] = 0.01
        first.run()
    other = first.another()
    np.testing.assert_array_equal(other.state(), header.first_state)
    held = first.state()
    assert not np.array_equal(held, header.first_state)
    assert not other.inputs.any()
    decisions = [other.run(), other.run()]
    np.testing.assert_array_equal(first.state(), held)
    assert decisions[0] is not decisions[1]
    decisions[0][:] = np.nan  # what was given out is not what the program writes to
    assert np.isfinite(other.run()).all()


def test_one_input_gives_the_same_bytes() -> None:
    pytest.importorskip("iree.compiler")
    again = archive_bytes(export_detector(*EXPORTS["thesis"]()))
    assert again == exported("thesis").read_bytes()


@pytest.mark.parametrize("target", sorted(set(TARGETS) - {"host"}))
def test_for_another_processor(target: str) -> None:
    """Compiled here, and not run: refused in plain words on a machine that it is not for."""
    pytest.importorskip("iree.compiler")
    step = PackedStep(load_detector("filtered-rate").detector, RangeAxis.of(RANGE_M))
    made = compile_program(step.lowered().as_text(), target, single=True)
    assert len(made) <= 100_000
    with pytest.raises(ConfigError, match="compiled for another processor"):
        Program(made, step.initial(), step.inputs, len(DECISION_FIELDS))


def rate_step() -> PackedStep:
    return PackedStep(load_detector("filtered-rate").detector, RangeAxis.of(RANGE_M))


def test_the_check_notices_another_threshold() -> None:
    """The program of one detector against what another one decides: all, some and none of the sweeps differ."""
    artefact = read_artefact(exported("filtered-rate"))
    step = PackedStep(wanted("filtered-rate"), RangeAxis.of(np.array(artefact.header.range_m)))
    inputs = check_sweeps(step, None)
    assert differing(step, artefact.program, inputs, reference(step, inputs)) == 0.0
    expected = reference(step, inputs).copy()
    place = DECISION_FIELDS.index("statistic")
    expected[:60, place] += 0.01 * np.abs(expected[:, place]).max()
    assert differing(step, artefact.program, inputs, expected) == pytest.approx(0.1, abs=0.01)
    expected = reference(step, inputs).copy()
    expected[5, DECISION_FIELDS.index("event")] = 1 - expected[5, DECISION_FIELDS.index("event")]
    assert differing(step, artefact.program, inputs, expected) == 1.0


def test_the_sweeps_of_the_check_hold_all_that_can_befall_one() -> None:
    step = rate_step()
    sample = np.full((700, 128), 7, np.uint16)
    inputs = check_sweeps(step, sample)
    assert inputs.shape == (1200, step.inputs)
    assert inputs.dtype == step.dtype
    assert set(np.unique(inputs[:, 128])) == {0.0, SweepFlag.MISSED_DATA, SweepFlag.SATURATED}
    assert (inputs[:600, :128].max(), inputs[:, :128].min()) == (65535.0, 0.0)
    np.testing.assert_array_equal(inputs[600:, :128], sample[:600])
    np.testing.assert_array_equal(inputs, check_sweeps(step, sample))
    decided = reference(step, inputs[:600])
    assert 0 < decided[:, DECISION_FIELDS.index("event")].sum() < 600


@pytest.mark.parametrize("how", ["refused", "wrong"])
def test_where_one_dispatch_does_not_hold_it_is_compiled_the_usual_way(
    how: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """In both cases: the compiler does not take it, and what it makes of it is something else."""
    monkeypatch.setattr(make, "compiler_version", lambda: "3.13.0")
    tried = []

    def compiled(text: str, target: str, *, single: bool) -> bytes:
        tried.append((target, single))
        if single and how == "refused":
            raise CompilerError("no such thing")
        return b"single" if single else b"usual"

    monkeypatch.setattr(make, "compile_program", compiled)
    monkeypatch.setattr(make, "differing", lambda step, program, *_: 0.5 if program == b"single" else 0.0)
    made = export_detector(DetectorFile(load_detector("filtered-rate").detector), RANGE_M, target="aarch64-cortex-a53")
    assert made.program == b"usual"
    assert tried == [("host", True), ("host", False), ("aarch64-cortex-a53", False)]
    assert made.header.target == "aarch64-cortex-a53"
    (warning,) = caplog.messages
    assert {"refused": "no such thing", "wrong": "of 50.0% of the sweeps"}[how] in warning


def test_nothing_is_given_out_that_does_not_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(make, "compiler_version", lambda: "3.13.0")
    monkeypatch.setattr(make, "compile_program", lambda *_, **__: b"")
    monkeypatch.setattr(make, "differing", lambda *_: 0.011)
    with pytest.raises(ConfigError, match=r"does not take this detector: .* says something else .* 1\.1%"):
        export_detector(DetectorFile(load_detector("filtered-rate").detector), RANGE_M)


def test_the_usual_way_holds_too(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    """Where the compiler's text is not as known, in earnest."""
    pytest.importorskip("iree.compiler")
    monkeypatch.setattr(iree, "_FUNCTION", "  func.unknown @main(")
    made = export_detector(DetectorFile(load_detector("filtered-rate").detector), RANGE_M)
    assert "found no function `main`" in caplog.text
    step = rate_step()
    inputs = check_sweeps(step, None, seed=3)
    assert differing(step, made.program, inputs, reference(step, inputs)) == 0.0


@pytest.mark.parametrize(("name", "text"), [("_one_region", "module {}"), ("_untiled", "no pipeline here")])
def test_a_text_that_is_not_as_known_is_the_compilers_error(name: str, text: str) -> None:
    with pytest.raises(CompilerError, match="found no"):
        getattr(iree, name)(text)


def test_what_cannot_be_compiled_is_said_in_the_compilers_words() -> None:
    pytest.importorskip("iree.compiler")
    with pytest.raises(CompilerError, match="error"):
        compile_program("func @nonsense", "host", single=False)


def test_no_program_is_refused_in_plain_words() -> None:
    pytest.importorskip("iree.runtime")
    with pytest.raises(ConfigError, match="the compiled detector does not run here"):
        Program(b"nothing at all", np.zeros(3, np.float32), 4, 8)


def test_unknown_targets_and_kinds_are_refused_before_any_work(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(make, "PackedStep", lambda *_: pytest.fail("began"))
    file = DetectorFile(load_detector("thesis").detector)
    for kind in ("iree", "jax"):
        with pytest.raises(ConfigError, match=r"unknown target `z80`; expected host, aarch64-cortex-a53"):
            export_detector(file, RANGE_M, target="z80", kind=kind)
    with pytest.raises(ValueError, match="must be one of iree, jax; got 'onnx'"):
        export_detector(file, RANGE_M, kind="onnx")


def test_for_those_who_have_jax(tmp_path: Path) -> None:
    pytest.importorskip("flatbuffers")
    from jaxradar.export import JaxStep, write_archive
    from jaxradar.live.detect import LiveDetector

    file, range_m = EXPORTS["thesis"]()
    artefact = export_detector(file, range_m, kind="jax", sensors=(1, 3))
    write_archive(tmp_path / "step.pyz", artefact)
    read = read_artefact(tmp_path / "step.pyz")
    assert read == artefact
    assert read.header.sensors == (1, 3)
    assert not (tmp_path / "step.pyz").stat().st_mode & 0o100  # there is no program for Python in it
    found = taken(LiveDetector(read.header, JaxStep.of_artefact(read)), wandering())
    for one in wandering().sensors:
        assert_as_detected(found[one.sensor], detect(file.detector, one))
    with pytest.raises(ConfigError, match="this version of JAX does not take the compiled detector"):
        JaxStep.of_artefact(dataclasses.replace(read, program=read.program[:50]))
