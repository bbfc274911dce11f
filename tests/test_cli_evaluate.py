"""`jaxradar evaluate` end to end: lines, table, parts, failures, exit statuses."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from jaxradar.cli import main
from jaxradar.drive import Channel, Drive, Motion, RoadStep, SensorSeries, Truth
from jaxradar.logs import write_log

AXIS = 0.1 + 0.02 * np.arange(40)
KEYS = [
    "path", "sensor", "sweeps", "duration_s", "sweep_rate_hz", "invalid_sweeps", "problems", "detections",
    "hits", "misses", "false_alarms", "lead_s",
]  # fmt: skip
DETECTION_KEYS = ["time_s", "range_m", "strength", "statistic", "threshold", "sweep", "impact_in_s"]


def jumps(*at: int, count: int = 200, sensor: int = 3, **more: Any) -> Drive:
    """A sensor at 100 Hz whose one strong bin moves by one, at the sweeps given: 2 m/s for one sweep."""
    place = 10 + np.cumsum(np.isin(np.arange(count), at))
    sweeps = np.full((count, len(AXIS)), 8, np.uint16)
    sweeps[np.arange(count), place] = 8000
    times = np.arange(count, dtype=np.int64) * 10_000_000
    return Drive(sensors=(SensorSeries(sensor, times, sweeps, AXIS, np.zeros(count, np.uint16)),), **more)


def known(*impacts: float) -> Truth:
    return Truth(tuple(RoadStep(impact) for impact in impacts))


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, list[dict[str, Any]], str]:
    """Status, lines and standard error of an evaluation with the thesis's rule and `--json -`."""
    status = main(["evaluate", *map(str, arguments), "--detector", "thesis", "--json", "-"])
    captured = capsys.readouterr()
    return status, [json.loads(line) for line in captured.out.splitlines()], captured.err


@pytest.fixture
def log(tmp_path: Path) -> Path:
    write_log(jumps(50, 120, truth=known(0.55, 1.9)), tmp_path / "log")
    return tmp_path / "log"


