"""Creep of an axis from one hold at the end of the experiment, and the records without what creeps in them."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import nnls

from phaselead.device import TICK_HZ, Capture, Channel, Device, Mode, recording_of
from phaselead.identify.plan import HOLD_S, Experiment, name_of_hold
from phaselead.model import AdoptedEffect, lags, without_lags
from phaselead.record import Recording, Samples, refuse_gapped
from phaselead.waveforms import Goto

TAU_S = np.array([0.1, 1.0, 10.0])
"""Creep is straight in the logarithm of time (Devasia, Eleftheriou and Moheimani 2007): one lag a decade draws it."""
HOLD_V, MOVE_S = 5.0, 0.2
"""No further than the largest sine of its axis; slower where its slew limit asks for that."""
RINGS_S = 0.1
"""After the move, before it is looked at."""
EVERY = 100
"""Rows that are averaged, 20 ms, a period of the mains: creep is slow."""


def hold_of(plan: Sequence[Experiment], axis: str, slew_V_per_s: float) -> Goto:
    """The move into the hold: to 5 V, or as far as the plan drives this axis, in as long as the slew limit takes."""
    move = Goto(min(HOLD_V, max(e.swing_V for e in plan if e.axis == axis)), 0.0, "V", 1 / MOVE_S)
    slower = 0.999 * slew_V_per_s / move.steepest()
    return move if slower >= 1 else replace(move, f_Hz=move.f_Hz * slower)


def hold(device: Device, axis: str, move: Goto) -> Capture:
    """Moves and holds, from rest: no shorter than it moves. The capture begins with the move."""
    device.set_axis(axis, Mode.OPEN)
    device.set_path(axis, "move", swing=move.swing, f_Hz=move.f_Hz, ticks=round(move.duration_s * TICK_HZ))
    ticks = round(max(HOLD_S, 2 * move.duration_s) * TICK_HZ)
    return device.capture(ticks, axes=axis, channels=Channel.ADC | Channel.DAC)


def recording_of_hold(capture: Capture, axis: str) -> Recording:
    """The capture in units. Raises BadInput where it is gapped."""
    recording = recording_of(capture, meta={"mode": "open"})
    recording = replace(recording, source=name_of_hold(axis), sha256=recording.samples_sha256)
    refuse_gapped(recording)
    return recording


def creep_of(held: Recording, axis: str) -> Samples:
    """k (3,), not negative, of the lags that the hold shows: what still moves while the voltage does not."""
    record = held.axes[axis]
    assert record.u_V is not None
    assert record.x_um is not None
    there = int(np.argmax(record.u_V >= record.u_V.max())) + round(RINGS_S * TICK_HZ)
    way_um = float(record.x_um[there] - record.x_um[0])
    moved = np.where(np.arange(len(record.x_um)) < there, (record.x_um - record.x_um[0]) / way_um, 1.0)
    moved[0] = 0.0
    columns = [*(lags(moved, np.array([tau_s]), np.ones(1), 1 / TICK_HZ) for tau_s in TAU_S), np.ones_like(moved)]
    basis = np.stack([_slow(column[there:]) for column in columns], axis=1)
    *gone_on, level = nnls(basis, _slow(record.x_um[there:] - record.x_um[0]) * np.sign(way_um))[0]
    return np.array(gone_on) / float(level)


def _slow(x: Samples) -> Samples:
    return np.asarray(x[: len(x) // EVERY * EVERY].reshape(-1, EVERY).mean(axis=1))


def without_creep(
    records: Sequence[Recording], axis: str, k: Samples, rested_s: Sequence[float | None]
) -> list[Recording]:
    """The records, which drive this axis one after the other, without what creeps in them.

    ``rested_s``: of each, since the end of the one before, out of which what crept there goes on; None where it does
    not: the first of a session, which begins at rest. What creeps is counted from where each record begins: the little
    that its remanence creeps is an offset, which the fit has.
    """
    begins = [i for i, pause_s in enumerate(rested_s) if pause_s is None]
    found: list[Recording] = []
    for begin, end in itertools.pairwise([*begins, len(records)]):
        found += _of_session(records[begin:end], axis, k, [pause_s or 0.0 for pause_s in rested_s[begin:end]])
    return found


def _of_session(records: Sequence[Recording], axis: str, k: Samples, rested_s: Sequence[float]) -> Iterator[Recording]:
    parts: list[Samples] = []
    for record, pause_s in zip(records, rested_s, strict=True):
        x_um = record.axes[axis].x_um
        assert x_um is not None
        parts += [np.zeros(round(pause_s * TICK_HZ)), x_um - x_um[0]]
    all_um = np.concatenate(parts)
    crept_um = all_um - without_lags(all_um, TAU_S, k, 1 / TICK_HZ)
    crept = np.split(crept_um, np.cumsum([len(part) for part in parts])[:-1])[1::2]
    return (_less(record, axis, crept_um) for record, crept_um in zip(records, crept, strict=True))


def _less(record: Recording, axis: str, crept_um: Samples) -> Recording:
    one = record.axes[axis]
    assert one.x_um is not None
    return replace(record, axes={**record.axes, axis: replace(one, x_um=one.x_um - crept_um)})


def effect_of_hold(k: Samples) -> AdoptedEffect:
    """As a stage file has it."""
    return AdoptedEffect(name="creep", params={"k": tuple(map(float, k)), "tau_s": tuple(map(float, TAU_S))})


def described_creep(k: Samples) -> str:
    """How much an axis creeps, in words."""
    return f"goes on by {100 * k.sum():.2g} % of a step while it is held for some {HOLD_S:g} s"
