"""Acconeer's HDF5: real recordings, every flag, and every refusal by name."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from fuzz_logs import write_h5
from log_samples import recordings

from jaxradar._errors import LogError
from jaxradar.drive import RoadStep, SweepFlag, Truth
from jaxradar.logs import find_logs, read_log

SESSION = {"range_start_m": 0.2, "data_length": 24, "step_length_m": 0.000484}


@pytest.mark.parametrize(
    "length_m, bins, expected", [(0.6, 1240, 0.6 / 1239), (0.3, 1240, 0.000484), ("far", 1240, 0.000484)]
)
def test_the_step_is_taken_unrounded_where_the_length_says_it(
    tmp_path: Path, length_m: Any, bins: int, expected: float
) -> None:
    session = SESSION | {"data_length": bins, "range_length_m": length_m}
    path = write_h5(tmp_path / "a.h5", data=np.ones((6, 1, bins), np.uint16), session_info=json.dumps(session))
    (series,) = read_log(path).sensors
    np.testing.assert_allclose(series.range_m, 0.2 + np.arange(bins) * expected, rtol=1e-12)


def test_a_recording_as_the_makers_tool_saves_it(tmp_path: Path) -> None:
    path = write_h5(tmp_path / "a.h5")
    (tmp_path / "a.truth.json").write_text('{"steps": [{"impact_s": 0.1}]}')
    drive = read_log(path)
    (series,) = drive.sensors
    with h5py.File(path) as file:
        np.testing.assert_array_equal(series.sweeps, file["data"][:, 0])
    assert series.sensor == 3
    assert series.sweeps.dtype == np.uint16
    assert series.times_ns.tolist() == [31_250_000 * row for row in range(6)]
    assert drive.started_at_ns == 1_632_137_110_250_000_000
    np.testing.assert_array_equal(series.range_m, 0.2 + np.arange(24) * 0.000484)
    assert series.spec == {
        "mode": "ENVELOPE",
        "sensor": [3],
        "profile": "PROFILE_2",
        "update_rate": 30.0,
        "rss_version": "2.8.2",
    }
    assert drive.truth == Truth((RoadStep(0.1),))
    assert (drive.problems, drive.clock_start_ns) == ((), 0)


def test_flags_of_each_sweep_and_sensor(tmp_path: Path) -> None:
    data = np.full((3, 2, 24), 7, np.uint16)
    data[2, 0, 5] = 65535
    info = [
        [{"missed_data": True}, {"data_saturated": True, "data_quality_warning": None}],
        [{"data_quality_warning": True, "proximity_power": 3}, {"sensor_comm_error": True, "missed_data": True}],
        [{}, {}],
    ]
    path = write_h5(
        tmp_path / "a.h5",
        sweeps=3,
        data=data,
        data_info=json.dumps(info),
        sensor_config_dump='{"sensor": [4, 2]}',
        rss_version=None,
    )
    drive = read_log(path)
    assert [series.sensor for series in drive.sensors] == [2, 4]
    assert drive.series(4).flags.tolist() == [1, 4, 2]
    assert drive.series(2).flags.tolist() == [2, SweepFlag.COMMUNICATION_ERROR | SweepFlag.MISSED_DATA, 0]
    assert drive.series(2).spec == {"sensor": [4, 2]}


def test_iq_gives_the_modulus(tmp_path: Path) -> None:
    config = '{"mode": "IQ", "sensor": 1}'
    exact = write_h5(tmp_path / "a.h5", data=np.full((6, 1, 24), 3 - 4j), mode="iq", sensor_config_dump=config)
    assert read_log(exact).series(1).sweeps.dtype == np.float32
    assert (read_log(exact).series(1).sweeps == 5).all()
    odd = np.full((6, 24), 1 + 1j)  # one sensor without its axis
    inexact = write_h5(tmp_path / "b.h5", data=odd, mode="iq", sensor_config_dump=config, data_info=None)
    assert read_log(inexact).series(1).sweeps.dtype == np.float64
    assert (read_log(inexact).series(1).sweeps == np.abs(1 + 1j)).all()


def test_fixed_length_texts_and_no_sweeps(tmp_path: Path) -> None:
    path = write_h5(
        tmp_path / "a.h5",
        data=np.empty((0, 1, 24), np.uint16),
        sample_times=np.empty(0),
        data_info="[]",
        mode=np.bytes_("envelope"),
        session_info=np.bytes_(json.dumps(SESSION)),
    )
    drive = read_log(path)
    assert drive.series(3).sweeps.shape == (0, 24)
    assert drive.started_at_ns is None
    assert drive.problems == ("a.h5: holds no sweep.",)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"mode": "sparse"}, "`mode` is 'sparse'; an A111 recording in the envelope or IQ mode can be read"),
        ({"mode": "power_bins"}, "`mode` is 'power_bins'"),
        ({"mode": None, "sensor_config_dump": "{}"}, "`mode` is None"),
        ({"generation": "a121"}, "is a recording of the A121 generation"),
        ({"data": None}, "holds data_info, mode, rss_version, sample_times, sensor_config_dump, session_info, but no"),
        ({"session_info": None}, "lacks `session_info`"),
        ({"sample_times": None}, "lacks `sample_times`"),
        ({"sample_times": np.arange(5.0)}, r"`sample_times` has shape (5,) for `data` of shape (6, 1, 24)"),
        ({"sample_times": np.arange(6)}, "`sample_times` is int64 of shape (6,); expected 1 dimensions of kind f"),
        ({"sample_times": np.array([0, 1, np.nan, 3, 4, 5])}, "`sample_times` [2] is nan; expected Unix seconds"),
        ({"sample_times": np.array([0, 1, 2, 3, 4, 1e12])}, "`sample_times` [5] is 1000000000000.0"),
        ({"data": np.ones((6, 1, 24))}, "`data` is float64 of shape (6, 1, 24)"),
        ({"data": np.ones((6, 1, 24), np.uint32)}, "`data` is uint32; expected uint16"),
        ({"data": np.ones((6, 1, 1), np.uint16)}, "`data` has shape (6, 1, 1)"),
        (
            {"data": np.full((6, 1, 24), np.nan + 0j), "mode": "iq"},
            "`data` holds a number that is not finite, at [0 0 0]",
        ),
        ({"data": np.ones(6, np.uint16)}, "`data` is uint16 of shape (6,); expected 3 dimensions"),
        ({"session_info": "{"}, "`session_info` is no JSON"),
        ({"session_info": "[]"}, "`session_info` is []; expected an object"),
        ({"session_info": np.arange(3.0)}, "`session_info` is float64 of shape (3,); expected one text"),
        ({"session_info": json.dumps(SESSION | {"step_length_m": 0})}, "`step_length_m` 0; expected metres, a step"),
        ({"session_info": json.dumps(SESSION | {"step_length_m": 1e-30})}, "too small to tell bins apart"),
        ({"session_info": json.dumps(SESSION | {"range_start_m": None})}, "`range_start_m` None"),
        ({"session_info": json.dumps(SESSION | {"range_start_m": float("nan")})}, "`range_start_m` nan"),
        ({"session_info": json.dumps(SESSION | {"data_length": 25})}, "`data_length` 25; `data` has 24 bins"),
        ({"sensor_config_dump": '{"mode": "ENVELOPE", "sensor": [1, 2]}'}, "names `sensor` [1, 2]; `data` has 1"),
        ({"sensor_config_dump": '{"mode": "ENVELOPE", "sensor": ["a"]}'}, "names `sensor` ['a']"),
        ({"data_info": "[]"}, "`data_info` does not hold one entry for each of 6 sweeps"),
        ({"data_info": "[1, 2, 3, 4, 5, 6]"}, "`data_info` [0] is 1; expected one object for each sensor"),
        ({"data_info": json.dumps([[{"missed_data": "no"}]] * 6)}, "`data_info` [0] has `missed_data` 'no'"),
    ],
)
def test_what_is_wrong_is_named(changes: dict[str, object], message: str, tmp_path: Path) -> None:
    with pytest.raises(LogError) as caught:
        read_log(write_h5(tmp_path / "a.h5", **changes))
    assert message in str(caught.value)
    assert caught.value.path == str(tmp_path / "a.h5")


def test_a_shape_that_the_file_cannot_hold_is_not_allocated(tmp_path: Path) -> None:
    path = write_h5(tmp_path / "a.h5", data=None)
    with h5py.File(path, "a") as file:
        file.create_dataset("data", (10**7, 1, 1000), np.uint16, chunks=(1, 1, 24), compression="gzip")
    with pytest.raises(LogError, match="claims 20000000000 bytes in pieces of 48, more than a file of this size"):
        read_log(path)


def test_what_is_no_hdf5_is_said(tmp_path: Path) -> None:
    for content in (b"", b"\x89HDF\r\n\x1a\n" + bytes(90), write_h5(tmp_path / "b.h5").read_bytes()[:3000]):
        (tmp_path / "a.h5").write_bytes(content)
        with pytest.raises(LogError, match=r"a\.h5: (cannot be read as HDF5|is a damaged HDF5 file)"):
            read_log(tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_group("data")
    with pytest.raises(LogError, match="lacks `sensor_config_dump`"):
        read_log(tmp_path / "a.h5")


def test_real_recordings_of_roads() -> None:
    for path in find_logs([recordings("a111_road")]):
        drive = read_log(path)
        (series,) = drive.sensors
        assert series.sweeps.shape == (len(series), 1240)
        assert abs(series.bin_m - 0.6 / 1239) < 1e-12
        assert series.range_m[0] == 0.2
        assert series.sweep_rate_hz is not None
        assert 31.3 < series.sweep_rate_hz < 31.6
        assert series.spec["profile"] == "PROFILE_2"
        assert drive.started_at is not None
        assert drive.started_at.date().isoformat() == "2021-09-20"
        assert series.invalid.sum() == 0
        with h5py.File(path) as file:
            np.testing.assert_array_equal(series.sweeps, file["data"][:, 0])
            seconds = file["sample_times"][:]
        np.testing.assert_allclose(series.times_s, seconds - seconds[0], rtol=0, atol=1e-9)


def test_real_recordings_of_other_kinds() -> None:
    folder = recordings("a111_acconeer")
    assert read_log(folder / "distance_detector_input.h5").series(1).sweeps.shape == (50, 827)
    iq = read_log(folder / "obstacle_detection_iq_input.h5").series(1)
    with h5py.File(folder / "obstacle_detection_iq_input.h5") as file:
        np.testing.assert_array_equal(iq.sweeps, np.abs(file["data"][:, 0]))
    with pytest.raises(LogError, match="holds above_thres_hist_dist, found_peaks, threshold, but no `data`"):
        read_log(folder / "output_cfar_sensitivity-0.7_threshold_type-cfar.h5")
    for path in find_logs([recordings("a121_acconeer")]):
        with pytest.raises(LogError, match="is a recording of the A121 generation"):
            read_log(path)
