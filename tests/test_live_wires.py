"""What goes over the line, byte by byte, against another reading of its layout; and when a step is told."""

from __future__ import annotations

import struct

import pytest
from board import crc16, reply
from hypothesis import given
from hypothesis import strategies as st

from jaxradar.live.board import HOLD_S, Alarm, Fault, Told
from jaxradar.live.wires import Framed, Heard, Nucleo
from jaxradar.units import NANOSECONDS

MS = NANOSECONDS // 1000
FAULTS = st.sampled_from(range(128)).map(Fault)
TOLD = st.builds(
    Told,
    st.booleans(),
    st.integers(0, 0xFFFF),
    st.none() | st.floats(0, 100),
    st.none() | st.floats(-10, 10),
    FAULTS,
)


def test_the_lab_s_bytes() -> None:
    wire = Nucleo()
    assert (wire.tell(Told(), 0.02), wire.tell(Told(event=True), 0.02)) == (b"\x00", b"\x01")
    assert wire.hear(b"") == Heard(None, 0, 0)
    assert [wire.hear(bytes([byte])).acceleration_m_s2 for byte in (0, 128, 255)] == [-128.0, 0.0, 127.0]
    assert wire.hear(b"\x00\x8a") == Heard(10.0, 2, 0)


@given(told=TOLD, period_s=st.floats(1e-4, 1.0))
def test_a_frame_says_what_was_told(told: Told, period_s: float) -> None:
    wire = Framed()
    wire.tell(told, period_s)
    frame = wire.tell(told, period_s)
    assert frame[:4] == b"\xa5\x5a\x01\x0c"
    sequence, number, event, period_ms, impact, height, faults, crc = struct.unpack("<HHBBHhHH", frame[4:])
    assert crc == crc16(frame[2:16])
    assert (sequence, number, event, faults) == (2, told.number, told.event, told.faults)
    assert period_ms >= min(255, 1e3 * period_s)
    assert (impact == 0xFFFF) == (told.impact_in_s is None)
    if told.impact_in_s is not None:
        assert impact / 1e4 == pytest.approx(min(told.impact_in_s, 6.5534), abs=5.1e-5)
    assert (height == -0x8000) == (told.height_m is None)
    if told.height_m is not None:
        assert height / 1e4 == pytest.approx(min(max(told.height_m, -3.2767), 3.2767), abs=5.1e-5)


def test_the_checksum_is_the_one_of_its_name() -> None:
    assert crc16(b"123456789") == 0x29B1  # the check value of CRC-16/CCITT-FALSE


@given(
    parts=st.lists(st.tuples(st.binary(max_size=20), st.integers(-0x8000, 0x7FFF))),
    tail=st.binary(max_size=20),
    cuts=st.randoms(),
)
def test_frames_are_found_in_garbage_wherever_it_is_cut(
    parts: list[tuple[bytes, int]], tail: bytes, cuts: object
) -> None:
    """Nothing that is not one is taken for one; garbage may hide a frame only where it looks like the begin of one."""
    wire, found = Framed(), []
    noise = [garbage.replace(b"\xa5", b"\x00") for garbage, _ in parts]
    stream = b"".join(
        one + reply(place, value) for place, (one, (_, value)) in enumerate(zip(noise, parts, strict=True))
    )
    stream += tail.replace(b"\xa5", b"\x00")
    garbage = at = 0
    while at < len(stream):
        size = cuts.randint(1, 30)  # type: ignore[attr-defined]
        heard = wire.hear(stream[at : at + size])
        found.append(heard)
        garbage += heard.garbage
        at += size
    assert sum(heard.messages for heard in found) == len(parts)
    assert garbage == sum(map(len, noise)) + len(tail)
    told = {value for _, value in parts} - {-0x8000}
    assert {round(100 * one.acceleration_m_s2) for one in found if one.acceleration_m_s2 is not None} <= told


@given(st.binary(max_size=400))
def test_noise_is_no_frame(content: bytes) -> None:
    wire = Framed()
    for at in range(0, len(content), 7):
        assert wire.hear(content[at : at + 7]).messages == 0
    assert wire.hear(reply(1, 5) + reply(2, 7)).messages >= 1  # and the next ones are found


@given(place=st.integers(0, 11), flip=st.integers(1, 255))
def test_a_damaged_frame_is_none(place: int, flip: int) -> None:
    frame = bytearray(reply(3, 100))
    frame[place] ^= flip
    assert Framed().hear(bytes(frame)).messages == 0


def test_a_step_is_told_from_its_detection_until_its_impact() -> None:
    alarm = Alarm()
    assert alarm.at(0, Fault(0)) == Told()
    alarm.detected(10 * MS, 0.05)
    assert alarm.at(10 * MS, Fault(0)) == Told(True, 1, 0.05)
    assert alarm.at(40 * MS, Fault(0)) == Told(True, 1, 0.02)
    assert alarm.at(60 * MS, Fault(0)) == Told(False, 1)
    assert alarm.at(20 * MS, Fault(0)) == Told(False, 1)  # what is over stays over, even if the clock goes back
    alarm.detected(100 * MS, 0.0)
    assert alarm.at(100 * MS + round(HOLD_S * NANOSECONDS) - 1, Fault(0)) == Told(True, 2)
    assert alarm.at(100 * MS + round(HOLD_S * NANOSECONDS), Fault(0)) == Told(False, 2)


def test_a_set_hold_counts_instead_and_detections_do_not_shorten_one_another() -> None:
    alarm = Alarm(hold_s=0.2)
    alarm.detected(0, 0.05)
    assert alarm.at(49 * MS, Fault(0)) == Told(True, 1, 0.001)
    assert alarm.at(50 * MS, Fault(0)) == Told(True, 1)  # not 0 s, after which a board takes it to be over
    assert alarm.at(199 * MS, Fault(0)) == Told(True, 1)
    assert alarm.at(200 * MS, Fault(0)) == Told(False, 1)
    alarm = Alarm()
    alarm.detected(0, 0.3)
    alarm.detected(50 * MS, 0.1)
    assert alarm.at(299 * MS, Fault(0)).event
    assert not alarm.at(300 * MS, Fault(0)).event


@given(FAULTS)
def test_any_fault_but_the_recorder_s_is_safe(faults: Fault) -> None:
    alarm = Alarm()
    alarm.detected(0, 0.1)
    told = alarm.at(1, faults)
    assert told.faults == faults
    assert told.event == (faults in (Fault(0), Fault.RECORDER))
    assert alarm.at(2, Fault(0)).event  # it goes on when the fault is over, until the impact


def test_a_recording_s_clock_that_is_set_back_ends_what_was_told() -> None:
    """By more than a second: then the end of it may be hours away."""
    alarm = Alarm()
    alarm.detected(3600 * NANOSECONDS, 0.1)
    assert alarm.at(3600 * NANOSECONDS - MS, Fault(0)).event  # sensors of one moment are not of one time
    assert not alarm.at(0, Fault(0)).event
    alarm.detected(7200 * NANOSECONDS, 0.1)
    alarm.detected(0, 0.1)
    assert alarm.at(99 * MS, Fault(0)).event
    assert not alarm.at(100 * MS, Fault(0)).event


def test_an_impact_that_is_no_number_is_not_known() -> None:
    for impact_in_s in (float("inf"), float("nan")):
        alarm = Alarm()
        alarm.detected(0, impact_in_s)
        assert alarm.at(0, Fault(0)) == Told(True, 1)
        assert not alarm.at(round(HOLD_S * NANOSECONDS), Fault(0)).event
