"""Many logs: tables, order, failures, workers that die, the report's data and its page."""

from __future__ import annotations

import dataclasses
import html.parser
import json
import os
import signal
import threading
import time
import zlib
from base64 import b64decode
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pyarrow as pa
import pytest
from test_cli_evaluate import AXIS, jumps, known

from jaxradar import ConfigError
from jaxradar.cli import main
from jaxradar.cluster import Cluster, Here, LostError, cluster_of
from jaxradar.evaluation import Evaluation, Selection, Settings, evaluate, evaluate_each, operating_curve
from jaxradar.evaluation.picture import picture_of
from jaxradar.evaluation.records import Failure, SeriesResult, record_of
from jaxradar.logs import read_log, write_log
from jaxradar.report import write_report
from jaxradar.report.data import NOTHING, page_data
from jaxradar.systems.step import ThesisDetector, detect


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Seven logs with truth, one without, one that is broken."""
    folder = tmp_path_factory.mktemp("logs")
    for number in range(7):
        drive = jumps(50 + number, 120, count=200 + 10 * number, truth=known(0.6, 1.9))
        write_log(drive, folder / f"log{number}")
    write_log(jumps(30), folder / "unknown")
    (folder / "wrong").mkdir()
    (folder / "wrong" / "1.csv").write_text(",1,2\n0,x,2\n")
    return folder


@pytest.fixture(scope="module")
def found(logs: Path) -> Evaluation:
    return evaluate(logs, "thesis", pictures=True)


def test_every_log_is_a_row_in_order(found: Evaluation, logs: Path) -> None:
    assert [Path(one.path).name for one in found.results] == [f"log{n}" for n in range(7)] + ["unknown"]
    assert [one.path for one in found.failures] == [str(logs / "wrong")]
    assert "1.csv, line 2, column 2" in found.failures[0].error
    for one in found.results:
        (series,) = read_log(one.path).sensors
        trace = detect(ThesisDetector(), series)
        assert list(one.events) == list(trace.events)
        assert (one.sweeps, one.sweep_rate_hz, one.duration_s) == (len(series), series.sweep_rate_hz, series.duration_s)
        assert one.invalid_sweeps == int((~trace.valid).sum())
    assert found.results[-1].score is None
    assert (found.summary.hits, found.summary.misses, found.summary.series) == (7, 7, 7)


def test_tables_go_where_tables_go(found: Evaluation) -> None:
    import polars

    arrow = pa.table(found)
    assert arrow.num_rows == len(found) == 8
    assert arrow["hits"].to_pylist() == [1] * 7 + [None]
    assert arrow["lead_s"].to_pylist()[0] == pytest.approx([0.1])
    assert polars.DataFrame(found)["sweeps"].to_list() == [200 + 10 * n for n in range(7)] + [200]
    assert found.to_polars().columns == arrow.column_names
    frame = found.to_pandas()
    assert list(frame.columns) == arrow.column_names
    assert frame["false_alarms"].sum() == found.summary.false_alarms
    events = found.events()
    assert events.num_rows == sum(len(one.events) for one in found.results)
    assert events.schema.names[0] == "path"
    steps = found.steps()
    assert steps.num_rows == found.summary.hits + found.summary.misses
    assert steps["lead_s"].null_count == found.summary.misses
    empty = Evaluation.of([], Settings(ThesisDetector()))
    assert (empty.to_arrow().num_rows, empty.events().num_rows) == (0, 0)
    assert empty.to_arrow().schema == arrow.schema


def test_json_lines(found: Evaluation, tmp_path: Path) -> None:
    found.write_json(tmp_path / "lines")
    lines = [json.loads(line) for line in (tmp_path / "lines").read_text().splitlines()]
    assert lines[:-1] == [json.loads(json.dumps(record_of(one))) for one in found.results]
    assert list(lines[-1]) == ["path", "error"]


def test_a_part_of_each_log(logs: Path) -> None:
    (one,) = evaluate(logs / "log0", "thesis", selection=Selection(start_s=1.0, stop_s=1.5)).results
    assert [event.sweep for event in one.events] == [120]
    assert one.sweeps == 51
    failed = evaluate([logs / "log0"], "thesis", selection=Selection(sensor=9)).failures
    assert failed[0].wrong_option
    assert "no sensor 9" in failed[0].error


def test_progress_and_a_detector_that_there_is_not(logs: Path) -> None:
    heard: list[tuple[int, int]] = []
    evaluate(logs, "thesis", progress=lambda done, whole: heard.append((done, whole)))
    assert heard[-1] == (9, 9)
    with pytest.raises(ConfigError, match="unknown detector"):
        evaluate(logs, "theses")


def test_operating_curve(found: Evaluation) -> None:
    heard: list[int] = []
    curve = operating_curve(found, (0.5, 1.0, 100.0), most_logs=4, advance=heard.append)
    assert [point.chosen for point in curve] == [False, True, False]
    assert [point.threshold for point in curve] == pytest.approx([0.35, 0.7, 70.0])
    assert [point.summary.series for point in curve] == [4, 4, 4]
    assert [point.summary.hits for point in curve] == [4, 4, 0]
    own, last = curve[1].detected, curve[-1].detected
    assert own is not None
    assert own.low < own.value == 0.5 < own.high
    assert last is not None
    assert (last.low, last.high) == (0.0, pytest.approx(0.3694, abs=1e-4))  # 1 - .025^(1/8)
    assert curve[-1].false_alarms_per_hour is not None
    assert curve[-1].false_alarms_per_hour.low == 0.0
    assert sum(heard) == 4


# Workers


@pytest.fixture(scope="module")
def workers() -> Any:
    with cluster_of("local:2") as made:
        yield made


def test_workers_give_what_this_process_gives(
    workers: Cluster, found: Evaluation, logs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from jaxradar.evaluation import run

    monkeypatch.setattr(run, "SHARD", 2)
    there = evaluate(logs, "thesis", pictures=True, cluster=workers)
    assert [record_of(one) for one in there.results] == [record_of(one) for one in found.results]
    assert there.failures == found.failures
    for one, other in zip(there.results, found.results, strict=True):
        jax.tree.map(np.testing.assert_array_equal, vars(one.picture), vars(other.picture))


def _gradient(part: list[float]) -> Any:
    weights = {"a": np.float32(0.1), "b": np.arange(3, dtype=np.float32)}
    loss = lambda weights: sum(jax.numpy.sin(weights["a"] * x) * weights["b"].sum() for x in part)  # noqa: E731
    return jax.tree.map(np.asarray, jax.grad(loss)(weights))


def test_sums_of_gradients_are_those_of_one_process(workers: Cluster) -> None:
    parts = [[0.1 * n, n**0.5, 1.0] for n in range(17)]
    there, here = workers.total(_gradient, parts), Here().total(_gradient, parts)
    jax.tree.map(np.testing.assert_array_equal, there, here)
    assert workers.total(len, parts, max) == 3
    with pytest.raises(ValueError, match="at least one part"):
        workers.total(_gradient, [])


def _slow_square(number: int) -> int:
    time.sleep(0.05)
    return number * number


def test_a_worker_that_dies_costs_a_retry(workers: Cluster) -> None:
    victims = list(workers._client.run(os.getpid).values())
    killer = threading.Timer(0.5, lambda: os.kill(victims[0], signal.SIGKILL))
    killer.start()
    assert list(workers.map(_slow_square, range(60))) == [n * n for n in range(60)]
    killer.join()
    deadline = time.monotonic() + 30
    while victims[0] in (now := list(workers._client.run(os.getpid).values())) or len(now) < 2:
        assert time.monotonic() < deadline
        time.sleep(0.1)


def _deadly(number: int) -> int:
    if number == 3:
        os._exit(1)
    return number


@pytest.mark.long  # Dask tries again four times, each with a new process
def test_a_part_that_kills_its_workers_is_lost_alone() -> None:
    with cluster_of("local:2") as made:
        assert made is not None
        results = list(made.map(_deadly, range(6)))
    assert [one for one in results if not isinstance(one, LostError)] == [0, 1, 2, 4, 5]
    assert isinstance(results[3], LostError)


def _broken(number: int) -> int:
    raise OSError(f"no {number}")


def test_what_a_part_raises_is_raised_here(workers: Cluster) -> None:
    with pytest.raises(OSError, match="no 0"):
        list(workers.map(_broken, range(3)))
    assert list(workers.map(_slow_square, [2])) == [4]


def test_each_worker_has_its_own_cores(workers: Cluster) -> None:
    if not hasattr(os, "sched_getaffinity") or len(os.sched_getaffinity(0)) < 2:
        pytest.skip("one core")
    held = list(workers._client.run(lambda: sorted(os.sched_getaffinity(0))).values())
    assert not set(held[0]) & set(held[1])
    assert set(held[0]) | set(held[1]) == os.sched_getaffinity(0)


@pytest.mark.parametrize(
    ("name", "said"),
    [("local:0", "unknown cluster"), ("local:x", "unknown cluster"), ("http://x", "unknown cluster"), ("", "unknown")],
)
def test_clusters_that_there_are_not(name: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said), cluster_of(name):
        pass


def test_a_scheduler_that_does_not_answer(monkeypatch: pytest.MonkeyPatch, logs: Path, capsys: Any) -> None:
    monkeypatch.setattr("jaxradar.cluster.CONNECT_SECONDS", 1)
    assert main(["evaluate", str(logs), "--detector", "thesis", "--cluster", "tcp://127.0.0.1:9"]) == 2
    err = capsys.readouterr().err
    assert err.startswith("jaxradar: no scheduler answers at tcp://127.0.0.1:9")
    assert len(err.splitlines()) == 1


# The report


class _Page(html.parser.HTMLParser):
    """The text of the scripts that hold data, and every attribute that could ask for something."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.data, self.blobs, self.asked, self.kind = "", [], [], ""
        self.feed(text)

    def handle_starttag(self, tag: str, attributes: Any) -> None:
        held = dict(attributes)
        self.asked += [held[name] for name in ("src", "href", "action") if name in held]
        self.kind = held.get("id") or held.get("class") or "" if tag == "script" else self.kind

    def handle_data(self, text: str) -> None:
        if self.kind == "data":
            self.data += text
        elif self.kind == "blob":
            self.blobs.append(text)

    def handle_endtag(self, tag: str) -> None:
        self.kind = ""


