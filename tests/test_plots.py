"""Figures say what was found, show it at its place, and stay small whatever the log's length."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure

from jaxradar.drive import Channel, Motion, RoadStep, SensorSeries, SweepFlag
from jaxradar.matching import match_steps
from jaxradar.plots import plot_drive, plot_sweeps, save
from jaxradar.plots.reduce import envelope_of, grid, runs
from jaxradar.plots.timeline import message_of
from jaxradar.systems.step.result import StepEvent, StepTrace


def made(
    times_s: np.ndarray, bins: int = 16, events: tuple[float, ...] = (), flags: np.ndarray | None = None
) -> tuple[SensorSeries, StepTrace]:
    """A series whose amplitude in each bin is the sweep's number, and a trace with detections at some times."""
    count = len(times_s)
    flags = np.zeros(count, np.uint16) if flags is None else flags.astype(np.uint16)
    sweeps = np.repeat(np.arange(count, dtype=np.uint16)[:, None], bins, axis=1)
    series = SensorSeries(1, np.rint(times_s * 1e9).astype(np.int64), sweeps, 0.2 + 0.01 * np.arange(bins), flags)
    valid = ~series.invalid
    nearest = np.searchsorted(times_s, events).tolist()
    trace = StepTrace(
        sensor=1,
        times_s=series.times_s,
        range_m=np.where(valid, 0.3, np.nan),
        speed_m_s=np.zeros(count),
        strength=np.ones(count),
        statistic=np.zeros(count),
        impact_in_s=np.zeros(count),
        valid=valid,
        saturated=np.zeros(count, bool),
        threshold=0.7,
        statistic_name="|range rate|",
        statistic_unit="m/s",
        events=tuple(StepEvent(time, 0.3, 1.0, 1.0, 0.7, place) for time, place in zip(events, nearest, strict=True)),
    )
    return series, trace


@pytest.fixture(autouse=True)
def untouched_settings() -> Iterator[None]:
    before = dict(mpl.rcParams)
    yield
    assert dict(mpl.rcParams) == before


def title(figure: Figure) -> str:
    return figure.get_suptitle()


@pytest.mark.parametrize(
    ("events", "impacts", "said"),
    [
        ((), None, "No detections in 1 s"),
        ((0.5,), None, "1 detection in 1 s"),
        ((0.5,), (0.55,), "1 step seen 50 ms before impact, no false alarms"),
        ((0.5, 0.8), (0.55, 0.83, 0.01), "2 of 3 steps seen 30 to 50 ms before impact, no false alarms"),
        ((0.1, 0.5), (0.51,), "1 step seen 10 ms before impact, 1 false alarm"),
        ((0.1, 0.2, 0.5), (0.51,), "2 false alarms; 1 step seen 10 ms before impact"),
        ((0.9,), (0.5,), "The step was missed, 1 false alarm"),
        ((), (0.5, 0.6), "All 2 steps were missed, no false alarms"),
        ((0.1, 0.2), (), "No step, 2 false alarms"),
    ],
)
def test_the_title_says_what_came_out(events: tuple[float, ...], impacts: tuple[float, ...] | None, said: str) -> None:
    _, trace = made(np.arange(101) / 100, events=events)
    matching = None if impacts is None else match_steps(events, [RoadStep(impact) for impact in impacts])
    assert message_of(trace, matching) == said


def test_a_drive_has_a_panel_for_each_quantity_with_its_unit(tmp_path: Path) -> None:
    series, trace = made(np.arange(101) / 100, events=(0.5,))
    shaken = Motion(acceleration_m_s2=Channel(np.array([0, 10**9]), np.array([0.0, 1.0])))
    figure = plot_drive(
        series, trace, motion=shaken, matching=match_steps([0.5], [RoadStep(0.55)]), source="a $1_b^2$ log"
    )
    labels = [axes.get_ylabel().replace("\n", " ") for axes in figure.axes]
    assert labels == ["slant range / m", "range / m", "|range rate| / m/s", "acceleration / m/s²", "amplitude / counts"]
    assert figure.axes[3].get_xlabel() == "time since the first sweep / s"
    assert title(figure) == "1 step seen 50 ms before impact, no false alarms"
    assert figure.axes[0].get_title(loc="left") == "a $1_b^2$ log"
    # In each panel: one line at the detection, one at the impact.
    for panel in figure.axes[:4]:
        (hit,) = [part for part in panel.collections if part.get_zorder() == 3]
        assert hit.get_segments()[0][:, 0].tolist() == [0.5, 0.5]
        assert [0.55, 0.55] in [list(line.get_xdata()) for line in panel.lines]
    save(figure, tmp_path / "drive.png")
    assert mpl.image.imread(tmp_path / "drive.png").shape[1] == 1200
    assert len(plot_drive(series, trace, motion=Motion()).axes) == 4


def test_invalid_sweeps_are_shaded_where_they_are(tmp_path: Path) -> None:
    flags = np.zeros(100)
    flags[30:50] = SweepFlag.MISSED_DATA
    series, trace = made(np.arange(100) / 100, flags=flags)
    panel = plot_drive(series, trace).axes[1]
    (shade,) = panel.patches
    left, width = shade.get_x(), shade.get_width()
    assert left == pytest.approx(0.30, abs=0.011)
    assert left + width == pytest.approx(0.50, abs=0.011)


