"""A stage of its own making, for hiding effects in: Dahl friction elements for the hysteresis, many first-order lags
for creep, modes integrated at a finer step. Shares no code and no model family with the package."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, field

import numpy as np
from scipy.signal import cont2discrete, lfilter

from phaselead.record.recording import AxisRecord, Recording


@dataclass
class Rig:
    """``hidden``: what is switched on, by name, with its size; memory and time run on from record to record."""

    seed: int = 0
    rate_Hz: float = 2000.0
    hidden: dict[str, float] = field(default_factory=dict)
    noise_um: float = 0.010
    swing_V: float = 8.0

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.seed)
        base = np.random.default_rng(1000 + self.seed)
        self.gain = 10 * base.uniform(0.8, 1.2)
        self.lengths_V = np.array([0.15, 0.6, 2.2]) * base.uniform(0.8, 1.25, 3)
        self.weights = self.gain * np.array([0.05, 0.06, 0.08]) * base.uniform(0.8, 1.25, 3)
        self.z = -0.5 * self.lengths_V
        self.u_V, self.now_s = 0.0, 0.0
        self.slow = np.zeros(28)
        self.offset_um = base.uniform(-3, 3)

    def _hysteresis(self, u: np.ndarray) -> np.ndarray:
        bias = self.hidden.get("asymmetric_hysteresis", 0.0)
        out = np.zeros(len(u))
        for j, (length, weight) in enumerate(zip(self.lengths_V, self.weights, strict=True)):
            z, last, track = float(self.z[j]), self.u_V, []
            for now in u.tolist():
                du = now - last
                # An element that yields earlier on the way up than on the way down, the more the higher the voltage.
                reach = length * (1 + 6 * bias * (now / self.swing_V) * (1 if du > 0 else -1))
                limit = math.copysign(reach, du)
                z = limit + (z - limit) * math.exp(-abs(du) / reach)
                last = now
                track.append(z)
            self.z[j] = z
            out += weight * np.array(track)
        self.u_V = float(u[-1])
        # Friction holds back: after a turning point the position lags.
        x = (self.gain + self.weights.sum()) * u - out
        return x + bias * self.gain * u**2 / self.swing_V

    def _creep(self, x: np.ndarray) -> np.ndarray:
        per_decade = self.hidden.get("creep", 0.0)
        if not per_decade:
            return x
        taus = np.logspace(-2, 3, 28)
        gain = per_decade * 5 / 28
        total = np.zeros_like(x)
        for j, tau in enumerate(taus):
            a = np.exp(-1 / (self.rate_Hz * tau))
            y, end = lfilter([1 - a], [1, -a], x, zi=[a * self.slow[j]])
            self.slow[j] = end[0] / a
            total += y
        return x + gain * total

    def _mode(self, x: np.ndarray) -> np.ndarray:
        f = self.hidden.get("resonance")
        if not f:
            return x
        w, zeta, fine = 2 * np.pi * f, 0.03, 8
        a = np.array([[0, 1], [-w * w, -2 * zeta * w]])
        ad, bd, *_ = cont2discrete(
            (a, np.array([[0], [w * w]]), np.eye(1, 2), np.zeros((1, 1))), 1 / (fine * self.rate_Hz)
        )
        b = [0, bd[0, 0], ad[0, 1] * bd[1, 0] - ad[1, 1] * bd[0, 0]]
        den = [1, -np.trace(ad), np.linalg.det(ad)]
        rows = np.arange(fine * len(x)) / fine + 0.5 / fine  # straight between rows
        pushed = np.interp(rows, np.arange(len(x)), x - x[0])
        return x[0] + lfilter(b, den, pushed)[::fine]

    def record(self, u: np.ndarray, name: str) -> Recording:
        n = len(u)
        t = self.now_s + np.arange(n) / self.rate_Hz
        late = self.hidden.get("delay", 0.0) * self.rate_Hz
        seen = np.interp(np.arange(n) - late, np.arange(n), u, left=self.u_V) if late else u
        x = self._mode(self._creep(self._hysteresis(seen)))
        x = x * (1 + self.hidden.get("gain_change", 0.0)) + self.offset_um
        x = x + self.hidden.get("thermal_drift", 0.0) * t
        hum = self.hidden.get("mains_hum", 0.0)
        x = x + hum * np.sin(2 * np.pi * 50.02 * t + 1) + 0.3 * hum * np.sin(2 * np.pi * 150.06 * t)
        slow = lfilter([1], [1, -0.98], self.rng.normal(size=n)) * 0.2
        x = x + self.noise_um * np.sqrt(0.5) * (self.rng.normal(size=n) + slow)
        self.now_s = float(t[-1]) + 5.0
        digest = hashlib.sha256(x.tobytes()).hexdigest()
        return Recording(t_s=t, axes={"x": AxisRecord(u, x)}, source=f"{name}.csv", sha256=digest)

    def waves(self, seconds: float = 2.0) -> dict[str, np.ndarray]:
        n = round(seconds * self.rate_Hz)
        t = np.arange(n) / self.rate_Hz
        middle, half = self.swing_V / 2, self.swing_V / 2
        ramp = np.minimum(1.0, np.minimum(t, t[-1] - t) / 0.1)
        found = {}
        for level in (0.25, 0.9):
            lines = np.unique(np.round(np.logspace(0, np.log10(0.4 * self.rate_Hz * 1.0), 60)))
            phases = self.rng.uniform(0, 2 * np.pi, len(lines))
            wave = np.sum(
                [np.sin(2 * np.pi * f * t + p) / np.sqrt(f) for f, p in zip(lines, phases, strict=True)], axis=0
            )
            found[f"multisine{level:g}"] = ramp * (middle + level * half * wave / np.abs(wave).max())
        levels = self.swing_V * np.array([0, 0.75, 0.3, 0.9, 0.15, 0.6, 0, 0])
        found["steps"] = levels[np.minimum((t / seconds * 8).astype(int), 7)]
        found["triangle"] = self._decaying(t, seconds)
        found["idle"] = np.zeros(n)
        found["fast"] = ramp * (middle - half * 0.5 * np.cos(2 * np.pi * 37 * t))
        return found

    def _decaying(self, t: np.ndarray, seconds: float) -> np.ndarray:
        corners = [0.0]
        for size in (1.0, 0.8, 0.6, 0.4, 0.2):
            corners += [self.swing_V * (0.5 + size / 2), self.swing_V * (0.5 - size / 2)]
        corners.append(0.0)
        return np.interp(t, np.linspace(0, seconds, len(corners)), corners)

    def session(self, name: str, seconds: float = 2.0) -> list[Recording]:
        return [self.record(u, f"{name}-{kind}") for kind, u in self.waves(seconds).items()]


def trial(seed: int, hidden: dict[str, float], *, seconds: float = 2.0, rate_Hz: float = 2000.0):
    """(reference, train, holdout): the reference session without what is hidden."""
    rig = Rig(seed, rate_Hz=rate_Hz)
    reference = rig.session("reference", seconds)
    rig.hidden = dict(hidden)
    return reference, rig.session("train", seconds), rig.session("holdout", seconds)
