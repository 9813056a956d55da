"""A stage file with any effects of the catalogue as parameters of the linked kernel.

Names, units and defaults of the parameters are the catalogue's; the equations are written out here and in
``kernel/link.c`` a second time, so that what a virtual stage does can be held against what a model says.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from phaselead.errors import BadInput
from phaselead.model import AxisModel, Stage, ends_um
from phaselead.sim.structures import (
    BACKLASH,
    CLIP,
    DEADZONES,
    HUM_LINES,
    LINKS,
    OPERATOR,
    PLAYS,
    POLES,
    POLES_SUM,
    SENSOR_LINKS,
    SLEW,
    SOFTENING,
    Link,
    LinkedAxis,
    LinkedParameters,
)
from phaselead.sim.terms import Terms

LONGEST_DELAY_S = 10.0
AXES = "xyz"
HYSTERESIS_PLAYS, CREEP_TERMS = 10, 8


@dataclass
class Building:
    """An axis being put together: links are sorted into their physical order at the end."""

    axis: LinkedAxis
    model: AxisModel
    where: str
    span_V: tuple[float, float]
    ends_um: tuple[float, float]
    links: list[tuple[int, Link]] = field(default_factory=list)
    sensor_links: list[Link] = field(default_factory=list)
    plays: list[tuple[float, float, float]] = field(default_factory=list)
    """Threshold V, weight um/V, start V."""
    spread: float = 0.0
    """Thresholds of the part of the loop that widens with the rate, of the loop's own; 0 where none does."""
    load: float = 0.0
    """Mass added to what moves."""

    @property
    def range_um(self) -> float:
        return abs(self.ends_um[1] - self.ends_um[0]) or 1.0

    @property
    def range_V(self) -> float:
        return self.span_V[1] - self.span_V[0]


SLEWING, CHARGING, RAILS, LEAKING, MEMORY, SOFT, CREEPING, SLACK, MECHANICS = range(9)
"""Places of links along the way from the voltage to the displacement."""


def _link(kind: int, *numbers: float) -> Link:
    link = Link(kind=kind)
    for i, value in enumerate(numbers):
        link.number[i] = value
    return link


def _poles(direct: float, poles: Sequence[complex], weights: Sequence[complex]) -> Link:
    link = _link(POLES_SUM, direct)
    link.poles = len(poles)
    for i, (pole, weight) in enumerate(zip(poles, weights, strict=True)):
        link.pole_re[i], link.pole_im[i] = pole.real, pole.imag
        link.weight_re[i], link.weight_im[i] = weight.real, weight.imag
    return link


def _tau_s(terms: Terms) -> float:
    return terms.one("tau_s", low=0.0)


def _amplifier_lowpass(to: Building, terms: Terms) -> None:
    if tau_s := _tau_s(terms):
        to.links.append((CHARGING, _poles(0.0, [-1 / tau_s], [1.0])))


def _sensor_lowpass(to: Building, terms: Terms) -> None:
    if tau_s := _tau_s(terms):
        to.sensor_links.append(_poles(0.0, [-1 / tau_s], [1.0]))


def _slew_limit(to: Building, terms: Terms) -> None:
    if traverse_s := terms.one("traverse_s", low=0.0):
        to.links.append((SLEWING, _link(SLEW, to.range_V / traverse_s)))


def _saturation(to: Building, terms: Terms) -> None:
    top, bottom = terms.one("top", low=0.0, below=0.5), terms.one("bottom", low=0.0, below=0.5)
    low = to.span_V[0] + bottom * to.range_V if bottom else -1e9
    high = to.span_V[1] - top * to.range_V if top else 1e9
    if not low < high:
        raise BadInput(f"{to.where}: effect 'saturation': the rails leave no room between them; lower top or bottom")
    to.links.append((RAILS, _link(CLIP, low, high)))


def _charge_leakage(to: Building, terms: Terms) -> None:
    if rate_per_s := terms.one("rate_per_s", low=0.0):
        to.links.append((LEAKING, _poles(1.0, [-rate_per_s], [-1.0])))


def _delay(to: Building, terms: Terms) -> None:
    to.axis.delay_s += terms.one("delay_s", low=0.0)


