"""Value and gradient of a loss of three parameters over the whole batch: `python benches/run.py gradient`."""

from __future__ import annotations

import jax
import numpy as np
import subject
from child import ask
from data import UnavailableError, make_batch
from measure import around, figure, ratio, rounds, say, spread
from peers import numpy_peers
from report import Row, Section
from settings import Settings

__all__ = ["measure"]

# What we hold ourselves to at 512 logs, in milliseconds and megabytes.
MOST_MS = {"window": 110.0, "soft": 160.0}
MOST_MB = 150.0
# Short, since |speed| has a corner at 0: with 1e-6 one sweep in 4000 steps over it and moves a slope by 2e-4 of it. The
# loss is rounded to some 1e-17, which is 1e-8 of its slopes at this step.
STEP = 1e-7
USUAL = np.array([2.0, 0.1, 0.7])  # exponent, temperature, threshold


def _check(row: str) -> str:
    """Empty if the gradient is right: float64 against central differences, float32 against float64, on two logs."""
    batch = make_batch(2)
    with jax.enable_x64(True):
        both, alone = subject.gradient(row, batch)
        slope = np.asarray(both()[1])
        differences = []
        for i in range(3):
            step = np.zeros(3)
            step[i] = STEP
            differences.append((alone(USUAL + step) - alone(USUAL - step)) / (2.0 * STEP))
    single = np.asarray(subject.gradient(row, batch)[0]()[1])
    scale = np.abs(slope).max()
    if not np.allclose(slope, differences, rtol=1e-5, atol=1e-5 * scale):
        return f"gradient {slope} in float64, central differences {np.array(differences)}"
    if not np.allclose(single, slope, rtol=1e-2, atol=1e-3 * scale):
        return f"gradient {single} in float32, {slope} in float64"
    return ""


def measure(settings: Settings) -> Section:
    logs = 32 if settings.quick else 512
    columns = ("estimator", "ms", "10..90 %", "Msweeps/s", "/NumPy", "10..90 %", "peak MB", "of input", "bound")
    title = f"value and gradient of 3 parameters, {logs} logs x 2000 sweeps x 128 bins; {settings.rounds} rounds"
    section = Section("gradient", title, columns)
    say(f"making {logs} logs")
    batch = make_batch(logs)
    calls = {}
    for row in subject.GRADIENTS:
        say(f"checking the gradient of {row}")
        wrong = _check(row)
        if not wrong:
            calls[row] = subject.gradient(row, batch)[0]
        else:
            section.failed = True
            section.notes.append(f"WRONG, not timed: {row}: {wrong}.")
    if not calls:
        return section
    plain = numpy_peers.candidates(batch)[numpy_peers.BY_LOG]
    numpy = {f"NumPy, {row}": plain[row] for row in calls}
    times = rounds({**calls, **numpy}, settings.rounds, "gradient")
    try:
        say("measuring memory in a process of its own")
        peaks = ask("gradient", {"JAX_PLATFORMS": "cpu"}, rows=list(calls), logs=logs)
    except UnavailableError as why:
        section.notes.append(f"Skipped: memory: {why}")
        peaks = {}
    for row in calls:
        took = spread(times[row]).scaled(1e3)
        against = ratio(times[row], times[f"NumPy, {row}"])
        peak = peaks.get(row, {}).get("peak")
        section.rows.append(
            Row(
                row,
                [
                    row,
                    figure(took.median),
                    around(took),
                    figure(batch.count / took.median / 1e3),
                    figure(against.median),
                    around(against),
                    "-" if peak is None else f"{peak / 1e6:.0f}",
                    "-" if peak is None else f"{peak / batch.sweeps.nbytes:.0%}",
                    "-" if settings.quick else f"{MOST_MS[row]:.0f} ms, {MOST_MB:.0f} MB",
                ],
                {"ms": took.median, "peak": peak},
                against,
            )
        )
    section.notes.append(
        "/NumPy: over NumPy's forward pass alone of the same estimator, log by log, in the same rounds."
    )
    return section
