"""A stage drawn at random, as the lab has it before anything is hidden in it."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from . import memory
from .parts import Mode, Samples

SPANS_V = ((-30.0, 150.0), (0.0, 10.0), (0.0, 100.0), (-500.0, 500.0))
"""Voltages of the converter's lowest code and one past its highest."""
FINE = {2000.0: 10, 5000.0: 6, 10000.0: 4}
"""Points per row on which a stage of that sampling rate is solved."""
IN_UM = {"offset", "quantisation", "thermal_drift", "mains_hum", "vibration"}
IN_V = {"crossover_distortion", "dead_band"}
SLOW = {"creep", "charge_leakage", "thermal_drift"}
FAST = {"delay", "amplifier_lowpass", "sensor_lowpass", "slew_limit", "sampling_jitter", "crossover_distortion"}
SIGN_BY_SENSE = {"asymmetric_hysteresis", "sensor_nonlinearity", "stiffness_nonlinearity"}
"""Whose sign would be a matter of taste where the sensor counts backwards."""


@dataclass(frozen=True)
class Traits:
    """Volts, micrometres, hertz and seconds. ``low_V`` to ``high_V`` is the working range, ``travel_um`` the travel of
    its slow loop, ``park_V`` where the stage waits; the converter holds between rows, or draws straight lines."""

    output_V: tuple[float, float]
    low_V: float
    high_V: float
    park_V: float
    bits: int
    travel_um: float
    rate_Hz: float
    modes: tuple[Mode, ...]
    amplifier_s: float
    delay_s: float
    held: bool
    sensor_Hz: float | None
    sign: int
    zero_um: float
    noise_um: float
    pink: float
    creep: tuple[float, float, float] | None
    recipe: memory.Recipe
    width: float

    @property
    def mid_V(self) -> float:
        return (self.low_V + self.high_V) / 2

    @property
    def half_V(self) -> float:
        return (self.high_V - self.low_V) / 2

    @property
    def lsb_V(self) -> float:
        return float((self.output_V[1] - self.output_V[0]) / 2**self.bits)

    @property
    def park(self) -> float:
        """Where it waits, -1..1 over the working range."""
        return (self.park_V - self.mid_V) / self.half_V

    def volts(self, s: Samples) -> Samples:
        """The converter's grid, for s = -1..1 over the working range."""
        codes = np.round((self.mid_V + self.half_V * s - self.output_V[0]) / self.lsb_V)
        return np.asarray(self.output_V[0] + self.lsb_V * np.clip(codes, 0, 2**self.bits - 1))


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def draw(rng: np.random.Generator, names: Collection[str] = ()) -> Traits:
    """A stage on which a lab would look for these effects: those in um at 10-200 um, those in V at 10 V, slow ones at
    2 or 5 kHz, fast ones at 5 or 10 kHz."""
    hidden = set(names)
    output_V = SPANS_V[1 if hidden & IN_V else int(rng.integers(4))]
    margin = rng.uniform(0.01, 0.08) * (output_V[1] - output_V[0])
    low_V, high_V = output_V[0] + margin, output_V[1] - margin
    travel_um = log_uniform(rng, 10, 200) if hidden & IN_UM else log_uniform(rng, 1, 500)
    rate_Hz = float(rng.choice(list(FINE), p=_odds(hidden)))
    f_Hz, zeta = log_uniform(rng, 150, min(2000, 0.28 * rate_Hz)), log_uniform(rng, 0.005, 0.08)
    modes: tuple[Mode, ...] = ((1.0, f_Hz, zeta),)
    higher_Hz, share = f_Hz * rng.uniform(1.4, 2.8), rng.uniform(0.01, 0.08)
    if rng.random() < 0.4 and higher_Hz < 0.42 * rate_Hz:
        modes = ((1 - share, f_Hz, zeta), (share, higher_Hz, log_uniform(rng, 0.008, 0.05)))
    recipe, width = memory.draw(rng)
    creep = (log_uniform(rng, 0.002, 0.01), log_uniform(rng, 0.01, 0.1), log_uniform(rng, 30, 1000))
    bits = [12, 14] if "dac_nonlinearity" in hidden else [12, 14, 16, 18]
    return Traits(
        output_V=output_V,
        low_V=low_V,
        high_V=high_V,
        park_V=float(np.clip(0.0, low_V, high_V)) if rng.random() < 0.65 else (low_V + high_V) / 2,
        bits=int(rng.choice(bits, p=[0.6, 0.4] if len(bits) == 2 else [0.1, 0.2, 0.5, 0.2])),
        travel_um=travel_um,
        rate_Hz=rate_Hz,
        modes=modes,
        amplifier_s=1 / (2 * math.pi * log_uniform(rng, 1200, 8000)),
        delay_s=rng.uniform(0.2, 1.5) / rate_Hz,
        held=bool(rng.random() < 0.6),
        sensor_Hz=log_uniform(rng, max(800, 1.2 * f_Hz), 8000) if rng.random() < 0.5 else None,
        sign=-1 if rng.random() < 0.3 and not hidden & SIGN_BY_SENSE else 1,
        zero_um=travel_um * rng.uniform(-0.5, 0.5) if rng.random() < 0.4 else 0.0,
        noise_um=float(np.clip(travel_um * log_uniform(rng, 0.5e-5, 10e-5), 2e-4, 0.03)),
        pink=rng.uniform(0.2, 0.7),
        creep=creep if rng.random() < 0.6 else None,
        recipe=recipe,
        width=width,
    )


def _odds(hidden: set[str]) -> list[float]:
    """Of the sampling rates of ``FINE``."""
    if hidden & FAST:
        return [0.0, 0.5, 0.5]
    return [0.75, 0.25, 0.0] if hidden & SLOW else [0.25, 0.5, 0.25]
