"""Moves from where the axes are to where they shall be, and holds between them: what `phaselead move` does."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

from phaselead.control.gains import GainsLike, gains_in_mode, gains_of
from phaselead.control.held import held_stage, low_gains_warning, unknown_warning
from phaselead.control.modes import NEEDS_MODEL
from phaselead.control.motion_limits import (
    WINDOW_S,
    motion_limits,
    refuse_beyond_hard_limits,
    refuse_too_fast,
    usual_duration_s,
    window_um,
)
from phaselead.control.moved import SETTLE_S, AxisMoved, Moved, Planned
from phaselead.control.run_away import advice
from phaselead.control.tracking import check_path, loop_warnings
from phaselead.device import (
    STOP_S,
    TICK_HZ,
    Device,
    MotionLimits,
    NoEdge,
    Where,
    device_model,
    inverse_refusal,
    motion,
    no_edge,
    read_limits,
    wire,
)
from phaselead.errors import BadInput, DeviceRefused, LinkError
from phaselead.model import AxisModel, Gains, Stage
from phaselead.waveforms import PEAK_SPEED, Goto, Waveform

ENGAGE_S = 0.05
"""Of the join from the output there is to holding in closed loop."""
STOP_ACCELERATION, STOP_JERK = 3.75, 30.0
"""Of a join of T seconds from a steady v to the place half a join ahead, in v/T and v/T^2; its velocity is
up to 1.18 v."""
LONGEST_S = 3600.0
"""Of a move: one that takes longer is a slip, and would be tried on its model first without a word."""
SAME_TIME = 0.01
"""Share by which a duration and a speed that are both given may differ."""

UNSTABLE = {"oscillation": "the loop is unstable", "adc_rail": "where the stage swung, the loop is unstable"}
"""By fault."""


def checked_window(um: float | None) -> float | None:
    """Raises BadInput for a window that no axis stays within."""
    if um is not None and not um > 0:
        raise BadInput(f"a window of {um:g} um: give one above 0")
    return um


@dataclass
class Mover:
    """The axes of one device while they are held and moved: ``choose`` how, ``engage``, ``move``; parking ends it."""

    device: Device
    stage: Stage | None = None
    """What it was given, and uploads."""
    known: Stage | None = None
    """That, else what the device tells of the model it holds."""
    mode: str = ""
    gains: dict[str, Gains] = field(default_factory=dict)
    gains_given: bool = False
    """They are of somebody's choice, not the stage file's or designed for its model."""
    window_um: float | None = None
    """How far off an axis may be that is on target; None: by its sensor's noise."""
    playing: dict[str, Waveform] = field(default_factory=dict)
    """Paths without an end that were begun and left running."""
    entered_tick: int = 0
    """In which the last of them had been entered."""

    @property
    def axes(self) -> str:
        """Letters of the axes that are held."""
        return "".join(sorted(self.gains))

    def model(self, axis: str) -> AxisModel | None:
        return None if self.known is None else self.known.axes.get(axis)

    def limits(self, axis: str) -> MotionLimits:
        return motion_limits(self.model(axis))

    def window(self, axis: str) -> float:
        """How far off its target it may be and is on it, um."""
        return window_um(self.model(axis)) if self.window_um is None else self.window_um

    def choose_window(self, um: float) -> None:
        """For every axis, from now on. Raises BadInput for one that no axis stays within."""
        self.window_um = checked_window(um)
        self._set_limits_if_running()

    def where(self) -> Where:
        """Where the axes are; also feeds the host timeout."""
        return motion.where(self.device)

    # ---------------------------------------------------------------- holding

    def choose(
        self,
        axes: str,
        stage: Stage | None,
        mode: str | None = None,
        gains: GainsLike | Mapping[str, GainsLike] | None = None,
        *,
        force: bool = False,
    ) -> list[str]:
        """How the axes will be held, before anything is done to the device; when it holds already, checks that it holds
        these, so. Without a stage by the model that the device holds; without a mode the best that the model allows.
        Returns what the model warns of.

        Raises BadInput, and DeviceRefused where the device cannot be armed.
        """
        now = self.where()
        if now.state == "running" and self.gains:
            self.refuse_other(axes, mode, stage)
            return [] if gains is None else self.change_gains(gains, force=force)
        if now.state not in ("parked", "armed"):
            raise DeviceRefused(f"the device is {now.state}; `phaselead park` ends that")
        held = held_stage(self.device, axes) if stage is None else None
        known = stage or held
        chosen = mode or best_mode(known, axes)
        if chosen == "open":
            raise BadInput(
                "mode open moves in volts and holds no position; use pid, ff, ff+pid, inverse or inverse+pid"
            )
        if chosen in NEEDS_MODEL and known is None:
            raise BadInput(f"mode {chosen} needs a model: --model STAGE.toml (`phaselead identify` makes one)")
        own = {axis: gains_in_mode(chosen, gains, known, axis) for axis in axes}
        for axis in axes:
            check_path(axis, _hold(now, axis), chosen, _model(known, axis))
        warnings = unknown_warning(self.device, known, chosen, gains_given=gains is not None)
        warnings += [*low_gains_warning(stage, held, chosen, own), *loop_warnings(known, chosen, own, force=force)]
        self.stage, self.known, self.mode, self.gains = stage, known, chosen, own
        self.gains_given = gains is not None
        return warnings

    def engage(self) -> None:
        """Uploads the model where the device holds another, arms, and holds the axes that were chosen where they stand.
        Nothing when they are held already."""
        state = self.where().state
        if state == "running":
            return
        self.forget_paths()
        if self.stage is not None:
            self.device.upload_if_other(device_model(self.stage))
        for axis, gain in self.gains.items():
            self.device.set_axis(axis, self.mode, **gain.sent())
            motion.hold_from_start(self.device, axis, ENGAGE_S)
        self._set_limits()
        if state == "parked":
            self.device.arm()
        self.device.start(self.axes)
        self._wait(2 * ENGAGE_S)

    def change_gains(self, gains: GainsLike | Mapping[str, GainsLike], *, force: bool = False) -> list[str]:
        """Gains of the axes that are held or follow a path, at once and without a bump; given by axis, of those alone.
        Returns what the model warns.

        Raises BadInput, and changes nothing, for a mode without feedback, and for a loop that the model cannot stand,
        unless ``force``.
        """
        own, warnings = self.other_gains(gains, force=force)
        self.take_gains(own)
        return warnings

    def other_gains(
        self, gains: GainsLike | Mapping[str, GainsLike], *, force: bool = False
    ) -> tuple[dict[str, Gains], list[str]]:
        """What ``change_gains`` would give the axes, and what the model says of it. Raises as that."""
        if not self.mode.endswith("pid"):
            raise BadInput(f"mode {self.mode} has no feedback, so no gains; park, then choose {self.mode}+pid")
        if isinstance(gains, Mapping) and (strangers := sorted(set(gains) - set(self.gains))):
            raise BadInput(f"gains for axis {strangers[0]}, which is not held; held are {self.axes}")
        kept = set(self.gains) - set(gains) if isinstance(gains, Mapping) else frozenset[str]()
        own = {a: now if a in kept else gains_of(gains, self.known, a) for a, now in self.gains.items()}
        return own, loop_warnings(self.known, self.mode, own, force=force)

    def take_gains(self, gains: Mapping[str, Gains], *, given: bool = True) -> None:
        """Gives the axes these gains, at once and without a bump; ``given``: somebody chose them."""
        for axis, gain in gains.items():
            self.device.set_gains(axis, gain)
        self.gains, self.gains_given = dict(gains), given

    def holds(self) -> bool:
        """Whether axes are held now, or follow paths."""
        return bool(self.gains) and self.where().state == "running"

    def forget_paths(self) -> None:
        """The axes begin anew: nothing plays."""
        self.playing, self.entered_tick = {}, 0

    def refuse_other(self, axes: str, mode: str | None, stage: Stage | None) -> None:
        """Raises BadInput for another mode, axis or model than those that the axes are held by."""
        if mode is not None and mode != self.mode:
            raise BadInput(f"the axes are held in mode {self.mode}; park before you choose {mode}")
        if strangers := sorted(set(axes) - set(self.gains)):
            raise BadInput(
                f"axis {strangers[0]} is not held: {self.axes} began without it; park, then name every axis that is to "
                f"move in the first move"
            )
        if stage is not None and not self.device.holds(device_model(stage)):
            raise BadInput(
                f"the axes are held by another model than {stage.name} of {stage.sha256[:12]}; park (`phaselead park`, "
                "or --park with the move before) before you choose this one"
            )

    def take_up(self, axes: str, mode: str, stage: Stage | None, gains: Mapping[str, Gains] | None) -> None:
        """Goes on with axes that are held already, with these gains; None: nobody knows them, they are taken for the
        usual ones."""
        self.stage, self.known, self.mode = stage, stage or held_stage(self.device, axes), mode
        usual = {axis: gains_in_mode(mode, None, self.known, axis) for axis in axes}
        self.gains = usual if gains is None else {axis: gains[axis] for axis in axes}
        self.gains_given = self.gains != usual

    # ---------------------------------------------------------------- moving

    def plan(
        self,
        targets: Mapping[str, float],
        *,
        relative: frozenset[str] = frozenset(),
        duration_s: float | None = None,
        speed_um_per_s: float | None = None,
    ) -> Planned:
        """The move, checked against range and limits. All axes take the time of the slowest.

        Raises BadInput: out of range, or a duration or a speed that cannot be kept, naming the shortest.
        """
        now = self.where()
        start = {axis: one.target_um if one.held else one.x_um for axis, one in now.axes.items() if axis in targets}
        target = {axis: value + (start[axis] if axis in relative else 0.0) for axis, value in targets.items()}
        way = {axis: abs(target[axis] - start[axis]) for axis in targets}
        seconds = duration_s
        if speed_um_per_s is not None:
            if not speed_um_per_s > 0:
                raise BadInput(f"a speed of {speed_um_per_s:g} um/s: give one above 0")
            seconds = max(PEAK_SPEED * max(way.values()) / speed_um_per_s, 1 / TICK_HZ)
            if duration_s is not None and abs(seconds - duration_s) > SAME_TIME * duration_s:
                raise BadInput(
                    f"a speed of {speed_um_per_s:g} um/s at its highest takes {seconds:.4g} s, not {duration_s:g} s: "
                    "give duration or speed"
                )
        if seconds is None:
            usual = (usual_duration_s(way[a], self.limits(a), self.model(a), self.mode) for a in targets)
            seconds = max(usual)
        else:
            slowest = max(targets, key=lambda axis: self.limits(axis).shortest_s(way[axis]))
            refuse_too_fast(slowest, way[slowest], seconds, self.model(slowest))
        if seconds > LONGEST_S:
            raise BadInput(f"a move of {seconds:.4g} s: give it at most {LONGEST_S:g} s, or a higher speed")
        planned = Planned(start, target, seconds)
        for axis, path in planned.paths().items():
            check_path(axis, path, self.mode, _model(self.known, axis))
        refuse_beyond_hard_limits(read_limits(self.device), target)
        return planned

    def move(
        self,
        planned: Planned,
        predicted: Mapping[str, float | None] | None = None,
        *,
        wait: bool = True,
        edge_within_s: float | None = None,
        begin_tick: int = 0,
    ) -> Moved:
        """Makes a move, behind any that is under way; waits until all axes are on target, or a second after the move.
        With ``edge_within_s`` it begins at an edge of the trigger input, which may take so long; with ``begin_tick``
        in that tick of the device.

        Raises DeviceRefused when the tick has passed or a fault ends it, NoEdge when none has come: the axes hold where
        they were.
        """
        now = self.where().axes
        joined = begin_tick > 0 and any(now[axis].moving for axis in planned.target_um)  # which may not have ended then
        segments = {
            axis: motion.move_segment(um, planned.duration_s, enter_s=STOP_S if joined else 0.0)
            for axis, um in planned.target_um.items()
        }
        edge = edge_within_s is not None
        tick = max(motion.queue(self.device, segments, at_trigger=edge, begin_tick=begin_tick), begin_tick)
        for axis in segments:
            self.playing.pop(axis, None)
        if edge_within_s is not None and wait:
            tick = self._wait_for_edge(tick, edge_within_s)
        axes = set(planned.target_um)
        found = self.where()
        if wait:
            while any(found.axes[axis].moving for axis in axes):
                found = self._next()
            end = found.tick + round(SETTLE_S * TICK_HZ)
            while not all(found.axes[axis].on_target for axis in axes) and found.tick < end:
                found = self._next()
        moved = {}
        for axis in planned.target_um:
            one = found.axes[axis]
            settled_s = (found.tick - one.near_ticks - tick) / TICK_HZ if one.on_target and not one.moving else None
            moved[axis] = AxisMoved(
                planned.start_um[axis],
                planned.target_um[axis],
                planned.duration_s,
                None if settled_s is None else max(settled_s, planned.duration_s),
                (predicted or {}).get(axis),
                one.x_um,
                self.window(axis),
            )
        return Moved(moved, wait)

    def _wait_for_edge(self, tick: int, within_s: float) -> int:
        """The tick in which what waits for the trigger input begins."""
        while not (first_tick := self.device.session.request(wire.StatusRequest()).first_tick):
            if self._next().tick > tick + within_s * TICK_HZ:
                self.hold()
                raise NoEdge(no_edge(within_s))
        return first_tick

    def hold(self, axes: str = "") -> Where:
        """Stops these axes (none: all), drops what is queued for them, and holds.

        The stop keeps the limits of acceleration and jerk. Where the axes are as fast as their limits allow it takes
        them up to a fifth faster for a moment, which the queue would refuse: its limits are lifted for this one.
        """
        seconds, axes = STOP_S, axes or self.axes
        try:
            self._queue_hold(axes, seconds)
        except DeviceRefused:
            seconds = max(stop_s(self.limits(axis)) for axis in axes)
            with self.without_limits():
                self._queue_hold(axes, seconds)
        self._wait(2 * seconds)
        while any((found := self.where()).axes[axis].moving for axis in axes):  # a join before had to end first
            self._next()
        return found

    def end_paths(self, axes: Iterable[str]) -> None:
        """Brings axes to a hold that follow paths without an end, since a move begins where an axis rests."""
        now = self.where()
        if following := [axis for axis in axes if axis in self.playing and now.axes[axis].moving]:
            self.wait_for_joins(now)
            self.hold("".join(following))

    def _queue_hold(self, axes: str, seconds: float) -> None:
        motion.queue(self.device, {axis: motion.hold_segment(seconds) for axis in axes}, at_once=True)
        for axis in axes:
            self.playing.pop(axis, None)

    @contextmanager
    def without_limits(self) -> Iterator[None]:
        """What is queued meanwhile is not held against the limits of motion."""
        self._set_limits(lifted=True)
        try:
            yield
        except LinkError:
            raise
        except BaseException:
            self._set_limits_if_running()
            raise
        self._set_limits_if_running()

    def _set_limits_if_running(self) -> None:
        if self.where().state == "running":
            self._set_limits()

    def _set_limits(self, *, lifted: bool = False) -> None:
        for axis in self.gains:
            limits = MotionLimits() if lifted else self.limits(axis)
            motion.set_motion(self.device, axis, limits, self.window(axis), WINDOW_S)

    def _next(self) -> Where:
        self.device.session.pump(64)
        found = self.where()
        if found.state != "running":
            raise DeviceRefused(
                f"the move ended in fault {found.fault}; `phaselead explain {found.fault}` says why, `phaselead park` "
                f"clears it{self._of_the_loop(found.fault)}"
            )
        return found

    def _of_the_loop(self, fault: str) -> str:
        """What to add where the fault is, or may be, that of a loop that ran away."""
        if fault not in UNSTABLE or not self.mode.endswith("pid"):
            return ""
        return f"; {UNSTABLE[fault]}: {advice(self.gains_given)}"

    def _wait(self, seconds: float) -> None:
        self.wait_until(self.where().tick + round(seconds * TICK_HZ))

    def wait_for_joins(self, now: Where) -> None:
        """Until the last paths have been entered: a join is not left."""
        if now.tick < self.entered_tick:
            self.wait_until(self.entered_tick)

    def wait_until(self, tick: int) -> None:
        """Until the device has come to this tick. Raises DeviceRefused for a fault."""
        while self._next().tick < tick:
            pass