def _hysteresis(to: Building, terms: Terms) -> None:
    """Plays whose lag (play - v) is added to the straight line: each takes its weight off the gain, and what it says
    at rest off the offset."""
    part = [(i + 1) / HYSTERESIS_PLAYS for i in range(HYSTERESIS_PLAYS)]
    reach_V = terms.one("reach", above=0.0) * to.range_V / 2
    density = [math.exp(terms.one("slope") * p) for p in part]
    opening = 2 * sum(reach_V * p * d for p, d in zip(part, density, strict=True))
    for p, d in zip(part, density, strict=True):
        weight, start_V = terms.one("width") * to.range_um * d / opening, terms.one("rest_fraction") * reach_V * p
        to.plays.append((reach_V * p, weight, start_V))
        to.axis.operator.gain_um_per_V -= weight
        to.axis.offset_um -= weight * start_V


def _asymmetric_hysteresis(to: Building, terms: Terms) -> None:
    operator = to.axis.operator
    operator.bend_um, operator.skew_um = terms.one("bend") * to.range_um, terms.one("skew") * to.range_um
    operator.skew_reach = terms.one("reach", above=0.0)


def _rate_dependence(to: Building, terms: Terms) -> None:
    to.axis.operator.widening = terms.one("widening", low=0.0)
    to.axis.operator.held = terms.one("held", low=0.0)
    to.axis.operator.onset_V_per_s = terms.one("onset_per_s", above=0.0) * to.range_V
    if to.axis.operator.widening:
        to.spread = terms.one("spread", above=0.0)


def _softening(to: Building, terms: Terms) -> None:
    numbers = (terms.one("kappa"), to.range_um, terms.one("tau_s", above=0.0), terms.one("about_mean"))
    to.links.append((SOFT, _link(SOFTENING, *numbers)))


def creep_terms(terms: Terms) -> tuple[list[float], list[float]]:
    """k and tau_s: as given, or equal shares at equal ratios between the first time constant and the last."""
    if "k" in terms or "tau_s" in terms:
        k, tau_s = terms.alike("k", "tau_s", most=CREEP_TERMS)
        terms.positive("tau_s", tau_s)
        return k, tau_s
    first, last = sorted((terms.one("tau_first_s", above=0.0), terms.one("tau_last_s", above=0.0)))
    k = [terms.one("gamma") * math.log10(last / first) / CREEP_TERMS] * CREEP_TERMS
    return k, [first * (last / first) ** ((i + 0.5) / CREEP_TERMS) for i in range(CREEP_TERMS)]


def mode_terms(terms: Terms) -> tuple[list[float], list[float], list[float]]:
    """c, f_Hz and zeta, one of each per mode."""
    f_Hz, zeta, c = terms.alike("f_Hz", "zeta", "c", most=POLES)
    terms.positive("f_Hz", f_Hz)
    terms.positive("zeta", zeta, below=1.0)
    return c, f_Hz, zeta


SHARED = "modes that the axes share, which the simulator does not play; remove it, or give modes of the axis alone"


def _creep(to: Building, terms: Terms) -> None:
    k, tau_s = creep_terms(terms)
    to.links.append((CREEPING, _poles(1.0, [-1 / tau for tau in tau_s], k)))


def _backlash(to: Building, terms: Terms) -> None:
    to.links.append((SLACK, _link(BACKLASH, terms.one("width", low=0.0) * to.range_um / 2)))


def _resonance(to: Building, terms: Terms) -> None:
    """Each mode as twice the real part of one complex lag: w^2 / (s^2 + 2 zeta w s + w^2)."""
    if "velocity" in terms:
        raise BadInput(f"{to.where}: effect 'resonance' has {SHARED}")
    c, f_Hz, zeta = mode_terms(terms)
    poles, weights = [], []
    for share, f, damping in zip(c, f_Hz, zeta, strict=True):
        slower = (1 + to.load) ** -0.5
        w, damping = 2 * math.pi * f * slower, damping * slower
        pole = w * complex(-damping, math.sqrt(1 - damping**2))
        poles.append(pole)
        weights.append(-2 * share * (w**2 / (pole - pole.conjugate())) / pole)
    to.links.append((MECHANICS, _poles(1 - sum(c), poles, weights)))


def _load_change(to: Building, terms: Terms) -> None:
    to.load = terms.one("mass", above=-1.0)
    if not any(effect.name == "resonance" for effect in to.model.effects):
        raise BadInput(f"{to.where}: effect 'load_change' moves a resonance and there is none; add one")


def _cross_coupling(to: Building, terms: Terms) -> None:
    if "f_Hz" in terms:
        raise BadInput(f"{to.where}: effect 'cross_coupling' has {SHARED}")
    for i, name in enumerate(AXES):
        to.axis.from_um_per_um[i] += terms.one(f"from_{name}")
    to.axis.from_lag_s = terms.one("lag_s", low=0.0)