def test_the_page_holds_all_and_asks_for_nothing(found: Evaluation, logs: Path, tmp_path: Path) -> None:
    curve = operating_curve(found, (1.0, 2.0))
    write_report(found, tmp_path / "page.html", curve=curve, title="<b>&")
    text = (tmp_path / "page.html").read_text()
    page = _Page(text)
    assert page.asked == ["#table"]
    assert "://" not in text.replace("http://www.w3.org/2000/svg", "")
    assert "<title>&lt;b&gt;&amp;</title>" in text
    data = json.loads(page.data)
    assert data["path"] == [Path(one.path).name for one in found.results]
    assert data["score"][0] == [1, 1, 1, [0.1]]
    assert data["failures"][0][0] == str(logs / "wrong")
    assert len(data["curve"]) == 2
    assert sorted(path.name for path in tmp_path.iterdir()) == ["page.html"]


def test_pictures_come_back_from_their_blobs(found: Evaluation) -> None:
    data, blobs = page_data(found, (), "title")
    raw = b"".join(zlib.decompress(b64decode(blob), -15) for blob in blobs)
    offset = 0
    for one, frame in zip(found.results, data["picture"], strict=True):
        start, stop, near, far, top, size, fastest = frame
        words = np.frombuffer(raw[offset : offset + size], "<u2")
        count, columns, rows = words[:3]
        low, high, slow, fast, statistic, event = words[3 : 3 + 6 * count].reshape(6, count)
        picture = one.picture
        assert picture is not None
        for row, wanted in ((low, picture.range_m[0]), (high, picture.range_m[1])):
            known_ = np.isfinite(wanted)
            assert ((row == NOTHING) == ~known_).all()
            np.testing.assert_allclose(near + row[known_] / 65534 * (far - near), wanted[known_], atol=2e-5)
        np.testing.assert_allclose(statistic / 65535 * top, picture.statistic, atol=1e-4 * max(top, 1))
        assert event.astype(bool).tolist() == picture.event.tolist()
        assert bool(picture.event.any()) == bool(len(one.events))
        known_ = np.isfinite(picture.speed_m_s[1])
        np.testing.assert_allclose((fast[known_] / 32767 - 1) * fastest, picture.speed_m_s[1][known_], atol=1e-3)
        cells = np.frombuffer(raw[offset : offset + size], np.uint8)[6 + 12 * count :][: rows * columns]
        np.testing.assert_array_equal(cells.reshape(rows, columns), picture.amplitude)
        assert (start, stop) == (picture.start_s, picture.stop_s)
        assert (slow <= fast)[fast != NOTHING].all()
        offset += size
    assert offset == len(raw)


