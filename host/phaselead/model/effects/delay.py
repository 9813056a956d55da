"""Dead time between the applied voltage and the motion."""

from __future__ import annotations

from phaselead.model.effects.interface import Effect, Parameter, Params, Picture, Place, Samples, Signal, number
from phaselead.model.operator import delayed


def apply(signal: Signal, params: Params) -> Samples:
    """By itself. Beside another delay the chain takes both in one: what runs straight between rows is bent by each."""
    return delayed(signal.value, number(params, "delay_s") / signal.step_s, float(signal.value[0]))


EFFECT = Effect(
    name="delay",
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
    picture=Picture("response", {"delay_s": 1e-3}),
)
