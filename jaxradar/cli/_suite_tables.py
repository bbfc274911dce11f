"""The tables of the detection suite."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING

from jaxradar.cli._output import print_table

if TYPE_CHECKING:
    from jaxradar.estimate.intervals import Estimate
    from jaxradar.suite import HeightErrors, Oblique, ObliqueCell, Recorded, StepCell, Suite

__all__ = ["print_heights", "print_oblique", "print_recorded", "print_suite"]


def print_suite(suite: Suite) -> None:
    """Roads without a step, then every cell."""
    _print_quiet(suite)
    for name in suite.cells:
        _print_cells(suite, name, usual=True)
    for name in suite.cells:
        _print_cells(suite, name, usual=False)


def _print_quiet(suite: Suite) -> None:
    roads = list(next(iter(suite.quiet.values())))
    hours = sum(one.hours for one in next(iter(suite.quiet.values())).values())
    print(f"\nFalse alarms an hour, with 95 % intervals, in {hours:.1f} hours without a step")
    rows = [
        [name, *(_range(held[road].per_hour, 1.0, ".2g") for road in roads), f"{suite.thresholds[name]:.2f}"]
        for name, held in suite.quiet.items()
    ]
    print_table(sys.stdout, ["detector", *roads, "x threshold for 1/h"], rows)


def _print_cells(suite: Suite, detector: str, usual: bool) -> None:
    """One row for each road and speed, or for each variation; one column for each height."""
    held = {cell: one for cell, one in suite.cells[detector].items() if bool(cell.variation) != usual}
    if not held:
        return
    print(f"\n{detector}: steps seen with 80 % of the possible lead, in %, and what at least (95 %)")
    if usual:
        heights = sorted({cell.height_m for cell in held})
        rows = []
        for road, speed in dict.fromkeys((cell.road, cell.speed_kmh) for cell in held):
            of = {cell.height_m: one for cell, one in held.items() if (cell.road, cell.speed_kmh) == (road, speed)}
            rows.append([f"{road}, {speed:g} km/h", *(_least(of[height].in_time) for height in heights)])
        print_table(sys.stdout, ["", *(f"{1e3 * height:+g} mm" for height in heights)], rows)
        return
    rows = [[cell.name, _least(one.in_time), *_leads(one.lead_s)] for cell, one in held.items()]
    print_table(sys.stdout, ["", "seen", "lead 5 %", "50 %", "95 %, ms"], rows)


def _least(one: Estimate) -> str:
    return f"{100 * one.value:.3g} ({100 * one.low:.3g})"


def _range(one: Estimate, scale: float, form: str) -> str:
    return f"{scale * one.value:{form}} ({scale * one.low:{form}}–{scale * one.high:{form}})"


def _leads(leads: tuple[Estimate, ...]) -> list[str]:
    return [f"{1e3 * one.value:.0f}" for one in leads] if leads else ["", "", ""]


def print_recorded(recorded: Mapping[str, Recorded], count: int) -> None:
    """What was raised in recordings of a car that stands, and found of steps put into them."""
    rates = list(next(iter(recorded.values())).alarms)
    seconds = next(iter(recorded.values())).seconds
    print(f"\n{count} recordings of a car that stands: detections at their own rate and with other times")
    columns = [f"{'own rate' if rate is None else f'{rate:g} Hz'}, {seconds[rate]:.0f} s" for rate in rates]
    rows = [[name, *(str(one.alarms[rate]) for rate in rates)] for name, one in recorded.items()]
    print_table(sys.stdout, ["detector", *columns], rows)
    held = next(iter(recorded.values())).injected
    if not held:
        return
    print("\nSteps put into them, found within 40 ms, in %, and what at least (95 %, each recording counted once)")
    heights = sorted({height for _, height in held})
    rows = [
        [f"{name}, {rate:g} Hz", *(_least(one.injected[rate, height]) for height in heights)]
        for name, one in recorded.items()
        for rate in sorted({rate for rate, _ in held})
    ]
    print_table(sys.stdout, ["detector", *(f"{1e3 * height:g} mm" for height in heights)], rows)


def print_oblique(detector: str, found: Mapping[ObliqueCell, Oblique], total: Oblique) -> None:
    """What one sensor reports too late, and two recover."""
    print(f"\n{detector}, oblique steps: too late for the wheel that is first, of drives; and what two sensors recover")
    rows = []
    for name, one in [*((cell.name, one) for cell, one in found.items()), ("all", total)]:
        told = one.record()
        share = told["recovered_share"]
        rows.append(
            [
                name,
                f"{told['late']} of {told['drives']}",
                f"{told['after']}",
                f"{told['recovered']}",
                f"{100 * share['value']:.1f} ({100 * share['low']:.1f})" if share else "",
            ]
        )
    columns = ["one sensor in the middle", "too late", "after the impact", "recovered", "in %, at least (95 %)"]
    print_table(sys.stdout, columns, rows)


def print_heights(detector: str, found: Mapping[tuple[StepCell, bool], HeightErrors]) -> None:
    """What 68 % of the errors of heights are not beyond, in millimetres."""
    heights = sorted({cell.height_m for cell, _ in found})
    print(f"\n{detector}, heights of steps: 68 % of the errors are below, in mm (share of drives with a height, in %)")
    rows = []
    for road, speed, known in dict.fromkeys((cell.road, cell.speed_kmh, known) for cell, known in found):
        of = {
            cell.height_m: one
            for (cell, told), one in found.items()
            if (cell.road, cell.speed_kmh, told) == (road, speed, known)
        }
        name = f"{road}, {speed:g} km/h, {'impact known' if known else 'impact as detected'}"
        rows.append([name, *(_error(of[height]) if height in of else "" for height in heights)])
    print_table(sys.stdout, ["", *(f"{1e3 * height:+g} mm" for height in heights)], rows)


def _error(one: HeightErrors) -> str:
    return "" if one.found.value == 0 else f"{1e3 * one.usual_m.value:.1f} ({100 * one.found.value:.0f})"
