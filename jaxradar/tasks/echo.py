"""The range of one echo: what the estimators of `jaxradar.signal` find, and those of others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from jaxradar.estimate.bounds import coloured_bound_m, threshold_snr_db, total_error_m, white_bound_m
from jaxradar.pareto import Candidate, Case, Data, Score, Task, estimation_score
from jaxradar.signal.pulses import SIGMA_PER_FWHM
from jaxradar.tasks.echo_jax import Build, jax_candidate, jax_candidates
from jaxradar.tasks.echo_peers import peer_candidates
from jaxradar.tasks.noise import draw_recorded, recorded_covariance

__all__ = ["EchoInputs", "EchoRange"]

MILLIMETRES = 1e3
AMPLITUDE = 1000.0  # counts, about what the recordings have at 45°
NARROW_M = 0.040  # a short pulse
RECORDED_M = 0.066  # the narrowest echo in the recordings, profile 2 of the A111
BINS = {0.484e-3: 1240, 5.5e-3: 128, 7.0e-3: 128}  # the sensor's own, the thesis's 0.7 m and 0.9 m over 128


@dataclass(frozen=True, eq=False)
class EchoInputs:
    """`sweeps` (sweeps, bins) float32 counts, bin 0 at range 0; the width that the candidates are told, in bins; the
    error in metres from which on it is a gross one, the echo's true width."""

    sweeps: np.ndarray
    bin_m: float
    fwhm: float
    gross_m: float


