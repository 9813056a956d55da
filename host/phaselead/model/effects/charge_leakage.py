"""Charge that leaks from the actuator: a high-pass with a corner of millihertz."""

from __future__ import annotations

import numpy as np

from phaselead.model.axis import AxisModel
from phaselead.model.effects.filters import relaxed
from phaselead.model.effects.interface import (
    STOOD_OFF,
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


def apply(signal: Signal, params: Params) -> Samples:
    rate_per_s = number(params, "rate_per_s")
    if rate_per_s <= 0:
        return signal.value
    # What stood on the actuator in the first row is all still there then, and leaks from there on.
    stood_V = signal.value[0] * -np.expm1(-rate_per_s * signal.since_s)
    return np.asarray(signal.value - relaxed(signal.value - signal.value[0], 1 / rate_per_s, signal.step_s) - stood_V)


def before_record(since_s: Samples, params: Params, axis: AxisModel) -> Samples:
    """What had leaked away before."""
    view = axis.time
    assert view is not None
    low, high = view.u_range_V
    most_V = max(high, 0.0) - min(low, 0.0)  # all that stands on the actuator may be lost
    return np.asarray(STOOD_OFF * most_V * np.exp(-number(params, "rate_per_s") * since_s)[:, None])


def reads(params: Params, axis: AxisModel) -> str:
    rate_per_s = number(params, "rate_per_s")
    return f"RC = {1 / rate_per_s:.4g} s" if rate_per_s > 0 else "no leakage"


def virtual(axis: VirtualAxis, given: CheckedParameters) -> None:
    if rate_per_s := given.one("rate_per_s", low=0.0):
        axis.filter(1.0, [-rate_per_s], [-1.0])


EFFECT = Effect(
    name="charge_leakage",
    listed=120,
    title="Charge leakage",
    place=Place.AMPLIFIER,
    order=3,
    equation="v = u s / (s + rate_per_s),  rate_per_s = 1 / (R C);  about v = u where a record begins",
    source="Fleming and Moheimani 2005 (charge drives lose their low frequencies); Clayton, Tien, Fleming, Moheimani "
    "and Devasia 2008 (inverse feed-forward of charge-controlled positioners)",
    parameters=(
        Parameter("rate_per_s", "1/s", 0.01, 0.0, 2.0, log=True, doc="corner in rad/s: 1/(R C) of 10 to 1000 s"),
    ),
    shows="the position decays towards rest at every hold, from both sides",
    reveals="long holds at two levels of opposite sign, and one at rest to tell it from drift",
    confused_with=("creep", "thermal_drift"),
    compensation="An integral controller removes it. A feed-forward would integrate the reference and run into the "
    "voltage limit, so there is none.",
    apply=apply,
    absorbed_by_modes=True,
    picture=Picture("holds", {"rate_per_s": 0.03}),
    reads=reads,
    slow=True,
    before_record=before_record,
    virtual=virtual,
    repeatable=True,
)
