"""The whole model of an axis: the time view's operator with its effects around it, in physical order.

u -> converter -> timing -> amplifier -> hysteresis operator -> hysteresis effects -> creep -> mechanics
  -> coupling -> sensor -> environment -> x

The delay (timing) is applied where the amplifier begins to lag.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import copy
from dataclasses import replace
from itertools import takewhile
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from phaselead.errors import BadInput
from phaselead.model.axis import AxisModel, TimeView
from phaselead.model.effects import (
    MODES_FROM,
    Effect,
    Entry,
    Params,
    Place,
    Signal,
    effect,
    relaxed_late,
    rewritten,
)
from phaselead.model.operator import PreparedOperator, delayed
from phaselead.record import Samples

Extra = Sequence[tuple[Effect, Params]]


def simulate(
    axis: AxisModel,
    t_s: ArrayLike,
    u_V: ArrayLike,
    *,
    others_um: Mapping[str, Samples] | None = None,
    extra: Extra = (),
    start: ArrayLike | None = None,
    turned_V: Sequence[float] | None = None,
    rng: np.random.Generator | None = None,
) -> Samples:
    """Position (n,) in um for the applied voltage ``u_V`` (n,) at the uniform, absolute times ``t_s`` (n,).

    The effects adopted in ``axis`` and those of ``extra`` act together. From rest at 0 V, or from the plays
    ``start`` (one per play, V) as a continuation that stood at ``u_V[0]`` and, where that is known, had turned round at
    ``turned_V`` (the last one last) since it left rest at 0 V. ``others_um`` are the displacements of the other axes
    from rest. With ``rng``, noise-like effects are drawn. Raises BadInput without a time view.
    """
    return Chain(axis, t_s, u_V, others_um=others_um, start=start, turned_V=turned_V, remember=0).run(extra, rng=rng)


def _view_of(axis: AxisModel) -> TimeView:
    if axis.time is None:
        raise BadInput("the axis has no time view to simulate; fit it to recordings first")
    return axis.time


class Chain:
    """One record's input through one axis, again and again with other effects.

    It keeps the last ``remember`` intermediate signals, so that changing an effect does not run again what comes
    before it in the chain.
    """

    def __init__(
        self,
        axis: AxisModel,
        t_s: ArrayLike,
        u_V: ArrayLike,
        *,
        others_um: Mapping[str, Samples] | None = None,
        start: ArrayLike | None = None,
        turned_V: Sequence[float] | None = None,
        remember: int = 16,
    ) -> None:
        view = _view_of(axis)
        self._delay_s, self._operator = view.delay_s, _operator(view)
        self._remember = remember
        self._known: dict[_Path, _Passed] = {}
        t, u = np.asarray(t_s, dtype=np.float64), np.asarray(u_V, dtype=np.float64)
        step = float(t[-1] - t[0]) / (len(t) - 1) if len(t) > 1 else 1.0
        # One row in front: how things stood before the record.
        u = np.concatenate([[0.0 if start is None else u[0]], u])
        plays = None if start is None else np.asarray(start, dtype=np.float64)
        self._continues = start is not None
        self._input = Signal(np.concatenate([[t[0] - step], t]), u, u, axis, plays_V=plays, turned_V=turned_V)
        adopted = [(effect(e.name), e.params) for e in axis.effects]
        self._adopted: list[Entry] = [(e, e.complete(params)) for e, params in adopted]
        self._adopted_links = {id(entry): _of_effect(entry) for entry in self._adopted}
        if others_um:
            self._see(others_um)

    def run(self, extra: Extra = (), *, rng: np.random.Generator | None = None) -> Samples:
        """Position (n,) in um with the adopted effects and ``extra``."""
        entries = self._entries(extra)
        return self._through(self._links(entries), entries, rng).value[1:].copy()

    def with_others(self, others_um: Mapping[str, Samples]) -> Chain:
        """The same record, and all that is known of it, with the displacements (n,) of other axes in um from rest."""
        chain = copy(self)
        chain._known = {path: value for path, value in self._known.items() if path[1].place < Place.COUPLING}
        chain._see(others_um)
        return chain

    def push(self, extra: Extra = ()) -> Signal:
        """What the actuator would do without the mechanics, slack included; one row more than the record, in front."""
        entries = self._entries(extra)
        links = [link for link in self._links(entries) if (link.step.place, link.step.order) < MODES_FROM]
        value, drive = self._through(links, entries, None)
        return replace(self._input, value=value, drive_V=drive, active=tuple(entries), pushes={})

    def with_pushes(self, pushes: Mapping[str, Signal]) -> Chain:
        """The same record, and all that is known of it, with what pushes the mechanics on every axis."""
        chain = copy(self)
        chain._known = {path: value for path, value in self._known.items() if path[1].place < Place.MECHANICS}
        chain._input = replace(self._input, pushes=pushes)
        return chain

    def _see(self, others_um: Mapping[str, Samples]) -> None:
        others = {name: np.concatenate([[x[0] if self._continues else 0.0], x]) for name, x in others_um.items()}
        self._input = replace(self._input, others_um=others)

    def signal_at(self, place: Place, extra: Extra = ()) -> Signal:
        """What one more effect at ``place`` would be given: the signal after everything up to and including it.

        Its arrays have one row more than the record, in front: how things stood before.
        """
        entries = self._entries(extra)
        links = [link for link in self._links(entries) if link.step.place <= place]
        value, drive = self._through(links, entries, None)
        return replace(self._input, value=value, drive_V=drive, active=tuple(entries))

    def _entries(self, extra: Extra) -> list[Entry]:
        """All effects with complete parameters, in physical order."""
        return sorted(rewritten([*self._adopted, *((e, e.complete(p)) for e, p in extra)]), key=_position)

    def _links(self, entries: Sequence[Entry]) -> list[_Link]:
        return _links(self._delay_s, self._operator, entries, self._adopted_links)

    def _through(self, links: Sequence[_Link], entries: Sequence[Entry], rng: np.random.Generator | None) -> _Passed:
        """The signal after ``links``; what is drawn is not kept."""
        known = self._known if rng is None else {}
        paths: list[_Path] = []
        for link in links:
            paths.append((paths[-1] if paths else None, link.step))
        passed = _Passed(self._input.value, None)
        done = next((i for i in range(len(paths), 0, -1) if paths[i - 1] in known), 0)
        for path in paths[:done]:
            if path in known:
                passed = known[path] = known.pop(path)  # the most recent is the last
        signal = self._input.among(tuple(entries), rng) if done < len(links) else self._input
        for link, path in zip(links[done:], paths[done:], strict=True):
            value = link.apply(signal.carrying(*passed))
            passed = known[path] = _Passed(value, passed.value if link.step.name == OPERATOR else passed.drive_V)
        while len(known) > self._remember:
            del known[next(iter(known))]
        return passed


OPERATOR = "operator"


class _Passed(NamedTuple):
    """The signal after a step, and the voltage at the operator once it has passed that."""

    value: Samples
    drive_V: Samples | None


class _Step(NamedTuple):
    """What a link does; equal steps and equal input give equal output."""

    name: str
    params: tuple[tuple[str, object], ...]
    place: Place
    order: int


_Path = tuple["_Path | None", _Step]
"""A step, behind the path of all steps before it."""


class _Link(NamedTuple):
    """One step of the chain and how it is done."""

    step: _Step
    apply: Callable[[Signal], Samples]


def _operator(view: TimeView) -> _Link:
    prepared = PreparedOperator(view)

    def apply(signal: Signal) -> Samples:
        return prepared.respond(signal.value, signal.carrying(signal.value, signal.value).start_plays_V)[0]

    return _Link(_Step(OPERATOR, (), Place.HYSTERESIS, 0), apply)


def _links(delay_s: float, operator: _Link, entries: Sequence[Entry], made: Mapping[int, _Link]) -> list[_Link]:
    """Every step in order, of a stage with this delay and operator. ``made``: links there are, by their entry's id.

    Delays add up. What comes before the amplifier's lags is time-invariant and sees the voltage as it runs between its
    rows, so the delay is applied behind it; applied before, it would smooth the corners at the rows.
    """
    delay_s += sum(e.dead_time_s(params) for e, params in entries if e.dead_time_s is not None)

    def links(some: Iterable[Entry]) -> list[_Link]:
        return [made.get(id(entry)) or _of_effect(entry) for entry in some]

    others = [entry for entry in entries if entry[0].dead_time_s is None]
    at_once = list(takewhile(lambda entry: entry[0].place <= Place.AMPLIFIER and entry[0].lag_s is None, others))
    lags = list(takewhile(_lags_in_amplifier, others[len(at_once) :]))
    rest = others[len(at_once) + len(lags) :]
    return [
        *links(at_once),
        _late_lags(lags, delay_s) if lags else _late(delay_s),
        *links(entry for entry in rest if entry[0].place <= Place.AMPLIFIER),
        operator,
        *links(entry for entry in rest if entry[0].place > Place.AMPLIFIER),
    ]


def _lags_in_amplifier(entry: Entry) -> bool:
    e, _ = entry
    return e.place == Place.AMPLIFIER and e.lag_s is not None


def _late(delay_s: float) -> _Link:
    def apply(signal: Signal) -> Samples:
        return delayed(signal.value, delay_s / signal.step_s, float(signal.value[0]))

    return _Link(_Step("late", (("delay_s", delay_s),), Place.AMPLIFIER, 0), apply)


def _of_effect(entry: Entry) -> _Link:
    e, params = entry
    values = {name: v if isinstance(v, (int, float)) else tuple(v) for name, v in params.items()}
    step = _Step(e.name, tuple(sorted(values.items())), e.place, e.order)
    return _Link(step, lambda signal: e.apply(signal, params))


def _late_lags(entries: Sequence[Entry], delay_s: float) -> _Link:
    """The delay and the lags right behind it in one: between rows the way of a lag is curved."""
    taus_s = tuple(e.lag_s(params) for e, params in entries if e.lag_s is not None)
    step = _of_effect(entries[0]).step

    def apply(signal: Signal) -> Samples:
        return relaxed_late(signal.value, taus_s, signal.step_s, delay_s)

    return _Link(step._replace(params=(("taus_s", taus_s), ("delay_s", delay_s))), apply)


def _position(entry: Entry) -> tuple[int, int, str]:
    """Where an effect stands in the physical chain."""
    e, _ = entry
    return e.place, e.order, e.name
