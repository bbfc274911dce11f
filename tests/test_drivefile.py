"""The binary form of a drive: lossless, and whole up to the last whole sweep after a crash at any byte."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from log_samples import assert_drives_equal, assert_series_equal, drives, sample_drive

from jaxradar._errors import LogError
from jaxradar.drive import Drive, Mounting, SensorSeries, Truth
from jaxradar.drivefile import DriveWriter, SensorLayout, read_drive, write_drive
from jaxradar.drivefile.layout import is_mapped

AXIS = np.array([0.1, 0.2, 0.3])
LAYOUT = SensorLayout(3, AXIS)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(drive=drives())
def test_every_field_comes_back_equal(drive: Drive, tmp_path: Path) -> None:
    target = tmp_path / "any.drive"
    write_drive(drive, target, overwrite=True)
    assert_drives_equal(read_drive(target, verify=True), drive)


def test_sweeps_are_read_only_page_aligned_maps(tmp_path: Path) -> None:
    drive = sample_drive()
    write_drive(drive, tmp_path / "a.drive")
    sweeps = read_drive(tmp_path / "a.drive").series(3).sweeps
    assert is_mapped(sweeps)
    assert not sweeps.flags.writeable
    assert sweeps.ctypes.data % 4096 == 0
    assert (tmp_path / "a.drive" / "3.sweeps").read_bytes() == drive.series(3).sweeps.tobytes()


def test_layout_is_as_documented(tmp_path: Path) -> None:
    with DriveWriter(tmp_path / "a.drive", [LAYOUT], motion=["speed_m_s"]) as writer:
        writer.append(3, 5, np.array([1, 2, 515], np.uint16), 2)
        writer.append_motion("speed_m_s", 7, 1.5)
    row = b"\x01\x00\x02\x00\x03\x02"
    head = b"\x05\0\0\0\0\0\0\0" + b"\x02\0\0\0"
    assert (tmp_path / "a.drive/3.sweeps").read_bytes() == row
    assert (tmp_path / "a.drive/3.index").read_bytes() == head + zlib.crc32(head + row).to_bytes(4, "little")
    sample = b"\x07\0\0\0\0\0\0\0" + np.float64(1.5).tobytes() + bytes(4)
    assert (tmp_path / "a.drive/speed_m_s.motion").read_bytes() == sample + zlib.crc32(sample).to_bytes(4, "little")
    text = (tmp_path / "a.drive/header.json").read_bytes()
    header = json.loads(text)
    assert header["sealed"]["3.sweeps"] == {"bytes": 6, "crc32": zlib.crc32(row)}
    lines = text.splitlines(keepends=True)
    assert lines[-2:] == [b' "checksum": %d\n' % zlib.crc32(b"".join(lines[:-2])), b"}\n"]
    assert header["checksum"] == zlib.crc32(b"".join(lines[:-2]))


def test_times_on_the_recorders_clock_count_from_the_first_sweep_of_any_sensor(tmp_path: Path) -> None:
    start = 86_400_000_000_000 + 1
    with DriveWriter(
        tmp_path / "a.drive", [LAYOUT, SensorLayout(1, AXIS)], motion=["speed_m_s"], started_at_ns=9
    ) as writer:
        writer.append(3, [start + 7, start + 10_000_007], np.zeros((2, 3), np.uint16))
        writer.append(1, start, np.ones(3, np.uint16))
        writer.append_motion("speed_m_s", start - 1, 3.0)
        writer.set(truth=Truth(()), mounting=Mounting(0.35), started_at_ns=123)
    drive = read_drive(tmp_path / "a.drive")
    assert drive.series(3).times_ns.tolist() == [7, 10_000_007]
    assert drive.series(1).times_ns.tolist() == [0]
    assert drive.motion.speed_m_s is not None
    assert drive.motion.speed_m_s.times_ns.tolist() == [-1]
    assert (drive.clock_start_ns, drive.started_at_ns) == (start, 123)
    assert (drive.truth, drive.mounting) == (Truth(()), Mounting(0.35))
    assert drive.problems == ()


def _recording(path: Path, sweeps: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """An unclosed recording of sensor 3 and of speed, as a crash leaves it."""
    rows = np.random.default_rng(3).integers(0, 65536, (sweeps, 3)).astype(np.uint16)
    times = np.arange(sweeps, dtype=np.int64) * 20_000_000
    writer = DriveWriter(path, [LAYOUT], motion=["speed_m_s"])
    for time, row in zip(times, rows, strict=True):
        writer.append(3, time, row)
        writer.append_motion("speed_m_s", time, time / 1e9)
    for file in writer._files.values():
        file.close()
    return times, rows


TAILS = {"cut": b"", "zeros": bytes(40), "garbage": b"\xa5" * 7}
FILES = {"3.sweeps": 6, "3.index": 16, "speed_m_s.motion": 24}


@pytest.mark.parametrize("tail", TAILS)
@pytest.mark.parametrize("name", FILES)
def test_a_crash_at_any_byte_leaves_every_whole_sweep(name: str, tail: str, tmp_path: Path) -> None:
    times, rows = _recording(tmp_path / "whole.drive")
    content = (tmp_path / "whole.drive" / name).read_bytes()
    for length in range(len(content) + 1):
        torn = tmp_path / "torn.drive"
        shutil.copytree(tmp_path / "whole.drive", torn)
        (torn / name).write_bytes(content[:length] + TAILS[tail])
        drive = read_drive(torn)
        kept = length // FILES[name]
        series, speed = drive.series(3), drive.motion.speed_m_s
        assert speed is not None
        wanted, samples = (4, kept) if name == "speed_m_s.motion" else (kept, 4)
        np.testing.assert_array_equal(series.sweeps, rows[:wanted])
        np.testing.assert_array_equal(series.times_ns, times[:wanted])
        np.testing.assert_array_equal(speed.values, times[:samples] / 1e9)
        assert any(name in problem for problem in drive.problems) == bool(length % FILES[name] or TAILS[tail])
        with DriveWriter.reopen(torn) as writer:
            writer.append(3, 10**9, np.full(3, 9, np.uint16))
        again = read_drive(torn, verify=True)
        assert len(again.series(3)) == wanted + 1
        assert again.series(3).sweeps[-1].tolist() == [9, 9, 9]
        np.testing.assert_array_equal(again.series(3).sweeps[:-1], rows[:wanted])
        assert len(again.problems) == len(drive.problems) - 1  # closed now, but what was cut stays said
        shutil.rmtree(torn)


def test_a_closed_drive_that_lost_its_tail_says_so(tmp_path: Path) -> None:
    write_drive(sample_drive(), tmp_path / "a.drive")
    os.truncate(tmp_path / "a.drive/3.sweeps", 4 * 8 + 1)
    drive = read_drive(tmp_path / "a.drive")
    assert_series_equal(
        drive.series(3),
        replace(
            (whole := sample_drive().series(3)),
            times_ns=whole.times_ns[:4],
            sweeps=whole.sweeps[:4],
            flags=whole.flags[:4],
        ),
    )
    assert "3.sweeps: 1 of 33 bytes after 4 whole records" in drive.problems[1]
    assert "3.index: 16 of 80 bytes after 4 whole records" in drive.problems[2]
    assert "33 bytes where the closed drive had 40" in drive.problems[3]


def test_verify_finds_one_wrong_bit(tmp_path: Path) -> None:
    write_drive(sample_drive(), tmp_path / "a.drive")
    content = bytearray((tmp_path / "a.drive/1.sweeps").read_bytes())
    content[11] ^= 4
    (tmp_path / "a.drive/1.sweeps").write_bytes(content)
    assert len(read_drive(tmp_path / "a.drive").series(1)) == 5
    with pytest.raises(LogError, match=r"1\.sweeps: has checksum \d+ where \d+ is stated"):
        read_drive(tmp_path / "a.drive", verify=True)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"version": 1', '"version": 2', "has version 2; this program reads version 1"),
        ('"jaxradar.drive"', '"other"', "holds format 'other'; expected 'jaxradar.drive'"),
        ('"PROFILE_2"', '"PROFILE_3"', r"has checksum \d+, but says that it should be \d+"),
        ("{", "", "is not JSON"),
        ('"height_m": 0.35', '"height_m": NaN', "not finite"),
    ],
)
def test_a_damaged_header_is_refused(old: str, new: str, message: str, tmp_path: Path) -> None:
    write_drive(sample_drive(), tmp_path / "a.drive")
    header = tmp_path / "a.drive" / "header.json"
    text = header.read_text()
    assert old in text
    header.write_text(text.replace(old, new, 1))
    with pytest.raises(LogError, match=message) as caught:
        read_drive(tmp_path / "a.drive")
    assert caught.value.path == str(header)


def test_a_header_cut_at_any_byte_is_refused(tmp_path: Path) -> None:
    write_drive(sample_drive(1, 2, sensors=(1,)), tmp_path / "a.drive")
    content = (tmp_path / "a.drive/header.json").read_bytes()
    for length in range(len(content)):
        (tmp_path / "a.drive/header.json").write_bytes(content[:length])
        with pytest.raises(LogError):
            read_drive(tmp_path / "a.drive")


def test_missing_column_and_missing_drive_are_named(tmp_path: Path) -> None:
    write_drive(sample_drive(), tmp_path / "a.drive")
    (tmp_path / "a.drive/3.index").unlink()
    with pytest.raises(LogError, match=r"3\.index: cannot be read: No such file"):
        read_drive(tmp_path / "a.drive")
    with pytest.raises(LogError, match=r"none\.drive.header\.json: cannot be read"):
        read_drive(tmp_path / "none.drive")


def test_nothing_there_is_lost(tmp_path: Path) -> None:
    one, other = sample_drive(2), sample_drive(3)
    write_drive(one, tmp_path / "a.drive")
    with pytest.raises(LogError, match="exists already"):
        write_drive(other, tmp_path / "a.drive")
    broken = replace(other, sensors=(replace(other.sensors[0], spec={"what": object()}),))
    with pytest.raises(TypeError):
        write_drive(broken, tmp_path / "a.drive", overwrite=True)
    assert_drives_equal(read_drive(tmp_path / "a.drive"), one)
    write_drive(other, tmp_path / "a.drive", overwrite=True)
    assert_drives_equal(read_drive(tmp_path / "a.drive"), other)
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos/cat.jpg").write_text("cat")
    with pytest.raises(LogError, match="left alone"):
        write_drive(one, tmp_path / "photos", overwrite=True)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.drive", "photos"]


def test_the_writer_refuses_what_does_not_fit(tmp_path: Path) -> None:
    with DriveWriter(tmp_path / "a.drive", [LAYOUT], motion=["speed_m_s"]) as writer:
        for arguments in (
            (3, 0, np.zeros(4, np.uint16)),
            (3, 0, np.zeros(3, np.int64)),
            (3, [0, 1], np.zeros((1, 3), np.uint16)),
            (3, 0.5, np.zeros(3, np.uint16)),
            (1, 0, np.zeros(3, np.uint16)),
        ):
            with pytest.raises(ValueError, match="DriveWriter"):
                writer.append(*arguments)
        with pytest.raises(ValueError, match="knows mounting"):
            writer.set(sensors=())
    with pytest.raises(ValueError, match="closed"):
        writer.append(3, 0, np.zeros(3, np.uint16))
    with pytest.raises(ValueError, match="different sensor numbers"):
        DriveWriter(tmp_path / "b.drive", [LAYOUT, LAYOUT])
    with pytest.raises(ValueError, match="knows acceleration_m_s2"):
        DriveWriter(tmp_path / "b.drive", [LAYOUT], motion=["heave"])
    with pytest.raises(LogError, match="exists already"):
        DriveWriter(tmp_path / "a.drive", [LAYOUT])
    assert len(read_drive(tmp_path / "a.drive").series(3)) == 0


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
def test_a_full_disk_cuts_the_drive_before_the_call_that_failed(tmp_path: Path) -> None:
    writer = DriveWriter(tmp_path / "a.drive", [LAYOUT])
    writer.append(3, 0, np.ones(3, np.uint16))

    whole = writer._files["3.index"]
    with Path("/dev/full").open("ab", buffering=0) as full, pytest.raises(LogError, match="No space left"):
        writer._files["3.index"] = full
        writer.append(3, 1, np.ones(3, np.uint16))
    writer._files["3.index"] = whole
    writer.append(3, 2, np.full(3, 2, np.uint16))
    writer.close()
    series = read_drive(tmp_path / "a.drive", verify=True).series(3)
    assert (series.times_ns.tolist(), series.sweeps[:, 0].tolist()) == ([0, 2], [1, 2])


def test_needs_numpy_alone() -> None:
    code = (
        "import sys, jaxradar.drivefile; "
        "print([name for name in ('jax', 'h5py', 'pyarrow', 'equinox') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_large_times_and_many_sweeps(tmp_path: Path) -> None:
    times = 86_400_000_000_000 + np.arange(20_000, dtype=np.int64) * 3_333_333
    rows = np.random.default_rng(0).integers(0, 65536, (20_000, 128)).astype(np.uint16)
    drive = Drive((SensorSeries(1, times, rows, np.arange(128.0), np.zeros(20_000, np.uint16)),))
    write_drive(drive, tmp_path / "a.drive")
    assert_drives_equal(read_drive(tmp_path / "a.drive", verify=True), drive)
