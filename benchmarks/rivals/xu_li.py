"""The paper's own controllers: phase-lead feed-forward, PID, and both (Xu and Li 2010, eqs. 6, 7, 11 and 13).

Gain K over the swing and lag theta over swing and frequency are polynomials fitted to the sines. Their swing belongs to
the voltage, so K(u) u = range is solved first. Outside of the frequencies that were recorded they mean nothing: theta
is then that of the nearest one. A path that is no sine is seen early by its fundamental's lag.

The PID gains were found by trial. On another stage they are scaled as the loop asks (Kp with 1/K, Ki with f0/K, Kd with
1/(K f0), K the gain of small motions and f0 the first mode, so that the loop is the published one but for its dead
time), and halved, as one would at a bench, until the loop on the measured response has no larger peak sensitivity than
the published gains had on the stage like theirs.
"""

from __future__ import annotations

import numpy as np

from rivals.bench import Reference
from rivals.evidence import TICK_S, Evidence, Samples
from rivals.paths import Path

KP_V_per_um, KI_V_per_um_s, KD_V_s_per_um = 0.017, 8.62, 2.33e-5
PUBLISHED_FOR = (19.4, 200.0)
"""Gain of small motions, um/V, and first mode, Hz, of sim://xyz250, on which the published gains are stable."""
WORST_PEAK = 2.4
"""Peak sensitivity of the published gains on the response that is measured there (2.38)."""


class FeedForward:
    """u(t) = r(t + theta / 2 pi f) / K (eq. 11)."""

    def __init__(self, evidence: Evidence, path: Path, reference: Reference) -> None:
        swing, f_Hz, gain, lag = evidence.grid
        self._k = np.linalg.lstsq(np.stack([np.ones_like(swing), swing, swing**2], 1), gain, rcond=None)[0]
        self._theta = np.linalg.lstsq(_terms(swing, f_Hz), lag, rcond=None)[0]
        levels = np.linspace(0.0, swing.max(), 2000)
        reached = levels * np.polynomial.polynomial.polyval(levels, self._k)
        swing_V = float(np.interp(path.swing_um, reached, levels))
        inside_Hz = float(np.clip(path.f_Hz, f_Hz.min(), f_Hz.max()))
        theta = float((_terms(np.array([swing_V]), np.array([inside_Hz])) @ self._theta)[0])
        self._gain = float(np.polynomial.polynomial.polyval(swing_V, self._k))
        self._wanted_um = reference.by_tick(theta / (2 * np.pi * path.f_Hz))

    def step(self, tick: int, measured_um: float) -> float:
        return self._wanted_um(tick) / self._gain


class Pid:
    """Eq. 13 without its feed-forward."""

    def __init__(self, evidence: Evidence, path: Path, reference: Reference) -> None:
        self._wanted_um, (self._low_V, self._high_V) = reference.by_tick(), evidence.u_limits_V
        self.gains = scaled_gains(evidence)
        self._sum_V, self._before_um = 0.0, 0.0

    def step(self, tick: int, measured_um: float) -> float:
        kp, ki, kd = self.gains
        error_um = self._wanted_um(tick) - measured_um
        self._sum_V = min(max(self._sum_V + ki * TICK_S * error_um, self._low_V), self._high_V)
        rate = (error_um - self._before_um) / TICK_S
        self._before_um = error_um
        return kp * error_um + self._sum_V + kd * rate


class FeedForwardPid:
    """Eq. 13."""

    def __init__(self, evidence: Evidence, path: Path, reference: Reference) -> None:
        self._parts = (FeedForward(evidence, path, reference), Pid(evidence, path, reference))

    def step(self, tick: int, measured_um: float) -> float:
        return sum(part.step(tick, measured_um) for part in self._parts)


def scaled_gains(evidence: Evidence) -> tuple[float, float, float]:
    """Kp in V/um, Ki in V/(um s), Kd in V s/um for a stage."""
    slow = evidence.f_Hz < 0.1 * evidence.first_mode_Hz
    steeper = float(np.median(np.abs(evidence.gain[slow]))) / PUBLISHED_FOR[0]
    faster = evidence.first_mode_Hz / PUBLISHED_FOR[1]
    gains = KP_V_per_um / steeper, KI_V_per_um_s * faster / steeper, KD_V_s_per_um / (steeper * faster)
    while peak_sensitivity(evidence, gains) > WORST_PEAK:
        gains = gains[0] / 2, gains[1] / 2, gains[2] / 2
    return gains


def peak_sensitivity(evidence: Evidence, gains: tuple[float, float, float]) -> float:
    """Of the loop on the measured response; infinite where it is not stable."""
    kp, ki, kd = gains
    f_Hz = np.geomspace(evidence.f_Hz[0], evidence.f_Hz[-1], 4000)
    back = np.exp(-2j * np.pi * f_Hz * TICK_S)
    loop = evidence.response_at(f_Hz) * (kp + ki * TICK_S / (1 - back) + kd / TICK_S * (1 - back))
    turned = np.unwrap(np.angle(1 + loop))
    return float(np.inf) if abs(turned[-1]) > np.pi / 2 else float(1 / np.abs(1 + loop).min())


def _terms(swing: Samples, f_Hz: Samples) -> Samples:
    return np.stack([np.ones_like(swing), swing, f_Hz, swing * f_Hz, swing**2, f_Hz**2], 1)
