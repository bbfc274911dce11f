"""One drive over time: what the sensor saw, what the detector followed, what it decided on, how the car was shaken."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxradar.drive import Channel, Motion, RoadStep, SensorSeries
from jaxradar.matching import Matching
from jaxradar.plots.reduce import envelope_of, grid, runs
from jaxradar.plots.style import BLACK, BLUE, GREY, MAP, ORANGE, SKY, VERMILION, WIDTH_IN, styled, titled
from jaxradar.systems.step.result import StepTrace

__all__ = ["message_of", "plot_drive"]

# More lines than this are a smear; the marks above the panel still tell how many there are.
_MOST_LINES = 40


def plot_drive(
    series: SensorSeries,
    trace: StepTrace,
    *,
    motion: Motion | None = None,
    matching: Matching | None = None,
    source: str = "",
) -> Figure:
    """Map of amplitude over time and range with the followed range on it; that range; the detector's statistic with
    its threshold; the acceleration, if it was recorded. Detections, and the impacts if `matching` knows the truth, run
    through all panels.

    `source` (file, sensor, detector) stands under the title, which says what came out. Raises `ValueError` for a series
    without sweeps.
    """
    if not len(series):
        raise ValueError("`plot_drive(series=...)` must hold at least one sweep; got none.")
    acceleration = None if motion is None else motion.acceleration_m_s2
    if acceleration is not None and not len(acceleration.values):
        acceleration = None
    first, last = float(trace.times_s.min()), float(trace.times_s.max())
    heights = [2.4, 1.3, 1.1] + ([1.1] if acceleration is not None else [])
    with styled():
        figure = Figure(figsize=(WIDTH_IN, 1.0 + 1.28 * sum(heights)), layout="constrained")
        panels = list(figure.subplots(len(heights), 1, sharex=True, height_ratios=heights))
        figure.align_ylabels(panels)
        _draw_map(figure, panels[0], series, trace)
        _draw_range(panels[1], trace)
        _draw_statistic(panels[2], trace)
        if acceleration is not None:
            _draw_acceleration(panels[3], acceleration)
        handles, labels = _draw_marks(panels, trace, matching)
        if handles:
            figure.legend(handles, labels, loc="outside lower center", ncols=len(handles), columnspacing=1.6)
        period = 1 / (series.sweep_rate_hz or 1.0)
        panels[-1].set_xlim(first - period / 2, max(last, first + period) + period / 2)
        panels[-1].set_xlabel("time since the first sweep / s")
        titled(figure, panels[0], message_of(trace, matching), source)
    return figure


def message_of(trace: StepTrace, matching: Matching | None) -> str:
    """What came out, in one line."""
    count = len(trace.events)
    if matching is None:
        duration = float(np.ptp(trace.times_s)) if len(trace.times_s) else 0.0
        return f"{_several(count, 'detection').capitalize()} in {duration:.3g} s"
    alarms = _several(matching.false_alarms, "false alarm")
    if not matching.steps:
        return f"No step, {alarms}"
    lead = [1e3 * value for value in matching.lead_s]
    if not lead:
        seen = "The step was missed" if len(matching.steps) == 1 else f"All {len(matching.steps)} steps were missed"
        return f"{seen}, {alarms}"
    before = f"{min(lead):.0f} ms" if round(min(lead)) == round(max(lead)) else f"{min(lead):.0f} to {max(lead):.0f} ms"
    seen = "1 step" if len(matching.steps) == 1 else f"{len(lead)} of {len(matching.steps)} steps"
    seen = f"{seen} seen {before} before impact"
    # Who cries all the time has seen nothing: what there is more of comes first.
    return f"{alarms}; {seen}" if matching.false_alarms > matching.hits else f"{seen}, {alarms}"


def _several(count: int, noun: str) -> str:
    return f"{'no' if count == 0 else count} {noun}{'' if count == 1 else 's'}"


def _draw_map(figure: Figure, panel: Axes, series: SensorSeries, trace: StepTrace) -> None:
    image, edges = grid(series)
    held = image[np.isfinite(image)]
    # One glint, or the direct leakage, must not darken the rest.
    top = float(np.percentile(held, 99.8)) if held.size else 1.0
    panel.set_facecolor("#D9D9D9")
    drawn = panel.imshow(
        image,
        extent=edges,
        origin="lower",
        aspect="auto",
        cmap=MAP,
        vmin=0,
        vmax=max(top, 1.0),
        interpolation="nearest",
    )
    figure.colorbar(drawn, ax=panel, label="amplitude / counts", pad=0.012, extend="max", aspect=16)
    panel.plot(*envelope_of(trace.times_s, trace.range_m), color="white", linewidth=1.0, alpha=0.9)
    panel.set_ylabel("slant range / m")
    panel.grid(False)


def _draw_range(panel: Axes, trace: StepTrace) -> None:
    panel.plot(*envelope_of(trace.times_s, trace.range_m), color=BLUE, label="followed range")
    known = trace.range_m[np.isfinite(trace.range_m)]
    if known.size:
        # A few wild sweeps may run out of the panel; the map above shows them.
        low, high = np.percentile(known, [0.5, 99.5])
        margin = max(0.15 * (high - low), 0.01)
        panel.set_ylim(low - margin, high + margin)
    else:
        panel.text(0.5, 0.5, "no valid sweep", transform=panel.transAxes, ha="center", va="center", color=GREY)
    panel.set_ylabel("range / m")


def _draw_statistic(panel: Axes, trace: StepTrace) -> None:
    unit = f" / {trace.statistic_unit}" if trace.statistic_unit in ("m/s", "m", "counts") else ""
    panel.plot(*envelope_of(trace.times_s, trace.statistic), color=BLUE)
    panel.axhline(trace.threshold, color=BLACK, linestyle=(0, (4, 3)), linewidth=1.0)
    top = float(np.nanmax(trace.statistic, initial=0.0))
    if trace.threshold > 0 and top > 12 * trace.threshold:
        # Linear up to the threshold and logarithmic above, or the threshold would lie on the axis.
        panel.set_yscale("symlog", linthresh=2 * trace.threshold, linscale=0.6)
        panel.set_ylim(0, 2 * top)
        powers = np.arange(math.ceil(math.log10(2 * trace.threshold)), math.floor(math.log10(2 * top)) + 1)
        panel.set_yticks([0.0, *(10.0**powers)], ["0", *(f"{10.0**power:g}" for power in powers)])
        panel.minorticks_off()
    else:
        top = 1.25 * max(top, 1.3 * trace.threshold, 1e-12)
        panel.set_ylim(-0.04 * top, top)  # a line at 0 would lie under the axis
    panel.annotate(
        f"threshold {trace.threshold:g}",
        (1.0, trace.threshold),
        xycoords=("axes fraction", "data"),
        xytext=(-3, 2),
        textcoords="offset points",
        ha="right",
        va="bottom",
        fontsize=9,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 0.8},
    )
    panel.set_ylabel(trace.statistic_name.replace("evidence of a shift", "evidence\nof a shift") + unit)


def _draw_acceleration(panel: Axes, acceleration: Channel) -> None:
    order = np.argsort(acceleration.times_ns, kind="stable")
    panel.plot(*envelope_of(acceleration.times_s[order], acceleration.values[order]), color=BLACK, linewidth=1.0)
    panel.set_ylabel("acceleration\n/ m/s²")


def _draw_marks(panels: Sequence[Axes], trace: StepTrace, matching: Matching | None) -> tuple[list[Artist], list[str]]:
    """Detections, impacts and sweeps without echo in all panels; what the legend says of them."""
    steps: tuple[RoadStep, ...] = () if matching is None else matching.steps
    false = set(range(len(trace.events))) if matching is None else set(matching.false.tolist())
    hits = set() if matching is None else {index for index in matching.hit_by if index is not None}
    kinds = {
        "detection" if matching is None else "false alarm": (sorted(false), ORANGE if matching is None else GREY),
        "hit": (sorted(hits), VERMILION),
        "repeat": (sorted(set(range(len(trace.events))) - false - hits), SKY),
    }
    handles: list[Artist] = []
    labels: list[str] = []
    for name, (indices, colour) in kinds.items():
        if not indices:
            continue
        times = np.array([trace.events[index].time_s for index in indices])
        marks = panels[0].plot(
            times,
            np.ones(len(times)),
            "v",
            color=colour,
            markersize=7,
            markeredgecolor="white",
            markeredgewidth=0.6,
            transform=panels[0].get_xaxis_transform(),
            clip_on=False,
            zorder=5,
        )
        handles += marks
        labels.append(f"{name} ({len(indices)})")
        if name == "hit" or len(trace.events) <= _MOST_LINES:
            for panel in panels:
                panel.vlines(times, 0, 1, transform=panel.get_xaxis_transform(), color=colour, linewidth=1.2, zorder=3)
    for number, step in enumerate(steps):
        for panel in panels:
            colour = "white" if panel is panels[0] else BLACK
            line = panel.axvline(step.impact_s, color=colour, linestyle=(0, (1, 1.5)), linewidth=1.6, zorder=4)
        if not number:
            handles.append(line)
            labels.append(f"impact ({len(steps)})")
    spans = _invalid_spans(trace)
    for number, (first, last) in enumerate(spans):
        panels[0].axvspan(first, last, facecolor="none", edgecolor="#FFFFFF80", hatch="//", linewidth=0, zorder=2)
        shades = [panel.axvspan(first, last, color="#D9D9D9", linewidth=0, zorder=0) for panel in panels[1:]]
        if not number:
            handles.append(shades[0])
            labels.append(f"no echo ({_several(int((~trace.valid).sum()), 'sweep')})")
    return handles, labels


def _invalid_spans(trace: StepTrace, columns: int = 600) -> list[tuple[float, float]]:
    """Stretches of time whose sweeps are invalid, no finer than a picture can show."""
    if trace.valid.all():
        return []
    first, last = float(trace.times_s.min()), float(trace.times_s.max())
    width = max(last - first, 1e-9) / columns
    size = min(columns, len(trace.times_s))
    place = np.clip(((trace.times_s - first) / width * size / columns).astype(int), 0, size - 1)
    bad = np.bincount(place, ~trace.valid, size)
    all_of = np.bincount(place, minlength=size)
    edges = first + np.arange(size + 1) * width * columns / size
    return [(float(edges[one]), float(edges[two + 1])) for one, two in runs((bad > 0) & (2 * bad >= all_of))]
