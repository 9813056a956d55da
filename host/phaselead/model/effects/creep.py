"""Slow motion that goes on after the voltage has stopped, straight in the logarithm of time."""

from __future__ import annotations

import math

import numpy as np

from phaselead.errors import BadInput
from phaselead.model.axis import AxisModel
from phaselead.model.effects.filters import lags
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
    numbers,
)
from phaselead.model.operator import range_um

LOST_AT_MOST = 0.02
"""Per decade: against its model a stage can lose what ceramics creep, 1 to 2 % (catalogue of Physik Instrumente); none
creeps back."""
TERMS = 8
"""Time constants between the first and the last: two or three a decade draw a straight line within 1 %."""


def terms(params: Params) -> tuple[Samples, Samples]:
    """k and tau_s, each (m,), of either form. Raises BadInput."""
    if "k" not in params and "tau_s" not in params:
        first, last = sorted((number(params, "tau_first_s"), number(params, "tau_last_s")))
        decades = float(np.log10(last / first))
        tau_s = first * 10 ** (decades * (np.arange(TERMS) + 0.5) / TERMS)
        return np.full(TERMS, number(params, "gamma") * decades / TERMS), tau_s
    if not {"k", "tau_s"} <= set(params):
        raise BadInput("effect 'creep': k and tau_s go together; give both, or gamma, tau_first_s and tau_last_s")
    k, tau_s = numbers(params, "k"), numbers(params, "tau_s")
    if len(k) != len(tau_s) or not (tau_s > 0).all():
        raise BadInput("effect 'creep': k and tau_s need as many elements, and every tau_s must be above 0")
    return k, tau_s


def apply(signal: Signal, params: Params) -> Samples:
    k, tau_s = terms(params)
    return signal.value + lags(signal.value - signal.rest_um, tau_s, k, signal.step_s)


def basis(signal: Signal, params: Params) -> Samples:
    return np.asarray(apply(signal, {**params, "gamma": 1.0}) - signal.value)[:, None]


def before_record(since_s: Samples, params: Params, axis: AxisModel) -> Samples:
    """Two lags of a chain at a time: neighbours relax alike."""
    k, tau_s = terms(params)
    pairs = [slice(i, i + 2) for i in range(0, len(k), 2)]
    size_um = STOOD_OFF * range_um(axis) * np.array([np.hypot.reduce(k[pair]) for pair in pairs])
    together_s = np.array([np.exp(np.log(tau_s[pair]).mean()) for pair in pairs])
    return np.asarray(size_um * np.exp(-since_s[:, None] / together_s))


def virtual(axis: VirtualAxis, given: CheckedParameters) -> None:
    """As given, or equal shares at equal ratios between the first time constant and the last."""
    if "k" in given or "tau_s" in given:
        k, tau_s = given.alike("k", "tau_s", most=TERMS)
        given.positive("tau_s", tau_s)
        axis.lags(k, tau_s)
        return
    first, last = sorted((given.one("tau_first_s", above=0.0), given.one("tau_last_s", above=0.0)))
    each = given.one("gamma") * math.log10(last / first) / TERMS
    axis.lags([each] * TERMS, [first * (last / first) ** ((i + 0.5) / TERMS) for i in range(TERMS)])


EFFECT = Effect(
    name="creep",
    listed=50,
    title="Creep",
    place=Place.CREEP,
    rising=("tau_first_s", "tau_last_s"),
    equation="y = x + sum_i k_i (x - x_rest) / (1 + s tau_i); k_i equal and tau_i in equal ratios between tau_first_s "
    "and tau_last_s make y ~ 1 + gamma log10(t / tau_first_s) after a step",
    source="Kuhnen 2003; Devasia, Eleftheriou and Moheimani 2007 (logarithmic and viscoelastic forms)",
    parameters=(
        Parameter(
            "gamma",
            "per decade",
            0.015,
            -0.2,
            0.2,
            known=(-LOST_AT_MOST, 0.2),
            doc="growth per decade of time, as a share of the step",
        ),
        Parameter("tau_first_s", "s", 0.1, 0.001, 10.0, role="shape", log=True, doc="where the straight line begins"),
        Parameter("tau_last_s", "s", 100.0, 1.0, 1e5, role="shape", log=True, doc="where it ends"),
    ),
    shows="after a step the position goes on in the direction of the step, as much in each decade of time; slow loops "
    "are wider and the gain falls by 1-2 % a decade of frequency",
    reveals="steps of both signs with holds of 30 s and more",
    confused_with=("thermal_drift", "charge_leakage", "rate_dependence", "softening"),
    compensation="The inverse, a sum of the same slow lags with k negative, runs in the feed-forward; an integral "
    "controller also removes it, slowly enough.",
    apply=apply,
    absorbed_by_modes=True,
    picture=Picture("steps", {"gamma": 0.015, "tau_first_s": 0.01, "tau_last_s": 1000.0}),
    basis=basis,
    before_record=before_record,
    accepts=("k", "tau_s"),
    slow=True,
    virtual=virtual,
    repeatable=True,
    creep_terms=terms,
)
