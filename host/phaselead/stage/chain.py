"""The whole model of an axis: the time view's operator with its effects around it, in physical order.

u -> converter -> timing -> amplifier -> hysteresis operator -> hysteresis effects -> creep -> mechanics
  -> coupling -> sensor -> environment -> x
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from phaselead.effects import catalogue, effect
from phaselead.effects.effect import Effect, Entry, Params, Place, Samples, Signal, number
from phaselead.effects.filters import relaxed_late
from phaselead.errors import BadInput
from phaselead.stage.file import AxisModel, TimeView
from phaselead.stage.operator import delayed, respond, rest_plays

Extra = Sequence[tuple[Effect, Params]]


def simulate(
    axis: AxisModel,
    t_s: ArrayLike,
    u_V: ArrayLike,
    *,
    others_um: Mapping[str, Samples] | None = None,
    extra: Extra = (),
    start: ArrayLike | None = None,
    rng: np.random.Generator | None = None,
) -> Samples:
    """Position (n,) in um for the applied voltage ``u_V`` (n,) at the uniform, absolute times ``t_s`` (n,).

    The effects adopted in ``axis`` and those of ``extra`` act together. From rest at 0 V, or from the plays
    ``start`` (one per play, V) as a continuation that stood at ``u_V[0]``. ``others_um`` are the displacements of
    the other axes from rest. With ``rng``, noise-like effects are drawn. Raises BadInput without a time view.
    """
    return Chain(axis, t_s, u_V, others_um=others_um, start=start, remember=0).run(extra, rng=rng)


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
        remember: int = 8,
    ) -> None:
        if axis.time is None:
            raise BadInput("the axis has no time view to simulate; fit it to recordings first")
        self._view: TimeView = axis.time
        self._remember = remember
        self._known: dict[tuple[_Link, ...], Samples] = {}
        t, u = np.asarray(t_s, dtype=np.float64), np.asarray(u_V, dtype=np.float64)
        step = float(t[-1] - t[0]) / (len(t) - 1) if len(t) > 1 else 1.0
        # One row in front: how things stood before the record.
        u = np.concatenate([[0.0 if start is None else u[0]], u])
        plays = rest_plays(self._view) if start is None else np.asarray(start, dtype=np.float64)
        self._continues = start is not None
        self._input = Signal(np.concatenate([[t[0] - step], t]), u, u, axis, plays_V=plays)
        self._adopted = [(effect(e.name), e.params) for e in axis.effects]
        if others_um:
            self._see(others_um)

    def run(self, extra: Extra = (), *, rng: np.random.Generator | None = None) -> Samples:
        """Position (n,) in um with the adopted effects and ``extra``."""
        entries = self._entries(extra)
        return self._through(_links(self._view, entries), entries, rng)[0][1:].copy()

    def seeing(self, others_um: Mapping[str, Samples]) -> Chain:
        """The same record, and all that is known of it, beside the displacements (n,) of other axes."""
        chain = copy(self)
        chain._known = {path: value for path, value in self._known.items() if path[-1].place < Place.COUPLING}
        chain._see(others_um)
        return chain

    def push(self, extra: Extra = ()) -> Signal:
        """What the actuator would do without the mechanics, slack included; one row more than the record, in front."""
        entries = self._entries(extra)
        links = [link for link in _links(self._view, entries) if (link.place, link.order) < MODES_FROM]
        value, drive = self._through(links, entries, None)
        return replace(self._input, value=value, drive_V=drive, active=tuple(entries), pushes={})

    def beside(self, pushes: Mapping[str, Signal]) -> Chain:
        """The same record, and all that is known of it, with what pushes the mechanics on every axis."""
        chain = copy(self)
        chain._known = {path: value for path, value in self._known.items() if path[-1].place < Place.MECHANICS}
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
        links = [link for link in _links(self._view, entries) if link.place <= place]
        value, drive = self._through(links, entries, None)
        return replace(self._input, value=value, drive_V=drive, active=tuple(entries))

    def _entries(self, extra: Extra) -> list[Entry]:
        """All effects with complete parameters, in physical order."""
        entries: Sequence[Entry] = [(e, e.complete(p)) for e, p in (*self._adopted, *extra)]
        for e, params in tuple(entries):
            if e.rewrite is not None:
                entries = e.rewrite(entries, params)
        position = {name: i for i, name in enumerate(catalogue())}
        return sorted(entries, key=lambda entry: (entry[0].place, entry[0].order, position.get(entry[0].name, -1)))

    def _through(
        self, links: Sequence[_Link], entries: Sequence[Entry], rng: np.random.Generator | None
    ) -> tuple[Samples, Samples | None]:
        """The signal after ``links``, and the voltage at the operator if they reach it."""
        signal = replace(self._input, rng=rng, active=tuple(entries))
        path: tuple[_Link, ...] = ()
        for link in links:
            path = (*path, link)
            value = self._known.pop(path, None) if rng is None else None
            if value is None:
                value = link.apply(signal)
            if rng is None and self._remember:
                self._known[path] = value  # the most recent is the last
            drive = signal.value if link.name == OPERATOR else signal.drive_V
            signal = replace(signal, value=value, drive_V=drive)
        while len(self._known) > self._remember:
            del self._known[next(iter(self._known))]
        return signal.value, signal.drive_V


OPERATOR = "operator"
MODES_FROM = (Place.MECHANICS, 1)
"""Place and order from which on effects belong to the moving structure; what comes before is the actuator's own."""


@dataclass(frozen=True)
class _Link:
    """One step of the chain; equal links and equal input give equal output."""

    name: str
    params: tuple[tuple[str, object], ...]
    place: Place
    order: int
    apply: Callable[[Signal], Samples] = field(compare=False)


def _links(view: TimeView, entries: Sequence[Entry]) -> list[_Link]:
    """Every step in order; the time view's delay and operator stand where the design has them. Delays add up: what runs
    straight between rows would be bent twice by one after the other."""
    delay_s = view.delay_s + sum(number(params, "delay_s") for e, params in entries if e.name == "delay")

    def late(signal: Signal) -> Samples:
        return delayed(signal.value, delay_s / signal.step_s, float(signal.value[0]))

    def operator(signal: Signal) -> Samples:
        return respond(view, signal.value, signal.start_plays_V)[0]

    def of_effect(entry: Entry) -> _Link:
        e, params = entry
        values = {name: v if isinstance(v, (int, float)) else tuple(v) for name, v in params.items()}
        return _Link(e.name, tuple(sorted(values.items())), e.place, e.order, lambda signal: e.apply(signal, params))

    own = [
        _Link("late", (("delay_s", delay_s),), Place.TIMING, 0, late),
        _Link(OPERATOR, (), Place.HYSTERESIS, 0, operator),
    ]
    links = [*own, *(of_effect(entry) for entry in entries if entry[0].name != "delay")]
    amplifier = next((link for link in links if link.place == Place.AMPLIFIER), None)
    if amplifier is not None and amplifier.name == "amplifier_lowpass":
        links[links.index(amplifier)] = _late_lag(amplifier, delay_s)
        links = links[1:]
    return sorted(links, key=lambda link: link.place)  # stable: the view's own come first in their place


def _late_lag(link: _Link, delay_s: float) -> _Link:
    """The delay and the amplifier's lag behind it in one: between rows the lag's way is curved."""
    params = dict(link.params)
    tau_s = number(params, "tau_s")  # type: ignore[arg-type]

    def apply(signal: Signal) -> Samples:
        return relaxed_late(signal.value, tau_s, signal.step_s, delay_s)

    return replace(link, params=(*link.params, ("delay_s", delay_s)), apply=apply)
