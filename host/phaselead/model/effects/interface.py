"""What an effect of the catalogue is: words for people, parameters with bounds for a fit, a function for the chain,
and what else the engine asks of it: how it is simulated, how it is undone, what it does to others."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeVar, cast

import numpy as np

from phaselead.errors import BadInput
from phaselead.model.axis import AxisModel, TimeView
from phaselead.model.effects.code_grid import CodeGrid, code_grid
from phaselead.model.effects.derived import Derived, Scene
from phaselead.model.effects.filters import Mode
from phaselead.model.effects.parameters import CheckedParameters, Parameter, Params, Value, number, numbers
from phaselead.model.effects.place import MODES_FROM, Place
from phaselead.model.effects.virtual import VirtualAxis
from phaselead.model.operator import range_um, rest_plays, rest_position_um
from phaselead.model.sections import Undone
from phaselead.nearest import nearest
from phaselead.record import Samples

__all__ = [
    "STOOD_OFF",
    "CheckedParameters",
    "Derived",
    "Effect",
    "Entry",
    "Parameter",
    "Params",
    "Picture",
    "Place",
    "Samples",
    "Scene",
    "Signal",
    "Value",
    "VirtualAxis",
    "columns",
    "modes_in",
    "number",
    "numbers",
    "rewritten",
    "with_columns",
]

STOOD_OFF = 0.3
"""Of its range: deviation of where a stage had stood before a record began from where it stands then, as of two places
drawn anywhere in the range: 1 / sqrt(6) apart, less as it lingers."""

T = TypeVar("T")

Entry = tuple["Effect", Params]
"""An effect and all of its parameters."""


@dataclass(frozen=True)
class Signal:
    """What an effect is given. Arrays are (n,); the voltage runs straight between rows, the times are uniform.

    The first row is how things stood for ever before: memories are settled there (``chain.simulate`` puts a row
    in front of the record, at rest or at its first voltage).
    """

    t_s: Samples
    value: Samples
    """The signal at this place of the chain: V up to AMPLIFIER, um after it."""
    u_V: Samples
    """The voltage as recorded."""
    axis: AxisModel
    others_um: Mapping[str, Samples] = field(default_factory=dict)
    """Displacement of the other axes from rest, um."""
    rng: np.random.Generator | None = None
    """With it, what no voltage predicts is drawn; without, ``apply`` gives the expectation."""
    drive_V: Samples | None = None
    """From HYSTERESIS on: the voltage that drove the hysteresis, after converter, delay and amplifier."""
    plays_V: Samples | None = None
    """Where the plays of the time view stood in the first row, were the recorded voltage at the material; None at
    rest."""
    turned_V: Sequence[float] | None = None
    """Where the recorded voltage turned round before the first row, after it left rest at 0 V, if that is known."""
    active: Sequence[Entry] = ()
    """All effects of this run."""
    pushes: Mapping[str, Signal] = field(default_factory=dict)
    """At the mechanics of a stage whose axes share modes: of every axis, this one too, what pushes them."""
    _known: dict[Callable[..., Any], Any] = field(default_factory=dict, init=False, compare=False, repr=False)
    """What is known of its axis and its recorded voltage, by what works it out; ``carrying`` shares it."""

    def _once(self, of: Callable[..., T], *given: object) -> T:
        """``of(*given)``, which depends on the axis and the recorded voltage alone."""
        if of not in self._known:
            self._known[of] = of(*given)
        return cast(T, self._known[of])

    def carrying(self, value: Samples, drive_V: Samples | None) -> Signal:
        """The same record with another signal in it: ``dataclasses.replace`` for the many runs of a search."""
        other = object.__new__(Signal)
        other.__dict__.update(self.__dict__, value=value, drive_V=drive_V)
        return other

    def among(self, active: Sequence[Entry], rng: np.random.Generator | None) -> Signal:
        """The same signal in a run with these effects."""
        other = self.carrying(self.value, self.drive_V)
        other.__dict__.update(active=active, rng=rng)
        return other

    @property
    def step_s(self) -> float:
        """Time between rows."""
        return float(self.t_s[-1] - self.t_s[0]) / (len(self.t_s) - 1) if len(self.t_s) > 1 else 1.0

    @property
    def since_s(self) -> Samples:
        """Times (n,) since the record began: 0 in its first row and in the one in front of it."""
        return np.asarray(np.maximum(self.t_s - self.t_s[min(1, len(self.t_s) - 1)], 0.0))

    @property
    def driven_V(self) -> Samples:
        """The voltage at the hysteresis."""
        return self.u_V if self.drive_V is None else self.drive_V

    @property
    def field_V(self) -> Samples:
        """The field that the hysteresis answers to, in volts of an even one."""
        return self.axis.time.field.of(self.driven_V) if self.axis.time is not None else self.driven_V

    @property
    def start_plays_V(self) -> Samples:
        """Positions of the time view's plays in the first row: about the field that the hysteresis stood at, which a
        rail keeps off that of the recorded voltage."""
        view = self.axis.time
        if view is None:
            return np.zeros(0)
        offset_V = view.field.at(self.driven_V[0]) - view.field.at(self.u_V[0])
        return offset_V + (rest_plays(view) if self.plays_V is None else self.plays_V)

    @property
    def rest_um(self) -> float:
        """Position at rest at 0 V, of the base model."""
        return self._once(rest_position_um, self.axis.time) if self.axis.time is not None else 0.0

    @property
    def range_um(self) -> float:
        """Quasi-static travel over the voltages the base was fitted on: what "of range" means."""
        return self._once(range_um, self.axis)

    @property
    def code_grid(self) -> CodeGrid:
        """Which codes of the output converter the recorded voltages belong to."""
        return self._once(code_grid, self.axis.actuator, self.u_V)

    @property
    def displacement_um(self) -> Samples:
        """From rest."""
        return self.value - self.rest_um

    @property
    def span_V(self) -> tuple[float, float]:
        """The voltages the base was fitted on."""
        view = self.axis.time
        return view.u_range_V if view is not None else (self.axis.limits.u_min_V, self.axis.limits.u_max_V)

    @property
    def drive_share(self) -> Samples:
        """The voltage at the hysteresis, -1..1 over the voltages the base was fitted on."""
        low, high = self.span_V
        return (2 * self.driven_V - (low + high)) / (high - low)


@dataclass(frozen=True)
class PartOf:
    """An effect that may have this one as a part of it."""

    effect: str
    up_to: float
    """Size up to which the part is expected there. A size alone is no evidence, so up to it the two are tied."""


@dataclass(frozen=True)
class InPlaceOf:
    """A change of what the model has, in whose place an effect of its own can stand."""

    effect: str
    """Name of the one that makes such changes."""
    apart: Callable[[Params, Sequence[Mode]], float]
    """How far, as the logarithm of a ratio of frequencies, the effect is from standing in the place of one of the modes
    that the model has: 0 is there, infinite where it can be in the place of none."""


ModePart = Literal["own path", "coupling", "level"]
"""Of modes that axes share: what an actuator does at its own axis, at the others, and how its level moves the modes."""

Loops = Literal["loop", "loops", "difference"]
Times = Literal["sine", "holds", "steps", "idle", "line", "ramp", "neighbour"]
PictureView = Loops | Times | Literal["response", "level"]


@dataclass(frozen=True)
class Picture:
    """The small figure on the effect's page: which experiment, at which (exaggerated) size, on which base."""

    view: PictureView
    params: Params
    base: Literal["linear", "plays", "mode"] = "linear"


