"""What may be hidden: typical size and unit of the catalogue, how its shape is drawn, where it is put on a bench."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from .amplifier import Converter, GrowingLoad, Leak, Loop, Rails, Slack
from .bench import Bench
from .ceramic import Beside, Creep, Electrostriction, Level, SpeedFriction, forgetful, more_sliders
from .mechanics import BendingSpring, loaded
from .parts import Lag, Modes, Part, Samples
from .readout import Curve, Drift, Hum, Vibration
from .stage import Traits, log_uniform

Shape = Mapping[str, float]
Rng = np.random.Generator


def _no_shape(rng: Rng, value: float, traits: Traits) -> Shape:
    return {}


@dataclass(frozen=True)
class Effect:
    """``mount`` puts one of a value (in ``unit``, of the catalogue's first size parameter) and a shape on a bench."""

    typical: float
    unit: str
    mount: Callable[[Bench, float, Shape], None]
    shape: Callable[[Rng, float, Traits], Shape] = _no_shape
    signed: bool = False
    """Whether the value may be negative."""
    largest: float = 2.0
    """Largest size, as a multiple of the typical one."""


def _beside(bench: Bench, test: Part, force: Part, value: float, gained: float) -> None:
    t = bench.traits
    part = Beside(test, force, value * t.travel_um, gained, bench.memory.least_um, t.travel_um, t.park)
    bench.beside.append(_Scaled(part, t))


def _hysteresis(bench: Bench, value: float, h: Shape) -> None:
    _beside(bench, more_sliders(h["mean"], -1.0), more_sliders(h["mean"], bench.here), value, h["gained"])


def _fading(bench: Bench, value: float, h: Shape) -> None:
    made = [forgetful(h["reach"], h["exponent"], s) for s in (-1.0, bench.here)]
    _beside(bench, made[0], made[1], value, h["gained"])


def _asymmetric(bench: Bench, value: float, h: Shape) -> None:
    t = bench.traits
    part = Electrostriction(value * t.travel_um, h["lag"], h["level"], bench.here)
    bench.beside.append(_Scaled(part, t))


class _Scaled(Part):
    """A part of s = -1..1, given volts."""

    def __init__(self, part: Part, traits: Traits) -> None:
        self.part, self.traits = part, traits

    def run(self, x: Samples) -> Samples:
        return self.part.run((x - self.traits.mid_V) / self.traits.half_V)


def _friction(bench: Bench, value: float, h: Shape) -> None:
    args = (value, h["coulomb"], h["onset"], h["reach"], bench.traits.travel_um, bench.dt_s)
    bench.put("friction", lambda x: SpeedFriction(*args, x))


def _softening(bench: Bench, value: float, h: Shape) -> None:
    args = (value, h["tau_s"], h["about_mean"], bench.traits.travel_um, bench.fine, bench.dt_s, bench.rest_um)
    bench.put("level", lambda x: Level(*args))


def _creep(bench: Bench, value: float, h: Shape) -> None:
    args = (value, h["first_s"], h["last_s"], bench.fine, bench.dt_s, bench.rest_um)
    bench.put("creep", lambda x: Creep(*args, x))


def _resonance(bench: Bench, value: float, h: Shape) -> None:
    bench.put("mode", lambda x: Modes([(value, h["f_Hz"], h["zeta"])], bench.dt_s, x))


def _load(bench: Bench, value: float, h: Shape) -> None:
    modes = loaded(bench.traits.modes, value, h["others"])
    bench.put("modes", lambda x: Modes(modes, bench.dt_s, x))


def _amplifier(bench: Bench, value: float, h: Shape) -> None:
    args = (value, h["growth"], bench.traits.mid_V, bench.traits.half_V, bench.dt_s)
    bench.put("load", lambda u: GrowingLoad(*args, u))


def _slew(bench: Bench, value: float, h: Shape) -> None:
    rate = 2 * bench.traits.half_V / value
    up, down = rate * (1 + h["uneven"]), rate * (1 - h["uneven"])
    bench.put("amplifier", lambda u: Loop(bench.traits.amplifier_s, bench.dt_s, u, up, down))


def _crossover(bench: Bench, value: float, h: Shape) -> None:
    args = {"zone_V": value / (1 - h["leak"]), "leak": h["leak"]}  # the current that leaks across narrows the zone
    bench.put("amplifier", lambda u: Loop(bench.traits.amplifier_s, bench.dt_s, u, **args))


def _saturation(bench: Bench, value: float, h: Shape) -> None:
    t = bench.traits
    low = t.low_V + 2 * t.half_V * h["bottom"] if h["bottom"] else None
    bench.put("rails", lambda u: Rails(low, t.high_V - 2 * t.half_V * value, 2 * t.half_V * h["knee"]))


def _delay(bench: Bench, value: float, h: Shape) -> None:
    bench.delay_s += value


def _leak(bench: Bench, value: float, h: Shape) -> None:
    rest_V = float(bench.traits.volts(np.array([bench.traits.park]))[0])
    bench.put("leak", lambda u: Leak(value, rest_V, bench.dt_s))


def _dead_band(bench: Bench, value: float, h: Shape) -> None:
    bench.put("dead_band", lambda u: Slack(value, u))


def _backlash(bench: Bench, value: float, h: Shape) -> None:
    bench.put("slack", lambda x: Slack(value * bench.traits.travel_um, x))


def _bending(bench: Bench, value: float, h: Shape) -> None:
    t = bench.traits
    args = (value, h["cube"], t.travel_um, bench.rest_um, bench.dt_s)
    bench.put("modes", lambda x: BendingSpring(t.modes, *args, x))


def _sensor_lowpass(bench: Bench, value: float, h: Shape) -> None:
    bench.put("lag", lambda y: Lag((1 - h["second"]) * value, bench.dt_s, y))
    bench.put("short_lag", lambda y: Lag(h["second"] * value, bench.dt_s, y))


def _sensor_curve(bench: Bench, value: float, h: Shape) -> None:
    bench.put("curve", lambda y: Curve(value * bench.traits.travel_um, h["bent"], *bench.range_um()))


def _gain(bench: Bench, value: float, h: Shape) -> None:
    bench.gain *= 1 + value


def _offset(bench: Bench, value: float, h: Shape) -> None:
    bench.offset_um += value


def _quantisation(bench: Bench, value: float, h: Shape) -> None:
    bench.step_um = value


def _jitter(bench: Bench, value: float, h: Shape) -> None:
    bench.jitter_s = value


def _drift(bench: Bench, value: float, h: Shape) -> None:
    bench.room.append(Drift(value, h["wave"], *bench.ahead_s))


def _hum(bench: Bench, value: float, h: Shape) -> None:
    phases = (h["phase1"], h["phase2"], h["phase3"])
    bench.room.append(Hum(value, h["f_Hz"], (h["second"], h["third"]), phases, h["wander"]))


def _vibration(bench: Bench, value: float, h: Shape) -> None:
    bench.room.append(Vibration(value, h["f_Hz"], h["bandwidth_Hz"], h["swell_s"], h["phase"]))


def _converter(bench: Bench, value: float, h: Shape) -> None:
    weights = tuple(h[f"bit{i}"] for i in range(1, 5))
    bench.converter = Converter(bench.traits.bits, *bench.traits.output_V, value, h["bow"], h["skew"], weights)


def _mode_shape(rng: Rng, value: float, traits: Traits) -> Shape:
    """Not within a quarter of the mode that is there."""
    while True:
        f_Hz = log_uniform(rng, 100, min(0.25 * traits.rate_Hz, 1200))
        if not 0.8 < f_Hz / traits.modes[0][1] < 1.25:
            return {"f_Hz": f_Hz, "zeta": log_uniform(rng, 0.008, 0.05)}


def _friction_shape(rng: Rng, value: float, traits: Traits) -> Shape:
    """The spring takes at most a third of the slope off, so that a turning point turns nothing round."""
    coulomb = rng.uniform(0, 0.02)
    reach = (value + coulomb) * rng.uniform(1.5, 3)
    return {"coulomb": coulomb, "onset": log_uniform(rng, 0.3, 3), "reach": reach}


def _rails_shape(rng: Rng, value: float, traits: Traits) -> Shape:
    """Knees so narrow that they are past at the end of the range."""
    bottom = value * rng.uniform(0.3, 1) if rng.random() < 0.5 else 0.0
    return {"bottom": bottom, "knee": min(log_uniform(rng, 0.0005, 0.004), 0.2 * value)}


def _hum_shape(rng: Rng, value: float, traits: Traits) -> Shape:
    phases = {f"phase{k}": rng.uniform(0, 2 * np.pi) for k in (1, 2, 3)}
    f_Hz = float(rng.choice([50.0, 60.0])) + rng.uniform(-0.03, 0.03)
    shares = {"second": rng.uniform(0.05, 0.3), "third": rng.uniform(0.1, 0.4)}
    return {"f_Hz": f_Hz, "wander": rng.uniform(0, 0.2), **shares, **phases}


def _vibration_shape(rng: Rng, value: float, traits: Traits) -> Shape:
    f_Hz = log_uniform(rng, 15, 150)
    shape = {"f_Hz": f_Hz, "bandwidth_Hz": f_Hz * log_uniform(rng, 0.06, 0.25)}
    return {**shape, "swell_s": rng.uniform(1.5, 6), "phase": rng.uniform(0, 2 * np.pi)}


def _converter_shape(rng: Rng, value: float, traits: Traits) -> Shape:
    bits = {f"bit{i}": rng.uniform(-0.7, 0.7) for i in range(1, 5)}
    return {"bow": rng.uniform(-1, 1), "skew": rng.uniform(-0.4, 0.4), **bits}


EFFECTS = {
    "hysteresis": Effect(
        0.12, "of range", _hysteresis, lambda g, v, t: {"mean": g.uniform(0.15, 0.45) + v, "gained": g.uniform(0, 0.6)}
    ),
    "fading_hysteresis": Effect(
        0.12,
        "of range",
        _fading,
        lambda g, v, t: {
            "reach": max(log_uniform(g, 0.1, 0.3), 2 * v),  # shorter ones would double the travel
            "exponent": g.uniform(0.6, 0.95),
            "gained": g.uniform(0, 0.3),
        },
    ),
    "asymmetric_hysteresis": Effect(
        0.02,
        "of range",
        _asymmetric,
        lambda g, v, t: {"lag": g.uniform(0.2, 0.9), "level": g.uniform(0.05, 0.25)},
        signed=True,
    ),
    "rate_dependence": Effect(0.02, "of range", _friction, _friction_shape),
    "softening": Effect(
        0.15, "1", _softening, lambda g, v, t: {"tau_s": log_uniform(g, 0.15, 1.5), "about_mean": g.uniform(0, 1)}
    ),
    "creep": Effect(
        0.015,
        "per decade",
        _creep,
        lambda g, v, t: {"first_s": log_uniform(g, 0.03, 0.2), "last_s": log_uniform(g, 100, 1000)},
    ),
    "resonance": Effect(1.0, "1", _resonance, _mode_shape, largest=1.0),
    "load_change": Effect(0.1, "of moving mass", _load, lambda g, v, t: {"others": g.uniform(0, 1)}, signed=True),
    "amplifier_lowpass": Effect(0.00016, "s", _amplifier, lambda g, v, t: {"growth": g.uniform(0.02, 0.12)}),
    "slew_limit": Effect(0.01, "s", _slew, lambda g, v, t: {"uneven": g.uniform(-0.06, 0.06)}),
    "saturation": Effect(0.05, "of voltage range", _saturation, _rails_shape),
    "delay": Effect(0.0002, "s", _delay),
    "charge_leakage": Effect(0.01, "1/s", _leak),
    "sensor_lowpass": Effect(8e-05, "s", _sensor_lowpass, lambda g, v, t: {"second": g.uniform(0.02, 0.2)}),
    "sensor_nonlinearity": Effect(
        0.002, "of range", _sensor_curve, lambda g, v, t: {"bent": log_uniform(g, 0.2, 1.2)}, signed=True
    ),
    "gain_change": Effect(0.03, "1", _gain, signed=True),
    "offset": Effect(1.0, "um", _offset, signed=True),
    "quantisation": Effect(0.008, "um", _quantisation),
    "thermal_drift": Effect(0.002, "um/s", _drift, lambda g, v, t: {"wave": g.uniform(-0.4, 0.4)}, signed=True),
    "mains_hum": Effect(0.01, "um", _hum, _hum_shape),
    "vibration": Effect(0.01, "um", _vibration, _vibration_shape),
    "backlash": Effect(0.002, "of range", _backlash),
    "sampling_jitter": Effect(2e-06, "s", _jitter),
    "dac_nonlinearity": Effect(2.0, "LSB", _converter, _converter_shape, signed=True),
    "crossover_distortion": Effect(0.02, "V", _crossover, lambda g, v, t: {"leak": g.uniform(0, 0.08)}),
    "dead_band": Effect(0.005, "V", _dead_band),
    "stiffness_nonlinearity": Effect(
        0.01, "1", _bending, lambda g, v, t: {"cube": abs(v) * g.uniform(-1, 1)}, signed=True
    ),
}
"""Every effect of the catalogue but cross-coupling, which takes more than one axis."""

UNLIKE = (
    {"amplifier_lowpass", "sensor_lowpass", "delay", "slew_limit", "crossover_distortion"},
    {"resonance", "load_change", "stiffness_nonlinearity"},
    {"offset", "thermal_drift", "charge_leakage", "creep"},
    {"sensor_nonlinearity", "asymmetric_hysteresis", "dac_nonlinearity", "saturation", "stiffness_nonlinearity"},
    {"hysteresis", "fading_hysteresis", "backlash", "dead_band", "crossover_distortion", "rate_dependence"},
    {"gain_change", "softening"},
    {"vibration", "sampling_jitter", "quantisation"},
)
"""At most one of each group in a pair or triple: records like these hardly tell them apart."""