def test_one_object_for_each_series(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, (line,), err = run(capsys, log)
    assert status == 0
    assert list(line) == KEYS
    assert line["path"] == str(log)
    assert (line["sensor"], line["sweeps"], line["invalid_sweeps"], line["problems"]) == (3, 200, 0, [])
    assert line["duration_s"] == pytest.approx(1.99)
    assert line["sweep_rate_hz"] == pytest.approx(100)
    first, second = line["detections"]
    assert list(first) == DETECTION_KEYS
    assert (first["time_s"], first["sweep"]) == (pytest.approx(0.5), 50)
    assert first["range_m"] == pytest.approx(AXIS[11])
    assert first["statistic"] == pytest.approx(2.0)
    assert first["threshold"] == pytest.approx(0.7)
    assert (second["time_s"], second["sweep"]) == (pytest.approx(1.2), 120)
    assert (line["hits"], line["misses"], line["false_alarms"]) == (1, 1, 1)
    assert line["lead_s"] == [pytest.approx(0.05)]
    assert "lead ms" in err
    assert "1 of 2 steps seen" in err


def test_unknown_truth_is_null_and_no_steps_are_not(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_log(jumps(50), tmp_path / "unknown")
    write_log(jumps(50, truth=Truth()), tmp_path / "flat")
    _, (flat, unknown), _ = run(capsys, tmp_path)
    assert [unknown[key] for key in KEYS[-4:]] == [None] * 4
    assert [flat[key] for key in KEYS[-4:]] == [0, 0, 1, []]


def test_the_window_is_settable_and_follows_the_speed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    slow = Motion(speed_m_s=Channel(np.array([0, 2 * 10**9]), np.array([2.0, 2.0])))
    write_log(jumps(50, truth=known(0.95), motion=slow), tmp_path / "slow")
    write_log(jumps(50, truth=known(0.95)), tmp_path / "unsaid")
    hits = {}
    for options in ([], ["--window", "0.5"], ["--window-metres", "0.5"]):
        _, lines, _ = run(capsys, tmp_path, *options)
        hits[tuple(options)] = [line["hits"] for line in lines]
    assert list(hits.values()) == [[1, 0], [1, 1], [0, 0]]


def test_a_part_of_the_log_is_looked_at(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, (late,), _ = run(capsys, log, "--start", 1.0, "--stop", 1.5)
    assert late["sweeps"] == 51
    assert [(one["sweep"], one["time_s"]) for one in late["detections"]] == [(120, pytest.approx(1.2))]
    assert [late[key] for key in KEYS[-4:]] == [0, 0, 1, []]  # both steps lie outside
    _, (early,), _ = run(capsys, log, "--stop", 1.0)
    assert [early[key] for key in KEYS[-4:]] == [1, 0, 0, [pytest.approx(0.05)]]
    assert run(capsys, log, "--start", 7)[0] == 2


def test_thinning_and_sensors(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    two = replace(jumps(50), sensors=jumps(50).sensors + jumps(count=100, sensor=1).sensors)
    write_log(replace(two, sensors=tuple(sorted(two.sensors, key=lambda one: one.sensor))), tmp_path / "two")
    _, lines, _ = run(capsys, tmp_path / "two")
    assert [(line["sensor"], line["sweeps"]) for line in lines] == [(1, 100), (3, 200)]
    _, (three,), _ = run(capsys, tmp_path / "two", "--sensor", 3, "--thin", 20)
    # Every second bin is kept: with the echo in bin 11 the rule is left with the background, strongest at the end.
    assert [one["range_m"] for one in three["detections"]] == [pytest.approx(AXIS[38])]
    status, (failed,), err = run(capsys, tmp_path / "two", "--sensor", 2)
    assert status == 2
    assert failed["error"] == f"{tmp_path / 'two'}: has no sensor 2; its sensors: 1, 3."
    assert failed["error"] in err
    status, lines, _ = run(capsys, tmp_path / "two", "--thin", 41)
    assert status == 2
    assert "cannot thin 40 range bins to 41" in lines[0]["error"]


def test_a_failed_log_is_said_and_the_others_are_evaluated(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_log(jumps(), tmp_path / "bad")
    (tmp_path / "bad" / "truth.json").write_text('{"stepz": []}')
    (tmp_path / "empty").mkdir()
    status, lines, err = run(
        capsys, tmp_path / "bad", tmp_path / "gone.h5", tmp_path / "empty", log, tmp_path / "no*such", log
    )
    assert status == 1
    failed = {line["path"]: line["error"] for line in lines if "error" in line}
    assert set(failed) == {str(tmp_path / name) for name in ("bad", "gone.h5", "empty", "no*such")}
    assert all(list(line) == ["path", "error"] for line in lines if "error" in line)
    assert "did you mean `steps`?" in failed[str(tmp_path / "bad")]
    assert [line["path"] for line in lines if "error" not in line] == [str(log)]
    assert "Traceback" not in err
    for sentence in failed.values():
        assert sentence in err


def test_a_salvaged_log_counts_as_read(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (log / "3.csv").read_text()
    (log / "3.csv").write_text(text[:-200])
    status, (line,), err = run(capsys, log)
    assert status == 0
    assert line["sweeps"] == 199
    assert len(line["problems"]) == 1
    assert line["problems"][0] in err


def test_a_log_without_sweeps_is_strict_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_log(jumps(count=0), tmp_path / "none.drive")
    write_log(jumps(count=1), tmp_path / "one.drive")
    status, (none, one), _ = run(capsys, tmp_path, "--figures", tmp_path / "figures")
    assert status == 0
    assert (none["sweeps"], none["duration_s"], none["sweep_rate_hz"]) == (0, 0.0, None)
    assert (one["sweeps"], one["sweep_rate_hz"], one["detections"]) == (1, None, [])
    assert sorted(path.name for path in (tmp_path / "figures").iterdir()) == [
        "one-sensor3-sweeps.png",
        "one-sensor3.png",
    ]


def test_the_table_fits_80_columns_and_says_everything(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    write_log(jumps(50, truth=known(0.55)), tmp_path / "first [bold]")
    write_log(jumps(50), tmp_path / "second")
    shown = {}
    for columns in ("80", "30"):
        monkeypatch.setenv("COLUMNS", columns)
        assert main(["evaluate", str(tmp_path), "--detector", "thesis"]) == 0
        shown[columns], err = capsys.readouterr()
        assert err == ""
    out = shown["80"]
    assert shown["30"] == out  # nothing vanishes in a narrow window
    assert "\x1b" not in out
    head, first, second, total = (line.rstrip() for line in out.splitlines())
    assert max(map(len, (head, first, second))) <= 80
    assert head.split() == ["log", "sensor", "sweeps", "invalid", "found", "hit", "missed", "false", "lead", "ms"]
    assert first.split() == ["first", "[bold]", "3", "200", "0", "1", "1", "0", "0", "50"]
    assert second.split() == ["second", "3", "200", "0", "1", "?", "?", "?", "?"]
    assert total == "Truth known for 2.0 s: 1 of 1 steps seen, median lead 50 ms, false alarms: 0 (0.0 per hour)."
    assert main(["evaluate", str(tmp_path), "--detector", "thesis", "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")


def test_figures_of_logs_of_one_name_do_not_replace_each_other(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for folder in ("a", "b"):
        write_log(jumps(50), tmp_path / folder / "log")
    assert run(capsys, tmp_path / "a", tmp_path / "b", "--figures", tmp_path / "f" / "g")[0] == 0
    names = {path.name for path in (tmp_path / "f" / "g").iterdir()}
    assert names == {f"{log}-sensor3{more}.png" for log in ("log", "b-log") for more in ("", "-sweeps")}


def test_targets_that_cannot_be_written_are_refused_before_any_work(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    import jaxradar.logs

    monkeypatch.setattr(jaxradar.logs, "read_log", lambda _: pytest.fail("a log was read"))
    (tmp_path / "file").write_text("kept")
    before = (log / "3.csv").read_bytes()
    for option, target in (
        ("--json", tmp_path),
        ("--json", tmp_path / "absent" / "x.jsonl"),
        ("--json", log / "3.csv"),
        ("--json", tmp_path / "x" / ".." / "log" / "new.jsonl"),
        ("--json", tmp_path / "log.truth.json"),
        ("--figures", tmp_path / "file"),
        ("--figures", tmp_path / "file" / "deeper"),
    ):
        assert main(["evaluate", str(log), option, str(target)]) == 2
        out, err = capsys.readouterr()
        assert out == ""
        assert len(err.splitlines()) == 1
        assert option in err
    assert (log / "3.csv").read_bytes() == before
    assert (tmp_path / "file").read_text() == "kept"


def test_what_was_read_is_on_the_disk_when_reading_ends(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from jaxradar.evaluation import run

    write_log(jumps(50), tmp_path / "next")
    read, target = run.read_log, tmp_path / "results.jsonl"

    def stopped(path: str) -> Drive:
        if path.endswith("next"):
            raise KeyboardInterrupt
        return read(path)

    monkeypatch.setattr(run, "read_log", stopped)
    assert main(["evaluate", str(log), str(tmp_path / "next"), "--detector", "thesis", "--json", str(target)]) == 130
    assert capsys.readouterr().err == "jaxradar: stopped.\n"
    assert [json.loads(line)["path"] for line in target.read_text().splitlines()] == [str(log)]


def test_a_name_that_is_no_text(tmp_path: Path) -> None:
    odd = tmp_path / "n\udcff\N{SUPERSCRIPT TWO}"
    write_log(jumps(50), odd)
    ran = subprocess.run(
        [sys.executable, "-m", "jaxradar", "evaluate", str(tmp_path), "--detector", "thesis", "--json", "-"],
        capture_output=True,
        check=False,
        env={"PYTHONIOENCODING": "ascii", "PATH": "/usr/bin:/bin"},
    )
    assert ran.returncode == 0, ran.stderr
    assert json.loads(ran.stdout)["path"] == str(odd)


def test_the_road_recordings_thinned_as_in_the_lab(
    road_recordings: dict[str, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    """Against a count in plain NumPy of what the thesis's rule does on three of them."""
    import h5py

    names = ["Roughgravel_0_45", "cement_0_15", "demo1"]
    status, lines, _ = run(capsys, *(road_recordings[name] for name in names), "--thin", 128)
    assert status == 0
    for line in lines:
        with h5py.File(line["path"]) as file:
            sweeps, times = file["data"][:, 0, :].astype(np.float64), file["sample_times"][:].ravel()
        kept = sweeps.shape[1] * np.arange(128) // 128
        axis = (0.2 + 0.6 * np.arange(sweeps.shape[1]) / (sweeps.shape[1] - 1))[kept]
        ranges = axis[(sweeps[:, kept] * (2 * axis) ** 2).argmax(axis=1)]
        wanted = int((np.abs(np.diff(ranges)) / np.diff(times) > 0.7).sum())
        assert wanted > 0
        assert len(line["detections"]) == wanted


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_a_full_disk_is_said_with_the_file_that_it_concerns(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", str(log), "--detector", "thesis", "--quiet", "--json", "/dev/full"]) == 1
    assert capsys.readouterr().err == "jaxradar: /dev/full: cannot be written: No space left on device.\n"


def test_a_figure_that_cannot_be_written_leaves_no_half_of_it(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from matplotlib.figure import Figure

    def full(self: Figure, path: Path, **_: object) -> None:
        path.write_bytes(b"\x89PNG")
        raise OSError(28, "No space left on device")  # as `write` says it: without a name

    monkeypatch.setattr(Figure, "savefig", full)
    figures = tmp_path / "figures"
    assert main(["view", str(log), "--detector", "thesis", "-o", str(figures)]) == 1
    assert capsys.readouterr().err == (
        f"jaxradar: {figures / 'log-sensor3.png'}: cannot be written: No space left on device.\n"
    )
    assert not list(figures.iterdir())


@pytest.mark.parametrize("name", ["n\udcff", "two\nlines", "\x1b[31m", "路面", "$x$"])
def test_names_that_no_font_and_no_terminal_takes_as_they_are(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], recwarn: pytest.WarningsRecorder
) -> None:
    write_log(jumps(50), tmp_path / name)
    arguments = ["--detector", "thesis", "--figures", str(tmp_path / "figures")]
    assert main(["evaluate", str(tmp_path / name), *arguments]) == 0
    out, err = capsys.readouterr()
    assert len(out.splitlines()) == 2
    assert err == ""
    assert not [str(one.message) for one in recwarn if "Glyph" in str(one.message)]
    assert len(list((tmp_path / "figures").iterdir())) == 2


@pytest.mark.parametrize("given", ["./log", "log/", ".//log", "log"])
def test_the_path_is_the_one_that_was_given(
    given: str, log: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(log.parent)
    assert [line["path"] for line in run(capsys, given)[1]] == [given]


def test_no_output_takes_the_place_of_what_was_recorded(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, store = tmp_path / "log", tmp_path / "store"
    write_log(jumps(50), log)
    assert main(["import", str(log), "-o", str(store), "--quiet"]) == 0
    assert main(["import", str(store), "-o", str(tmp_path / "a.zip"), "--quiet"]) == 0
    capsys.readouterr()
    os.mkfifo(tmp_path / "pipe")
    for source, target in (
        (log, next(log.glob("*.csv"))),
        (log, log / "truth.json"),
        (store, store / "catalogue.sqlite"),
        (tmp_path / "a.zip", tmp_path / "a.zip"),
        (log, tmp_path / "store" / "report.html"),
    ):
        before = target.read_bytes() if target.exists() else None
        for option in ("--report", "--json"):
            assert main(["evaluate", str(source), option, str(target), "--detector", "thesis"]) == 2
            assert len(capsys.readouterr().err.splitlines()) == 1
            assert (target.read_bytes() if target.exists() else None) == before
    assert main(["evaluate", str(log), "--report", str(tmp_path / "pipe"), "--detector", "thesis"]) == 2
    both = str(tmp_path / "both")
    assert main(["evaluate", str(log), "--report", both, "--json", both, "--detector", "thesis"]) == 2
    assert not Path(both).exists()


def test_a_report_of_logs_named_in_two_ways(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("a", "b"):
        write_log(jumps(50), tmp_path / name)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    page = tmp_path / "r.html"
    assert main(["evaluate", str(tmp_path / "a"), "b", "empty", "--report", "r.html", "--detector", "thesis"]) == 1
    assert "is a folder without logs" in page.read_text()


def test_a_log_that_goes_away_costs_the_curve_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_log(jumps(50, truth=Truth((RoadStep(0.6),))), tmp_path / "log.drive")
    import jaxradar.evaluation as evaluation

    curve = evaluation.operating_curve

    def gone(*given: Any, **more: Any) -> Any:
        shutil.rmtree(tmp_path / "log.drive")
        return curve(*given, **more)

    monkeypatch.setattr(evaluation, "operating_curve", gone)
    page = tmp_path / "page.html"
    assert main(["evaluate", str(tmp_path / "log.drive"), "--report", str(page), "--detector", "thesis"]) == 0
    assert "no curve: " in capsys.readouterr().err
    assert '"curve":[]' in page.read_text()
