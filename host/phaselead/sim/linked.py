"""A stage file with any effects of the catalogue as parameters of the linked kernel.

The linked kernel is a chain: the voltage passes from link to link (filters, clips, the hysteresis operator) up to the
sensor. It takes effects in any number and order; the exact kernel of ``plant.py`` takes a few, each at one place.

Each effect says in its file (``virtual``) which parts it is made of. The equations of the parts are written out here
and in ``kernel/link.c`` a second time, so that what a virtual stage does can be held against what a model says.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from phaselead.device import AXES
from phaselead.errors import BadInput
from phaselead.model import AxisModel, CheckedParameters, Place, Stage, VirtualAxis, catalogue
from phaselead.sim.structures import (
    BACKLASH,
    CLIP,
    CROSSOVER,
    DEADZONES,
    FADING,
    FRICTION,
    LINKS,
    OPERATOR,
    PLAYS,
    POLES_SUM,
    SENSOR_LINKS,
    SLEW,
    SOFTENING,
    STIFFNESS,
    Link,
    LinkedAxis,
    LinkedParameters,
)

LONGEST_DELAY_S = 10.0


def add_effects(axis: VirtualAxis) -> None:
    """Add the parts of every effect of its model to ``axis``, in the order in which the effects act.

    Raises BadInput for what cannot be simulated, and NotPlayed for what this axis cannot be.
    """
    for name, effect in catalogue().items():
        mine = [adopted for adopted in axis.model.effects if adopted.name == name]
        if mine and effect.virtual is None:
            known = ", ".join(name for name, e in catalogue().items() if e.virtual is not None)
            raise BadInput(f"{axis.where}: the simulator does not know effect {name!r}; it knows {known}")
        if len(mine) > 1 and not effect.repeatable:
            raise BadInput(f"{axis.where}: effect {name!r} stands there {len(mine)} times; the simulator takes one")
        axis.place = effect.place
        for adopted in mine:
            try:
                complete = effect.complete(adopted.params)
            except BadInput as error:
                raise BadInput(f"{axis.where}: {error}") from None
            assert effect.virtual is not None
            effect.virtual(axis, CheckedParameters(f"{axis.where}: effect {name!r}", complete, adopted.params))


class LinkedParts(VirtualAxis):
    """The parts of one axis of the linked kernel. Links are made at the end, when the load of the modes is known."""

    def __init__(self, axis: LinkedAxis, model: AxisModel, where: str) -> None:
        super().__init__(model, where)
        self._axis, self._operator, self._surroundings = axis, axis.operator, axis.surroundings
        self._links: list[tuple[Place, Callable[[], Link]]] = []
        self._plays: list[tuple[float, float, float]] = []  # threshold V, weight um/V, start V
        self._mass, self._damping, self._others = 0.0, 0.0, 1.0
        self._largest = 0.0
        self._taken: set[str] = set()

    def filter(self, direct: float, poles: Sequence[complex], weights: Sequence[complex]) -> None:
        self._link(lambda: _poles(direct, poles, weights))

    def lowpass(self, tau_s: float, corner_Hz: float | None = None) -> None:
        if tau_s:
            self.filter(0.0, [-1 / tau_s], [1.0])

    def lags(self, k: Sequence[float], tau_s: Sequence[float]) -> None:
        self.filter(1.0, [-1 / tau for tau in tau_s], k)

    def modes(self, c: Sequence[float], f_Hz: Sequence[float], zeta: Sequence[float]) -> None:
        self.has_modes = True
        self._largest = max([self._largest, *(abs(share) for share in c)])
        self._link(lambda: _modes(c, f_Hz, zeta, self._felt(c)))

    def load(self, mass: float, damping: float, others: float) -> None:
        self._only("load")
        self._mass, self._damping, self._others = mass, damping, others

    def _felt(self, c: Sequence[float]) -> list[tuple[float, float]]:
        """The mass and the damping of the load that each of some modes feels, once all modes are known."""
        felt = [1.0 if abs(share) >= self._largest else self._others for share in c]
        return [(part * self._mass, part * self._damping) for part in felt]

    def slew(self, per_s: float, loop_s: float) -> None:
        self._link(lambda: _link(SLEW, per_s, loop_s))

    def clip(self, low: float, high: float) -> None:
        self._link(lambda: _link(CLIP, low, high))

    def slack(self, half: float) -> None:
        self._link(lambda: _link(BACKLASH, half))

    def crossover(self, half: float, tau_s: float) -> None:
        self._link(lambda: _link(CROSSOVER, half, tau_s))

    def level_gain(self, kappa: float, tau_s: float, about_mean: float, exponent: float) -> None:
        self._link(lambda: _link(SOFTENING, kappa, self.range_um, tau_s, about_mean, exponent))

    def stiffness(self, square: float, cube: float) -> None:
        self._link(lambda: _link(STIFFNESS, self.range_um, square, cube))

    def slope(self, um_per_V: float) -> None:
        self._operator.gain_um_per_V += um_per_V

    def plays(self, r_V: Sequence[float], w_um_per_V: Sequence[float], start_V: Sequence[float]) -> None:
        """Each takes its weight off the gain, and what it says at rest off the offset."""
        for r, weight, start in zip(r_V, w_um_per_V, start_V, strict=True):
            self._plays.append((r, weight, start))
            self._operator.gain_um_per_V -= weight
            self._axis.offset_um -= weight * start

    def fading_plays(self, r_V: Sequence[float], w_um_per_V: Sequence[float]) -> None:
        operator, view = self._operator, self.model.time
        assert view is not None
        if operator.fading + len(r_V) > FADING:
            raise BadInput(f"{self.where}: more fading plays than the simulator takes ({FADING})")
        operator.fading_start = -view.rest_fraction
        for r, weight in zip(r_V, w_um_per_V, strict=True):
            operator.fading_r_V[operator.fading], operator.fading_w_um_per_V[operator.fading] = r, weight
            operator.fading += 1

    def asymmetry(self, bend_um: float, skew_um: float, reach: float) -> None:
        self._only("asymmetry of the loop")
        self._operator.bend_um, self._operator.skew_um, self._operator.skew_reach = bend_um, skew_um, reach

    def friction(self, openings: tuple[float, float, float], onset_per_s: float, reach: float) -> None:
        view = self.model.time
        assert view is not None

        def make() -> Link:
            beside = bool(view.play_r_V or self._plays)
            return _link(FRICTION, self.range_um, reach, onset_per_s, *(openings if beside else ()))

        self._link(make)

    def converter_errors(self, bow_LSB: float, bits_LSB: Sequence[float]) -> None:
        self._only("curve of the output converter")
        self._axis.dac_bow_LSB = bow_LSB
        for i, excess_LSB in enumerate(bits_LSB):
            self._axis.dac_bit_LSB[i] = excess_LSB

    def delay(self, delay_s: float) -> None:
        self._axis.delay_s += delay_s

    def other_axes(self, um_per_um: Sequence[float], lag_s: float) -> None:
        self._only("motion of other axes")
        for i, share in enumerate(um_per_um):
            self._axis.from_um_per_um[i] += share
        self._axis.from_lag_s = lag_s

    def sensor_gain(self, gain: float) -> None:
        self._only("gain of the sensor")
        self._surroundings.gain = gain

    def offset(self, offset_um: float) -> None:
        self._axis.offset_um += offset_um

    def sensor_curve(self, quadratic: float, cubic: float, quartic: float, linear: float) -> None:
        self._only("curve of the sensor")
        self._surroundings.quadratic, self._surroundings.cubic = quadratic, cubic
        self._surroundings.quartic, self._surroundings.linear = quartic, linear

    def jitter(self, rms_s: float) -> None:
        self._only("jitter")
        self._surroundings.jitter_s = rms_s

    def steps(self, step_um: float) -> None:
        self._only("rounding of the sensor")
        self._surroundings.lsb_um = step_um

    def drift(self, ramp_um_per_s: float, rise_um: float, tau_s: float) -> None:
        self._only("drift")
        self._surroundings.ramp_um_per_s = ramp_um_per_s
        self._surroundings.rise_um, self._surroundings.rise_tau_s = rise_um, tau_s

    def lines(self, f_Hz: float, sin_um: Sequence[float], cos_um: Sequence[float]) -> None:
        self._only("set of lines")
        self._surroundings.hum_Hz = f_Hz
        for i, (sine, cosine) in enumerate(zip(sin_um, cos_um, strict=True)):
            self._surroundings.hum_sin_um[i], self._surroundings.hum_cos_um[i] = sine, cosine

    def vibration(self, rms_um: float, f_Hz: float, width_Hz: float) -> None:
        self._only("vibration")
        self._surroundings.vibration_um_rms = rms_um
        self._surroundings.vibration_Hz, self._surroundings.vibration_width_Hz = f_Hz, width_Hz

    def _link(self, make: Callable[[], Link]) -> None:
        """One more link at the place of the effect that is being added."""
        if self.place in (Place.COUPLING, Place.ENVIRONMENT):
            raise BadInput(f"{self.where}: the simulator has no filters, clips and plays at {self.place.name.lower()}")
        self._links.append((self.place, make))

    def _only(self, what: str) -> None:
        """Refuse what the kernel has room for once."""
        if what in self._taken:
            raise BadInput(f"{self.where}: two effects ask for a {what}; the simulator takes one")
        self._taken.add(what)

    def finish(self) -> None:
        """Fill the kernel's parameters. Raises BadInput when they have no room for it all."""
        axis, operator, view = self._axis, self._operator, self.model.time
        assert view is not None
        rest = [(r, w, view.rest_fraction * r) for r, w in zip(view.play_r_V, view.play_w_um_per_V, strict=True)]
        plays = [*rest, *self._plays]
        before = [make for place, make in self._links if place <= Place.AMPLIFIER]
        behind = [make for place, make in self._links if Place.AMPLIFIER < place < Place.SENSOR]
        links = [*before, lambda: _link(OPERATOR), *behind]
        sensor = [make for place, make in self._links if place == Place.SENSOR]
        self._refuse_more_than_it_holds(len(plays), len(view.deadzone_d_V), len(links), len(sensor))
        operator.plays, operator.deadzones = len(plays), len(view.deadzone_d_V)
        operator.uneven = 0 if view.density.is_even else len(view.play_r_V)
        for i, (r_V, w, start_V) in enumerate(plays):
            operator.play_r_V[i], operator.play_w_um_per_V[i], operator.play_start_V[i] = r_V, w, start_V
        for i, (d_V, s) in enumerate(zip(view.deadzone_d_V, view.deadzone_s_um_per_V, strict=True)):
            operator.deadzone_d_V[i], operator.deadzone_s_um_per_V[i] = d_V, s
        axis.links, axis.sensor_links = len(links), len(sensor)
        for i, make in enumerate(links):
            axis.link[i] = make()
        for i, make in enumerate(sensor):
            axis.sensor_link[i] = make()

    def _refuse_more_than_it_holds(self, plays: int, deadzones: int, links: int, sensor_links: int) -> None:
        if plays > PLAYS or deadzones > DEADZONES:
            raise BadInput(f"{self.where}: more plays or dead zones than the simulator takes ({PLAYS}, {DEADZONES})")
        if links > LINKS or sensor_links > SENSOR_LINKS:
            raise BadInput(
                f"{self.where}: more effects than the simulator takes ({LINKS}, {SENSOR_LINKS} of the sensor)"
            )
        if not self._axis.delay_s <= LONGEST_DELAY_S:
            raise BadInput(
                f"{self.where}: a delay of {self._axis.delay_s:g} s; the simulator takes up to {LONGEST_DELAY_S:g} s"
            )


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