@pytest.mark.parametrize("count", [1, 2])
def test_short_and_empty_of_echo(count: int, tmp_path: Path) -> None:
    series, trace = made(np.arange(count) / 100, flags=np.full(count, SweepFlag.NO_AMPLITUDES))
    save(plot_drive(series, trace), tmp_path / "none.png")
    with pytest.raises(ValueError, match="at least one valid sweep"):
        plot_sweeps(series)
    series, trace = made(np.zeros(count))  # a clock that stands still
    save(plot_drive(series, trace), tmp_path / "still.png")
    save(plot_sweeps(series, trace), tmp_path / "sweeps.png")


def test_no_sweep_at_all_is_refused() -> None:
    series, trace = made(np.zeros(0))
    with pytest.raises(ValueError, match="at least one sweep"):
        plot_drive(series, trace)


def test_the_grid_holds_the_nearest_sweep_and_no_more_columns_than_asked_for() -> None:
    times = np.array([0.0, 1.0, 2.0, 3.0])
    image, edges = grid(made(times)[0], columns=16)
    assert edges == pytest.approx((-0.5, 3.5, 0.195, 0.355))
    assert image.shape == (16, 16)
    assert image[0].tolist() == sorted([0.0, 1.0, 2.0, 3.0] * 4)
    many, _ = grid(made(np.arange(50_000) / 100, bins=1000)[0], columns=300, rows=200)
    assert many.shape == (200, 300)
    assert (np.diff(many[0]) > 0).all()


def test_gaps_and_invalid_sweeps_are_empty_and_times_may_go_back() -> None:
    times = np.concatenate([np.arange(20), np.arange(60, 80)]) / 10
    image, (left, right, _, _) = grid(made(times)[0], columns=160)
    centres = left + (np.arange(160) + 0.5) * (right - left) / 160
    empty = np.isnan(image[0])
    assert empty[(centres > 2.1) & (centres < 5.8)].all()
    assert not empty[(centres < 1.9) | (centres > 6.1)].any()
    back = made(np.array([0.2, 0.0, 0.1]))[0]
    assert list(dict.fromkeys(grid(back)[0][0].tolist())) == [1.0, 2.0, 0.0]
    silent = made(np.arange(4.0), flags=np.array([0, 4, 16, 0]))[0]
    assert np.isnan(grid(silent, columns=4)[0][0]).tolist() == [False, False, True, False]


@settings(max_examples=60, deadline=None)
@given(
    values=st.lists(st.one_of(st.floats(-1e6, 1e6), st.just(float("nan"))), min_size=1, max_size=200),
    blocks=st.integers(2, 20),
)
def test_a_reduced_line_keeps_the_extremes_in_their_order(values: list[float], blocks: int) -> None:
    series = np.array(values)
    times, kept = envelope_of(np.arange(len(series), dtype=float), series, blocks)
    assert len(kept) <= max(2 * blocks, 1)
    assert (np.diff(times) >= 0).all()
    np.testing.assert_array_equal(series[times.astype(int)], kept)
    if np.isfinite(series).any():
        assert np.nanmax(kept) == np.nanmax(series)
        assert np.nanmin(kept) == np.nanmin(series)


def test_runs_of_true_values() -> None:
    assert runs(np.array([True, True, False, True])) == [(0, 1), (3, 3)]
    assert runs(np.zeros(3, bool)) == []


def test_the_overlay_names_the_peak_of_the_mean_and_marks_the_detections() -> None:
    series, trace = made(np.arange(101) / 100, events=(0.5,))
    sweeps = np.full((101, 16), 100, np.uint16)
    sweeps[:, 5] = 900
    series = SensorSeries(1, series.times_ns, sweeps, series.range_m, series.flags)
    figure = plot_sweeps(series, trace, source="log, sensor 1")
    assert title(figure) == "The mean echo peaks at 0.250 m with 900 counts"
    (panel,) = figure.axes
    assert (panel.get_xlabel(), panel.get_ylabel()) == ("slant range / m", "amplitude / counts")
    legend = panel.get_legend()
    assert legend is not None
    assert "at a detection" in [text.get_text() for text in legend.get_texts()]


def test_pyplot_is_not_used() -> None:
    code = "import sys, jaxradar.plots; assert 'matplotlib.pyplot' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_day_of_sweeps_makes_a_small_picture(tmp_path: Path) -> None:
    count = 24 * 3600 * 20
    series, trace = made(np.arange(count) / 20, bins=4, events=tuple(np.arange(2000) * 40.0))
    save(plot_drive(series, trace), tmp_path / "day.png")
    assert (tmp_path / "day.png").stat().st_size < 1_000_000


def test_a_statistic_of_zero_does_not_lie_under_the_axis() -> None:
    series, trace = made(np.arange(20) / 100)
    panel = plot_drive(series, trace).axes[2]
    assert panel.get_ylim()[0] < 0
