"""What an effect can tell a virtual stage to do, so that firmware in the loop meets it tick by tick.

An effect's function ``virtual(axis, given)`` names parts of ``VirtualAxis``; the simulator (``phaselead.sim``) plays
them with equations of its own, in C. So a virtual stage can be held against what ``apply`` of the same effect says.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NoReturn

from phaselead.model.axis import AxisModel
from phaselead.model.effects.place import Place
from phaselead.model.operator import ends_um

MOST_POLES = 48
"""Of one filter."""


class NotPlayed(Exception):
    """A simulator does not have a part that an effect asks for."""


class VirtualAxis:
    """One axis of a virtual stage while it is put together; a simulator overrides the parts that it plays.

    Filters, clips and the like act at the place of the effect that asks for them, one effect behind the other: on volts
    up to the amplifier, on micrometres from rest behind it, on the measured position at the sensor. Everything rests
    where 0 V puts it. Parts that a simulator does not have raise NotPlayed.
    """

    place = Place.CONVERTER
    """Of the effect that is telling."""
    has_modes = False
    """Whether an effect has asked for modes."""
    LARGEST_ZETA = 0.99
    """Of a mode that a load damps: from 1 on it would be no mode but two lags."""

    def __init__(self, model: AxisModel, where: str) -> None:
        self.model = model
        self.where = where
        """Stage and axis, for messages."""
        self.span_V = model.time.u_range_V if model.time is not None else (-1.0, 1.0)
        self.ends_um = ends_um(model)

    @property
    def range_V(self) -> float:
        """The voltages that the model was fitted on: what "of voltage range" means."""
        return self.span_V[1] - self.span_V[0]

    @property
    def range_um(self) -> float:
        """Quasi-static travel over them: what "of range" means."""
        return abs(self.ends_um[1] - self.ends_um[0]) or 1.0

    def filter(self, direct: float, poles: Sequence[complex], weights: Sequence[complex]) -> None:
        """y = direct x + sum Re(weight / (1 - s / pole)) x. Poles in 1/s, in the left half-plane."""
        _refuse()

    def lowpass(self, tau_s: float, corner_Hz: float | None = None) -> None:
        """y = x / (1 + s tau). ``corner_Hz``: the same as the stage file has it, to its last digit."""
        _refuse()

    def lags(self, k: Sequence[float], tau_s: Sequence[float]) -> None:
        """y = x + sum k / (1 + s tau) x."""
        _refuse()

    def modes(self, c: Sequence[float], f_Hz: Sequence[float], zeta: Sequence[float]) -> None:
        """y = (1 - sum c) x + sum c w^2 / (s^2 + 2 zeta w s + w^2) x."""
        _refuse()

    def load(self, mass: float, damping: float, others: float) -> None:
        """The largest mode carries 1 + mass of its own mass and has 1 + damping of its damping force, each other one 1
        + others mass and 1 + others damping."""
        _refuse()

    def slew(self, per_s: float, loop_s: float) -> None:
        """Follow by at most ``per_s`` a second: x - y = loop_s (per_s artanh(p) - dy/dt), p = (dy/dt) / per_s."""
        _refuse()

    def clip(self, low: float, high: float) -> None:
        """Stay between ``low`` and ``high``."""
        _refuse()

    def slack(self, half: float) -> None:
        """A play: follow no closer than ``half``."""
        _refuse()

    def crossover(self, half: float, tau_s: float) -> None:
        """y = x - tau dz/dt, z = d - v: v is a play of d no closer than ``half``, tau dd/dt = x - v."""
        _refuse()

    def level_gain(self, kappa: float, tau_s: float, about_mean: float, exponent: float) -> None:
        """y = x + kappa X z sqrt(e)^exponent, tau de/dt = z^2 - e, z = x / X less ``about_mean`` times its mean over
        tau."""
        _refuse()

    def stiffness(self, square: float, cube: float) -> None:
        """y = x + X (square z^2 + cube z^3), z = x / X."""
        _refuse()

    def slope(self, um_per_V: float) -> None:
        """The hysteresis rises by so much more."""
        _refuse()

    def plays(self, r_V: Sequence[float], w_um_per_V: Sequence[float], start_V: Sequence[float]) -> None:
        """More plays of the hysteresis, each less the straight line: sum w (play_r[v] - v) less its value at rest."""
        _refuse()

    def fading_plays(self, r_V: Sequence[float], w_um_per_V: Sequence[float]) -> None:
        """Plays that forget their turns, each less the straight line, less its value at rest; they rest as the plays of
        the time view do."""
        _refuse()

    def asymmetry(self, bend_um: float, skew_um: float, reach: float) -> None:
        """Curvature of the loop, and the width of one end that the other lacks."""
        _refuse()

    def friction(self, openings: tuple[float, float, float], onset_per_s: float, reach: float) -> None:
        """Friction along the path, of range: what it gains per decade of rate above ``onset_per_s``, what it loses from
        rest to sliding, and what it has at any rate; it turns within ``reach``. Without plays there is none."""
        _refuse()

    def converter_errors(self, bow_LSB: float, bits_LSB: Sequence[float]) -> None:
        """Errors of the output converter, 0 at its first code and its last: a bow over all codes, and excess weights of
        its bits, the most significant first."""
        _refuse()

    def delay(self, delay_s: float) -> None:
        """Dead time of the voltage; several add up."""
        _refuse()

    def other_axes(self, um_per_um: Sequence[float], lag_s: float) -> None:
        """Motion of x, y and z in this axis, behind a lag."""
        _refuse()

    def sensor_gain(self, gain: float) -> None:
        """The sensor shows 1 + gain of the displacement."""
        _refuse()

    def offset(self, offset_um: float) -> None:
        """The position is shifted; several add up."""
        _refuse()

    def sensor_curve(self, quadratic: float, cubic: float, quartic: float, linear: float) -> None:
        """Error of the sensor over its travel, of range."""
        _refuse()

    def jitter(self, rms_s: float) -> None:
        """Each sample is taken early or late by a random time."""
        _refuse()

    def steps(self, step_um: float) -> None:
        """The measured position is rounded."""
        _refuse()

    def drift(self, ramp_um_per_s: float, rise_um: float, tau_s: float) -> None:
        """x + ramp t + rise (1 - exp(-t / tau)), t from the opening of the device."""
        _refuse()

    def lines(self, f_Hz: float, sin_um: Sequence[float], cos_um: Sequence[float]) -> None:
        """Sines and cosines of f, 2 f and 3 f in the measured position."""
        _refuse()

    def vibration(self, rms_um: float, f_Hz: float, width_Hz: float) -> None:
        """A spring and mass under white force, seen by the sensor."""
        _refuse()


def _refuse() -> NoReturn:
    raise NotPlayed