@dataclass(frozen=True)
class _Kind:
    """`told`: the pulse width that candidates are told over the true one; `second`: amplitude of a second echo, one
    width behind the first, over the first one's."""

    snr_db: float
    bin_m: float = 5.5e-3
    recorded: bool = False
    told: float = 1.0
    second: float = 0.0

    @property
    def name(self) -> str:
        parts = [f"{'recorded' if self.recorded else 'white'} {self.snr_db:g} dB"]
        if self.bin_m != 5.5e-3:
            parts.append(f"{1e3 * self.bin_m:.3g} mm")
        if self.told != 1.0:
            parts.append("pulse wrong")
        if self.second:
            parts.append("two echoes")
        return ", ".join(parts)

    @property
    def about(self) -> str:
        noise = "noise as recorded" if self.recorded else "white noise"
        text = f"a pulse of {1e3 * self.fwhm_m:.0f} mm in {noise}, bins of {1e3 * self.bin_m:g} mm"
        if self.told != 1.0:
            text += f", its width taken for {self.told - 1.0:+.0%}"
        return text + (", another half as strong one width behind it" if self.second else "")

    @property
    def fwhm_m(self) -> float:
        return RECORDED_M if self.recorded else NARROW_M

    def bound_m(self) -> float:
        if not self.recorded and not self.second:
            return white_bound_m(self.snr_db, self.fwhm_m, self.bin_m)
        bins = BINS[self.bin_m]
        places = (np.arange(bins) - bins // 2) * self.bin_m
        covariance = recorded_covariance(bins, self.bin_m) if self.recorded else np.eye(bins)
        first, slope = _pulse(places, self.fwhm_m)
        nuisance = None
        if self.second:
            second, its_slope = _pulse(places - self.fwhm_m, self.fwhm_m)
            nuisance = np.stack([first, second, self.second * its_slope])
        return coloured_bound_m(slope, covariance * 10.0 ** (-self.snr_db / 10.0), nuisance)

    def case(self, sweeps: int, seed: int) -> Case:
        shape, length_m = (self.fwhm_m, self.bin_m), BINS[self.bin_m] * self.bin_m
        plain = not (self.second or self.recorded or self.told != 1.0)
        return Case(
            name=self.name,
            draw=lambda: self.data(sweeps, seed),
            about=self.about,
            conditions={"snr_db": self.snr_db, "bin_m": self.bin_m, "fwhm_m": self.fwhm_m, "window_m": length_m},
            bound_name="Cramér-Rao",
            series=self.about,
            level=self.snr_db,
            level_name="SNR in one bin, 20 log₁₀(A/σ) (dB)",
            attainable=(lambda snr_db: MILLIMETRES * total_error_m(snr_db, *shape, length_m)) if plain else None,
            threshold=threshold_snr_db(*shape, length_m) if plain else None,
        )

    def data(self, sweeps: int, seed: int) -> Data:
        kind = [round(self.snr_db), self.recorded, round(1e6 * self.bin_m), round(100 * self.told), bool(self.second)]
        random = np.random.default_rng([seed, *map(int, kind)])
        bins, fwhm_m = BINS[self.bin_m], self.fwhm_m
        # Away from the ends: what happens there is another question.
        truth = random.uniform(2.0 * fwhm_m, bins * self.bin_m - 3.0 * fwhm_m, sweeps)
        offset = np.arange(bins) * self.bin_m - truth[:, None]
        clean = _pulse(offset, fwhm_m)[0]
        if self.second:
            clean = clean + self.second * _pulse(offset - fwhm_m, fwhm_m)[0]
        draw = partial(draw_recorded, bin_m=self.bin_m) if self.recorded else np.random.Generator.standard_normal
        values = AMPLITUDE * (clean + 10.0 ** (-self.snr_db / 20.0) * draw(random, clean.shape))
        inputs = EchoInputs(values.astype(np.float32), self.bin_m, self.told * fwhm_m / self.bin_m, fwhm_m)
        return Data(inputs, truth, sweeps, MILLIMETRES * self.bound_m())


def _pulse(offset_m: np.ndarray, fwhm_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Height 1, and its derivative by range."""
    sigma = SIGMA_PER_FWHM * fwhm_m
    height = np.exp(-0.5 * (offset_m / sigma) ** 2)
    return height, height * offset_m / sigma**2


class EchoRange(Task):
    """Range of one echo in one sweep. SNR is 20 log₁₀(A/σ) in one bin.

    The truth is drawn evenly over range and so over the fractions of a bin; nothing is rounded to counts. Where there
    are two echoes, the range of the stronger is asked for, and the bound is of an estimator that knows their shape.
    Thinned and half-precision sweeps are as a sensor might record them: making them so is not timed.
    """

    name = "range"
    title = "Range of one echo in one sweep"
    item = "sweep"
    error_name = "RMS error"
    unit = "mm"

    def __init__(self, sweeps: int | None = None, seed: int = 0) -> None:
        self.sweeps, self.seed = sweeps, seed

    def cases(self, quick: bool = False) -> Sequence[Case]:
        levels = (10, 20, 40) if quick else (0, 5, 10, 15, 20, 30, 40, 50)
        first = 20  # whom nobody asks for another case shows this one
        white = [_Kind(level) for level in sorted(levels, key=lambda level: (level != first, level))]
        recorded = [_Kind(level, recorded=True) for level in ((40,) if quick else (40, 20, 30, 50))]
        others = [
            _Kind(40, 0.484e-3, recorded=True),
            _Kind(20, 0.484e-3),
            _Kind(20, 7.0e-3),
            _Kind(20, told=1.2),
            _Kind(20, told=0.8),
            _Kind(40, told=1.2),
            _Kind(30, second=0.5),
        ]
        kinds = [*white, *recorded, *([] if quick else others)]
        return [kind.case(self._count(kind), self.seed) for kind in kinds]

    def _count(self, kind: _Kind) -> int:
        if self.sweeps is not None:
            return self.sweeps
        return 20_000 // (8 if BINS[kind.bin_m] > 1000 else 1)

    def candidates(self, quick: bool = False) -> Sequence[Candidate]:
        return [*jax_candidates(quick), *peer_candidates()]

    def candidate(self, name: str, build: Build) -> Candidate:
        """One's own: `build(fwhm, bin_m)` gives a `PeakEstimator` for a pulse of `fwhm` bins of `bin_m` metres."""
        return jax_candidate(name, build)

    def score(self, data: Data, answer: Any, items: int) -> Score:
        return estimation_score(answer, data.truth[:items], MILLIMETRES, data.inputs.gross_m)
