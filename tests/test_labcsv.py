"""The lab's CSV: the thesis's own table, every repair with its exact values, every refusal with its place."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from log_samples import FIGURE_AXIS, FIGURE_ROWS, FIGURE_TEXT, lab_text

from jaxradar._errors import LogError
from jaxradar.drive import Drive, Mounting, RoadStep, SweepFlag, Truth
from jaxradar.labcsv import read_lab_csv

pytestmark = pytest.mark.usefixtures("csv_parser")

FIGURE_COUNTS = np.array([row[1:] for row in FIGURE_ROWS])
FIGURE_NS = [round(row[0] * 1000) * 1_000_000 for row in FIGURE_ROWS]


def read(tmp_path: Path, text: str | bytes, name: str = "3.csv") -> Drive:
    (tmp_path / name).write_bytes(text.encode() if isinstance(text, str) else text)
    return read_lab_csv(tmp_path / name)


def test_figure_c1(tmp_path: Path) -> None:
    drive = read(tmp_path, FIGURE_TEXT)
    (series,) = drive.sensors
    assert series.sensor == 3
    assert series.sweeps.dtype == np.uint16
    np.testing.assert_array_equal(series.sweeps, FIGURE_COUNTS)
    assert series.times_ns.tolist() == FIGURE_NS
    assert series.range_m.tolist() == list(FIGURE_AXIS)
    assert not series.flags.any()
    assert (drive.truth, drive.mounting, drive.started_at_ns, drive.clock_start_ns) == (None, None, None, 0)
    assert drive.problems == ()


TRIMMED = "".join(f",{metres:g}" for metres in FIGURE_AXIS) + "".join(
    "\n" + ",".join(f"{value:g}" for value in row) for row in FIGURE_ROWS
)


@pytest.mark.parametrize(
    "text",
    [
        FIGURE_TEXT + "\n",
        FIGURE_TEXT + "\n\n",
        FIGURE_TEXT.replace("\n", "\r\n"),
        FIGURE_TEXT.replace("\n", "\r\n") + "\r\n",
        "\ufeff" + FIGURE_TEXT,
        FIGURE_TEXT.replace("0.012000,272.000000", "1.2e-2, +2.72E2"),
        TRIMMED + "\n",
        FIGURE_TEXT.replace(".000000", ".") + "\n",
    ],
    ids=["line end", "blank line", "crlf", "crlf end", "bom", "exponents", "trimmed", "points"],
)
def test_what_spreadsheets_do_to_a_file_is_read(text: str, tmp_path: Path) -> None:
    drive = read(tmp_path, text)
    (series,) = drive.sensors
    np.testing.assert_array_equal(series.sweeps, FIGURE_COUNTS)
    assert series.times_ns.tolist() == FIGURE_NS
    assert series.range_m.tolist() == list(FIGURE_AXIS)
    assert drive.problems == ()


@pytest.mark.parametrize("bins", [2, 128, 1446])
def test_any_number_of_bins_and_the_axis_is_the_headers(bins: int, tmp_path: Path) -> None:
    axis = 0.2 + np.arange(bins) * 0.000484
    (series,) = read(tmp_path, lab_text(axis, [(0.02, *range(bins))]), "walk.csv").sensors
    assert series.sensor == 1  # the name is no number
    np.testing.assert_array_equal(series.range_m, [float(f"{metres:f}") for metres in axis])
    assert series.sweeps.tolist() == [list(range(bins))]


def test_a_header_alone_is_a_drive_without_sweeps(tmp_path: Path) -> None:
    for end, said in (("", "3.csv: holds no sweep; its first line has no end."), ("\n", "3.csv: holds no sweep.")):
        drive = read(tmp_path, lab_text(FIGURE_AXIS, ()) + end)
        assert drive.series(3).sweeps.shape == (0, 6)
        assert drive.problems == (said,)


@pytest.mark.parametrize(
    ("values", "dtype"),
    [
        ((0, 65535), np.uint16),
        ((0, 65536), np.float32),
        ((0.5, 3), np.float32),
        ((0.1, 3), np.float64),
        ((16777217, 3), np.float64),
    ],
)
def test_amplitudes_take_the_smallest_dtype_that_holds_them(
    values: tuple[float, ...], dtype: type, tmp_path: Path
) -> None:
    (series,) = read(tmp_path, lab_text((1, 2), [(0, *values), (1, 1, 2)])).sensors
    assert series.sweeps.dtype == dtype
    assert series.sweeps[0].tolist() == list(values)


def test_saturation_is_flagged(tmp_path: Path) -> None:
    (series,) = read(tmp_path, lab_text((1, 2), [(0, 65534, 1), (1, 65535, 2)])).sensors
    assert series.flags.tolist() == [0, SweepFlag.SATURATED]


ALONE = "\n0.012000"


@pytest.mark.parametrize("alone", [ALONE, ALONE + ",,", ALONE + "," * 6], ids=["time", "some cells", "all cells"])
def test_a_failed_read_leaves_a_time_alone(alone: str, tmp_path: Path) -> None:
    lines = FIGURE_TEXT.split("\n")
    lines[2] = alone[1:]
    lines[6] = "0.050000"
    drive = read(tmp_path, "\n".join(lines))
    (series,) = drive.sensors
    assert series.flags.tolist() == [0, 16, 0, 0, 0, 16, 0, 0, 0, 0, 0, 0, 0]
    assert not series.sweeps[[1, 5]].any()
    np.testing.assert_array_equal(np.delete(series.sweeps, [1, 5], 0), np.delete(FIGURE_COUNTS, [1, 5], 0))
    assert series.times_ns.tolist() == FIGURE_NS
    assert series.sweeps.dtype == np.uint16
    assert drive.problems == (
        "3.csv: 2 of 13 sweeps have a time but no amplitudes, first in line 3; they are marked invalid.",
    )


def test_every_cut_keeps_every_whole_row(tmp_path: Path) -> None:
    lines = FIGURE_TEXT.split("\n")
    header = len(lines[0])
    for length in range(header + 1, len(FIGURE_TEXT)):
        drive = read(tmp_path, FIGURE_TEXT[:length])
        (series,) = drive.sensors
        body = FIGURE_TEXT[header + 1 : length]
        whole = sum(length >= len("\n".join(lines[: row + 2])) for row in range(13))
        np.testing.assert_array_equal(series.sweeps, FIGURE_COUNTS[:whole])
        assert series.times_ns.tolist() == FIGURE_NS[:whole]
        torn = bool(body) and not body.endswith("\n") and length != len("\n".join(lines[: whole + 1]))
        assert any("is cut off" in problem for problem in drive.problems) == torn, (length, drive.problems)
    for length in range(header):
        if length in (18, 27, 36, 45):  # between two distances: nothing says that more were to come
            assert "its first line has no end" in read(tmp_path, FIGURE_TEXT[:length]).problems[0]
            continue
        with pytest.raises(LogError):
            read(tmp_path, FIGURE_TEXT[:length])


def test_what_was_dropped_is_said(tmp_path: Path) -> None:
    assert read(tmp_path, FIGURE_TEXT[:-1]).problems == (
        "3.csv, line 14: the last row is cut off (it ends at cell 7 of 7, '144.00000') and was dropped.",
    )
    assert read(tmp_path, FIGURE_TEXT + "\n0.14\0\0\0").problems == (
        "3.csv: 3 zero bytes at the end were dropped: the file was cut off.",
        "3.csv, line 15: the last row is cut off (it ends at cell 1 of 7, '0.14') and was dropped.",
    )
    assert len(read(tmp_path, FIGURE_TEXT + "\n\n\n0.14").series(3)) == 13  # blank lines, as at the end of a file
    whole_numbers = read(tmp_path, ",1,2\n0,12,5\n1,13,6")
    assert whole_numbers.series(3).sweeps.tolist() == [[12, 5], [13, 6]]
    assert "whether its last number '6' is complete cannot be told; it was kept" in whole_numbers.problems[0]
    ragged = read(tmp_path, ",1,2,3\n0,1.5,2,5.25\n1,1.5,2.25,6.2")
    assert len(ragged.series(3)) == 1  # the row before ends with two decimals
    assert "'6.2') and was dropped" in ragged.problems[0]


@pytest.mark.parametrize(
    ("text", "line", "column", "message"),
    [
        ("", None, None, "is empty"),
        (",0.1", 1, None, "found 1 distances; expected at least 2"),
        ("acc_z\n1.0\n", 1, 1, "found 'acc_z'; expected an empty cell"),
        (",0.1,0.2x\n", 1, 3, "found '0.2x'; expected a distance"),
        (",0.1,nan\n", 1, 3, "found 'nan'; expected a distance"),
        (",0.1,1e999\n", 1, 3, "found '1e999'; expected a finite distance"),
        (",0.1,0.3,0.3\n", 1, 4, "found '0.3'; expected a finite distance, greater"),
        (",1,2\n0,1,2\n1,1\n2,1,2\n", 3, None, "has 2 cells; expected 3 cells"),
        (",1,2\n0,1,2,3\n1,1,2\n", 2, None, "has 4 cells; expected 3 cells"),
        (",1,2\n0,1,2\n1,1,2,3\n", 3, None, "has 4 cells; expected 3 cells"),
        (",1,2\n0,1,2\n\n2,1,2\n", 3, None, "is empty; expected 3 cells"),
        (",1,2\n0,1,\n2,1,2\n", 2, 3, "the cell is empty; expected a number"),
        (",1,2\n0,1,2\n1,12a,2\n", 3, 2, "found '12a'; expected a number"),
        (',1,2\n0,1,2\n1,"12",2\n', 3, 2, "found '\"12\"'; expected a number"),
        (",1,2\n0,1,2\n1,1 2,2\n", 3, 2, "found '1 2'; expected a number"),
        (",1,2\n0,1,2\n1,1\r2,1,2\n", 3, None, "has 4 cells"),
        (",1,2\n0,1,2\n1,1\r,2\n", 3, 2, r"found '1\r'; expected a number"),
        (",1,2\n0,1,2\n1,nan,2\n", 3, 2, "found 'nan'; expected a finite number"),
        (",1,2\n0,1,2\n1,1,-inf\n", 3, 3, "found '-inf'; expected a finite number"),
        (",1,2\n0,1,2\n1,1,1e999\n", 3, 3, "found '1e999'; expected a finite number"),
        (",1,2\n0,1,2\n1,1,-8\n", 3, 3, "found '-8'; expected an amplitude, which is not negative"),
        (",1,2\n0,1,2\nnan,1,8\n", 3, 1, "found 'nan'; expected a time in seconds"),
        (",1,2\n0,1,2\n5e9,1,8\n", 3, 1, "found '5e9'; expected a time in seconds, below 4000000000"),
        (",1,2\n0,1,2\n1,NULL,8\n", 3, 2, "found 'NULL'"),
        (",1,2\n0,1,2\n1,\xff\xfe,8\n", 3, 2, "expected a number"),
        (",1,2\n0,1,2\nx\n1,1,8\n", 3, 1, "found 'x'; expected a number"),
    ],
)
def test_what_is_wrong_is_named_with_its_place(
    text: str, line: int | None, column: int | None, message: str, tmp_path: Path
) -> None:
    with pytest.raises(LogError) as caught:
        read(tmp_path, text.encode("latin-1"))
    assert message in str(caught.value)
    assert (caught.value.line, caught.value.column) == (line, column)
    assert caught.value.path == str(tmp_path / "3.csv")


def test_times_count_from_the_first_sweep_of_the_drive(tmp_path: Path) -> None:
    log = tmp_path / "log"
    log.mkdir()
    (log / "3.csv").write_text(",1,2\n5.03,1,2\n5.05,3,4\n")
    (log / "1.csv").write_text(",1,2,3\n5.01,1,2,3\n")
    (log / "acc.csv").write_text("5.000,9\n5.1,-7\n")
    drive = read_lab_csv(log)
    assert [series.sensor for series in drive.sensors] == [1, 3]
    assert drive.series(3).times_ns.tolist() == [20_000_000, 40_000_000]
    assert drive.series(1).times_ns.tolist() == [0]
    assert drive.clock_start_ns == 5_010_000_000
    assert drive.motion.acceleration_m_s2 is not None
    assert drive.motion.acceleration_m_s2.times_ns.tolist() == [-10_000_000, 90_000_000]
    assert drive.motion.acceleration_m_s2.values.tolist() == [9.0, -7.0]
    assert drive.problems == ()


@pytest.mark.parametrize("seconds", [86_400, 1_632_137_110])
def test_nanoseconds_are_exact_after_a_day_and_since_1970(seconds: int, tmp_path: Path) -> None:
    texts = [f"{seconds}.123456789", f"{seconds}.123456791", f"{seconds + 1}.000000001"]
    drive = read(tmp_path, ",1,2" + "".join(f"\n{text},1,2" for text in texts) + "\n")
    assert drive.clock_start_ns == seconds * 10**9 + 123_456_789
    assert drive.series(3).times_ns.tolist() == [0, 2, 876_543_212]


def test_times_that_go_back_or_stand_still_are_kept_and_said(tmp_path: Path) -> None:
    drive = read(tmp_path, lab_text((1, 2), [(time, 1, 2) for time in (0.5, 0.51, 0.51, 0.1, 0.11, 0.11, 0.05)]))
    assert drive.series(3).times_ns.tolist() == [0, 10**7, 10**7, -(4 * 10**8), -39 * 10**7, -39 * 10**7, -45 * 10**7]
    assert drive.problems == (
        "3.csv: 2 of 7 times go back, first in line 5; left as recorded.",
        "3.csv: 2 of 7 times repeat the one before, first in line 4; left as recorded.",
    )


@pytest.mark.parametrize(("rate", "start", "wraps"), [(50, 65000, 1), (50, 1, 3), (30, 60000, 1), (100, 65500, 2)])
def test_the_wrap_of_the_counter_is_undone(rate: int, start: int, wraps: int, tmp_path: Path) -> None:
    counts = np.arange(start, wraps * 65536 + 700)
    rows = "".join(f"\n{count % 65536 / rate:f},1.000000,2.000000" for count in counts)
    drive = read(tmp_path, ",1.000000,2.000000" + rows)
    wanted = np.array([round(int(count) * 10**9 / rate) for count in counts])
    times = drive.series(3).times_ns + drive.clock_start_ns
    assert np.abs(times - wanted).max() <= (0 if rate in (50, 100) else 1000)  # `%f` rounds thirds to 1 µs
    assert len(drive.problems) == 1
    assert "16-bit counter fell back to zero" in drive.problems[0]
    assert f"first in line {65536 - start + 2}; {65536 / rate:.2f} s" in drive.problems[0]


def test_a_reset_that_is_no_wrap_is_left_alone(tmp_path: Path) -> None:
    counts = [*range(60000, 65000), *range(700)]  # stopped short of the counter's end
    drive = read(tmp_path, ",1,2" + "".join(f"\n{count / 50:f},1,2" for count in counts) + "\n")
    assert drive.series(3).times_ns[5000] == -60000 * 20_000_000
    assert drive.problems == ("3.csv: 1 of 5700 times go back, first in line 5002; left as recorded.",)
    jittered = [1310.694, 1310.707, 1310.72, 0.013, 0.026]  # a clock that is not on the counter's grid of 13 ms
    drive = read(tmp_path, ",1,2" + "".join(f"\n{time:f},1,2" for time in jittered) + "\n")
    assert "go back" in drive.problems[0]


def _log(tmp_path: Path, motion: str, sweeps: int = 5, name: str = "gyro.csv") -> Drive:
    log = tmp_path / "log"
    log.mkdir(exist_ok=True)
    (log / "3.csv").write_text(lab_text((1, 2), [(0.02 * (row + 1), row, 2) for row in range(sweeps)]))
    (log / name).write_text(motion)
    return read_lab_csv(log)


@pytest.mark.parametrize("samples", [4, 5, 6])
def test_cpu_time_is_joined_row_by_row(samples: int, tmp_path: Path) -> None:
    drive = _log(tmp_path, "".join(f"{0.003 * row:.3f},{row - 2}\n" for row in range(samples)))
    channel = drive.motion.acceleration_m_s2
    assert channel is not None
    rows = min(samples, 5)
    assert channel.times_ns.tolist() == [20_000_000 * row for row in range(rows)]
    assert channel.values.tolist() == [row - 2.0 for row in range(rows)]
    assert "gyro.csv: its clock is up to" in drive.problems[0]
    assert "joined row by row" in drive.problems[0]
    assert ("1 row without a sweep was dropped" in drive.problems[0]) == (samples == 6)


def test_motion_on_the_radars_clock_is_joined_by_time(tmp_path: Path) -> None:
    for text in ("0.010,3\n0.020,4\n0.115,5\n", "0.021,3\n0.041,4\n0.061,5\n0.081,6\n0.101,7\n"):
        drive = _log(tmp_path, text)
        assert drive.problems == ()
        assert drive.motion.acceleration_m_s2 is not None
        wanted = [round(float(line.split(",")[0]) * 1000) * 10**6 - 20_000_000 for line in text.split()]
        assert drive.motion.acceleration_m_s2.times_ns.tolist() == wanted


def test_serial_time_outs_are_dropped(tmp_path: Path) -> None:
    drive = _log(tmp_path, "0.02,1\n0.04,-129\n0.06,-128\n0.08,-129\n0.10,2\n")
    assert drive.motion.acceleration_m_s2 is not None
    assert drive.motion.acceleration_m_s2.values.tolist() == [1, -128, 2]
    assert drive.motion.acceleration_m_s2.times_ns.tolist() == [0, 40_000_000, 80_000_000]
    assert drive.problems == (
        "gyro.csv: 2 of 5 samples are -129, which the program writes when the serial line times out; "
        "they were dropped.",
    )


@pytest.mark.parametrize("header", ["time,acceleration", "time_s,acceleration_m_s2"])
def test_further_columns_under_names(header: str, tmp_path: Path) -> None:
    drive = _log(tmp_path, f"{header},speed_m_s,yaw_rate_rad_s\n0.02,1,8.5,0.25\n0.04,2,,\n0.06,,,-0.5\n")
    motion = drive.motion
    assert motion.acceleration_m_s2 is not None
    assert motion.speed_m_s is not None
    assert motion.yaw_rate_rad_s is not None
    assert motion.acceleration_m_s2.values.tolist() == [1, 2]
    assert (motion.speed_m_s.times_ns.tolist(), motion.speed_m_s.values.tolist()) == ([0], [8.5])
    assert motion.yaw_rate_rad_s.times_ns.tolist() == [0, 40_000_000]
    assert motion.yaw_rate_rad_s.values.tolist() == [0.25, -0.5]
    assert drive.problems == ()


@pytest.mark.parametrize(
    ("text", "line", "column", "message"),
    [
        ("0.02,1,2\n", 1, None, "has 3 cells; expected time and acceleration"),
        ("seconds,acceleration\n", 1, 1, "found 'seconds'; expected `time_s`"),
        ("time,accel\n", 1, 2, "found 'accel'; expected `acceleration_m_s2`"),
        ("time,acceleration,heave\n", 1, 3, "found 'heave'; expected one of yaw_rate_rad_s, speed_m_s"),
        ("time,acceleration,speed_m_s,speed_m_s\n", 1, 4, "found 'speed_m_s'"),
        ("time\n", 1, None, "has one column"),
        ("0.02,1\n0.04\n0.06,2\n", 2, None, "has 1 cell; expected 2 cells"),
        ("time,acceleration\n0.02,1\n0.04,x\n", 3, 2, "found 'x'; expected a number"),
        ("0.02,1\n0.04,inf\n", 2, 2, "found 'inf'; expected a finite number"),
        ("time,acceleration,speed_m_s\n0.02,1,2\n0.03,1,inf\n", 3, 3, "found 'inf'; expected a finite number"),
        ("time,acceleration,speed_m_s\n0.02,1,2\n,1,2\n", 3, 1, "expected a time"),
        ("time,acceleration,speed_m_s\n0.02,1,2\n0.03,1,x\n0.04,1,2\n", 3, 3, "found 'x'; expected a number"),
    ],
)
def test_bad_motion_is_named_with_its_place(
    text: str, line: int, column: int | None, message: str, tmp_path: Path
) -> None:
    with pytest.raises(LogError) as caught:
        _log(tmp_path, text, name="acc.csv")
    assert message in str(caught.value)
    assert (caught.value.line, caught.value.column) == (line, column)
    assert caught.value.path.endswith("acc.csv")


def test_motion_cut_off_or_empty_or_twice(tmp_path: Path) -> None:
    drive = _log(tmp_path, "0.020,1\n0.040,2\n0.06")
    assert drive.motion.acceleration_m_s2 is not None
    assert drive.motion.acceleration_m_s2.values.tolist() == [1, 2]
    assert drive.problems == (
        "gyro.csv, line 3: the last row is cut off (it ends at cell 1 of 2, '0.06') and was dropped.",
    )
    assert _log(tmp_path, "").problems == ("gyro.csv: is empty.",)
    both = _log(tmp_path, "0.020,1\n", name="acc.csv")
    assert both.problems == ("gyro.csv: was not read, because acc.csv is there too.",)


def test_truth_and_mounting_beside_the_log(tmp_path: Path) -> None:
    text = '{"steps": [{"impact_s": 1, "height_m": 0.03}, {"impact_s": 2.5}], "mounting": {"angle_deg": 45}}'
    (tmp_path / "3.truth.json").write_text(text)
    drive = read(tmp_path, FIGURE_TEXT)
    assert drive.truth == Truth((RoadStep(1.0, 0.03), RoadStep(2.5)))
    assert drive.mounting == Mounting(angle_deg=45.0)
    (tmp_path / "3.truth.json").write_text('{"steps": []}')
    assert read(tmp_path, FIGURE_TEXT).truth == Truth(())
    (tmp_path / "3.truth.json").write_text('{"mounting": {}}')
    drive = read(tmp_path, FIGURE_TEXT)
    assert (drive.truth, drive.mounting) == (None, Mounting())
    (tmp_path / "log").mkdir()
    (tmp_path / "log/1.csv").write_text(FIGURE_TEXT)
    (tmp_path / "log/truth.json").write_text('{"steps": [{"impact_s": 3}]}')
    assert read_lab_csv(tmp_path / "log").truth == Truth((RoadStep(3.0),))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "is not JSON"),
        ("[" * 100_000, "is not JSON"),
        ("[]", "the file must be an object with steps, mounting; got []"),
        ('{"step": []}', "the file has the unknown key 'step' (did you mean `steps`?); known are steps, mounting."),
        ('{"steps": {}}', "`steps` must be a list; got {}"),
        ('{"steps": null}', "`steps` must be a list; got None"),
        ('{"steps": [{"height_m": 1}]}', "`steps[0]` lacks `impact_s`"),
        (
            '{"steps": [{"impact_s": 1}, {"impact_s": "2"}]}',
            "`impact_s` of `steps[1]` must be a finite number; got '2'",
        ),
        ('{"steps": [{"impact_s": NaN}]}', "must be a finite number; got nan"),
        ('{"steps": [{"impact_s": true}]}', "must be a finite number; got True"),
        ('{"steps": [{"impact_s": 1' + "0" * 400 + "}]}", "must be a finite number"),
        (
            '{"steps": [{"impact_s": 1, "heigth_m": 2}]}',
            "unknown key 'heigth_m' (did you mean `height_m`?); known are impact_s, height_m, wheels_s",
        ),
        ('{"mounting": {"tilt": 3}}', "`mounting` has the unknown key 'tilt'; known are height_m"),
        ('{"mounting": 3}', "`mounting` must be an object"),
    ],
)
def test_bad_truth_is_named_with_its_key(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "3.truth.json").write_text(text)
    with pytest.raises(LogError) as caught:
        read(tmp_path, FIGURE_TEXT)
    assert message in str(caught.value)
    assert caught.value.path == str(tmp_path / "3.truth.json")