def _gain_change(to: Building, terms: Terms) -> None:
    to.axis.surroundings.gain = terms.one("gain", above=-1.0)


def _offset(to: Building, terms: Terms) -> None:
    to.axis.offset_um += terms.one("offset_um")


def _sensor_nonlinearity(to: Building, terms: Terms) -> None:
    for name in ("quadratic", "cubic", "quartic", "linear"):
        setattr(to.axis.surroundings, name, terms.one(name))


def _quantisation(to: Building, terms: Terms) -> None:
    to.axis.surroundings.lsb_um = terms.one("lsb_um", low=0.0)


def _thermal_drift(to: Building, terms: Terms) -> None:
    to.axis.surroundings.ramp_um_per_s = terms.one("ramp_um_per_s")
    to.axis.surroundings.rise_um = terms.one("rise_um")
    to.axis.surroundings.rise_tau_s = terms.one("tau_s", above=0.0)


def _mains_hum(to: Building, terms: Terms) -> None:
    to.axis.surroundings.hum_Hz = terms.one("f_Hz", above=0.0)
    for line in range(HUM_LINES):
        to.axis.surroundings.hum_sin_um[line] = terms.one(f"sin{line + 1}_um")
        to.axis.surroundings.hum_cos_um[line] = terms.one(f"cos{line + 1}_um")


def _vibration(to: Building, terms: Terms) -> None:
    to.axis.surroundings.vibration_um_rms = terms.one("rms_um", low=0.0)
    to.axis.surroundings.vibration_Hz = terms.one("f_Hz", above=0.0)
    to.axis.surroundings.vibration_width_Hz = terms.one("bandwidth_Hz", above=0.0)


def _sampling_jitter(to: Building, terms: Terms) -> None:
    to.axis.surroundings.jitter_s = terms.one("rms_s", low=0.0)


def _dac_nonlinearity(to: Building, terms: Terms) -> None:
    axis = to.axis
    axis.dac_bow_V = terms.one("bow_LSB") * axis.dac_V_per_code
    axis.dac_s_V = terms.one("s_LSB") * axis.dac_V_per_code
    axis.dac_segment_V = terms.one("segment_LSB") * axis.dac_V_per_code
    axis.dac_segments = terms.one("segments")


EFFECTS: dict[str, Callable[[Building, Terms], None]] = {
    "load_change": _load_change,  # first: it changes the modes
    "delay": _delay,
    "dac_nonlinearity": _dac_nonlinearity,
    "slew_limit": _slew_limit,
    "amplifier_lowpass": _amplifier_lowpass,
    "saturation": _saturation,
    "charge_leakage": _charge_leakage,
    "hysteresis": _hysteresis,
    "asymmetric_hysteresis": _asymmetric_hysteresis,
    "rate_dependence": _rate_dependence,
    "softening": _softening,
    "creep": _creep,
    "backlash": _backlash,
    "resonance": _resonance,
    "cross_coupling": _cross_coupling,
    "gain_change": _gain_change,
    "offset": _offset,
    "sensor_lowpass": _sensor_lowpass,
    "sensor_nonlinearity": _sensor_nonlinearity,
    "sampling_jitter": _sampling_jitter,
    "quantisation": _quantisation,
    "thermal_drift": _thermal_drift,
    "mains_hum": _mains_hum,
    "vibration": _vibration,
}
"""Effects that a virtual stage can have, by their name in a stage file, in the order they are put in."""

REPEATABLE = {
    "delay", "offset", "hysteresis", "creep", "resonance", "amplifier_lowpass", "slew_limit", "saturation",
    "charge_leakage", "softening", "backlash", "sensor_lowpass",
}  # fmt: skip
"""What may stand in the file more than once: one acts after the other."""


def linked_parameters(stage: Stage, tick_s: float, latch_s: float, seed: int) -> LinkedParameters:
    """Kernel parameters of a stage at rest. Raises BadInput for what cannot be simulated."""
    parameters = LinkedParameters(tick_s=tick_s, seed=seed)
    coupling = stage.cross_coupling
    for i, name in enumerate(AXES):
        for j in range(3):
            parameters.coupling[i][j] = float(i == j) if coupling is None else coupling[i][j]
        where = f"stage {stage.name!r}, axis {name}"
        _axis(parameters.axes[i], stage.axes.get(name), where, tick_s, latch_s)
    return parameters


