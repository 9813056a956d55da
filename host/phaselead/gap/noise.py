"""Noise of a residual: what a sensor adds, and how the misfit of a hysteresis model wanders.

A sensor's noise is the same at rest and in motion. The misfit of a memory model is another thing: it stands still
while the voltage does and wanders as the voltage goes its way. So it is modelled as a random walk with a restoring
force (Ornstein and Uhlenbeck 1930) along the *path* of the voltage, not in time: a slow rise during a hold is then
judged against the sensor's noise alone, while the same rise during a loop may be the operator's fault.

    e_k = m_k + n_k,   m_k = phi_k m_{k-1} + w_k,   phi_k = exp(-|u_k - u_{k-1}| / length_V),
    var w_k = misfit_um^2 (1 - phi_k^2) + wander_um2_per_s step_s,   n autoregressive

e_k - phi_k e_{k-1}, filtered by the autoregression, then has a covariance of three diagonals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import LinAlgError, solve, solve_banded
from scipy.linalg.lapack import dpttrf, dpttrs
from scipy.optimize import minimize
from scipy.signal import detrend, lfilter

from phaselead.record import Samples

ORDER, SENSOR_ORDER = 16, 4
"""Of the autoregression of records at rest alone, and of the sensor's beside a misfit."""
LOUDER = 1.1
"""Mean square of whitened records at rest from which their noise is another than was expected."""
LIKELIHOOD_ROWS = 60_000
"""Most rows of a record in the likelihood, which is evaluated some 90 times."""


@dataclass(frozen=True)
class Noise:
    """Noise of residuals, in the terms of the module's equations."""

    sensor: Samples
    """Autoregression (1, a_1 ... a_p) of the sensor's noise."""
    sigma_um: float
    """Standard deviation of its innovations."""
    misfit_um: float = 0.0
    """Standard deviation of the misfit."""
    length_V: float = 1.0
    """Way of the voltage over which the misfit is forgotten."""
    wander_um2_per_s: float = 0.0
    """Growth of the misfit's variance in time."""

    def walk(self, u_V: Samples, step_s: float) -> tuple[Samples, Samples]:
        """phi (n,), and the variance (n,) in um^2 by which the misfit grows in each row of a record."""
        phi = np.exp(-np.abs(np.diff(u_V, prepend=u_V[0])) / self.length_V)
        return phi, self.misfit_um**2 * (1 - phi**2) + self.wander_um2_per_s * step_s

    def drawn(self, u_V: Samples, step_s: float, rng: np.random.Generator) -> Samples:
        """One draw (n,) in um for a record driven by a voltage (n,)."""
        n, lead = len(u_V), 8 * len(self.sensor)
        drawn = lfilter([self.sigma_um], self.sensor, rng.standard_normal(n + lead))[lead:]
        if self.misfit_um > 0:
            phi, grown = self.walk(u_V, step_s)
            grown[0] = self.misfit_um**2
            banded = np.stack([np.ones(n), np.append(-phi[1:], 0.0)])
            drawn = drawn + solve_banded((1, 0), banded, np.sqrt(grown) * rng.standard_normal(n))
        return np.asarray(drawn)

    def minus_log_likelihood(self, error_um: Samples, u_V: Samples, step_s: float) -> float:
        """Of a residual (n,) under a voltage (n,), but for a constant."""
        order = len(self.sensor)
        taps = self.sensor / self.sigma_um
        white = lfilter(taps, [1.0], error_um)[order:]
        phi, grown = (one[order + 1 :] for one in self.walk(u_V, step_s))
        # The autoregression changes the scale of slow signals by its sum.
        steps = white[1:] - phi * white[:-1]
        pivots, below, _ = dpttrf(1 + phi**2 + grown * float(taps.sum()) ** 2, -phi[1:])
        explained, _ = dpttrs(pivots, below, steps)
        return float(0.5 * steps @ explained + 0.5 * np.log(pivots).sum() + len(steps) * np.log(self.sigma_um))


