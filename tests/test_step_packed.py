"""One sweep as a program of plain vectors decides what `detect` decides."""

from __future__ import annotations

import dataclasses
import re
from typing import Any

import jax
import numpy as np
import pytest
from live_samples import assert_as_detected, eager, live_detector, ready_drive, taken
from step_samples import RANGE_M

from jaxradar import Motion
from jaxradar.drive import SweepFlag
from jaxradar.export.check import check_sweeps
from jaxradar.live.detect import LiveDecision
from jaxradar.systems.step import DETECTORS, RangeAxis, detect, load_detector, motion_at, precision, time_steps
from jaxradar.systems.step.packed import DECISION_FIELDS, PackedStep

MOVED = sorted(name for name in DETECTORS if DETECTORS[name].uses_motion)


def packed(name: str, bins: int = 128) -> PackedStep:
    return PackedStep(load_detector(name).detector, RangeAxis.of(RANGE_M[:bins]))


@pytest.mark.parametrize("name", DETECTORS)
def test_sweep_by_sweep_as_over_the_whole_series(name: str) -> None:
    """Without motion, as a live source has none."""
    drive = dataclasses.replace(ready_drive(), motion=Motion())
    one = drive.sensors[0]
    detector = eager(name, one)
    trace = detect(detector, one)
    assert trace.events
    assert not trace.valid[60:64].any()
    assert trace.saturated[150:155].all()
    assert_as_detected(taken(live_detector(detector, one), drive)[one.sensor], trace)


@pytest.mark.parametrize("name", MOVED)
def test_motion_goes_in_behind_the_time_where_it_is_used(name: str) -> None:
    drive = ready_drive()
    one = drive.sensors[0]
    detector = eager(name, one)
    step = PackedStep(detector, RangeAxis.of(one.range_m))
    assert step.motion[-3:] == ("acceleration_known", "yaw_rate_known", "speed_known")
    first = step.initial()
    program = jax.jit(lambda rows: jax.lax.scan(lambda *held: step(*held), first, rows)[1])
    alone = detect(detector, one).statistic
    for motion in (drive.motion, Motion(speed_m_s=drive.motion.speed_m_s), Motion()):
        moved = [np.asarray(getattr(motion_at(motion, one.times_ns), field)) for field in step.motion]
        inputs = np.column_stack([one.sweeps, one.flags, time_steps(one.times_ns), *moved]).astype(step.dtype)
        assert inputs.shape[1] == step.inputs
        rows = np.asarray(program(inputs))
        found = [LiveDecision(one.sensor, at, 0, *row[:5], *(row[5:] > 0)) for at, row in enumerate(rows)]
        trace = detect(detector, one, motion)
        assert_as_detected(found, trace)
        assert np.allclose(trace.statistic, alone) == (motion.speed_m_s is None)


@pytest.mark.parametrize("name", DETECTORS)
def test_the_lowered_program_is_plain(name: str) -> None:
    """No call out of the program, vectors in and out, and no processor's own form of a reduction."""
    step = packed(name)
    text = step.lowered().as_text()
    assert "custom_call" not in text
    assert "optimization_barrier" not in text
    element = "f64" if DETECTORS[name].float64 else "f32"
    shape = rf"tensor<{step.initial().size}x{element}>"
    assert re.search(rf"@main\(%arg0: {shape}[^,]*, %arg1: tensor<{step.inputs}x{element}>", text)
    assert step.lowered().as_text() == text  # the same each time, as files of one detector should be


@pytest.mark.parametrize("name", ["thesis", "lab-live"])
def test_what_chooses_in_double_precision_has_double_vectors(name: str) -> None:
    step = packed(name)
    assert step.dtype == np.float64
    assert step.initial().dtype == np.float64
    assert not jax.config.jax_enable_x64
    with precision(step.detector):
        state, decision = step.program()(step.initial(), np.ones(step.inputs))
    assert (state.dtype, decision.dtype) == (np.float64, np.float64)


@pytest.mark.parametrize("name", DETECTORS)
def test_the_first_state_is_the_detectors_own_and_finite(name: str) -> None:
    step = packed(name)
    with precision(step.detector):
        leaves = jax.tree.leaves(step.detector.init(step.axis))
    assert step.initial().size == sum(np.size(leaf) for leaf in leaves)
    assert np.isfinite(step.initial()).all()
    assert step.initial().dtype == step.dtype
    assert step.inputs == 128 + 2 + len(step.motion)


@pytest.mark.parametrize("name", ["range-rate", "thesis"])
@pytest.mark.parametrize("flag", SweepFlag)
def test_every_flag_arrives(name: str, flag: SweepFlag) -> None:
    step = packed(name)
    inputs = np.zeros(step.inputs, step.dtype)
    inputs[:128] = 100 + np.arange(128)
    inputs[128] = flag
    with precision(step.detector):
        _, decision = step.program()(step.initial(), inputs)
    said: dict[str, Any] = dict(zip(DECISION_FIELDS, np.asarray(decision), strict=True))
    assert said["valid"] == (not flag & SweepFlag.INVALID)
    assert said["saturated"] == (said["valid"] and flag == SweepFlag.SATURATED)


@pytest.mark.parametrize("dtype", ["uint16", "float32"])
def test_amplitudes_enter_as_they_were_recorded(dtype: str) -> None:
    """Sixteen bits are whole in single precision, up to full scale."""
    step = dataclasses.replace(packed("filtered-rate"), sweeps=np.dtype(dtype))
    inputs = np.zeros(step.inputs, step.dtype)
    inputs[70] = 65535
    _, decision = step.program()(step.initial(), inputs)
    assert np.asarray(decision)[0] == pytest.approx(RANGE_M[70], abs=1e-6)


@pytest.mark.filterwarnings("error")
def test_amplitudes_of_64_bits_enter_without_a_warning() -> None:
    """In single precision, as a program over a whole log takes them."""
    step = dataclasses.replace(packed("filtered-rate"), sweeps=np.dtype(np.float64))
    inputs = check_sweeps(step, np.full((3, 128), 1e300))
    assert np.isinf(inputs[600:, :128]).all()
    _, decision = step.program()(step.initial(), inputs[0])
    assert np.isfinite(decision).all()


def test_amplitudes_that_no_sweep_has_are_refused() -> None:
    with pytest.raises(ValueError, match=r"must be uint16, float32 or float64; got int32"):
        dataclasses.replace(packed("thesis"), sweeps=np.dtype(np.int32))


def test_what_jax_export_writes_decides_the_same() -> None:
    pytest.importorskip("flatbuffers")
    from jax import export

    step = packed("thesis")
    inputs = np.append(np.arange(128.0), [0.0, 0.01])
    program = export.deserialize(bytearray(step.exported()))
    with precision(step.detector):
        for found, wanted in zip(
            program.call(step.initial(), inputs), step.program()(step.initial(), inputs), strict=True
        ):
            np.testing.assert_array_equal(found, wanted)
