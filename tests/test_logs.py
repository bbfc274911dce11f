"""Reading by kind, finding, and writing: what goes out comes back."""

from __future__ import annotations

import json
import os
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from log_samples import FIGURE_TEXT, assert_drives_equal, lab_text, recordings, sample_drive

from jaxradar._errors import LogError
from jaxradar.drive import Channel, Drive, Motion, Mounting, RoadStep, SensorSeries, SweepFlag, Truth
from jaxradar.logs import find_logs, read_log, write_log


def _series(sweeps: np.ndarray, **changes: object) -> SensorSeries:
    count, bins = sweeps.shape
    times = np.arange(count, dtype=np.int64) * 10_000_000
    series = SensorSeries(3, times, sweeps, 0.1 + np.arange(bins) * 0.007034, np.zeros(count, np.uint16))
    return replace(series, **changes)


@pytest.mark.usefixtures("csv_parser")
def test_the_labs_bytes_come_back(tmp_path: Path) -> None:
    (tmp_path / "3.csv").write_text(FIGURE_TEXT)
    assert write_log(read_log(tmp_path / "3.csv"), tmp_path / "again" / "3.csv") == []
    assert (tmp_path / "again" / "3.csv").read_bytes() == FIGURE_TEXT.encode()


@pytest.mark.usefixtures("csv_parser")
def test_a_folder_of_the_lab_comes_back(tmp_path: Path) -> None:
    files = {
        "1.csv": lab_text((0.1, 0.2), [(0.02 * row, row, 8) for row in range(1, 5)]),
        "3.csv": lab_text((0.1, 0.2, 0.3), [(0.02 * row, row, 8, 65535) for row in range(1, 5)]) + "\n0.100000",
        "gyro.csv": "0.012,3\n0.032,-4\n0.052,127\n0.072,0\n",
    }
    files["3.csv"] += "\n" + lab_text((), [(0.12, 1, 2, 3)])[1:]
    (tmp_path / "log").mkdir()
    for name, text in files.items():
        (tmp_path / "log" / name).write_text(text)
    drive = read_log(tmp_path / "log")
    assert drive.series(3).flags.tolist() == [2, 2, 2, 2, 16, 0]
    assert write_log(replace(drive, problems=()), tmp_path / "again") == []
    assert {path.name: path.read_text() for path in (tmp_path / "again").iterdir()} == files


@pytest.mark.usefixtures("csv_parser")
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("last", [3.0, 1e-30, 0.1, 1e22])
def test_the_last_sweep_of_floats_of_any_length_is_not_taken_for_a_cut_one(
    dtype: type, last: float, tmp_path: Path
) -> None:
    # 1e-30 has no decimals to write it with, so that all are written as short as each can be.
    drive = Drive((_series(np.array([[1e-30, 0.123456789], [12345.678, last]], dtype)),))
    assert write_log(drive, tmp_path / "3.csv") == []
    assert "e-" in (tmp_path / "3.csv").read_text()
    again = read_log(tmp_path / "3.csv")
    assert_drives_equal(again, drive)
    assert again.problems == ()


