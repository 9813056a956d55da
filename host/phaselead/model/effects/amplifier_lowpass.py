"""The amplifier charging the actuator's capacitance."""

from __future__ import annotations

from phaselead.model.effects.filters import relaxed
from phaselead.model.effects.interface import Effect, Parameter, Params, Picture, Place, Samples, Signal, number
from phaselead.model.effects.lowpass import corner_reads, from_corner, virtual_lowpass
from phaselead.model.sections import Undone, undo_lowpass


def apply(signal: Signal, params: Params) -> Samples:
    return relaxed(signal.value, number(params, "tau_s"), signal.step_s)


def time_constant_s(params: Params) -> float:
    return number(params, "tau_s")


def undo_on_drive(params: Params) -> Undone:
    return undo_lowpass(number(params, "tau_s"))


EFFECT = Effect(
    name="amplifier_lowpass",
    listed=80,
    title="Amplifier low-pass",
    place=Place.AMPLIFIER,
    order=1,
    equation="v = u / (1 + s tau_s),  tau_s = R C,  corner = 1 / (2 pi tau_s)",
    source="Fleming and Leang 2014, Design, Modeling and Control of Nanopositioning Systems (electrical part)",
    parameters=(Parameter("tau_s", "s", 1.6e-4, 0.0, 0.01, doc="time constant; a corner of 1 kHz is 160 us"),),
    shows="gain and phase fall towards high frequencies, before the hysteresis: fast loops are smaller inside too",
    reveals="a multisine above 300 Hz at two levels: hysteresis seen through the sensor's low-pass differs from "
    "hysteresis driven through the amplifier's",
    confused_with=("sensor_lowpass", "delay", "rate_dependence"),
    compensation="A lead (numerator 1 + s tau_s) in the feed-forward within the slew limit, or preview by tau_s for "
    "paths far below the corner.",
    apply=apply,
    absorbed_by_modes=True,
    picture=Picture("response", {"tau_s": 5e-4}),
    accepts=("corner_Hz",),
    normalise=from_corner,
    reads=corner_reads,
    lag_s=time_constant_s,
    lag_in_loop_s=time_constant_s,
    virtual=virtual_lowpass,
    repeatable=True,
    undo_on_drive=undo_on_drive,
)
