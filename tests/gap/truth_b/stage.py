"""How the stages of this lab differ from each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .parts import Samples

CONVERTERS_V = ((0.0, 10.0), (-5.0, 5.0), (-10.0, 10.0), (-20.0, 120.0), (0.0, 150.0), (-200.0, 200.0))
FINER = {1000.0: 16, 5000.0: 8, 20000.0: 4}
"""Steps of the simulation for each row, by sampling rate (Hz)."""
MODES_HZ = {1000.0: (60.0, 200.0), 5000.0: (150.0, 700.0), 20000.0: (500.0, 2500.0)}
TRAVEL_UM = (2.0, 800.0)
NOISE_UM = (0.0003, 0.03)


@dataclass(frozen=True)
class Traits:
    """One stage. ``low_V`` to ``high_V`` is what the lab uses of the converter's ``output_V``."""

    rate_Hz: float
    output_V: tuple[float, float]
    bits: int
    low_V: float
    high_V: float
    park_V: float
    travel_um: float
    sign: int
    zero_um: float
    held: bool
    dead_time_s: float
    amplifier_tau_s: float
    loop: float
    bend: float
    creep: float
    modes: tuple[tuple[float, float, float], ...]
    """Share of the motion, natural frequency (Hz), damping ratio."""
    noise_um: float
    coloured: float
    corner_Hz: float

    @property
    def finer(self) -> int:
        return FINER[self.rate_Hz]

    @property
    def dt_s(self) -> float:
        return 1 / (self.rate_Hz * self.finer)

    @property
    def swing_V(self) -> float:
        return self.high_V - self.low_V

    @property
    def middle_V(self) -> float:
        return 0.5 * (self.low_V + self.high_V)

    @property
    def step_V(self) -> float:
        """Of the converter."""
        return (self.output_V[1] - self.output_V[0]) / 2**self.bits

    def volts(self, s: Samples) -> Samples:
        """Of a drive in -1..1."""
        return self.middle_V + 0.5 * self.swing_V * s

    def on_codes(self, volts: Samples) -> Samples:
        """What the converter is told, within the voltages of the lab."""
        low, step = self.output_V[0], self.step_V
        return low + step * np.rint((np.clip(volts, self.low_V, self.high_V) - low) / step)


def draw(rng: np.random.Generator, rate_Hz: float, bits: int, travel_um: tuple[float, float] = TRAVEL_UM) -> Traits:
    """A stage for records at ``rate_Hz``, with a travel between the two given."""
    output_V = CONVERTERS_V[rng.integers(len(CONVERTERS_V))]
    width = output_V[1] - output_V[0]
    low_V = 0.0 if output_V[0] == 0 else output_V[0] + width * rng.uniform(0.01, 0.05)
    high_V = output_V[1] - width * rng.uniform(0.01, 0.05)
    travel = float(np.exp(rng.uniform(*np.log(travel_um))))
    first_Hz = float(np.exp(rng.uniform(*np.log(MODES_HZ[rate_Hz]))))
    modes = [(1.0, first_Hz, float(np.exp(rng.uniform(*np.log((0.008, 0.06))))))]
    if rng.random() < 0.3:
        share = rng.uniform(0.03, 0.15)
        modes = [(1 - share, *modes[0][1:]), (share, first_Hz * rng.uniform(1.4, 1.8), rng.uniform(0.01, 0.04))]
    traits = Traits(
        rate_Hz=rate_Hz,
        output_V=output_V,
        bits=bits,
        low_V=low_V,
        high_V=high_V,
        park_V=0.0 if rng.random() < 0.6 else 0.5 * (low_V + high_V),
        travel_um=travel,
        sign=-1 if rng.random() < 0.3 else 1,
        zero_um=travel * rng.uniform(-0.3, 0.3),
        held=bool(rng.random() < 0.4),
        dead_time_s=rng.uniform(0.5, 2.5) / max(rate_Hz, 5000.0),
        amplifier_tau_s=rng.uniform(0.1, 0.4) / max(rate_Hz, 5000.0),
        loop=rng.uniform(0.05, 0.16),
        bend=rng.uniform(-0.01, 0.01) if rng.random() < 0.5 else 0.0,
        creep=rng.uniform(0.002, 0.012) if rng.random() < 0.5 else 0.0,
        modes=tuple(modes),
        noise_um=float(np.clip(travel * 10 ** rng.uniform(-4.7, -3.8), *NOISE_UM)),
        coloured=rng.uniform(0.0, 0.7),
        corner_Hz=rng.uniform(2.0, 40.0),
    )
    return traits
