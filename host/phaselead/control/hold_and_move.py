"""The part of a controller that holds its axes and moves them from place to place."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

from phaselead.control.gains import GainsLike
from phaselead.control.held import held_stage
from phaselead.control.keep_alive import HOST_TIMEOUT_S, KeepAlive
from phaselead.control.motion_limits import motion_limits, reach_um
from phaselead.control.move_rehearsal import rehearse_move
from phaselead.control.moved import Moved, Planned
from phaselead.control.moving import Mover, checked_window
from phaselead.control.targets import Target, parse_target
from phaselead.control.triggers import parse_outputs
from phaselead.device import (
    TICK_HZ,
    AxisWhere,
    Device,
    LeftRunning,
    MotionLimits,
    Where,
    read_limits,
    recall,
    remember,
    set_outputs,
)
from phaselead.errors import BadInput, DeviceRefused
from phaselead.model import AxisModel, Gains, Stage, StageLike, as_stage
from phaselead.quantity import IN_SECONDS, UM, UM_PER_S, Quantity, quantity

TargetLike = float | str


class HoldsAndMoves:
    """``move``, ``hold``, ``where`` and the axes ``x``, ``y``, ``z`` of a controller."""

    device: Device
    model: Stage | None
    """The model last uploaded: ``track`` and ``move`` use it unless they are given another."""

    def __init__(self, device: Device) -> None:
        self.device = device
        self.model = None
        self._mover = Mover(device)
        self._alive = KeepAlive(device.session)
        self._left: LeftRunning | None = None

    @property
    def x(self) -> Axis:
        """Axis x: ``dev.x.move(80)``."""
        return Axis(self, "x")

    @property
    def y(self) -> Axis:
        """Axis y."""
        return Axis(self, "y")

    @property
    def z(self) -> Axis:
        """Axis z."""
        return Axis(self, "z")

    def where(self) -> Where:
        """Where the axes are, in um and V, and whether they are on target; prints as a table."""
        return self._mover.where()

    def move(
        self,
        *,
        x: TargetLike | None = None,
        y: TargetLike | None = None,
        z: TargetLike | None = None,
        mode: str | None = None,
        model: StageLike | None = None,
        gains: GainsLike | Mapping[str, GainsLike] | None = None,
        duration: Quantity | None = None,
        speed: Quantity | None = None,
        window: Quantity | None = None,
        wait: bool = True,
        rehearse: bool = True,
        force: bool = False,
        trigger_out: str | None = None,
        trigger_in: Quantity | None = None,
        begin_tick: int = 0,
        on_planned: Callable[[Planned, Mapping[str, float | None]], None] | None = None,
    ) -> Moved:
        """Moves the axes together and holds them there; the next move begins where this one ended, without parking.

        A number is a place in um, so is "50um"; "+5um" and "-5um" are relative to the last target. The first move arms
        the device and decides ``mode`` (default: the best the model allows), ``model`` (default: the one last uploaded,
        else what the device holds) and ``gains``; it holds every axis of a model that is given. All axes take the same
        time: ``duration`` in s ("50ms"), or ``speed`` at its highest in um/s, or as fast as the model's limits allow.
        An axis is on target that stays within ``window`` of it, in um ("50nm"; default: five deviations of its sensor's
        noise and half a code); it counts until another is given. ``wait=False`` returns at once; a further move is
        queued behind.
        Between two calls the device is kept alive; it parks when the session ends, or a second after the program was
        killed. An axis that follows a path of ``play`` is first brought to a hold. ``trigger_out`` ("start",
        "target", "pixel=0.5um", "pixel=2ms"; as for ``track``) counts for later moves too, until another is
        given, or "none". ``trigger_in``: it begins at a rising edge of the trigger input, which is waited for
        so many seconds. ``begin_tick``: it begins in that tick of the device, which ``where().tick`` counts,
        5000 a second; a move that is under way then is left by a join of 20 ms.

        The move runs on a model that is given first, unless ``rehearse`` is False or another move is under way;
        ``on_planned`` is given the plan and the seconds until each axis will have settled, before it starts.
        Raises BadInput, before anything moves, for a target out of range, a duration or speed that cannot be kept
        (naming the shortest), or a fault on the model; DeviceRefused when a fault ends it.

        >>> import phaselead as pl
        >>> with pl.connect() as dev:
        ...     first = dev.move(x=40)
        ...     second = dev.x.move("+5um", duration=0.05)
        >>> second.axes["x"].to_um, abs(second.axes["x"].x_um - 45) < 0.5
        (45.0, True)
        """
        targets, edge_within_s = _targets(x, y, z), quantity("trigger_in", trigger_in, IN_SECONDS)
        mover = self._choose(targets, mode, model, gains, force=force)
        planned = _plan(mover, targets, duration, speed)
        window_um = checked_window(quantity("window", window, UM))
        pulses = parse_outputs(trigger_out, planned.paths())
        idle = not any(one.moving for one in mover.where().axes.values())
        predicted = rehearse_move(mover, planned, window_um) if rehearse and idle and not force else {}
        if on_planned is not None:
            on_planned(planned, predicted)
        if window_um is not None:
            mover.choose_window(window_um)
        self._engage()
        if pulses is not None:
            set_outputs(self.device, pulses)
        if begin_tick == 0:
            mover.end_paths(targets)
        planned = _plan(mover, targets, duration, speed)
        return mover.move(planned, predicted, wait=wait, edge_within_s=edge_within_s, begin_tick=begin_tick)

    def plan(
        self,
        *,
        x: TargetLike | None = None,
        y: TargetLike | None = None,
        z: TargetLike | None = None,
        duration: Quantity | None = None,
        speed: Quantity | None = None,
    ) -> Planned:
        """The move that ``move`` would make of axes that are held, without making it: where each begins and ends, and
        how long all of them take. Raises as ``move`` does.

        >>> import phaselead as pl
        >>> with pl.connect() as dev:
        ...     held = dev.hold()
        ...     planned = dev.plan(x=40, speed=500)
        >>> planned.target_um["x"], round(planned.duration_s, 2)
        (40.0, 0.15)
        """
        return _plan(self._mover, _targets(x, y, z), duration, speed)

    def hold(
        self,
        axes: str = "",
        *,
        mode: str | None = None,
        model: StageLike | None = None,
        gains: GainsLike | Mapping[str, GainsLike] | None = None,
    ) -> Where:
        """Stops every axis that is held, within its limits, drops the moves that wait, and goes on holding.

        A device that is not moving yet is armed, and holds where it stands: ``axes`` ("xyz") and those of a model, else
        x; ``mode``, ``model`` and ``gains`` as for ``move``. Raises as ``move`` does.
        """
        if not self._mover.holds():
            self._choose(axes, mode, model, gains)
            self._engage()
        return self._mover.hold()

    def set_gains(self, gains: GainsLike | Mapping[str, GainsLike], *, force: bool = False) -> None:
        """Other gains for the axes that are held, move or play, without a stop: the output goes on from where it is.

        ``gains`` as for ``move``, filters included where they come from a model. Raises BadInput, and changes nothing,
        for a mode without feedback and for gains whose loop on the model has a peak sensitivity above 6, unless
        ``force``; above 3 it warns. DeviceRefused where no axis is held.

        >>> import phaselead as pl
        >>> with pl.connect() as dev:
        ...     moved = dev.move(x=40)
        ...     dev.set_gains("paper")
        ...     held = dev.where()
        >>> held.x.held
        True
        """
        if not self._mover.holds():
            raise DeviceRefused("no axis is held; gains are given with the first move, or with a path")
        for line in self._mover.change_gains(gains, force=force):
            warnings.warn(line, stacklevel=2)

    def motion_limits(self, axis: str, model: StageLike | None = None) -> MotionLimits:
        """How fast a move of this axis may be: by ``model``, else the one last uploaded, else what the device holds."""
        return motion_limits(self._known(axis, model).get(axis))

    def range_um(self, axis: str) -> tuple[float, float]:
        """The lowest and the highest place in um that a move of this axis may have for its target: by the sensor, what
        the model reaches in the mode that holds it (before it is held: in any), and the device's hard limits.

        >>> import phaselead as pl
        >>> with pl.connect() as dev:
        ...     print(dev.range_um("x"))
        (-10.0, 270.0)
        """
        model = self._known(axis).get(axis, AxisModel())
        low, high = reach_um(self._mover.mode if self._mover.gains else None, model)
        hard = read_limits(self.device)[axis]
        return max(low, hard.x_min_um if hard.x_min_um is not None else low), min(
            high, hard.x_max_um if hard.x_max_um is not None else high
        )

    def leave_running(self, model_path: str | os.PathLike[str] | None = None) -> None:
        """Ends this program's part and leaves the axes held, without a host and without its timeout. A later
        ``connect(..., resume=True)`` on this computer goes on with it; `phaselead park` ends it. A virtual stage ends
        with its program. ``model_path``: the stage file the axes are held by.
        """
        mover, session = self._mover, self.device.session
        self._alive.end()
        self.device.set_timeout(0)
        self.device.park_on_exit = False
        before = recall(session.name)
        kept = before.model if before is not None and before.nonce == session.nonce else None
        path = kept if model_path is None else os.path.abspath(model_path)
        gains = {axis: own.model_dump(mode="json") for axis, own in mover.gains.items()}
        self._left = LeftRunning(session.nonce, session.last_id, mover.mode, mover.axes, path, gains)
        self._note_left()

    def _note_left(self) -> None:
        """How far the requests of a session have come that goes on without this program."""
        if self._left is not None:
            remember(self.device.session.name, replace(self._left, last_id=self.device.session.last_id))

    def take_up(self, left: LeftRunning) -> None:
        """Goes on with a session that was left running; forgets it when the device is parked meanwhile."""
        if self._mover.where().state != "running":
            remember(self.device.session.name, None)
            return
        self._left = left
        self.model = None if left.model is None else as_stage(left.model)
        self._mover.take_up(left.axes, left.mode, self.model, _gains_of(left))
        self.device.take_over(left.axes, left.mode)

    def watch_over(self) -> None:
        """What drives the axes from now on needs this program: when that is killed, the device parks by itself, also of
        a session that was left running without a host."""
        self._alive.begin()
        if self.resumed:
            self.device.set_timeout(round(HOST_TIMEOUT_S * TICK_HZ))

    def let_go(self) -> None:
        """The device is parked: nothing is held any more, nor left to a later program."""
        self._alive.end()
        self._left = None
        remember(self.device.session.name, None)

    @property
    def resumed(self) -> bool:
        """Whether axes are held that a program before this one left held."""
        return self._left is not None

    def _known(self, axis: str, model: StageLike | None = None) -> Mapping[str, AxisModel]:
        """Models by axis: those given, those that hold the axes, those last uploaded, those that the device holds."""
        if model is not None:
            return as_stage(model).axes
        known = self._mover.known if self._mover.gains else self.model or held_stage(self.device, axis)
        return {} if known is None else known.axes

    def _choose(
        self,
        named: Iterable[str],
        mode: str | None,
        model: StageLike | None,
        gains: GainsLike | Mapping[str, GainsLike] | None,
        *,
        force: bool = False,
    ) -> Mover:
        stage = self.model if model is None else as_stage(model)
        held = self._mover.gains if self._mover.holds() else None
        with_them = set(stage.axes if stage is not None else ()) if held is None else set(held)
        axes = "".join(sorted(set(named) | with_them)) or "x"
        for line in self._mover.choose(axes, stage, mode, gains, force=force):
            warnings.warn(line, stacklevel=4)
        self.model = stage
        return self._mover

    def _engage(self) -> None:
        self._mover.engage()
        self._alive.begin()


def _gains_of(left: LeftRunning) -> dict[str, Gains] | None:
    """Those that the axes of a session have; None where it does not say."""
    try:
        return {axis: Gains.model_validate((left.gains or {})[axis]) for axis in left.axes}
    except (KeyError, ValueError):
        return None


def _targets(*values: TargetLike | None) -> dict[str, Target]:
    """Of x, y, z, those that are given. Raises BadInput."""
    targets = {axis: parse_target(value) for axis, value in zip("xyz", values, strict=True) if value is not None}
    if not targets:
        raise BadInput('where to? e.g. move(x=80), move(x="+5um", y=20)')
    return targets


def _plan(mover: Mover, targets: Mapping[str, Target], duration: Quantity | None, speed: Quantity | None) -> Planned:
    return mover.plan(
        {axis: target.um for axis, target in targets.items()},
        relative=frozenset(axis for axis, target in targets.items() if target.relative),
        duration_s=quantity("duration", duration, IN_SECONDS),
        speed_um_per_s=quantity("speed", speed, UM_PER_S),
    )


@dataclass(frozen=True)
class Axis:
    """One axis of a controller."""

    of: HoldsAndMoves
    name: str

    def move(
        self,
        target: TargetLike,
        *,
        duration: Quantity | None = None,
        speed: Quantity | None = None,
        wait: bool = True,
    ) -> Moved:
        """Moves this axis to a place in um, or by "+5um", and holds it there; as ``Controller.move``."""
        to: dict[str, TargetLike] = {self.name: target}
        return self.of.move(x=to.get("x"), y=to.get("y"), z=to.get("z"), duration=duration, speed=speed, wait=wait)

    def where(self) -> AxisWhere:
        """Where it is, and where it goes."""
        return self.of.where().axes[self.name]

    def hold(self) -> AxisWhere:
        """Stops every axis and holds; where this one is then."""
        return self.of.hold().axes[self.name]