@pytest.mark.usefixtures("csv_parser")
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_any_drive_that_the_csv_can_hold_comes_back(data: st.DataObject, tmp_path: Path) -> None:
    draw = data.draw
    dtype, count, bins = draw(st.sampled_from(["u2", "f4", "f8"])), draw(st.integers(0, 4)), draw(st.integers(2, 5))
    counts = st.floats(0, 1e300) if dtype == "f8" else st.floats(0, 2.0**100, width=32)
    elements = {"elements": counts} if dtype != "u2" else {}
    sweeps = draw(hnp.arrays(dtype, (count, bins), **elements))
    seconds = st.integers(0, 3 * 10**18)
    flags = draw(hnp.arrays(np.uint16, count, elements=st.sampled_from([0, 16])))
    sweeps[flags == 16] = 0
    flags |= np.where((sweeps == 65535).any(axis=1), 2, 0).astype(np.uint16)
    times = np.array(draw(st.lists(seconds, min_size=count, max_size=count, unique=True)), np.int64)
    times -= times[:1].sum()
    axis = np.array(sorted(draw(st.sets(st.floats(0, 50), min_size=bins, max_size=bins))))
    channels = {}
    for name in draw(st.sets(st.sampled_from(["acceleration_m_s2", "yaw_rate_rad_s", "speed_m_s"]))):
        values = draw(hnp.arrays(np.float64, st.integers(1, 4), elements=st.floats(-1e9, 1e9)))
        values += 0.0  # `%d` has no -0
        channels[name] = Channel(draw(hnp.arrays(np.int64, len(values), elements=seconds)), values)
    some = st.none() | st.floats(-1e6, 1e6)
    drive = Drive(
        (SensorSeries(draw(st.integers(0, 99)), times, sweeps, axis, flags),),
        Motion(**channels),
        draw(st.none() | st.builds(Mounting, some, some, some)),
        draw(st.none() | st.lists(st.builds(RoadStep, st.floats(0, 9), some)).map(lambda steps: Truth(tuple(steps)))),
        clock_start_ns=draw(st.integers(0, 5 * 10**17)) if count else 0,
    )
    write_log(drive, tmp_path / "log", overwrite=True)
    if count and not channels:
        (again,) = find_logs([tmp_path])
    else:
        again = tmp_path / "log"
    found = read_log(again)
    series, wanted = found.sensors[0], drive.sensors[0]
    np.testing.assert_array_equal(np.float64(series.sweeps), np.float64(wanted.sweeps))
    assert series.sweeps.dtype.itemsize <= wanted.sweeps.dtype.itemsize or not wanted.sweeps.size
    bare = replace(found, problems=(), sensors=(replace(series, sweeps=wanted.sweeps),))
    assert_drives_equal(bare, drive)


@pytest.mark.usefixtures("csv_parser")
def test_motion_that_the_reader_would_mend_gets_a_row_of_names(tmp_path: Path) -> None:
    series = _series(np.ones((3, 2), np.uint16))
    own_clock = Channel(np.array([5, 6, 70_000_000]), np.array([1.0, 2.0, 3.0]))
    time_out = Channel(series.times_ns, np.array([1.0, -129.0, 3.0]))
    for place, channel in enumerate((own_clock, time_out)):
        drive = Drive((series,), Motion(acceleration_m_s2=channel))
        assert write_log(drive, tmp_path / str(place)) == []
        assert (tmp_path / str(place) / "gyro.csv").read_text().startswith("time_s,acceleration_m_s2\n")
        assert_drives_equal(read_log(tmp_path / str(place)), drive)


@pytest.mark.usefixtures("csv_parser")
def test_what_the_csv_cannot_hold_is_said(tmp_path: Path) -> None:
    drive = sample_drive()
    lost = write_log(drive, tmp_path / "log")
    assert lost == [
        "Sensor 1: flags of 1 sweeps were left out.",
        "Sensor 1: how it was set (profile, sensor) was left out.",
        "Sensor 3: flags of 1 sweeps were left out.",
        "Sensor 3: how it was set (profile, sensor) was left out.",
        "The date of the recording (2021-09-20 11:25:10.123456+00:00) was left out.",
        "What was said of the log (1 sentences) was left out.",
    ]
    wanted = replace(
        drive,
        started_at_ns=None,
        problems=(),
        sensors=tuple(replace(one, spec={}, flags=np.zeros(5, np.uint16)) for one in drive.sensors),
    )
    assert_drives_equal(read_log(tmp_path / "log"), wanted)
    alone = replace(wanted, sensors=wanted.sensors[1:], motion=Motion())
    assert write_log(alone, tmp_path / "walk.csv") == [
        "The sensor's number 3 was left out; this file's name says 1.",
    ]
    assert read_log(tmp_path / "walk.csv").truth == drive.truth
    silent = replace(alone.sensors[0], flags=np.full(5, SweepFlag.NO_AMPLITUDES, np.uint16))
    assert write_log(replace(alone, sensors=(silent,)), tmp_path / "3.csv") == [
        "Sensor 3: amplitudes of sweeps that are marked as without any were left out."
    ]
    odd = Motion(speed_m_s=Channel(np.arange(3), np.array([1.0, np.nan, 2.5])))
    assert write_log(replace(wanted, motion=odd), tmp_path / "odd") == [
        "speed_m_s: 1 samples that are no finite numbers were left out."
    ]


