"""What a device watches over and keeps by itself, from Python: hard limits, the fault log."""

from __future__ import annotations

from phaselead.device import AxisLimits, Device, FaultLog, Limits, read_fault_log, read_limits, set_limits
from phaselead.errors import BadInput


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
        """Sets hard limits of one axis and keeps them in the device's flash; while parked. Gives those of all axes.

        What is left out stays as it is; with ``remove`` it is no longer limited. Raises BadInput for limits that make
        no sense, DeviceRefused when the device is armed, or its output or safe value is outside of them.
        """
        given = AxisLimits(u_min_V, u_max_V, slew_V_per_s, x_min_um, x_max_um)
        if not given and not remove:
            raise BadInput("set_limits without a limit changes nothing; give one, or remove=True")
        return set_limits(self.device, axis, given, keep_others=not remove)

    def fault_log(self) -> FaultLog:
        """The last 16 faults, those before the last resets included; prints as a table.

        >>> import phaselead as pl
        >>> with pl.connect() as dev:
        ...     print(dev.fault_log())
        power cycle 1; no fault so far
        """
        return read_fault_log(self.device)