def autoregression(series: Sequence[Samples], order: int = ORDER) -> tuple[Samples, float]:
    """Autoregression (1, a_1 ... a_p) of all series (n_i,) together, and the deviation of its innovations, by least
    squares (covariance method). Short series get a lower order."""
    order = min(order, max(1, min(len(s) for s in series) // 20))
    normal = np.zeros((order + 1, order + 1))
    count = 0
    for s in series:
        lagged = np.lib.stride_tricks.sliding_window_view(s - s.mean(), order + 1)[:, ::-1]
        normal += lagged.T @ lagged
        count += len(lagged)
    ridge = (1e-9 * np.trace(normal) / (order + 1) + 1e-300) * np.eye(order)
    try:
        full = np.concatenate([[1.0], -solve(normal[1:, 1:] + ridge, normal[1:, 0], assume_a="pos")])
    except (LinAlgError, ValueError):
        full = np.eye(1, order + 1)[0]
    return full, float(np.sqrt(max(full @ normal @ full / max(count, 1), 1e-18)))


def fit_noise(driven: Sequence[tuple[Samples, Samples]], idle: Sequence[Samples], step_s: float) -> Noise:
    """The most likely noise of some residuals in um, each (n_i,): ``driven`` are pairs of residual and voltage,
    ``idle`` residuals at rest."""
    if not driven:
        return Noise(*autoregression(idle))
    sensor, sigma = autoregression(idle, SENSOR_ORDER) if idle else (np.ones(1), _roughness([e for e, _ in driven]))
    span = max(float(np.ptp(u)) for _, u in driven) or 1.0  # another axis drives the motion
    spread = float(np.sqrt(np.mean(np.concatenate([e for e, _ in driven]) ** 2)))
    noise = Noise(sensor, sigma, max(spread, sigma), 0.3 * span, 1e-6 * spread**2)
    return _likeliest(noise, driven, idle, step_s)


def as_idle(noise: Noise, idle: Sequence[Samples]) -> Noise:
    """The noise with the sensor's part learned anew from residuals at rest (n_i,), where these hold more than it
    expects: hum and vibration that came up since would otherwise look like whatever rings in motion."""
    quiet = [np.asarray(detrend(e)) for e in idle]
    if not quiet:
        return noise
    taps = noise.sensor / noise.sigma_um
    white = np.concatenate([np.convolve(e, taps, "valid") for e in quiet])
    if float(np.mean(white**2)) < LOUDER:
        return noise
    sensor, sigma = autoregression(quiet)
    return replace(noise, sensor=sensor, sigma_um=sigma)


def _roughness(series: Sequence[Samples]) -> float:
    """Deviation of the white noise in smooth residuals (n_i,), from the median of their third differences, whose
    variance is 20 times that of the noise."""
    rough = np.concatenate([np.diff(s, 3) for s in series])
    return max(float(1.4826 * np.quantile(np.abs(rough), 0.5) / np.sqrt(20.0)), 1e-6)


def _likeliest(
    noise: Noise, driven: Sequence[tuple[Samples, Samples]], idle: Sequence[Samples], step_s: float
) -> Noise:
    """The noise with the misfit, length and wander of the largest likelihood, and without idle records its sigma
    too."""
    parts = [(e, u) for e, u in driven] + [(e, np.zeros(len(e))) for e in idle]
    parts = [(e[:LIKELIHOOD_ROWS], u[:LIKELIHOOD_ROWS]) for e, u in parts]
    own_sigma = not idle

    def at(x: Samples) -> Noise:
        x = np.clip(x, -14, 14)
        sigma = noise.sigma_um * float(np.exp(x[3])) if own_sigma else noise.sigma_um
        return replace(
            noise,
            misfit_um=noise.misfit_um * float(np.exp(x[0])),
            length_V=noise.length_V * float(np.exp(x[1])),
            wander_um2_per_s=noise.wander_um2_per_s * float(np.exp(x[2])),
            sigma_um=sigma,
        )

    def cost(x: Samples) -> float:
        tried = at(x)
        return sum(tried.minus_log_likelihood(e, u, step_s) for e, u in parts) + 1e-3 * float(np.sum(x**2))

    start = np.zeros(4 if own_sigma else 3)
    simplex = np.vstack([start, start + 1.5 * np.eye(len(start))])
    options = {"xatol": 0.05, "fatol": 0.5, "maxfev": 90, "initial_simplex": simplex}
    return at(minimize(cost, start, method="Nelder-Mead", options=options).x)