def _axis(axis: LinkedAxis, model: AxisModel | None, where: str, tick_s: float, latch_s: float) -> None:
    actuator, sensor = (model or AxisModel()).actuator, (model or AxisModel()).sensor
    axis.dac_V_per_code = (actuator.u_max_V - actuator.u_min_V) / 2**actuator.bits
    axis.dac_zero_code = -actuator.u_min_V / axis.dac_V_per_code
    axis.dac_low_V, axis.dac_high_V, axis.delay_s = actuator.u_min_V, actuator.u_max_V, latch_s
    axis.surroundings.noise_um_rms, axis.operator.tick_s = sensor.noise_um_rms, tick_s
    axis.operator.low_V, axis.operator.high_V = -1.0, 1.0
    if model is None or model.time is None:
        axis.links, axis.link[0] = 1, _link(OPERATOR)
        return
    view = model.time
    to = Building(axis, model, where, view.u_range_V, ends_um(model))
    axis.operator.low_V, axis.operator.high_V = view.u_range_V
    axis.surroundings.low_um, axis.surroundings.high_um = sorted(to.ends_um)
    axis.operator.gain_um_per_V, axis.offset_um = view.gain_um_per_V, view.offset_um
    axis.delay_s += view.delay_s
    pairs = zip(view.play_r_V, view.play_w_um_per_V, strict=True)
    to.plays = [(r, w, view.rest_fraction * r) for r, w in pairs]
    to.links.append((MEMORY, _link(OPERATOR)))
    _put_in_effects(to)
    _finish(to)


def _put_in_effects(to: Building) -> None:
    given = list(to.model.effects)
    for name, put_in in EFFECTS.items():
        mine = [effect for effect in given if effect.name == name]
        if len(mine) > 1 and name not in REPEATABLE:
            raise BadInput(f"{to.where}: effect {name!r} stands there {len(mine)} times; the simulator takes one")
        for effect in mine:
            put_in(to, Terms(name, effect.params, to.where))
    for effect in given:
        if effect.name not in EFFECTS:
            raise BadInput(
                f"{to.where}: the simulator does not know effect {effect.name!r}; it knows {', '.join(EFFECTS)}"
            )


def _widening(to: Building) -> list[tuple[float, float, float, float]]:
    """Plays as they widen with the rate less the same at rest: threshold V, weight um/V, start V, whether it widens."""
    if not to.spread:
        return []
    spread = [(to.spread * r_V, w / to.spread, to.spread * start_V) for r_V, w, start_V in to.plays]
    return [(r_V, sign * w, start_V, widens) for sign, widens in ((1, 1.0), (-1, 0.0)) for r_V, w, start_V in spread]


def _finish(to: Building) -> None:
    axis, view = to.axis, to.model.time
    assert view is not None
    plays = [(*play, 0.0) for play in to.plays] + _widening(to)
    if len(plays) > PLAYS or len(view.deadzone_d_V) > DEADZONES:
        raise BadInput(f"{to.where}: more plays or dead zones than the simulator takes ({PLAYS}, {DEADZONES})")
    if len(to.links) > LINKS or len(to.sensor_links) > SENSOR_LINKS:
        raise BadInput(f"{to.where}: more effects than the simulator takes ({LINKS}, {SENSOR_LINKS} of the sensor)")
    if not axis.delay_s <= LONGEST_DELAY_S:
        raise BadInput(f"{to.where}: a delay of {axis.delay_s:g} s; the simulator takes up to {LONGEST_DELAY_S:g} s")
    operator = axis.operator
    operator.plays, operator.deadzones = len(plays), len(view.deadzone_d_V)
    for i, (r_V, w, start_V, widens) in enumerate(plays):
        operator.play_r_V[i], operator.play_w_um_per_V[i], operator.play_start_V[i] = r_V, w, start_V
        operator.play_widens[i] = widens
    for i, (d_V, s) in enumerate(zip(view.deadzone_d_V, view.deadzone_s_um_per_V, strict=True)):
        operator.deadzone_d_V[i], operator.deadzone_s_um_per_V[i] = d_V, s
    axis.links, axis.sensor_links = len(to.links), len(to.sensor_links)
    for i, (_, link) in enumerate(sorted(to.links, key=lambda placed: placed[0])):
        axis.link[i] = link
    for i, link in enumerate(to.sensor_links):
        axis.sensor_link[i] = link
