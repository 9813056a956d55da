"""What a device watches over and keeps by itself: hard limits, the fault log, the recorder that is always on."""

from __future__ import annotations

from phaselead.device import (
    AxisLimits,
    Device,
    FaultLog,
    Limits,
    Trigger,
    pull,
    read_fault_log,
    read_limits,
    set_limits,
    set_trigger,
)
from phaselead.errors import BadInput
from phaselead.record import Recording, parse_axes
from phaselead.result import Facts


class Supervision:
    """The part of a controller that speaks of what the device watches and keeps."""

    device: Device

    def limits(self) -> Limits:
        """The hard limits that the device keeps in its own flash, whatever the model; prints as a table.

        >>> import phaselead as pl
        >>> with pl.connect() as dev:
        ...     limits = dev.set_limits("x", u_min_V=0, u_max_V=8, slew_V_per_s=500)
        >>> limits["x"].u_max_V
        8.0
        """
        return read_limits(self.device)

    def set_limits(
        self,
        axis: str = "x",
        *,
        u_min_V: float | None = None,
        u_max_V: float | None = None,
        slew_V_per_s: float | None = None,
        x_min_um: float | None = None,
        x_max_um: float | None = None,
        remove: bool = False,
    ) -> Limits:
        """Sets hard limits of an axis, or of several ("x,y"), and keeps them in the device's flash; while parked. Gives
        those of all axes.

        What is left out stays as it is; with ``remove`` it is no longer limited. Raises BadInput for limits that make
        no sense, DeviceRefused when the device is armed, or its output or safe value is outside of them.
        """
        given = AxisLimits(u_min_V, u_max_V, slew_V_per_s, x_min_um, x_max_um)
        if not given and not remove:
            raise BadInput("set_limits without a limit changes nothing; give one, or remove=True")
        return set_limits(self.device, "".join(parse_axes(axis, "axis")), given, keep_others=not remove)

    def fault_log(self) -> FaultLog:
        """The last 16 faults, those before the last resets included; prints as a table.

        >>> import phaselead as pl
        >>> with pl.connect() as dev:
        ...     print(dev.fault_log())
        power cycle 1; no fault so far
        """
        return read_fault_log(self.device)

    def trigger(
        self,
        on: str = "fault",
        *,
        axis: str = "x",
        above_um: float | None = None,
        below_um: float | None = None,
        every: int = 1,
        after: float = 0.25,
    ) -> Facts:
        """Chooses what freezes the transient recorder, which keeps the last 80 ms of all axes at any time.

        A fault always does. ``on``: "fault" (nothing else), "set_point" (a path begins), "input" (the interlock's
        line opens), or "threshold": the position of ``axis`` rises above ``above_um`` or falls below ``below_um``.
        ``every=10`` keeps each tenth tick, and so 0.8 s; ``after`` is the share of it after the trigger. Gives
        ``before_s`` and ``after_s``. Raises BadInput for what makes no sense.

        >>> import phaselead as pl
        >>> with pl.connect() as dev:
        ...     facts = dev.trigger("threshold", axis="x", above_um=30)
        ...     run = dev.track("sine:60um@5Hz", mode="pid", duration=0.4)
        ...     seen = dev.pull()
        >>> bool(seen.ux_V.shape == (400,))
        True
        """
        return set_trigger(self.device, Trigger(on, axis, above_um, below_um, every, after))

    def pull(self, *, keep: bool = False) -> Recording:
        """What the transient recorder froze, all axes; t_s = 0 is the trigger. It then waits for the next fault, unless
        ``keep``. Raises DeviceRefused when nothing is frozen."""
        return pull(self.device, keep=keep)
