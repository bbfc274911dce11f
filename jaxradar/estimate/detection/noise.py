"""Coloured noise: what a record of it says of its colour, and the filter that makes it white.

Autoregressive, x[n] = Σ φ_k x[n−k] + e[n] about its mean, with e white: the innovations, of which the tests of this
package take one for a sample.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy import linalg

__all__ = ["NoiseModel", "fit_noise", "sample_autocorrelation"]


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """An autoregressive model of a record of noise, from `fit_noise`.

    `mean` and `innovation_sd` in the record's unit; `coefficients` φ_1 .. φ_p, none for white noise; `correlation`:
    ρ(0) .. ρ(p), those of the record.
    """

    mean: float
    coefficients: Float[np.ndarray, " order"]
    innovation_sd: float
    correlation: Float[np.ndarray, " order_and_one"]

    @property
    def order(self) -> int:
        return self.coefficients.size

    @property
    def sd(self) -> float:
        """Standard deviation of the noise itself: σ_e/√(1 − Σ φ_k ρ(k))."""
        return float(self.innovation_sd / np.sqrt(1.0 - self.coefficients @ self.correlation[1:]))

    def whitened(self, record: Float[np.ndarray, " samples"]) -> Float[np.ndarray, " innovations"]:
        """The innovations of a record; the first `order` samples have none."""
        return np.convolve(record - self.mean, np.concatenate([[1.0], -self.coefficients]), "valid")

    def autocorrelation(self, lags: int) -> Float[np.ndarray, " lags_and_one"]:
        """ρ(0) .. ρ(`lags`) of the model, beyond its order by its own recursion."""
        rho = list(self.correlation[: lags + 1])
        while len(rho) <= lags:
            rho.append(self.coefficients @ rho[: -self.order - 1 : -1] if self.order else 0.0)
        return np.array(rho)


def sample_autocorrelation(record: Float[np.ndarray, " samples"], lags: int) -> Float[np.ndarray, " lags_and_one"]:
    """ρ(0) .. ρ(`lags`) of a record about its mean, each sum over the whole length, so that no model of it is unstable.

    Raises `ValueError` for a record that is not longer than `lags`, not finite, or constant.
    """
    if not 0 <= lags < record.size:
        raise ValueError(f"`record` must be longer than {lags} lags; got {record.size} samples.")
    left = record - record.mean()
    power = left @ left
    # Rounding of the mean leaves a constant with a variance above 0.
    if not np.isfinite(power) or power <= record.size * (1e-12 * np.max(np.abs(record))) ** 2:
        raise ValueError("`record` must be finite and not constant.")
    return np.array([left[lag:] @ left[: record.size - lag] for lag in range(lags + 1)]) / power


def fit_noise(record: Float[np.ndarray, " samples"], order: int | None = None, most: int = 8) -> NoiseModel:
    """The autoregressive model of a record, by the equations of Yule and Walker.

    `order` None takes the one, up to `most`, of least AICC (Brockwell and Davis, Time Series: Theory and Methods, 1991,
    sections 8.1 and 9.3); it assumes a stationary record: a drift is taken away, or differenced away, before. The
    variance of the innovations is corrected for what was fitted, n/(n − p − 1). Checked on white noise and on
    autoregressions of the orders 1 and 2. Raises `ValueError` for a record shorter than `most` + 3 samples, or
    constant.
    """
    highest = most if order is None else order
    count = record.size
    if highest < 0 or count < highest + 3:
        raise ValueError(f"`record` must hold {highest + 3} samples or more, the order being 0 or more; got {count}.")
    rho = sample_autocorrelation(record, highest)
    variance = float(np.var(record))
    best: tuple[float, NoiseModel] | None = None
    for p in range(highest + 1) if order is None else [order]:
        phi = linalg.solve_toeplitz(rho[:p], rho[1 : p + 1]) if p else np.zeros(0)
        left = variance * (1.0 - phi @ rho[1 : p + 1])
        aicc = count * np.log(left) + 2.0 * (p + 1) * count / (count - p - 2)
        if best is None or aicc < best[0]:
            model = NoiseModel(float(record.mean()), phi, float(np.sqrt(left * count / (count - p - 1))), rho[: p + 1])
            best = aicc, model
    assert best is not None
    return best[1]
