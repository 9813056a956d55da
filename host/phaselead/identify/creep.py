"""Creep of an axis from one hold, and its time view fitted without it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import nnls

from phaselead.device import TICK_HZ, Channel, Device, Mode, recording_of
from phaselead.identify.fitting import fit
from phaselead.identify.plan import Experiment
from phaselead.model import AdoptedEffect, AxisModel, Stage, lags, simulate
from phaselead.record import Recording, Samples, refuse_gapped
from phaselead.waveforms import Goto

TAU_S = np.array([0.1, 1.0, 10.0])
"""Creep is straight in the logarithm of time (Devasia, Eleftheriou and Moheimani 2007): one lag a decade draws it."""
HOLD_V, MOVE_S, HOLD_S = 5.0, 0.2, 12.0
"""No further than the largest sine of its axis."""
WAIT_S = 40.0
"""At rest before: four times the slowest."""
SECONDS = WAIT_S + HOLD_S
"""That it takes an axis."""
FROM_S = 0.3
"""Of the hold: before it the mode rings."""
EVERY = 50
"""Rows: creep is slow."""
TURNS = 2
"""Fits of the time view and of the creep in turn: the second changes creep by 1 %, a third by less than 0.01 %."""


def hold_of(plan: Sequence[Experiment], axis: str) -> Goto:
    """The move into the hold: to 5 V, or as far as the plan drives this axis."""
    return Goto(min(HOLD_V, max(e.swing_V for e in plan if e.axis == axis)), 0.0, "V", 1 / MOVE_S)


def hold(device: Device, axis: str, move: Goto) -> Recording:
    """Rests, moves and holds; the record begins with the move. Raises BadInput where it is gapped."""
    device.wait(WAIT_S)
    device.set_axis(axis, Mode.OPEN)
    device.set_path(axis, "move", swing=move.swing, f_Hz=move.f_Hz, ticks=round(MOVE_S * TICK_HZ))
    capture = device.capture(round(HOLD_S * TICK_HZ), axes=axis, channels=Channel.ADC | Channel.DAC)
    recording = replace(recording_of(capture, meta={"mode": "open"}), source=f"{axis}-hold")
    refuse_gapped(recording)
    return recording


def with_creep(
    stage: Stage, axis: str, held: Recording, records: Sequence[Recording], used: Sequence[bool], rest_s: float
) -> Stage:
    """The stage with the creep of ``axis`` that its hold shows. The time view is fitted again, on what those of the
    ``records`` that are ``used`` show without creep; the table view stays, it is the paper's. The records were run in
    this order from rest, each after ``rest_s`` at 0 V, and each drives this axis; the hold came after them.
    """
    found, highest_V = stage.axis(axis), max(float(r.axes[axis].u_V.max()) for r in records)  # type: ignore[union-attr]
    k = _creep(found, held, axis, highest_V)
    for _ in range(TURNS):
        without = _less_creep(records, axis, found, k, rest_s)
        fitted = fit([record for record, use in zip(without, used, strict=True) if use], parent=stage)[0].axis(axis)
        found = found.model_copy(update={"time": fitted.time, "effects": fitted.effects})
        k = _creep(found, held, axis, highest_V)
    params = {"k": tuple(map(float, k)), "tau_s": tuple(map(float, TAU_S))}
    effects = (AdoptedEffect(name="creep", params=params), *found.effects)
    found = found.model_copy(update={"effects": effects})
    return stage.model_copy(update={"axes": {**stage.axes, axis: found}})


def described_creep(model: AxisModel) -> str:
    """How much it creeps, in words."""
    k = np.ravel([e.params["k"] for e in model.effects if e.name == "creep"])
    return f"goes on by {100 * k.sum():.2g} % of a step while it is held for some {HOLD_S:g} s"


def _creep(model: AxisModel, held: Recording, axis: str, highest_V: float) -> Samples:
    """k (3,), not negative, of the lags that the hold shows beside the model, with an offset of its own.

    The stage has been up to ``highest_V`` before: so has the model.
    """
    record, step_s = held.axes[axis], 1 / TICK_HZ
    assert record.u_V is not None
    assert record.x_um is not None
    before_V = highest_V * np.concatenate([np.linspace(0, 1, 500), np.linspace(1, 0, 500)])
    u_V = np.concatenate([before_V, record.u_V])
    moved_um = simulate(model, np.arange(len(u_V)) * step_s, u_V)[len(before_V) :]
    columns = [lags(moved_um - moved_um[0], np.array([tau_s]), np.ones(1), step_s) for tau_s in TAU_S]
    level = np.ones_like(moved_um)
    rows = slice(round(FROM_S * TICK_HZ), None, EVERY)
    basis = np.stack([*columns, level, -level], axis=1)[rows]
    return np.asarray(nnls(basis, (record.x_um - moved_um)[rows])[0][: len(TAU_S)])


def _less_creep(
    records: Sequence[Recording], axis: str, model: AxisModel, k: Samples, rest_s: float
) -> list[Recording]:
    """The records without what creeps in them; what one leaves goes on in those behind it."""
    still = np.zeros(round(rest_s * TICK_HZ))
    moved = []
    for record in records:
        moved_um = simulate(model, record.t_s, record.axes[axis].u_V)  # type: ignore[arg-type]
        moved += [still, moved_um - moved_um[0]]
    ends = np.cumsum([len(part) for part in moved])
    crept = np.split(lags(np.concatenate(moved), TAU_S, k, 1 / TICK_HZ), ends[:-1])[1::2]
    return [_less(record, axis, crept_um) for record, crept_um in zip(records, crept, strict=True)]


def _less(record: Recording, axis: str, crept_um: Samples) -> Recording:
    one = record.axes[axis]
    assert one.x_um is not None
    return replace(record, axes={**record.axes, axis: replace(one, x_um=one.x_um - crept_um)})