def stop_s(limits: MotionLimits) -> float:
    """The shortest join to a hold, from the highest velocity that the limits allow, that keeps the others."""
    velocity = limits.velocity_um_per_s
    by_acceleration = (
        STOP_ACCELERATION * velocity / limits.acceleration_um_per_s2 if limits.acceleration_um_per_s2 else 0.0
    )
    by_jerk = (STOP_JERK * velocity / limits.jerk_um_per_s3) ** 0.5 if limits.jerk_um_per_s3 else 0.0
    return max(STOP_S, by_acceleration, by_jerk)


def best_mode(stage: Stage | None, axes: str) -> str:
    """inverse+pid where every axis' model has an inverse, else ff+pid where it has tables, else pid."""
    models = [_model(stage, axis) for axis in axes]
    if stage is not None and all(model.time is not None and inverse_refusal(model) is None for model in models):
        return "inverse+pid"
    return "ff+pid" if all(model.table is not None for model in models) else "pid"


def _model(stage: Stage | None, axis: str) -> AxisModel:
    return AxisModel() if stage is None else stage.axis(axis)


def _hold(now: Where, axis: str) -> Goto:
    """Where it stands, as a path of no length."""
    return replace(Goto(0.0, 0.0, "um", 1.0), offset=max(0.0, now.axes[axis].x_um))