def _as_given(params: Params) -> Params:
    return params


@dataclass(frozen=True)
class Effect:
    """One physical effect. ``apply(signal, params)`` returns the signal with the effect, same shape.

    kind: "response" (a voltage predicts it), "calibration" (a constant that differs from session to session) or
    "disturbance" (no voltage predicts it).
    """

    name: str
    title: str
    place: Place
    equation: str
    source: str
    parameters: tuple[Parameter, ...]
    shows: str
    reveals: str
    confused_with: tuple[str, ...]
    compensation: str
    apply: Callable[[Signal, Params], Samples]
    picture: Picture
    kind: Literal["response", "disturbance", "calibration"] = "response"
    order: int = 0
    """Within its place, rising."""
    listed: int = 1000
    """Its place where effects are listed or tried one after the other, rising; the last by default."""
    peak: tuple[str, str] | None = None
    """Of a single sharp mode: the names of its frequency in Hz and of its damping ratio."""
    rising: tuple[str, ...] = ()
    """Shape parameters whose values rise in this order."""
    at_once: Callable[[Params], bool] | None = None
    """Whether ``apply`` with these parameters also takes several signals at once, a value of (n, k); None is never."""
    exact: bool = False
    """Whether its equation is its definition, so that only its parameters can be wrong: a rail, a dead time, a
    factor."""
    becomes_plays: bool = False
    """Whether a base model without memory takes it up as plays of its own, fitted anew."""
    of_base: bool = False
    """Whether it belongs to the operator that ``phaselead fit`` finds: told from plays by all of them together, and by
    no size of its own."""
    slow: bool = False
    """Whether it moves the position for seconds to hours after the voltage has stopped: over whole records, and before
    they began."""
    before_record: Callable[[Samples, Params, AxisModel], Samples] | None = None
    """Columns (n, m) at times (n,) since a record began: what the states of an effect that stood off then still do, one
    prior deviation each, in V up to AMPLIFIER and in um after it. A stage stood anywhere in its range before."""
    began_with: Callable[[Signal, Params], Samples] | None = None
    """Columns (n, m) in um over the rows of a signal: what its memory of another way before the first row would do, one
    prior deviation each."""
    basis: Callable[[Signal, Params], Samples] | None = None
    """(n, sizes) columns whose sum with the size parameters (in order) is exactly what ``apply`` adds, given shapes."""
    variance: Callable[[Signal, Params], Samples] | None = None
    """(n,) um^2 that it adds to the noise at each row."""
    spectrum: Callable[[Samples, Params, float], Samples] | None = None
    """One-sided density in um^2/Hz at frequencies (m,) in Hz, for a sampling rate in Hz."""
    rewrite: Callable[[Sequence[Entry], Params], Sequence[Entry]] | None = None
    """Changes the parameters of other effects of the run instead of adding anything itself."""
    accepts: tuple[str, ...] = ()
    """Parameters of another form that stage files may use, turned into ``parameters`` or understood by ``apply``."""
    normalise: Callable[[Params], Params] = _as_given
    """From the accepted forms to the one that ``apply`` takes."""
    untestable: Callable[[Signal], str | None] | None = None
    """Why this axis cannot show it whatever the data, or None."""
    derived: tuple[Derived, ...] = ()
    """Sizes that follow from its parameters and mean more to a person: reported beside them, never fitted."""
    alone_as: str | None = None
    """The effect that stands for it where one axis alone is seen, which cannot tell the two apart; None: itself."""
    part_of: PartOf | None = None
    """The effect of which it is a part; None where it is no part of another."""
    in_place_of: InPlaceOf | None = None
    """What the effect may be in the place of; None where it takes away nothing that the model has."""
    reads: Callable[[Params, AxisModel], str] | None = None
    """Its parameters as a person would say them, where the names do not; empty where there is nothing to say."""

    seen_as: Literal["lines", "band", "grid", "speed"] | None = None
    """How the gap finds a disturbance: lines at the mains, a band of the spectrum, a grid of values, noise that grows
    with speed; None where it has no test of that kind."""
    moves_zero: Literal["at once", "steadily"] | None = None
    """How it moves the zero from one session to the next; None where it does not."""
    shared_modes: ModePart | None = None
    """Which part of the modes that the axes of a stage share it describes, if any."""
    fitted_with_modes: bool = False
    """Whether it is fitted together with modes that axes share and their softening, on each axis: its first size, and
    its shapes."""
    absorbed_by_modes: bool = False
    """Whether modes fitted to axes that move together take it up, so that such records cannot show it."""
    hard_to_tell_from: tuple[str, ...] = ()
    """Effects that trials showed to be hard to tell from it, besides ``confused_with``: a tie with them is honest."""

    fixed: Mapping[str, float] = field(default_factory=dict)
    """Parameters that are not asked for, and their values."""

    # What it does to the rest of a run.
    dead_time_s: Callable[[Params], float] | None = None
    """In s, of an effect that is a dead time and nothing else: all of a run are taken in one."""
    lag_s: Callable[[Params], float] | None = None
    """Time constant in s, of an effect that is a first-order lag and nothing else: right behind the dead time both are
    taken in one."""
    lag_in_loop_s: Callable[[Params], float] | None = None
    """Time constant in s of the first-order lag that feedback sees, wherever it sits."""
    plays: Callable[[Signal, Params], tuple[Samples, Samples, Samples]] | None = None
    """Thresholds in V, weights in um/V and first positions in V, each (m,), of the plays that it adds to the
    hysteresis."""
    modes: Callable[[Params], Sequence[Mode]] | None = None
    """The modes of the mechanics that it adds. What passes them has no corners."""
    from_modes: Callable[[Sequence[Mode]], dict[str, float | tuple[float, ...]]] | None = None
    """The parameters that add these modes. One effect of the catalogue has it: fitted modes are adopted as that one."""
    from_shares: Callable[[Mapping[str, float]], Params] | None = None
    """The parameters that add these shares of the motion of other axes, by their names. One effect of the catalogue has
    it: the stage file's coupling matrix acts through that one."""

    from_fading: Callable[[Samples, Samples, AxisModel], Params] | None = None
    """The parameters that add fading plays of thresholds (m,) in V and weights (m,) in um/V to the time view of an
    axis. One effect of the catalogue has it: what a fit finds is adopted as that one."""

    # How a virtual stage has it, tick by tick.
    virtual: Callable[[VirtualAxis, CheckedParameters], None] | None = None
    """Tells a virtual axis which parts to add; None: the simulator refuses a stage with it."""
    repeatable: bool = False
    """Whether a virtual stage may have it more than once: one acts after the other."""

    # How the device undoes it; an effect with none of these, and no ``rewrite``, is left to feedback.
    into_time_view: Callable[[AxisModel, TimeView, Params], TimeView] | None = None
    """The time view with what it can express of the effect; the device leaves the rest. The axis is the one that sizes
    "of range" refer to."""
    creep_terms: Callable[[Params], tuple[Samples, Samples]] | None = None
    """k and tau_s, each (m,), of the slow lags that it adds to the position: the device has their inverse."""
    undo_on_drive: Callable[[Params], Undone] | None = None
    """Sections on the voltage that undo it."""
    undo_on_position: Callable[[Params], Undone] | None = None
    """Sections on the position asked for that undo it. Raises BadInput when there is no stable inverse."""
    coupling: Callable[[Params, str], float] | None = None
    """Share of the motion of the axis of that name that it adds to this one at rest: the device decouples it."""

    @property
    def is_lag(self) -> bool:
        """Whether it is a dead time or a first-order lag and nothing else, wherever it sits."""
        return any(one is not None for one in (self.dead_time_s, self.lag_s, self.lag_in_loop_s))

    @property
    def compensated(self) -> bool:
        """Whether the controller does anything about it once a model with it is uploaded."""
        inverses = (self.into_time_view, self.creep_terms, self.undo_on_drive, self.undo_on_position, self.coupling)
        return self.rewrite is not None or any(inverse is not None for inverse in inverses)

    def for_refitted_base(self) -> Effect:
        """The effect without the parameters that a base refitted together with it takes over: they stay as when left
        out."""
        return self._without([p for p in self.parameters if p.absorbed_by_refit])

    def beside_modes(self, count: int) -> Effect:
        """The effect without the parameters that change nothing in a model of so few modes."""
        return self._without([p for p in self.parameters if p.needs_modes > count])

    def _without(self, left_out: Sequence[Parameter]) -> Effect:
        asked = tuple(p for p in self.parameters if p not in left_out)
        return replace(self, parameters=asked, fixed={**self.fixed, **{p.name: p.left_out for p in left_out}})

    def as_known(self) -> Effect:
        """The effect with the bounds of what is known of stages."""
        return replace(self, parameters=tuple(p.as_known() for p in self.parameters))

    def as_sampled(self, highest_Hz: float) -> Effect:
        """The effect with no frequency above what a sampling can show."""
        return replace(self, parameters=tuple(p.as_sampled(highest_Hz) for p in self.parameters))

    @property
    def before_modes(self) -> bool:
        """Whether it acts on what the actuator gives to the moving structure, in front of every mode."""
        return (self.place, self.order) < MODES_FROM

    @property
    def sizes(self) -> tuple[Parameter, ...]:
        """The parameters that make it vanish when all are 0."""
        return tuple(p for p in self.parameters if p.role == "size")

    @property
    def shapes(self) -> tuple[Parameter, ...]:
        """The others."""
        return tuple(p for p in self.parameters if p.role == "shape")

    @property
    def typical(self) -> dict[str, float]:
        """Every parameter at its typical value."""
        return {p.name: p.typical for p in self.parameters}

    def parameter(self, name: str) -> Parameter:
        """One parameter by name; BadInput when there is none."""
        for p in self.parameters:
            if p.name == name:
                return p
        raise BadInput(f"effect {self.name!r} has no parameter {name}; it has {self._known()}")

    def complete(self, params: Params) -> Params:
        """``params`` in the form ``apply`` takes: sizes left out are 0, shapes left out typical.

        Raises BadInput on an unknown name.
        """
        known = {p.name for p in self.parameters} | set(self.accepts)
        unknown = sorted(set(params) - known)
        if unknown:
            raise BadInput(f"effect {self.name!r}: unknown parameter {', '.join(unknown)}; it has {self._known()}")
        given = self.normalise(params)
        if set(given) & set(self.accepts):
            return given
        return {**self.fixed, **{p.name: p.left_out for p in self.parameters}, **given}

    @property
    def has_free_sizes(self) -> bool:
        """Whether fits write it that know physical bounds alone: its ranges are those of a search, not of stages."""
        writers = (self.from_modes, self.from_fading, self.from_shares, self.lag_s, self.shared_modes)
        return self.fitted_with_modes or any(writer is not None for writer in writers)

    def fault_of(self, name: str, value: Value) -> str | None:
        """What is wrong with a value that is given for one of its parameters; None where it may be."""
        found = next((p for p in self.parameters if p.name == name), None)
        if found is None:
            if name in self.accepts:
                return None
            known = [*(p.name for p in self.parameters), *self.accepts]
            return f"is no parameter of {self.name}; {nearest(name, known, 'it has')}"
        low, high = found.low, found.high
        if self.has_free_sizes:
            low, high = 0.0 if low >= 0 else -math.inf, math.inf
        for one in value if isinstance(value, Sequence) else (value,):
            if not low <= one <= high and not math.isclose(one, low) and not math.isclose(one, high):
                bounds = f"at least {low:g}" if high == math.inf else f"{low:g}..{high:g}"
                return f"= {one:g} is out of range; {self.name} takes {bounds} ({found.unit})"
        return None

    def _known(self) -> str:
        return ", ".join([p.name for p in self.parameters] + [f"({name})" for name in self.accepts])


def rewritten(entries: Sequence[Entry]) -> list[Entry]:
    """The effects of a run after each has changed the parameters of the others (``Effect.rewrite``)."""
    found = entries
    for e, params in entries:
        if e.rewrite is not None:
            found = e.rewrite(found, params)
    return list(found)


def modes_in(entries: Sequence[Entry]) -> list[Mode]:
    """The modes of the mechanics that some effects add, with the parameters that they are given."""
    return [mode for e, params in entries if e.modes is not None for mode in e.modes(params)]


def columns(*of_rows: Samples) -> Samples:
    """(n,) arrays side by side, (n, k), each contiguous in memory."""
    return np.asarray(np.stack(of_rows).T)


def with_columns(signal: Signal, added: Samples, params: Params, *sizes: str) -> Samples:
    """The signal and ``added`` (n, len(sizes)) times the parameters ``sizes``."""
    return np.asarray(signal.value + added @ np.array([number(params, name) for name in sizes]))
