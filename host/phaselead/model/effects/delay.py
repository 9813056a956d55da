"""Dead time between the applied voltage and the motion."""

from __future__ import annotations

from phaselead.model.axis import AxisModel, TimeView
from phaselead.model.effects.interface import (
    CheckedParameters,
    Effect,
    Parameter,
    Params,
    Picture,
    Place,
    Samples,
    Signal,
    VirtualAxis,
    number,
)
from phaselead.model.operator import delayed


def apply(signal: Signal, params: Params) -> Samples:
    """By itself. Beside another delay the chain takes both in one: what runs straight between rows is bent by each."""
    return delayed(signal.value, number(params, "delay_s") / signal.step_s, float(signal.value[0]))


def dead_time_s(params: Params) -> float:
    return number(params, "delay_s")


def virtual(axis: VirtualAxis, given: CheckedParameters) -> None:
    axis.delay(given.one("delay_s", low=0.0))


def into_time_view(axis: AxisModel, view: TimeView, params: Params) -> TimeView:
    return view.model_copy(update={"delay_s": view.delay_s + number(params, "delay_s")})


EFFECT = Effect(
    name="delay",
    listed=110,
    title="Delay",
    place=Place.TIMING,
    equation="v(t) = u(t - delay_s)",
    source="Franklin, Powell and Workman 1998, Digital Control of Dynamic Systems",
    parameters=(
        Parameter(
            "delay_s", "s", 2e-4, 0.0, 0.01, doc="dead time of converters, computation, amplifier and sensor interface"
        ),
    ),
    shows="phase falls in proportion to frequency while the gain stays flat; after a step nothing moves for a while",
    reveals="a multisine up to a tenth of the sampling rate, at low level so that the hysteresis stays small",
    confused_with=("sensor_lowpass", "amplifier_lowpass", "hysteresis"),
    compensation="The reference is looked up ahead by the delay; it still bounds the bandwidth of feedback.",
    apply=apply,
    absorbed_by_modes=True,
    exact=True,
    picture=Picture("response", {"delay_s": 1e-3}),
    dead_time_s=dead_time_s,
    virtual=virtual,
    repeatable=True,
    into_time_view=into_time_view,
)