@pytest.mark.usefixtures("csv_parser")
@pytest.mark.parametrize("value", [0.1, 1e-20, 123456.7890625, 2.0**60, 1 / 3])
def test_more_decimals_only_where_the_labs_would_lose_something(value: float, tmp_path: Path) -> None:
    drive = Drive((_series(np.array([[value, 3.5], [1.0, 2.0]])),))
    write_log(drive, tmp_path / "3.csv")
    assert read_log(tmp_path / "3.csv").sensors[0].sweeps.tolist() == [[value, 3.5], [1.0, 2.0]]
    text = (tmp_path / "3.csv").read_text().split("\n")[2].split(",")
    assert text[0] == "0.010000"
    assert (text[1] == "1.000000") == (float(f"{value:f}") == value)


@pytest.mark.parametrize(
    ("drive", "name", "message"),
    [
        (Drive(()), "log", "has at least one sensor"),
        (sample_drive(), "a.csv", "one file holds one sensor and no motion"),
        (sample_drive(), "a.h5", "HDF5 is read only"),
        (Drive((_series(np.array([[1.0, -2.0]])),)), "a.csv", "amplitudes that are negative or not finite"),
        (Drive((_series(np.array([[1.0, np.nan]])),)), "log", "amplitudes that are negative or not finite"),
    ],
)
def test_what_cannot_be_written_is_refused(drive: Drive, name: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(LogError, match=message):
        write_log(drive, tmp_path / name)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["a.drive", "log", "a.csv"])
def test_nothing_that_is_there_is_lost(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    old = sample_drive(3, sensors=(1,))
    new = sample_drive(6, sensors=(1,))
    if name == "a.csv":
        old, new = replace(old, motion=Motion()), replace(new, motion=Motion(), truth=None)
    write_log(old, tmp_path / name)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    with pytest.raises(LogError, match="exists already"):
        write_log(new, tmp_path / name)

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch, pytest.raises(LogError, match="No space left on device"):
        patch.setattr(os, "fsync", full)
        patch.setattr(Path, "write_text", full)
        write_log(new, tmp_path / name, overwrite=True)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before
    write_log(new, tmp_path / name, overwrite=True)
    again = read_log(tmp_path / name)
    assert len(again.sensors[0]) == 6
    assert again.truth == new.truth
    hidden = [path for path in tmp_path.rglob("*") if path.name.startswith(".")]
    assert hidden == []


def test_a_folder_with_anything_else_in_it_is_never_replaced(tmp_path: Path) -> None:
    for name in ("log", "a.drive"):
        write_log(sample_drive(), tmp_path / name)
        (tmp_path / name / "notes.txt").write_text("the second lap")
        with pytest.raises(LogError, match="left alone"):
            write_log(sample_drive(), tmp_path / name, overwrite=True)
        assert (tmp_path / name / "notes.txt").read_text() == "the second lap"


def test_an_old_truth_is_not_taken_for_the_new_logs(tmp_path: Path) -> None:
    (tmp_path / "a.truth.json").write_text('{"steps": []}')
    with pytest.raises(LogError, match=r"a\.truth\.json: exists already"):
        write_log(Drive((_series(np.ones((1, 2))),)), tmp_path / "a.csv")
    assert [path.name for path in tmp_path.iterdir()] == ["a.truth.json"]


def test_each_kind_is_known_by_name_or_content(tmp_path: Path) -> None:
    write_log(sample_drive(), tmp_path / "plain")
    write_log(sample_drive(), tmp_path / "a.drive")
    (tmp_path / "a.drive").rename(tmp_path / "renamed")
    (tmp_path / "noname").write_text(FIGURE_TEXT)
    assert len(read_log(tmp_path / "plain").sensors) == 2
    assert_drives_equal(read_log(tmp_path / "renamed"), sample_drive())
    assert len(read_log(str(tmp_path / "noname")).sensors[0]) == 13


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda path: None, "cannot be read: No such file or directory"),
        (lambda path: path.mkdir(), "is a folder that holds nothing; expected"),
        (lambda path: path.write_bytes(b"RIFF"), "begins with b'RIFF', which is no log; expected a folder of"),
        (lambda path: path.symlink_to(path), "cannot be read: Too many levels of symbolic links"),
    ],
    ids=["missing", "empty folder", "another format", "loop"],
)
def test_what_is_no_log_is_said(make: object, message: str, tmp_path: Path) -> None:
    assert callable(make)
    make(tmp_path / "what")
    with pytest.raises(LogError, match=message) as caught:
        read_log(tmp_path / "what")
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)


