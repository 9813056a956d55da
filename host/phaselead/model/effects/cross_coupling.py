"""Motion of the other axes in this one."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from phaselead.errors import BadInput
from phaselead.model.effects.filters import relaxed
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
    columns,
    number,
    numbers,
)
from phaselead.model.effects.mode_bank import NOT_PLAYED, poles, state_weights, states
from phaselead.model.effects.softening import mode_levels
from phaselead.record import AXES

MODAL = ("f_Hz", "zeta", *(f"{part}_{axis}" for part in ("velocity", "direct") for axis in AXES))


def apply(signal: Signal, params: Params) -> Samples:
    if "f_Hz" in params:
        return _through_shared_modes(signal, params)
    y = np.array(signal.value)
    for axis, moved in signal.others_um.items():
        share = number(params, f"from_{axis}")
        if share:
            y += share * relaxed(moved, number(params, "lag_s"), signal.step_s)
    return y


def _through_shared_modes(signal: Signal, params: Params) -> Samples:
    """What the actuators of the other axes do here through the modes that the axes share."""
    f_Hz, zeta = numbers(params, "f_Hz"), numbers(params, "zeta")
    if len(f_Hz) != len(zeta):
        raise BadInput(f"effect 'cross_coupling': {len(f_Hz)} f_Hz but {len(zeta)} zeta; give one of each per mode")
    level, drop = mode_levels(signal, zeta)
    y = np.array(signal.value)
    for axis, push in signal.pushes.items():
        if f"from_{axis}" not in params:
            continue
        share, velocity = numbers(params, f"from_{axis}"), numbers(params, f"velocity_{axis}")
        if not len(share) == len(velocity) == len(f_Hz):
            raise BadInput(f"effect 'cross_coupling': from_{axis} and velocity_{axis} need {len(f_Hz)} elements each")
        moved = push.displacement_um
        through = states(moved, poles(f_Hz, zeta), signal.step_s, level, drop)
        y += number(params, f"direct_{axis}") * moved + through @ state_weights(share, velocity, zeta)
    return y


def basis(signal: Signal, params: Params) -> Samples:
    still = np.zeros(len(signal.value))
    lag_s = number(params, "lag_s")
    return columns(*(relaxed(signal.others_um.get(axis, still), lag_s, signal.step_s) for axis in AXES))


def untestable(signal: Signal) -> str | None:
    if any(np.ptp(moved) > 0 for moved in signal.others_um.values()):
        return None
    return "no other axis moves in these records; record all axes while one is driven at a time"


def virtual(axis: VirtualAxis, given: CheckedParameters) -> None:
    if "f_Hz" in given:
        raise BadInput(f"{given.label} has {NOT_PLAYED}")
    axis.other_axes([given.one(f"from_{name}") for name in AXES], given.one("lag_s", low=0.0))


def coupling(params: Params, other: str) -> float:
    """At rest every shared mode passes its share on."""
    return sum(float(np.sum(params.get(f"{part}_{other}", 0.0))) for part in ("from", "direct"))


def from_shares(shares: Mapping[str, float]) -> Params:
    return {f"from_{other}": share for other, share in shares.items()}


EFFECT = Effect(
    name="cross_coupling",
    listed=210,
    title="Cross-coupling",
    place=Place.COUPLING,
    equation="y_i = x_i + sum_j from_j (x_j - x_j,rest) / (1 + s lag_s)",
    source="Xu and Li 2010 (parasitic motion of a parallel XYZ stage, up to 4 %). With lists f_Hz, zeta, from_j and "
    "velocity_j beside a number direct_j, what actuator j does here through the modes that the axes share: direct_j "
    "and, per mode, (from_j w^2 + velocity_j w s) / (s^2 + 2 zeta w s + w^2) of what actuator j would do without "
    "mechanics (Gawronski 2004, section 2.3)",
    parameters=(
        *(Parameter(f"from_{axis}", "um/um", 0.02, -3.0, 3.0, doc=f"share of the motion of {axis}") for axis in AXES),
        Parameter("lag_s", "s", 0.0, 0.0, 0.01, role="shape", doc="time constant of the way from there to here"),
    ),
    shows="this axis moves when its own voltage stands still and another axis moves",
    reveals="one axis driven at a time, all recorded; or all at once, with other phases in each of three records",
    confused_with=("vibration", "thermal_drift"),
    compensation="The inverse of the 3 x 3 matrix in front of the axes' feed-forward and feedback (decoupling).",
    apply=apply,
    shared_modes="coupling",
    picture=Picture("neighbour", {"from_y": 0.04}),
    basis=basis,
    accepts=MODAL,
    untestable=untestable,
    from_shares=from_shares,
    virtual=virtual,
    coupling=coupling,
)
