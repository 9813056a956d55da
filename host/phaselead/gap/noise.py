"""Noise of a residual: what a sensor adds, and how the misfit of a hysteresis model wanders.

A sensor's noise is the same at rest and in motion. The misfit of a memory model is another thing: it stands still
while the voltage does and wanders as the voltage goes its way. So it is modelled as a random walk with a restoring
force (Ornstein and Uhlenbeck 1930) along the *path* of the voltage, not in time: a slow rise during a hold is then
judged against the sensor's noise alone, while the same rise during a loop may be the operator's fault.

    e_k = m_k + n_k,   m_k = phi_k m_{k-1} + w_k,   phi_k = exp(-|u_k - u_{k-1}| / length_V),
    var w_k = misfit_um^2 (1 - phi_k^2) + wander_um2_per_s step_s,   n autoregressive

e_k - phi_k e_{k-1} then has a covariance of three diagonals, whose Cholesky factor whitens (n, k) columns at once.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, solve
from scipy.optimize import minimize
from scipy.signal import detrend

from phaselead.compiled import kernel_of
from phaselead.record import Samples

ORDER, SENSOR_ORDER = 16, 4
"""Of the autoregressions. The sensor's is short because as many rows are lost after every jump."""
JUMP_STD = 30.0
"""A row is a jump when the misfit may change in it by this many deviations of the sensor's innovations; the filter for
the sensor's noise then says nothing for its length."""
RARE_SHARE = 0.02
"""Of the rows: what happens more often is no jump."""
WANDER_MARGIN = 4.0
"""A wander estimated from the few independent stretches of one record may be this many times larger."""
LOUDER = 1.1
"""Mean square of whitened records at rest from which their noise is another than was expected."""
START_STD = 1e3
"""Deviation of the misfit in a record's first row, in units of its own: nothing is known of it there."""
LIKELIHOOD_ROWS = 60_000
"""Most rows of a record in the likelihood, which is evaluated some 90 times."""
MOVING_SHARE = 0.5
"""Share of moving rows from which a record tells how the misfit behaves in motion."""
MOVING_GROWTH = 1e-2
"""A row in which the misfit's variance grows by more than this, in units of the sensor's, is one in motion."""


@dataclass(frozen=True)
class Noise:
    """Noise of residuals, in the terms of the module's equations."""

    sensor: Samples
    """Autoregression (1, a_1 ... a_p) of the sensor's noise."""
    sigma_um: float
    """Standard deviation of its innovations."""
    misfit_um: float
    """Standard deviation of the misfit."""
    length_V: float
    """Way of the voltage over which the misfit is forgotten."""
    wander_um2_per_s: float
    """Growth of the misfit's variance in time."""
    rest: Samples
    """Autoregression, with innovations of deviation 1, of what these leave in motion: there the misfit is smoother than
    a random walk."""
    idle_um2_per_s: float | None = None
    """Wander of records in which the voltage never moves; None where no record told."""

    @property
    def level_um(self) -> float:
        """Standard deviation of misfit and innovations together."""
        return float(np.hypot(self.sigma_um, self.misfit_um))

    def whitener(self, u_V: Samples, step_s: float) -> Whitener:
        """The whitener of a record driven by the voltage (n,)."""
        return Whitener(self, u_V, step_s)

    def amplitude_density(self, f_Hz: Samples, step_s: float) -> Samples:
        """One-sided amplitude density (m,) of the sensor's noise in um/sqrt(Hz) at frequencies (m,)."""
        turn = np.exp(-2j * np.pi * np.outer(f_Hz * step_s, np.arange(len(self.sensor))))
        return np.asarray(self.sigma_um * np.sqrt(2 * step_s) / np.abs(turn @ self.sensor))


class Whitener:
    """Filters under which the noise of one record becomes white and of unit variance."""

    def __init__(self, noise: Noise, u_V: Samples, step_s: float) -> None:
        self._noise = noise
        path = np.abs(np.diff(u_V, prepend=u_V[0]))
        self._phi = np.exp(-path / noise.length_V) if noise.misfit_um > 0 else np.zeros(len(u_V))
        idle = not path.any() and noise.idle_um2_per_s is not None
        wander = noise.idle_um2_per_s if idle and noise.idle_um2_per_s is not None else noise.wander_um2_per_s
        grown = noise.misfit_um**2 * (1 - self._phi**2) + wander * step_s
        # The autoregression for the sensor's noise comes first and changes the scale of slow signals by its sum.
        slow = float(np.sum(noise.sensor)) / noise.sigma_um
        first = START_STD**2 if noise.misfit_um > 0 else 0.0
        self.factor = differences_factor(self._phi, grown * slow**2, first)
        self._moving = grown * slow**2 > MOVING_GROWTH
        self._grown = grown

    def __call__(self, values: Samples) -> Samples:
        """Values (n, ...) whitened along the first axis. Rows without enough of a past, and those after jumps, become
        0."""
        n = self._noise
        white = self._whitened(values, n.rest)
        white[: len(n.sensor) + len(n.rest) - 1] = 0.0
        white[self._lost] = 0.0
        return white

    @cached_property
    def _lost(self) -> NDArray[np.intp]:
        """Rows (m,) after jumps, where jumps are rare."""
        n, rows = self._noise, len(self._grown)
        jumped = np.flatnonzero(self._grown > (JUMP_STD * n.sigma_um) ** 2)
        lost = (jumped[:, None] + np.arange(len(n.sensor))).ravel() if len(jumped) < RARE_SHARE * rows else jumped[:0]
        return np.asarray(lost[lost < rows])

    def innovations(self, values: Samples) -> Samples:
        """Values (n, ...) whitened but for the autoregression in motion, ``rest``."""
        return self._whitened(values, np.ones(1))

    def _whitened(self, values: Samples, rest: Samples) -> Samples:
        n = self._noise
        return whitened(values, n.sensor / n.sigma_um, self._phi, self.factor, rest, self._moving)


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
        sensor, sigma = autoregression(idle)
        return Noise(sensor, sigma, 0.0, 1.0, 0.0, np.ones(1))
    sensor, sigma = autoregression(idle, SENSOR_ORDER) if idle else (np.ones(1), _roughness([e for e, _ in driven]))
    span = max(float(np.ptp(u)) for _, u in driven)
    spread = float(np.sqrt(np.mean(np.concatenate([e for e, _ in driven]) ** 2)))
    noise = Noise(sensor, sigma, max(spread, sigma), 0.3 * span, 1e-6 * spread**2, np.ones(1))
    noise = _likeliest(noise, driven, idle, step_s)
    if idle:
        at_rest = max(_wander(e, step_s) for e in idle)
        noise = replace(noise, idle_um2_per_s=min(at_rest, noise.wander_um2_per_s))
    white = [noise.whitener(u, step_s).innovations(e)[len(sensor) :] for e, u in driven]
    moved = [np.abs(np.diff(u, prepend=u[0]))[len(sensor) :] > 0 for _, u in driven]
    white = [w[m] for w, m in zip(white, moved, strict=True) if m.mean() > MOVING_SHARE]
    if not white:
        return noise
    rest, scale = autoregression(white)
    return replace(noise, rest=rest / scale)


