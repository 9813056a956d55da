"""The effects that can be hidden: size and unit as the catalogue measures them (docs/effects.md), and how each is made.

``make(value, bench, rng)`` gives what is mounted on the bench; value is the signed size, in the catalogue's unit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .bench import Attachable, Bench
from .ceramic import Electrostriction, Friction, Kohlrausch, Softening
from .electronics import Converter, CurrentLimit, DeadTime, Leak, Rails
from .memory import draw_loop
from .parts import Lag, Modes
from .readout import Grid, Hum, Jitter, Load, RationalCurve, Rumble, Scale, Slack, Warming, Zero

Rng = np.random.Generator
Make = Callable[[float, Bench, Rng], Attachable]


@dataclass(frozen=True)
class Effect:
    """One entry: its typical size, whether it may have either sign, and the largest multiple of it that can be."""

    typical: float
    unit: str
    make: Make
    signed: bool = False
    largest: float = 3.0


def _hysteresis(value: float, bench: Bench, rng: Rng) -> Attachable:
    return draw_loop(rng, value, _s(bench))


def _asymmetry(value: float, bench: Bench, rng: Rng) -> Attachable:
    return Electrostriction(value * bench.traits.sign, rng.uniform(0.1, 0.2), bench.drive(0.0))


def _rate(value: float, bench: Bench, rng: Rng) -> Attachable:
    onset, bristle = 10 ** rng.uniform(-0.3, 0.3), rng.uniform(0.08, 0.2)
    return Friction(value, onset, bristle, bench.traits.loop, bench.traits.dt_s, _s(bench))


def _softening(value: float, bench: Bench, rng: Rng) -> Attachable:
    tau_s = 10 ** rng.uniform(-0.7, 0.3)
    return Softening(value, tau_s, bool(rng.random() < 0.5), bench.traits.dt_s, bench.zero)


def _creep(value: float, bench: Bench, rng: Rng) -> Attachable:
    return Kohlrausch(value, 10 ** rng.uniform(0.5, 2.0), rng.uniform(0.25, 0.5), bench.traits.dt_s, bench.zero)


def _resonance(value: float, bench: Bench, rng: Rng) -> Attachable:
    """In series with the stage's own: something on top of it that swings."""
    f_Hz = bench.traits.modes[0][1] * rng.uniform(1.4, 1.9) ** rng.choice([-1, 1])
    f_Hz = min(f_Hz, 0.2 * bench.traits.rate_Hz)
    return Modes(((value, f_Hz, 10 ** rng.uniform(-2.2, -1.3)),), bench.traits.dt_s, bench.zero)


def _amplifier_lag(value: float, bench: Bench, rng: Rng) -> Attachable:
    return Lag("amplifier", value, bench.traits.dt_s, bench.voltage_V)


def _sensor_lag(value: float, bench: Bench, rng: Rng) -> Attachable:
    return Lag("sensor", value, bench.traits.dt_s, bench.traits.zero_um)


def _current(value: float, bench: Bench, rng: Rng) -> Attachable:
    return CurrentLimit(bench.traits.swing_V / value)


def _rails(value: float, bench: Bench, rng: Rng) -> Attachable:
    t = bench.traits
    below = value * rng.uniform(0.5, 1.0)
    return Rails(t.low_V + below * t.swing_V, t.high_V - value * t.swing_V, 0.05 * value * t.swing_V)


def _leak(value: float, bench: Bench, rng: Rng) -> Attachable:
    return Leak(value, bench.traits.dt_s, bench.voltage_V)


def _sensor_curve(value: float, bench: Bench, rng: Rng) -> Attachable:
    middle_um = float(bench.um(0.0))
    return RationalCurve(value, abs(value) * rng.uniform(-0.4, 0.4), middle_um, bench.traits.travel_um)


def _warming(value: float, bench: Bench, rng: Rng) -> Attachable:
    return Warming(value, 10 ** rng.uniform(2.3, 3.2), bench.time_s, bench.left_s)


def _rumble(value: float, bench: Bench, rng: Rng) -> Attachable:
    f_Hz = 10 ** rng.uniform(1.2, 2.1)
    return Rumble(value, f_Hz, f_Hz * rng.uniform(0.04, 0.2), rng)


def _converter(value: float, bench: Bench, rng: Rng) -> Attachable:
    return Converter(value, bench.traits.bits, bench.traits.output_V, rng)


def _s(bench: Bench) -> float:
    return bench.drive(bench.voltage_V)


EFFECTS: dict[str, Effect] = {
    "hysteresis": Effect(0.12, "of range", _hysteresis),
    "asymmetric_hysteresis": Effect(0.02, "of range", _asymmetry, signed=True),
    "rate_dependence": Effect(0.2, "per decade", _rate),
    "softening": Effect(0.15, "1", _softening),
    "creep": Effect(0.015, "per decade", _creep),
    "resonance": Effect(1.0, "1", _resonance, largest=1.0),
    "load_change": Effect(0.1, "of moving mass", lambda value, bench, rng: Load(value), signed=True),
    "amplifier_lowpass": Effect(1.6e-4, "s", _amplifier_lag),
    "slew_limit": Effect(0.01, "s", _current),
    "saturation": Effect(0.05, "of voltage range", _rails),
    "delay": Effect(2e-4, "s", lambda value, bench, rng: DeadTime(value)),
    "charge_leakage": Effect(0.01, "1/s", _leak),
    "sensor_lowpass": Effect(8e-5, "s", _sensor_lag),
    "sensor_nonlinearity": Effect(0.002, "of range", _sensor_curve, signed=True),
    "gain_change": Effect(0.03, "1", lambda value, bench, rng: Scale(value, bench.traits.zero_um), signed=True),
    "offset": Effect(1.0, "um", lambda value, bench, rng: Zero(value), signed=True),
    "quantisation": Effect(0.008, "um", lambda value, bench, rng: Grid(value)),
    "thermal_drift": Effect(0.002, "um/s", _warming, signed=True),
    "mains_hum": Effect(0.01, "um", lambda value, bench, rng: Hum(value, rng)),
    "vibration": Effect(0.01, "um", _rumble),
    "backlash": Effect(0.002, "of range", lambda value, bench, rng: Slack(value, bench.level)),
    "sampling_jitter": Effect(2e-6, "s", lambda value, bench, rng: Jitter(value, rng)),
    "dac_nonlinearity": Effect(2.0, "LSB", _converter, signed=True),
}
"""By the catalogue's name; cross-coupling needs more than one axis and is not among them."""
IN_UM = {name for name, effect in EFFECTS.items() if effect.unit.startswith("um")}
"""Sizes that do not follow the travel."""