@pytest.mark.parametrize("count", [0, 1, 7, 1000])
def test_a_picture_keeps_extremes(count: int) -> None:
    rng = np.random.default_rng(count)
    series = dataclasses.replace(
        read_series(count), sweeps=rng.integers(0, 65536, (count, len(AXIS))).astype(np.uint16)
    )
    found = {name: rng.normal(size=count) for name in ("range_m", "speed_m_s", "statistic")}
    found["valid"] = rng.random(count) < 0.8
    found["event"] = rng.random(count) < 0.01
    picture = picture_of(series, found)
    seen = found["range_m"][found["valid"]]
    if len(seen):
        assert np.nanmin(picture.range_m) == np.float32(seen.min())
        assert np.nanmax(picture.range_m) == np.float32(seen.max())
        assert picture.statistic.max() == np.float32(found["statistic"].max())
    assert len(picture.statistic) == len(picture.event) == min(count, 160)
    assert picture.event.any() == found["event"].any()
    assert picture.amplitude.shape == (32, min(count, 80))


def read_series(count: int) -> Any:
    return (
        jumps(count=max(count, 1)).sensors[0]
        if count
        else dataclasses.replace(
            jumps(count=1).sensors[0],
            times_ns=np.empty(0, np.int64),
            sweeps=np.empty((0, len(AXIS)), np.uint16),
            flags=np.empty(0, np.uint16),
        )
    )


