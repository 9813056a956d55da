"""A structure that three piezos drive and three sensors watch: modes integrated four times faster than they are
sampled, by the exact step of scipy's state-space conversion; stiffness may fall with the level of the drive."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import cont2discrete

from phaselead.record.recording import AxisRecord, Recording

RATE_HZ, PERIOD, FINER = 2000.0, 1024, 4
F_HZ = np.array([92.0, 171.0, 240.0, 415.0])
ZETA = np.array([0.015, 0.02, 0.012, 0.01])
AXES = ("x", "y", "z")


@dataclass
class Structure:
    """``softening``: relative drop of every natural frequency per volt rms of the drive."""

    seed: int = 0
    softening: float = 0.0
    noise_um: float = 0.002

    def __post_init__(self) -> None:
        rng = np.random.default_rng(100 + self.seed)
        self.rng = np.random.default_rng(self.seed)
        self.sensors = rng.normal(size=(3, len(F_HZ)))
        self.actuators = rng.normal(size=(len(F_HZ), 3))
        self.feedthrough = np.array([[3.0, 0.3, -0.2], [0.2, -2.5, 0.4], [0.3, 0.1, 2.0]])

    def matrices(self, level_V: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Continuous state space, volts to um."""
        w = 2 * np.pi * F_HZ * (1 - self.softening * level_V)
        m = len(w)
        A = np.block([[np.zeros((m, m)), np.eye(m)], [-np.diag(w**2), -np.diag(2 * ZETA * w)]])
        B = np.vstack([np.zeros((m, 3)), np.diag((2 * np.pi * F_HZ) ** 2) @ self.actuators])
        return A, B, np.hstack([self.sensors, np.zeros((3, m))]), self.feedthrough

    def response(self, f_Hz: np.ndarray, level_V: float = 0.0) -> np.ndarray:
        """(lines, 3, 3) um/V."""
        A, B, C, D = self.matrices(level_V)
        s = 2j * np.pi * f_Hz
        return np.array([C @ np.linalg.solve(q * np.eye(len(A)) - A, B) + D for q in s])

    def multisine(self, level_V: float) -> np.ndarray:
        """(PERIOD, 3) volts of random phases over 2..900 Hz."""
        spectrum = np.zeros((PERIOD // 2 + 1, 3), dtype=complex)
        lines = slice(1, int(900 / RATE_HZ * PERIOD))
        phases = self.rng.uniform(0, 2 * np.pi, spectrum[lines].shape)
        spectrum[lines] = np.exp(1j * phases)
        u = np.fft.irfft(spectrum, axis=0)
        return level_V * u / np.sqrt(np.mean(u**2, axis=0))

    def record(self, u: np.ndarray, name: str, *, warm_rows: int = 0, level_V: float = 0.0) -> Recording:
        """What is recorded of the voltages (n, 3), straight between rows, from rest."""
        A, B, C, D = self.matrices(level_V)
        step = 1 / RATE_HZ
        Ad, Bd, Cd, Dd, _ = cont2discrete((A, B, C, D), step / FINER, method="foh")
        fine = np.arange(len(u) * FINER) / FINER
        v = np.stack([np.interp(fine, np.arange(len(u)), column) for column in u.T], axis=1)
        x, y = np.zeros(len(A)), np.empty((len(u), 3))
        forced = v @ Bd.T
        for k in range(len(v)):
            if k % FINER == 0:
                y[k // FINER] = Cd @ x + Dd @ v[k]
            x = Ad @ x + forced[k]
        y += self.noise_um * self.rng.normal(size=y.shape)
        axes = {a: AxisRecord(u[:, i].copy(), y[:, i].copy()) for i, a in enumerate(AXES)}
        return Recording(np.arange(len(u)) * step, axes, slice(warm_rows, len(u)), name)

    def experiments(self, count: int, level_V: float, name: str) -> list[Recording]:
        """Multisines on all axes, two periods, the second to be used."""
        return [
            self.record(np.tile(self.multisine(level_V), (2, 1)), f"{name}{i}", warm_rows=PERIOD, level_V=level_V)
            for i in range(count)
        ]
