"""What a byte of input costs at other numbers of range bins, relative to 128: `python benches/run.py bins`."""

from __future__ import annotations

import reference
import subject
from data import SWEEPS, make_batch
from measure import figure, ratio, rounds, say, spread
from report import Row, Section
from settings import Settings

__all__ = ["measure"]

# Powers of two, one off them, and what an A111 gives: 827 over 0.4 m, 1240 over 0.6 m, 1444 to 1448 over 0.7 m.
BINS = (16, 64, 127, 128, 256, 512, 827, 1240, 1444, 1448)


def measure(settings: Settings) -> Section:
    size = 4e6 if settings.quick else 64e6
    say("making a batch for each number of bins")
    # An even number of logs, so that two cores have the same to do.
    batches = {bins: make_batch(max(2, 2 * round(size / (4 * SWEEPS * bins))), bins, distinct=8) for bins in BINS}
    title = f"cost of a byte relative to 128 bins, {size / 1e6:.0f} MB each; {settings.rounds} rounds"
    section = Section("bins", title, ("detector", "GB/s at 128", *(str(bins) for bins in BINS)))
    for row, estimator in subject.ROWS.items():
        calls = {}
        for bins, batch in batches.items():
            detector = subject.build(row, batch.range_m)
            call = subject.runner(detector, batch, subject.place(detector, batch))
            if estimator is None:
                wrong = subject.check_default(detector, batch, call(), 1)
            else:
                wrong = reference.check(call(), reference.expected(batch, estimator, 2))
            if wrong:
                section.failed = True
                section.notes.append(f"WRONG, not timed: {row} at {bins} bins: {wrong}.")
            else:
                calls[str(bins)] = call
        if "128" not in calls:
            continue
        times = rounds(calls, settings.rounds, f"bins, {row}")
        per_byte = {bins: seconds / batches[int(bins)].sweeps.nbytes for bins, seconds in times.items()}
        costs = {bins: ratio(values, per_byte["128"]) for bins, values in per_byte.items()}
        gb_s = 1e-9 / spread(per_byte["128"]).median
        cells = [f"{costs[str(bins)].median:.2f}" if str(bins) in costs else "-" for bins in BINS]
        section.rows.append(Row(row, [row, figure(gb_s), *cells], {"gb_s": gb_s}))
        section.rows += [
            Row(f"{row}, {bins} bins", [], {"cost": cost.median}, cost) for bins, cost in costs.items() if bins != "128"
        ]
    return section
