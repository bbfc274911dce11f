"""What is on the disk, whenever the power goes, and that nobody waits for it."""

from __future__ import annotations

import errno
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from io import FileIO
from pathlib import Path

import numpy as np
import pytest
from board import until

from jaxradar._errors import ConfigError
from jaxradar.drive import Drive
from jaxradar.drivefile import is_drive_folder, read_drive
from jaxradar.drivefile import writer as writing
from jaxradar.live import recorder as recording
from jaxradar.live.recorder import Recorder
from jaxradar.live.sweeps import LiveSweep

RANGE_M = np.linspace(0.1, 0.8, 16)
NAME = re.compile(r"\d{4}-\d\d-\d\dT\d\d-\d\d-\d\dZ(-\d+)?\.drive")


def sweep(place: int, sensor: int = 1, bins: int = 16) -> LiveSweep:
    return LiveSweep(sensor, 10_000_000 * place, np.full(bins, place % 65536, np.uint16), place % 4)


def recorder(folder: Path, **options: object) -> Recorder:
    return Recorder(folder, (1, 3), RANGE_M, np.dtype(np.uint16), **options)  # type: ignore[arg-type]


def drives(folder: Path) -> list[Drive]:
    """Those that were begun: a name with a dot before it is of one that was not whole yet."""
    names = sorted((one for one in folder.iterdir() if not one.name.startswith(".")), key=order)
    assert all(map(is_drive_folder, names))
    return [read_drive(one) for one in names]


def order(path: Path) -> tuple[str, int]:
    stem, _, number = path.stem.partition("Z")
    return stem, int(number[1:] or 0)


def test_it_is_read_back_as_it_came(tmp_path: Path) -> None:
    made = recorder(tmp_path / "new" / "folder", accelerations=True)
    for place in range(500):
        made.take(sweep(place))
        made.take(sweep(1000 + place, 3))
        made.take_acceleration(10_000_000 * place, 0.5 * place)
    made.close()
    assert made.recorded == (1000, 0, 1, "")
    (drive,) = drives(tmp_path / "new" / "folder")
    assert NAME.fullmatch(next((tmp_path / "new" / "folder").iterdir()).name)
    assert drive.problems == ()
    assert [series.sensor for series in drive.sensors] == [1, 3]
    for series, offset in zip(drive.sensors, (0, 1000), strict=True):
        np.testing.assert_array_equal(series.sweeps[:, 0], np.arange(500) + offset)
        np.testing.assert_array_equal(series.flags, np.arange(500) % 4)
        np.testing.assert_array_equal(series.range_m, RANGE_M)
        np.testing.assert_array_equal(np.diff(series.times_ns), 10_000_000)
    channel = drive.motion.acceleration_m_s2
    assert channel is not None
    np.testing.assert_array_equal(channel.values, 0.5 * np.arange(500))
    assert drive.started_at_ns is not None
    assert abs(drive.started_at_ns - time.time_ns()) < 60e9


def test_the_lab_s_csv_is_made_of_it(tmp_path: Path) -> None:
    made = recorder(tmp_path / "log")
    for place in range(20):
        made.take(sweep(place))
    made.close()
    (folder,) = (tmp_path / "log").iterdir()
    command = [sys.executable, "-m", "jaxradar", "convert", str(folder), str(tmp_path / "csv")]
    ran = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    assert list((tmp_path / "csv").rglob("1.csv"))


def test_a_new_drive_by_size_and_by_time_and_no_name_twice(tmp_path: Path) -> None:
    made = recorder(tmp_path / "size", rotate_bytes=48 * 100)
    for place in range(1000):
        made.take(sweep(place))
        if place % 50 == 49:
            until(lambda place=place: made.recorded.sweeps == place + 1)
    made.close()
    found = drives(tmp_path / "size")
    assert len(found) == 10
    assert {len(drive.sensors[0]) for drive in found} == {100}
    assert np.concatenate([drive.sensors[0].sweeps[:, 0] for drive in found]).tolist() == list(range(1000))
    together = [recorder(tmp_path / "time", rotate_s=0.0) for _ in range(3)]
    for place in range(5):
        for one in together:
            one.take(sweep(place))
            until(lambda one=one, place=place: one.recorded.sweeps == place + 1)
    for one in together:
        one.close()
    assert [len(drive.sensors[0]) for drive in drives(tmp_path / "time")] == [1] * 15


