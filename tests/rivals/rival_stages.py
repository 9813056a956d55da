"""Evidence of stages that are known by equations."""

from __future__ import annotations

import numpy as np

from rivals import Evidence, Sine
from rivals.evidence import TICK_S

SWINGS_V, FREQUENCIES_HZ = (1.0, 3.0, 6.0, 10.0), (1.0, 5.0, 20.0)


def gain(swing_V):
    return 15.0 + 1.9 * swing_V - 0.1 * swing_V**2


def lag(swing_V, f_Hz):
    return np.radians(2 + 0.7 * swing_V + 0.05 * f_Hz - 0.04 * swing_V**2)


def evidence(*, steeper: float = 1.0, f0_Hz: float = 200.0, zeta: float = 0.02) -> Evidence:
    """Sines as eq. 5 of Xu and Li 2010 has them, and one mode behind a dead time of 1.65 ticks."""
    sines = []
    for swing in SWINGS_V:
        for f in FREQUENCIES_HZ:
            turns = 2 * np.pi * f * TICK_S * np.arange(round(2 / (f * TICK_S)))
            u = swing * (1 - np.cos(turns)) / 2
            x = steeper * gain(swing) * swing * (1 - np.cos(turns - lag(swing, f))) / 2
            sines.append(Sine(u, x, swing, f, len(u) // 2))
    f_Hz = np.geomspace(1.0, 2200.0, 3000)
    mode = 1 / (1 - (f_Hz / f0_Hz) ** 2 + 2j * zeta * f_Hz / f0_Hz)
    response = 19.4 * steeper * mode * np.exp(-2j * np.pi * f_Hz * 1.65 * TICK_S)
    return Evidence(sines, f_Hz, response, (-2.0, 10.0), 0.0)
