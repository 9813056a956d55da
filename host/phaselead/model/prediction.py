"""The model's answer to a recorded voltage."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from phaselead.errors import BadInput, more_like_it
from phaselead.model.axis import TimeView
from phaselead.model.chain import Chain
from phaselead.model.effects import Entry, Place, effect_of_shares
from phaselead.model.operator import plays_after
from phaselead.model.stage_file import Stage
from phaselead.record import AXES, AxisRecord, Recording, refuse_gapped, times_in

FAR_BEYOND = 0.5
"""Of the span of voltages that a model was fitted on."""


def predict(stage: Stage, recording: Recording, *, turned_V: Mapping[str, Sequence[float]] | None = None) -> Recording:
    """The same times and voltages with the predicted positions, from rest at 0 V before the first row. ``turned_V``: by
    axis, for a stage that went to its first voltage long before, where it had turned round since it left rest, in V;
    empty where it went straight.

    Adopted effects act. With three axes and a cross-coupling, what the other axes do is added. A window only
    warms and scores: the rows before it are predicted too. Axes that the stage does not know are left out.
    Raises BadInput when rows, a voltage or a time view are missing.
    """
    refuse_gapped(recording)
    with_voltage = [name for name, a in recording.axes.items() if a.u_V is not None]
    if not with_voltage:
        raise BadInput(f"{recording.source}: has no voltage to predict from; it needs a column u_V")
    known = [name for name in with_voltage if name in stage.axes] or with_voltage
    alone = {name: _chain(stage, recording, name, (turned_V or {}).get(name)) for name in known}
    pushes = {name: chain.push() for name, chain in alone.items()}
    chains = {name: chain.with_pushes(pushes) for name, chain in alone.items()}
    moved = {name: chain.signal_at(Place.MECHANICS).displacement_um[1:] for name, chain in chains.items()}
    axes = {}
    for name, chain in chains.items():
        others = {other: x for other, x in moved.items() if other != name}
        x = chain.with_others(others).run(_seen(stage, name, others))
        axes[name] = AxisRecord(recording.axes[name].u_V, x)
    return replace(recording, axes=axes, meta={})


def in_other_times(stage: Stage, recordings: Sequence[Recording]) -> list[str]:
    """Records whose times are probably milliseconds or microseconds, in one line for all."""
    found = []
    for recording in recordings:
        rates_Hz = [axis.time.rate_Hz for name, axis in stage.axes.items() if name in recording.axes and axis.time]
        asked = [question for rate_Hz in rates_Hz if (question := times_in(recording.rate_Hz, rate_Hz))]
        if asked:
            rates = f"{recording.rate_Hz:.6g} Hz, the model at {rates_Hz[0]:.6g} Hz"
            found.append(f"{recording.source}: is sampled at {rates}; {asked[0]}")
    return [found[0] + more_like_it(len(found) - 1)] if found else []


def driven_far_beyond(stage: Stage, recordings: Iterable[Recording]) -> list[str]:
    """One line for each axis of a recording whose voltages are beyond those that its model was fitted on by more than
    half of their span: it is probably the model of another stage, or of voltages in another unit."""
    found = []
    for recording in recordings:
        for name, driven in recording.axes.items():
            view = stage.axes[name].time if name in stage.axes else None
            if view is None or driven.u_V is None or not len(driven.u_V):
                continue
            (low_V, high_V), least_V, most_V = view.u_range_V, float(driven.u_V.min()), float(driven.u_V.max())
            if max(low_V - least_V, most_V - high_V) > FAR_BEYOND * (high_V - low_V):
                found.append(
                    f"{recording.source}: axis {name} is driven with {least_V:.4g}..{most_V:.4g} V, its model was "
                    f"fitted on {low_V:.4g}..{high_V:.4g} V: is it the model of this stage?"
                )
    return found


def time_view_of(stage: Stage, axis: str) -> TimeView:
    """The time view of an axis. Raises BadInput when the stage has none."""
    view = stage.axis(axis).time
    if view is None:
        raise BadInput(f"stage {stage.name!r} has no time view for axis {axis}; fit it to recordings first")
    return view


def _chain(stage: Stage, recording: Recording, axis: str, turned_V: Sequence[float] | None) -> Chain:
    view = time_view_of(stage, axis)
    model, u = stage.axis(axis), recording.axes[axis].u_V
    assert u is not None
    if turned_V is None:
        return Chain(model, recording.t_s, u)
    return Chain(model, recording.t_s, u, start=plays_after(view, *turned_V, float(u[0])), turned_V=turned_V)


def _seen(stage: Stage, axis: str, others: Iterable[str]) -> list[Entry]:
    """The row of the coupling matrix as an effect."""
    if stage.cross_coupling is None:
        return []
    row = stage.cross_coupling[AXES.index(axis)]
    return [effect_of_shares({other: row[AXES.index(other)] for other in others})]