def test_who_is_too_fast_is_not_kept_waiting(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    inner = recording.DriveWriter.append

    def slow(self: recording.DriveWriter, *given: object) -> None:
        time.sleep(0.5)
        inner(self, *given)  # type: ignore[arg-type]

    monkeypatch.setattr(recording.DriveWriter, "append", slow)
    made = recorder(tmp_path, most_waiting=100)
    begin = time.monotonic()
    for place in range(10_000):
        made.take(sweep(place))
    assert time.monotonic() - begin < 1.0
    made.close()
    kept, dropped, _, _ = made.recorded
    assert kept + dropped == 10_000
    assert 100 <= kept <= 1000
    assert len(drives(tmp_path)[0].sensors[0]) == kept


def test_what_does_not_fit_is_counted(tmp_path: Path) -> None:
    made = recorder(tmp_path)
    made.take(sweep(0, bins=15))
    made.take(sweep(0, sensor=2))
    made.take(sweep(1))
    made.close()
    assert made.recorded[:3] == (1, 2, 1)


def test_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(ConfigError, match="cannot be made a folder for drives"):
        recorder(tmp_path / "file")


FILL = """
import resource, signal, sys
from pathlib import Path
sys.path.insert(0, {tests!r})
from board import until
from test_live_recorder import recorder, sweep
import jaxradar.live.recorder as recording
recording.RETRY_S = 0.05
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
made = recorder(Path(sys.argv[1]))
for place in range(300):
    made.take(sweep(place))
    if place == 100:
        until(lambda: made.recorded.sweeps == 101)
        resource.setrlimit(resource.RLIMIT_FSIZE, ({most}, resource.RLIM_INFINITY))  # no file may grow beyond that
    if place == 200:
        until(lambda: sum(made.recorded[:2]) == 201)
        said = made.recorded.problem
        resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
        import time
        time.sleep(0.1)
made.close()
print(list(made.recorded), said)
"""


@pytest.mark.parametrize("most", [16 * 110, 32 * 101 + 7, 32 * 150 + 31], ids=str)
def test_a_disk_that_is_full_loses_what_it_did_not_take_and_nothing_else(tmp_path: Path, most: int) -> None:
    """A limit on the size of files stands for a full disk: rows and records run into it at different sweeps."""
    code = FILL.format(tests=str(Path(__file__).parent), most=most)
    ran = subprocess.run([sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    kept, dropped, count, problem = json.loads(ran.stdout.partition("]")[0].replace("'", '"') + "]")
    assert "cannot be written: File too large" in ran.stdout
    assert problem == ""
    found = drives(tmp_path)
    assert len(found) == count >= 2
    places = [int(place) for drive in found for place in drive.sensors[0].sweeps[:, 0]]
    assert len(places) == kept
    assert kept + dropped == 300
    assert places[:101] == list(range(101))
    assert set(range(201, 300)) <= set(places)
    assert places == sorted(places)


WRITE = """
import sys
from pathlib import Path
sys.path.insert(0, {tests!r})
from board import until
from test_live_recorder import recorder, sweep
made = recorder(Path(sys.argv[1]), rotate_bytes=20_000)
place = 0
while True:
    made.take(sweep(place))
    place += 1
    if place % 20 == 0:
        until(lambda: made.recorded.sweeps > place - 200)  # nothing is dropped
        print(made.recorded.sweeps, flush=True)
"""


@pytest.mark.parametrize("kills", [pytest.param(200, marks=pytest.mark.long), 8])
def test_killed_at_any_moment_every_whole_sweep_before_it_is_there(tmp_path: Path, kills: int) -> None:
    """By SIGKILL: all that the recorder had said to be on disk is read, in order, and where it ends is told."""
    code = WRITE.format(tests=str(Path(__file__).parent))
    random = np.random.default_rng(kills)
    told = 0
    for kill in range(kills):
        folder = tmp_path / str(kill)
        child = subprocess.Popen([sys.executable, "-c", code, str(folder)], stdout=subprocess.PIPE, text=True)
        assert child.stdout is not None
        lines = int(random.integers(1, 400))
        said = [int(child.stdout.readline()) for _ in range(lines)][-1]
        time.sleep(random.random() * 0.005)
        os.kill(child.pid, signal.SIGKILL)
        child.wait()
        child.stdout.close()
        found = drives(folder) if folder.exists() else []
        places = [int(place) for drive in found for place in drive.sensors[0].sweeps[:, 0]]
        assert len(places) >= said
        assert places == [place % 65536 for place in range(len(places))]
        cut = [drive for drive in found if drive.problems]
        assert cut in ([], found[-1:])
        told += len(cut)
    assert told > 0 or kills < 100  # some were cut in the middle of a sweep, and say where


def test_a_folder_that_goes_and_comes_back_is_written_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As of a stick that is pulled: nothing in it can be written, cut or sealed."""
    monkeypatch.setattr(recording, "RETRY_S", 0.05)
    inner, seal, away = writing._write_all, writing.write_header, threading.Event()

    def refused(*_: object, **__: object) -> None:
        raise OSError(errno.EIO, "Input/output error")

    def write(file: FileIO, content: memoryview) -> None:
        if away.is_set():
            raise OSError(errno.EIO, "Input/output error")
        inner(file, content)

    monkeypatch.setattr(writing, "_write_all", write)
    made = recorder(tmp_path / "stick")
    for place in range(10):
        made.take(sweep(place))
    until(lambda: made.recorded.sweeps == 10)
    away.set()
    monkeypatch.setattr(writing, "write_header", refused)
    shutil.rmtree(tmp_path / "stick")
    for place in range(10, 20):
        made.take(sweep(place))
    until(lambda: made.recorded.dropped == 10)
    assert "Input/output error" in made.recorded.problem
    away.clear()
    monkeypatch.setattr(writing, "write_header", seal)
    time.sleep(0.1)
    made.take(sweep(20))
    until(lambda: made.recorded.sweeps == 11)
    made.close()
    assert made.recorded == (11, 10, 2, "")
    assert drives(tmp_path / "stick")[0].sensors[0].sweeps[:, 0].tolist() == [20]


def test_a_failure_that_nobody_foresaw_is_told_and_tried_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recording, "RETRY_S", 0.05)
    inner, failures = recording.DriveWriter.append, [RuntimeError("odd")]

    def append(self: recording.DriveWriter, *given: object) -> None:
        if failures:
            raise failures.pop()
        inner(self, *given)  # type: ignore[arg-type]

    monkeypatch.setattr(recording.DriveWriter, "append", append)
    made = recorder(tmp_path)
    made.take(sweep(0))
    until(lambda: made.recorded.dropped == 1)
    assert "odd" in made.recorded.problem
    time.sleep(0.1)
    made.take(sweep(1))
    until(lambda: made.recorded.sweeps == 1)
    made.close()
    assert made.recorded == (1, 1, 2, "")
