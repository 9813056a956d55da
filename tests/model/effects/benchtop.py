"""A small stage and the signals of a lab, for tests of effects."""

from __future__ import annotations

import numpy as np

from phaselead.model.axis import AdoptedEffect, AxisModel, TimeView
from phaselead.model.chain import Chain, simulate
from phaselead.model.effects import effect

RATE_HZ = 2000.0
LINEAR = TimeView(gain_um_per_V=10.0, u_range_V=(0.0, 10.0), rate_Hz=RATE_HZ)
"""100 um over 10 V, no memory."""
PIEZO = TimeView(
    gain_um_per_V=8.0,
    play_r_V=(0.3, 1.0, 2.5),
    play_w_um_per_V=(1.0, 1.5, 1.0),
    deadzone_d_V=(3.0, 6.0),
    deadzone_s_um_per_V=(0.4, -0.6),
    offset_um=-3.0,
    delay_s=0.0004,
    rest_fraction=0.4,
    u_range_V=(-1.0, 9.0),
    rate_Hz=RATE_HZ,
)
MODE = AdoptedEffect(name="resonance", params={"f_Hz": 150.0, "zeta": 0.05, "c": 1.0})


def axis(view: TimeView = LINEAR, *effects: AdoptedEffect) -> AxisModel:
    return AxisModel(time=view, effects=effects)


def times(seconds: float, rate_Hz: float = RATE_HZ) -> np.ndarray:
    return np.arange(round(seconds * rate_Hz)) / rate_Hz


def run(
    model: AxisModel, u: np.ndarray, name: str | None = None, *, rate_Hz: float = RATE_HZ, t0: float = 0.0, **params
):
    """Position for a voltage, with at most one effect more."""
    extra = [] if name is None else [(effect(name), params)]
    return simulate(model, t0 + np.arange(len(u)) / rate_Hz, u, extra=extra)


def signal(model: AxisModel, u: np.ndarray, name: str, *, rate_Hz: float = RATE_HZ, others=None):
    """What ``apply`` of an effect is given."""
    e = effect(name)
    return Chain(model, np.arange(len(u)) / rate_Hz, u, others_um=others).signal_at(e.place)


def sine(swing: float, f_Hz: float, periods: float, *, low: float = 0.0, rate_Hz: float = RATE_HZ) -> np.ndarray:
    """Rising from ``low``, peak to peak ``swing``."""
    t = times(periods / f_Hz, rate_Hz)
    return low + swing / 2 * (1 - np.cos(2 * np.pi * f_Hz * t))


def response(u: np.ndarray, y: np.ndarray, f_Hz: float, rate_Hz: float = RATE_HZ) -> complex:
    """Complex gain at one frequency over whole periods of steady state."""
    wave = np.exp(-2j * np.pi * f_Hz * np.arange(len(u)) / rate_Hz)
    return complex((y - y.mean()) @ wave / ((u - u.mean()) @ wave))


def harmonics(y: np.ndarray, f_Hz: float, count: int, rate_Hz: float = RATE_HZ) -> np.ndarray:
    """Amplitudes of the first harmonics, over whole periods."""
    t = np.arange(len(y)) / rate_Hz
    return np.array([2 * abs(np.mean(y * np.exp(-2j * np.pi * k * f_Hz * t))) for k in range(1, count + 1)])


def rich(n: int = 3000, seed: int = 1) -> np.ndarray:
    """Steps, sines and a random walk between -0.9 and 8.9 V with visits to both ends, starting with a step."""
    rng = np.random.default_rng(seed)
    t = np.arange(n) / RATE_HZ
    steps = np.resize(np.repeat([4.0, 8.5, -0.5, 2.0, 6.0, 1.0], n // 6), n)
    return np.clip(steps + np.sin(2 * np.pi * 20 * t) + np.cumsum(rng.normal(0, 0.01, n)), -0.9, 8.9)