def test_find_logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_log(sample_drive(), tmp_path / "b/deep/log")
    write_log(sample_drive(), tmp_path / "b/a.drive")
    for name in ("b/walk.csv", "b/3.h5", "b/x.HDF5"):
        (tmp_path / name).write_text(FIGURE_TEXT)
    for name in ("b/gyro.csv", "b/acc.csv", "b/walk.truth.json", "b/table.csv", "b/notes.txt"):
        (tmp_path / name).write_text("time,acceleration\n")
    wanted = [tmp_path / "b" / name for name in ("3.h5", "a.drive", "deep/log", "walk.csv", "x.HDF5")]
    assert find_logs([tmp_path]) == wanted
    assert find_logs([tmp_path / "b", str(tmp_path / "b/walk.csv"), tmp_path / "b/a.drive/"]) == wanted
    assert find_logs([f"{tmp_path}/b/*.h5", f"{tmp_path}/**/l*"]) == [wanted[0], wanted[2]]
    assert find_logs([f"{tmp_path}/b/*"]) == wanted
    assert find_logs([tmp_path / "b/deep/log"]) == [tmp_path / "b/deep/log"]
    assert find_logs([tmp_path / "none", "no*thing"]) == [tmp_path / "none", Path("no*thing")]
    assert find_logs([tmp_path / "b/notes.txt"]) == [tmp_path / "b/notes.txt"]  # named, so it is tried
    monkeypatch.chdir(tmp_path)
    assert find_logs(["b/deep"]) == [Path("b/deep/log")]
    assert find_logs([]) == []


@pytest.mark.usefixtures("csv_parser")
def test_real_recordings_survive_every_form(tmp_path: Path) -> None:
    drive = read_log(recordings("a111_road") / "grass_0_45.h5")
    assert write_log(drive, tmp_path / "a.drive") == []
    assert_drives_equal(read_log(tmp_path / "a.drive"), drive)
    lost = write_log(drive, tmp_path / "1.csv")
    assert len(lost) == 2  # date and spec
    again = read_log(tmp_path / "1.csv")
    np.testing.assert_array_equal(again.sensors[0].sweeps, drive.sensors[0].sweeps)
    np.testing.assert_array_equal(again.sensors[0].times_ns, drive.sensors[0].times_ns)
    np.testing.assert_array_equal(again.sensors[0].range_m, drive.sensors[0].range_m)


def test_a_name_that_is_empty_or_a_pipe_is_refused_at_once(tmp_path: Path) -> None:
    """`Path("")` is the current folder, and a pipe waits for its other end."""
    with pytest.raises(LogError, match="name is empty"):
        read_log("")
    assert find_logs([""]) == []
    os.mkfifo(tmp_path / "3a.csv")
    with pytest.raises(LogError, match="pipe"):
        read_log(tmp_path / "3a.csv")
    assert find_logs([tmp_path]) == []


@pytest.mark.parametrize("impact_s", [1e300, -1e10, float("inf"), float("nan")])
def test_an_impact_that_is_no_time_of_a_drive(impact_s: float, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="impact_s"):
        RoadStep(impact_s)
    (tmp_path / "3.csv").write_text(FIGURE_TEXT)
    (tmp_path / "3.truth.json").write_text(json.dumps({"steps": [{"impact_s": 1}, {"impact_s": impact_s}]}))
    with pytest.raises(LogError, match=r"3\.truth\.json: `(steps\[1\]`|impact_s` of `steps\[1\]`)"):
        read_log(tmp_path / "3.csv")
