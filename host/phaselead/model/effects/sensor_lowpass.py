"""Finite bandwidth of the position sensor."""

from __future__ import annotations

from phaselead.model.effects.filters import relaxed, smoothly_relaxed
from phaselead.model.effects.interface import Effect, Parameter, Params, Picture, Place, Samples, Signal, number
from phaselead.model.effects.lowpass import corner_reads, from_corner, virtual_lowpass
from phaselead.model.sections import Undone, undo_lowpass


def apply(signal: Signal, params: Params) -> Samples:
    """Behind a mode the motion is smooth; it may have corners without one."""
    lag = smoothly_relaxed if any(e.modes for e, _ in signal.active) else relaxed
    return lag(signal.value, number(params, "tau_s"), signal.step_s)


def time_constant_s(params: Params) -> float:
    return number(params, "tau_s")


def undo_on_position(params: Params) -> Undone:
    return undo_lowpass(number(params, "tau_s"))


EFFECT = Effect(
    name="sensor_lowpass",
    listed=130,
    title="Sensor low-pass",
    place=Place.SENSOR,
    order=2,
    equation="y = x / (1 + s tau_s),  corner = 1 / (2 pi tau_s)",
    source="Fleming 2013, A review of nanometer resolution position sensors (bandwidth)",
    parameters=(Parameter("tau_s", "s", 8e-5, 0.0, 0.005, doc="time constant; a corner of 2 kHz is 80 us"),),
    shows="gain and phase of the measured motion fall towards high frequencies, at every level alike",
    reveals="a multisine up to a third of the sampling rate; in closed loop, noise that the stage itself does not make",
    confused_with=("delay", "amplifier_lowpass", "load_change"),
    compensation="A lead (numerator 1 + s tau_s) in the feed-forward makes the measured position follow. The stage "
    "itself then moves ahead of the reference by as much as the sensor is late.",
    apply=apply,
    absorbed_by_modes=True,
    picture=Picture("response", {"tau_s": 5e-4}),
    accepts=("corner_Hz",),
    normalise=from_corner,
    reads=corner_reads,
    lag_in_loop_s=time_constant_s,
    virtual=virtual_lowpass,
    repeatable=True,
    undo_on_position=undo_on_position,
)