def _modes(
    c: Sequence[float], f_Hz: Sequence[float], zeta: Sequence[float], felt: Sequence[tuple[float, float]]
) -> Link:
    """Each mode as twice the real part of one complex lag: w^2 / (s^2 + 2 zeta w s + w^2)."""
    poles, weights = [], []
    for share, f, damping, (mass, damper) in zip(c, f_Hz, zeta, felt, strict=True):
        slower = (1 + mass) ** -0.5
        w, damping = 2 * math.pi * f * slower, min(damping * (1 + damper) * slower, VirtualAxis.LARGEST_ZETA)
        pole = w * complex(-damping, math.sqrt(1 - damping**2))
        poles.append(pole)
        weights.append(-2 * share * (w**2 / (pole - pole.conjugate())) / pole)
    return _poles(1 - sum(c), poles, weights)


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
    axis.delay_s = latch_s
    axis.surroundings.noise_um_rms = sensor.noise_um_rms
    axis.operator.low_V, axis.operator.high_V = -1.0, 1.0
    if model is None or model.time is None:
        axis.links, axis.link[0] = 1, _link(OPERATOR)
        return
    view, parts = model.time, LinkedParts(axis, model, where)
    axis.operator.low_V, axis.operator.high_V = view.u_range_V
    axis.operator.field_bend = view.field_bend
    axis.operator.play_tilt, axis.operator.play_taper = view.play_tilt, view.play_taper
    axis.surroundings.low_um, axis.surroundings.high_um = sorted(parts.ends_um)
    axis.operator.gain_um_per_V, axis.offset_um = view.gain_um_per_V, view.offset_um
    axis.delay_s += view.delay_s
    add_effects(parts)
    parts.finish()
