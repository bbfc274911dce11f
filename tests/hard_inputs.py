"""The inputs that break numerics, by name: sweeps of any length, profiles, scalars, times."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

SIZES = (1, 2, 3, 16, 17, 128, 1448)
FULL_SCALE = 65535.0
TEMPERATURES = (1e-3, 0.1, 10.0)  # the settings' lower bound, default and upper bound
DTYPES = {"float16": np.float16, "bfloat16": jnp.dtype("bfloat16"), "float32": np.float32, "float64": np.float64}

# What a CPU flushes to 0 in arithmetic and not in a comparison of bits: found or not, but finite.
SUBNORMAL = "subnormal"


def echo(bins: int, centre: float, amplitude: float = 3000.0, fwhm: float = 8.0) -> np.ndarray:
    return amplitude * np.exp(-4.0 * np.log(2.0) * ((np.arange(bins) - centre) / fwhm) ** 2)


def sweeps(bins: int) -> dict[str, np.ndarray]:
    """Sweeps of so many bins, float64 that float32 holds exactly."""
    one = np.arange(bins, dtype=np.float64)
    middle = bins // 2
    some = np.rint(echo(bins, 0.37 * bins)) + 100.0
    bad = {"NaN": np.nan, "inf": np.inf, "-inf": -np.inf}
    made = {
        "all zero": np.zeros(bins),
        "constant": np.full(bins, 100.0),
        "uneven constant": np.full(bins, 40.974483),
        "full scale": np.full(bins, FULL_SCALE),
        "negative": np.full(bins, -5.0),
        "one bin": np.where(one == middle, 1.0, 0.0),
        "first bin": np.where(one == 0, 7.0, 0.0),
        "last bin": np.where(one == bins - 1, 7.0, 0.0),
        "ramp": 10.0 + one,
        "falling ramp": 10.0 + one[::-1],
        "echo": some,
        "two equal echoes": np.rint(echo(bins, bins // 4)) + np.rint(echo(bins, 3 * bins // 4)),
        "plateau": np.minimum(np.rint(echo(bins, 0.6 * bins, 2e5)), FULL_SCALE),
        "echo at the first bin": np.rint(echo(bins, 0.0)),
        "echo at the last bin": np.rint(echo(bins, bins - 1.0)),
        "echo before the first bin": np.rint(echo(bins, -3.3)),
        "echo beyond the last bin": np.rint(echo(bins, bins + 2.3)),
        "echo across a window's edge": np.rint(echo(bins, min(8.4, 0.5 * bins))) + 20.0,
        "alternating": np.where(one % 2 == 0, 0.0, FULL_SCALE),
        "huge offset": 2.0**20 + np.rint(echo(bins, 0.37 * bins, 8.0)),
        "huge": some * 2.0**88,  # 3e30
        "tiny": some * 2.0**-111,  # 1e-30
        SUBNORMAL: some * 2.0**-144,
        "largest count of float16": np.minimum(some * 20.0, 65504.0),
        "all NaN": np.full(bins, np.nan),
        **{f"{name} in the middle": np.where(one == middle, value, some) for name, value in bad.items()},
        "NaN beside the echo": np.where(one == int(0.37 * bins) + 1, np.nan, some),
        "NaN and inf at the ends": np.where(one == 0, np.nan, np.where(one == bins - 1, np.inf, some)),
    }
    return {name: values.astype(np.float32).astype(np.float64) for name, values in made.items()}


def profiles(cells: int) -> dict[str, np.ndarray]:
    """Amplitudes over a floor: finite, never negative, in the range whose squares float32 holds."""
    left_out = ("NaN", "inf", "negative", SUBNORMAL)
    kept = {name: one for name, one in sweeps(cells).items() if not any(word in name for word in left_out)}
    kept["huge"], kept["tiny"] = kept["echo"] * 2.0**44, kept["echo"] * 2.0**-66
    return kept


# Of a track, metres at so many seconds after the sample before.
STEPS_S = {
    "even": 0.01,
    "none": 0.0,
    "back": -0.005,
    "a nanosecond": 1e-9,
    "a day": 86400.0,
    "huge": 1e9,
    "clock set back": -3600.0,
}


def tracks(samples: int) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Values and their time steps, float64 that float32 holds exactly."""
    one = np.arange(samples, dtype=np.float64)
    values = {
        "nothing": 0.0 * one,
        "constant": 0.0 * one + 0.4,
        "ramp": 0.4 + 0.01 * one,
        "step": np.where(one < samples // 2, 0.4, 0.35),
        "parabola": 0.4 + 0.001 * one**2,
        "far": 2.0**16 + 0.01 * one,
        "huge": 1e30 * (1.0 + 0.1 * one),
        "tiny": 1e-30 * (1.0 + 0.1 * one),
    }
    steps = {
        **{name: np.full(samples, step) for name, step in STEPS_S.items()},
        "jitter": 0.01 + 0.004 * np.sin(3.0 * one),
        "jitter backwards": np.where(one % 4 == 2, -0.004, 0.01),
        "some at one time": np.where(one % 3 == 1, 0.0, 0.01),
        "a gap": np.where(one == samples // 2, 86400.0, 0.01),
    }
    rounded = lambda array: array.astype(np.float32).astype(np.float64)  # noqa: E731
    return {
        f"{a}, time steps: {b}": (rounded(values[a]), rounded(steps[b]))
        for a in values
        for b in steps
        if a in ("ramp", "step") or b in ("even", "jitter", "a day")
    }
