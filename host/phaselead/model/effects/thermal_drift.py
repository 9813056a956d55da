"""Frames that warm up."""

from __future__ import annotations

import numpy as np

from phaselead.model.effects.interface import (
    CheckedParameters,
    Derived,
    Effect,
    Parameter,
    Params,
    Picture,
    Place,
    Samples,
    Scene,
    Signal,
    VirtualAxis,
    columns,
    number,
    with_columns,
)

NM_PER_MIN = 60e3
"""In one um/s."""


def apply(signal: Signal, params: Params) -> Samples:
    return with_columns(signal, basis(signal, params), params, "ramp_um_per_s", "rise_um")


def basis(signal: Signal, params: Params) -> Samples:
    since = np.maximum(signal.t_s, 0.0)
    return columns(signal.t_s, -np.expm1(-since / number(params, "tau_s")))


def virtual(axis: VirtualAxis, given: CheckedParameters) -> None:
    axis.drift(given.one("ramp_um_per_s"), given.one("rise_um"), given.one("tau_s", above=0.0))


def _mean_rate_nm_per_min(params: Params, scene: Scene) -> float:
    """Over all records together; over the first time constant where there are none."""
    spans = np.array(scene.spans_s or ((0.0, number(params, "tau_s")),))
    ramp, rise = number(params, "ramp_um_per_s"), number(params, "rise_um")
    position = ramp * spans - rise * np.expm1(-np.maximum(spans, 0.0) / number(params, "tau_s"))
    return float(np.diff(position).sum() / np.diff(spans).sum()) * NM_PER_MIN


EFFECT = Effect(
    name="thermal_drift",
    listed=180,
    title="Thermal drift",
    place=Place.ENVIRONMENT,
    order=0,
    equation="y = x + ramp_um_per_s t + rise_um (1 - exp(-t / tau_s)),  t absolute, from 0 on",
    source="Newton's law of heating and cooling; expansion of 1-50 nm/K",
    parameters=(
        Parameter("ramp_um_per_s", "um/s", 0.002, -1.0, 1.0, doc="drift at a constant rate"),
        Parameter("rise_um", "um", 0.1, -100.0, 100.0, doc="warming up that comes to an end"),
        Parameter("tau_s", "s", 300.0, 5.0, 1e5, role="shape", log=True, doc="time constant of the warming"),
    ),
    derived=(Derived("mean_rate", "nm/min", _mean_rate_nm_per_min, doc="drift per time, mean over the records"),),
    shows="a slow way that goes on whatever the voltage does, over the records of a session",
    reveals="a long idle record; steps of both signs, which creep and leakage follow and drift does not",
    confused_with=("creep", "charge_leakage", "offset"),
    compensation="None in the feed-forward: it depends on the room, not on the path. Feedback follows it if the sensor "
    "does not drift itself.",
    kind="disturbance",
    apply=apply,
    moves_zero="steadily",
    picture=Picture("idle", {"ramp_um_per_s": 2e-4, "rise_um": 0.1, "tau_s": 100.0}),
    basis=basis,
    slow=True,
    virtual=virtual,
)