def test_names_cannot_end_the_element_they_stand_in(tmp_path: Path) -> None:
    wicked = tmp_path / "a</script><script>alert(1)<" / "{{data}}{{script}}"
    write_log(jumps(20), wicked)
    write_report(evaluate(tmp_path, "thesis", pictures=True), tmp_path / "page.html")
    page = _Page((tmp_path / "page.html").read_text())
    assert json.loads(page.data)["folder"].endswith("a</script><script>alert(1)<")
    assert json.loads(page.data)["path"] == ["{{data}}{{script}}"]


def test_a_report_from_the_command_line(logs: Path, tmp_path: Path, capsys: Any) -> None:
    page = tmp_path / "page.html"
    assert main(["evaluate", str(logs), "--detector", "thesis", "--report", str(page), "--quiet"]) == 1
    assert len(json.loads(_Page(page.read_text()).data)["curve"]) >= 5
    capsys.readouterr()
    assert main(["evaluate", str(logs), "--detector", "thesis", "--report", str(tmp_path / "no" / "page.html")]) == 2
    assert "--report" in capsys.readouterr().err
    csv = logs / "log0" / "3.csv"
    before = csv.read_bytes()
    assert main(["evaluate", str(csv), "--detector", "thesis", "--report", str(csv)]) == 2
    assert csv.read_bytes() == before


def test_what_fails_comes_in_its_place(logs: Path) -> None:
    paths = [str(logs / "wrong"), str(logs / "log1"), str(logs / "none"), str(logs / "log0")]
    settings = Settings(ThesisDetector())
    kinds = [type(one) for one in evaluate_each(paths, settings)]
    assert kinds == [Failure, SeriesResult, Failure, SeriesResult]
