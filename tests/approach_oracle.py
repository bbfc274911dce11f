"""The approach detector's statistic and events in float64, sweep by sweep, track by track; shares no code with it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np


def approach(
    counts: np.ndarray, dt: np.ndarray, valid: np.ndarray, range_m: np.ndarray, bin_m: float, s: dict[str, Any]
) -> tuple[np.ndarray, np.ndarray]:
    """`s`: every setting by name. Returns statistic and events, (sweeps,) each."""
    bins = counts.shape[1]
    per = max(1, min(round(s["cell_m"] / bin_m), bins // 2))
    n = bins // per
    centres = range_m[: n * per].reshape(n, per).mean(axis=1)
    ahead = s["farthest_m"] - s["place_m"] * np.arange(s["places"])
    slant = np.hypot(s["height_m"], ahead)
    where = (slant - centres[0]) * (n - 1) / (centres[-1] - centres[0])
    inside = (where >= 0) & (where <= n - 1) & (ahead > 0)
    tilt = np.linspace(s["tilt_far"], s["tilt_near"], s["places"])
    cost = np.array(
        [math.log(1 + g * math.sqrt(math.pi) / 2 * math.exp(g * g / 4) * (1 + math.erf(g / 2))) for g in tilt]
    )
    speeds = s["slowest_m_s"] * (s["fastest_m_s"] / s["slowest_m_s"]) ** (
        np.arange(s["speeds"]) / max(s["speeds"] - 1, 1)
    )
    reach = max(1, round(0.5 * s["around_m"] / (per * bin_m)))
    far = centres > math.hypot(s["height_m"], 0.5 * ahead[0])
    power = mean = np.zeros(n)
    noise, stands, stood, tracking = 0.0, False, False, False
    age = gap = quiet = 0.0
    armed = True
    evidence = [[0.0] * s["places"] for _ in speeds]
    travel = [0.0] * len(speeds)
    out = []
    for row, step, ok in zip(counts, dt, valid, strict=True):
        cells = np.where(np.isfinite(row), row, 0.0)[: n * per].astype(float).reshape(n, per).mean(axis=1)
        ok = bool(ok) and cells.max() > 0
        gap += step
        kept = tracking and abs(gap) <= s["longest_gap_s"]
        goes_on, fresh = ok and kept, ok and not kept
        elapsed = max(step, 0.0) if kept else 0.0
        still = goes_on and stands
        if fresh or (goes_on and stood and age <= 0):
            power, mean = cells**2, cells.copy()
        age = 0.0 if fresh or still else age + elapsed
        stood = (stood and kept) or still
        held, floor = power, noise
        since = max(gap, 0.0)
        share = since / (min(s["reference_s"], age) + since + 1e-9) if goes_on else 0.0
        power, mean = power + share * (cells**2 - power), mean + share * (cells - mean)
        noise = s["noise_share"] * power.min()
        total = 0.0
        for cell in range(0, n, 2):
            if power[cell] > 0 and far[cell]:
                weight = max(1 - noise / power[cell], 0.0) ** 2
                total += weight * (mean[cell] ** 2 / power[cell] - 0.79 - s["stands"] * 0.21 * weight)
        stands = age >= s["settle_s"] and total > 0.015
        counts_now = goes_on and not still
        on = kept and not still
        for j, speed in enumerate(speeds):
            way = travel[j] + speed * elapsed / s["place_m"]
            whole = math.floor(way + 0.5)
            old = evidence[j]
            if whole > 5 or whole < 0:
                old = [0.0] * s["places"]
            elif whole:
                old = [0.0] * min(whole, s["places"]) + old[: s["places"] - whole]
            travel[j] = way - whole if on else 0.0
            for i in range(s["places"]):
                gain = 0.0
                low = min(int(max(where[i], 0.0)), n - 2)
                part = min(max(where[i] - low, 0.0), 1.0)
                between = lambda v, low=low, part=part: v[low] * (1 - part) + v[low + 1] * part  # noqa: E731
                near = np.pad(held, reach, mode="edge")
                around = near[low : low + 2 * reach + 1].mean() * (1 - part)
                around += near[low + 1 : low + 2 * reach + 2].mean() * part
                expected = max(between(held), s["fade_share"] * around)
                if counts_now and inside[i] and expected > 0:
                    look = max(s["look_m"] * (1 - floor / expected), 1e-5)
                    gain = min(speed * elapsed / look, 1.0) * (tilt[i] * between(cells) / math.sqrt(expected) - cost[i])
                old[i] = max((old[i] if on else 0.0) + gain, 0.0)
            evidence[j] = old
        most = max(max(one) for one in evidence)
        settled = age >= (s["start_s"] if stood else s["settle_s"])
        quiet += max(step, 0.0)
        event = counts_now and settled and armed and most > s["evidence"]
        rearmed = most < s["release"] * s["evidence"] and quiet >= s["refractory_s"]
        armed = not event and (armed or rearmed)
        quiet = 0.0 if event else quiet
        gap = 0.0 if ok else gap
        tracking = kept or ok
        out.append((most if counts_now and settled else 0.0, event))
    statistic, events = zip(*out, strict=True) if out else ((), ())
    return np.array(statistic), np.array(events, bool)
