"""The model's answer to a recorded voltage."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from phaselead.errors import BadInput
from phaselead.model.axis import TimeView
from phaselead.model.chain import Chain
from phaselead.model.effects import Entry, Place, effect_of_shares
from phaselead.model.stage_file import Stage
from phaselead.record import AXES, AxisRecord, Recording, refuse_gapped


def predict(stage: Stage, recording: Recording) -> Recording:
    """The same times and voltages with the predicted positions, from rest at 0 V before the first row.

    Adopted effects act. With three axes and a cross-coupling, what the other axes do is added. A window only
    warms and scores: the rows before it are predicted too. Axes that the stage does not know are left out.
    Raises BadInput when rows, a voltage or a time view are missing.
    """
    refuse_gapped(recording)
    with_voltage = [name for name, a in recording.axes.items() if a.u_V is not None]
    if not with_voltage:
        raise BadInput(f"{recording.source}: has no voltage to predict from; it needs a column u_V")
    known = [name for name in with_voltage if name in stage.axes] or with_voltage
    alone = {name: _chain(stage, recording, name) for name in known}
    pushes = {name: chain.push() for name, chain in alone.items()}
    chains = {name: chain.with_pushes(pushes) for name, chain in alone.items()}
    moved = {name: chain.signal_at(Place.MECHANICS).displacement_um[1:] for name, chain in chains.items()}
    axes = {}
    for name, chain in chains.items():
        others = {other: x for other, x in moved.items() if other != name}
        x = chain.with_others(others).run(_seen(stage, name, others))
        axes[name] = AxisRecord(recording.axes[name].u_V, x)
    return replace(recording, axes=axes, meta={})


def time_view_of(stage: Stage, axis: str) -> TimeView:
    """The time view of an axis. Raises BadInput when the stage has none."""
    view = stage.axis(axis).time
    if view is None:
        raise BadInput(f"stage {stage.name!r} has no time view for axis {axis}; fit it to recordings first")
    return view


def _chain(stage: Stage, recording: Recording, axis: str) -> Chain:
    time_view_of(stage, axis)
    u = recording.axes[axis].u_V
    assert u is not None
    return Chain(stage.axis(axis), recording.t_s, u)


def _seen(stage: Stage, axis: str, others: Iterable[str]) -> list[Entry]:
    """The row of the coupling matrix as an effect."""
    if stage.cross_coupling is None:
        return []
    row = stage.cross_coupling[AXES.index(axis)]
    return [effect_of_shares({other: row[AXES.index(other)] for other in others})]