def _wander(error: Samples, step_s: float) -> float:
    """Upper estimate in um^2/s of how a residual at rest (n,) wanders: by how much the squares of its way over a
    quarter of the record exceed those over a fortieth, and the scatter of such a figure."""
    e = np.asarray(error, dtype=np.float64)
    n = len(e)
    long, short = n // 4, max(n // 40, 1)
    means = np.convolve(e, np.ones(short) / short, "valid")
    far, near = (float(np.mean((means[lag:] - means[:-lag]) ** 2)) for lag in (long, short))
    return (WANDER_MARGIN * max(far - near, 0.0) + near) / (long * step_s)


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
        tried, total = at(x), 0.0
        for e, u in parts:
            whitener = tried.whitener(u, step_s)
            white = whitener.innovations(e)[len(tried.sensor) :]
            logs = np.log(whitener.factor[0, len(tried.sensor) :])
            total += float(0.5 * white @ white + logs.sum() + len(white) * np.log(tried.sigma_um))
        return total + 1e-3 * float(np.sum(x**2))

    start = np.zeros(4 if own_sigma else 3)
    options = {"xatol": 0.05, "fatol": 0.5, "maxfev": 90, "initial_simplex": _simplex(start)}
    return at(minimize(cost, start, method="Nelder-Mead", options=options).x)


def _simplex(start: Samples) -> Samples:
    return np.vstack([start, start + 1.5 * np.eye(len(start))])


_SIZE, _DATA = ctypes.c_size_t, ctypes.c_void_p


class _KernelWhitener(ctypes.Structure):
    """struct gap_whitener."""

    _fields_ = (
        ("n_sensor", _SIZE), ("sensor", _DATA), ("phi", _DATA), ("diag", _DATA), ("below", _DATA),
        ("n_rest", _SIZE), ("rest", _DATA), ("moving", _DATA),
    )  # fmt: skip


@cache
def _kernel() -> ctypes.CDLL:
    kernel = kernel_of("phaselead.gap._kernel", "gap_differences_factor")
    kernel.gap_whiten.argtypes = [ctypes.POINTER(_KernelWhitener), _SIZE, _SIZE, _DATA, _DATA, _DATA]
    kernel.gap_differences_factor.argtypes = [_SIZE, _DATA, _DATA, ctypes.c_double, _DATA, _DATA]
    kernel.gap_whiten.restype = kernel.gap_differences_factor.restype = None
    return kernel


def differences_factor(phi: Samples, grown: Samples, first: float) -> Samples:
    """Lower Cholesky factor, banded (2, n), of the covariance of n_k - phi_k n_{k-1} + w_k for unit white n and w of
    the variance ``grown`` (n,); the first row's is 1 + ``first``."""
    phi, grown = (np.ascontiguousarray(a, dtype=np.float64) for a in (phi, grown))
    factor = np.empty((2, len(phi)))
    diag, below = factor
    _kernel().gap_differences_factor(
        len(phi), phi.ctypes.data, grown.ctypes.data, first, diag.ctypes.data, below.ctypes.data
    )
    return factor


def whitened(
    values: Samples, sensor: Samples, phi: Samples, factor: Samples, rest: Samples, moving: NDArray[np.bool_]
) -> Samples:
    """``values`` (n, ...) filtered by ``sensor``, freed of what lasts along the path by ``phi`` (n,) and the banded
    Cholesky ``factor`` (2, n), and in ``moving`` rows filtered by ``rest``."""
    rows = np.ascontiguousarray(values, dtype=np.float64).reshape(len(values), -1)
    steps, white = np.empty_like(rows), np.empty_like(rows)
    kept = [np.ascontiguousarray(a, dtype=np.float64) for a in (sensor, phi, factor[0], factor[1], rest)]
    moves = np.ascontiguousarray(moving, dtype=np.uint8)
    taps, along, diag, below, last = (a.ctypes.data for a in kept)
    by = _KernelWhitener(len(kept[0]), taps, along, diag, below, len(kept[4]), last, moves.ctypes.data)
    _kernel().gap_whiten(by, *rows.shape, rows.ctypes.data, steps.ctypes.data, white.ctypes.data)
    return white.reshape(np.shape(values))
