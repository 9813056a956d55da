"""The axes as PI's users know them: servo, target, velocity, stop. Everything here runs in the hub's thread."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from phaselead.control import Controller, GainsLike, Planned
from phaselead.device import Where
from phaselead.errors import BadInput
from phaselead.gcs.errors import Code, GcsError
from phaselead.model import Stage
from phaselead.waveforms import PEAK_SPEED, Waveform


@dataclass
class Axes:
    """The axes of one controller. The device begins and ends all of its axes together: as long as the servo of one is
    on, the others are held where they are, and take no moves."""

    dev: Controller
    letters: str
    stage: Stage | None = None
    mode: str | None = None
    gains: GainsLike | None = None
    target_um: dict[str, float] = field(default_factory=dict)
    """The last ones commanded."""
    speed_um_per_s: dict[str, float] = field(default_factory=dict)
    """Those that VEL has set."""
    waving: dict[str, Waveform] = field(default_factory=dict)
    """Waves that have not been seen to end."""
    _on: set[str] = field(default_factory=set)

    def known(self, word: str) -> str:
        """The axis of this name. Raises GcsError."""
        axis = word.lower()
        if len(axis) != 1 or axis not in self.letters:
            raise GcsError(Code.INVALID_AXIS_IDENTIFIER, f"axis {word[:40]!r}; there are {', '.join(self.letters)}")
        return axis

    def by_axis(self, groups: list[tuple[str, ...]]) -> dict[str, str]:
        """``x 1 y 2`` as words by axis, each axis once. Raises GcsError."""
        found: dict[str, str] = {}
        for word, value in groups:
            axis = self.known(word)
            if axis in found:
                raise GcsError(Code.DOUBLE_AXIS, axis)
            found[axis] = value
        return found

    # ---------------------------------------------------------------- where they are

    def where(self) -> Where:
        """Where they are; what has ended meanwhile is noted."""
        found = self.dev.where()
        if found.state != "running":
            self._on.clear()
            self.waving.clear()
            self.target_um = {axis: found.axes[axis].x_um for axis in self.letters}
        elif self.waving and not any(found.axes[axis].moving for axis in self.waving):
            ends_um = {axis: float(wave.value(0.0)) for axis, wave in self.waving.items()}
            self.waving.clear()
            self._go(ends_um)  # the device ends a path half a join beyond
            self.target_um |= ends_um
            return self.dev.where()
        return found

    def servo(self, axis: str) -> bool:
        """Whether it takes moves, as SVO? answers."""
        return axis in self._on

    def moving(self) -> int:
        """A bit for each axis under way, the first lowest."""
        found = self.where()
        return sum(found.axes[axis].moving << at for at, axis in enumerate(self.letters))

    def on_target(self, found: Where, axis: str) -> bool:
        """Of an axis whose servo is on."""
        return axis in self._on and found.axes[axis].on_target and not found.axes[axis].moving

    # ---------------------------------------------------------------- servo

    def set_servo(self, states: Mapping[str, bool]) -> None:
        """The first that is on arms the device and holds all axes where they stand; the last off parks it."""
        found = self.where()
        if any(states.values()) and found.state != "running":
            self._hold_all(found)
        self._on |= {axis for axis, on in states.items() if on}
        self._on -= {axis for axis, on in states.items() if not on}
        if not self._on and found.state == "running":
            self.dev.park()
            self.where()

    def _hold_all(self, found: Where) -> None:
        if found.state in ("fault", "armed"):
            self.dev.park()
        held = self.dev.hold(self.letters, mode=self.mode, model=self.stage, gains=self.gains)
        self.target_um = {axis: held.axes[axis].target_um for axis in self.letters}

    # ---------------------------------------------------------------- moves

    def move(self, to_um: Mapping[str, float]) -> None:
        """Begins a move of these axes to places; one under way is left for it. All that are under way arrive together.

        Raises GcsError, before anything moves: without servo, in a wave, or out of range.
        """
        found = self.where()
        if off := next((axis for axis in to_um if axis not in self._on), None):
            raise GcsError(Code.MOVE_WITHOUT_REF_OR_NO_SERVO, f"the servo of axis {off} is off: SVO {off} 1")
        if self.waving:
            raise GcsError(Code.WAVE_GENERATOR_ACTIVE)
        try:
            self._plan(to_um)
        except BadInput as error:
            raise GcsError(Code.POS_OUT_OF_LIMITS, str(error)) from None
        under_way = {axis: self.target_um[axis] for axis in self.letters if found.axes[axis].moving}
        if under_way:
            self.dev.hold()
        self._go(under_way | dict(to_um))
        self.target_um.update(to_um)

    def _plan(self, to_um: Mapping[str, float]) -> Planned:
        return self.dev.plan(x=to_um.get("x"), y=to_um.get("y"), z=to_um.get("z"))

    def _go(self, to_um: Mapping[str, float]) -> None:
        planned = self._plan(to_um)
        ways = {axis: abs(planned.target_um[axis] - planned.start_um[axis]) for axis in to_um}
        slowest_s = max(PEAK_SPEED * way / self.speed(axis) for axis, way in ways.items())
        duration_s = max(planned.duration_s, slowest_s)
        x_um, y_um, z_um = (to_um.get(axis) for axis in "xyz")
        self.dev.move(x=x_um, y=y_um, z=z_um, duration=duration_s, wait=False, rehearse=False)

    def speed(self, axis: str) -> float:
        """The highest that a move of this axis may have, um/s."""
        return self.speed_um_per_s.get(axis, self.highest_speed(axis))

    def highest_speed(self, axis: str) -> float:
        """By the limits of the stage, um/s."""
        return self.dev.motion_limits(axis, self.stage).velocity_um_per_s

    def set_speed(self, axis: str, um_per_s: float) -> None:
        """Raises GcsError for one that the stage's limits do not allow."""
        if not 0 < um_per_s <= self.highest_speed(axis) * (1 + 1e-6):
            raise GcsError(Code.VEL_OUT_OF_LIMITS, f"{um_per_s:g} um/s; at most {self.highest_speed(axis):.5g}")
        self.speed_um_per_s[axis] = um_per_s

    def stop(self, axes: str = "") -> None:
        """Stops these axes (none named: all) where they are, waves too, and holds them there. Nothing where nothing is
        held. Axes that are not named go on to their targets."""
        found = self.where()
        if found.state != "running":
            return
        stopped = set(self.waving) | set(axes or self.letters)
        held = self.dev.hold()
        others = {a: self.target_um[a] for a in self.letters if a not in stopped and found.axes[a].moving}
        self.waving.clear()
        self.target_um |= {axis: held.axes[axis].target_um for axis in self.letters if axis not in others}
        if others:
            self._go(others)

    # ---------------------------------------------------------------- waves

    def begin(self, waves: Mapping[str, Waveform], duration_s: float | None) -> None:
        """Plays paths of these axes, from where they are held, for so long or until they are stopped; the others go on
        to their targets, or stay there. Raises GcsError."""
        self.where()
        if off := next((axis for axis in waves if axis not in self._on), None):
            raise GcsError(Code.MOVE_WITHOUT_REF_OR_NO_SERVO, f"the servo of axis {off} is off: SVO {off} 1")
        if self.waving:
            raise GcsError(Code.WAVE_GENERATOR_ACTIVE)
        low = {axis: wave.lowest for axis, wave in waves.items()}
        high = {axis: wave.highest for axis, wave in waves.items()}
        for ends in (low, high):
            try:
                self._plan(ends)
            except BadInput as error:
                raise GcsError(Code.POS_OUT_OF_LIMITS, str(error)) from None
        self.dev.play(waves, duration=duration_s)
        self.waving = dict(waves)
