"""Parking, and what to say of a device that was interrupted or has faulted."""

from __future__ import annotations

import contextlib

from phaselead import interrupt
from phaselead.device import wire
from phaselead.device.quantities import TICK_HZ
from phaselead.device.session import Session
from phaselead.device.stream import AXES, axes_of, mask_of
from phaselead.errors import DeviceRefused, LinkError, PhaseleadError

PARK_S = 30.0
"""The longest ramp the device's formats allow for is far shorter: 12 V at 0.5 V/s."""
ALL_AXES = mask_of(AXES)


def wait_parked(session: Session, pump_size: int = 0) -> wire.StatusReply:
    """After PARK: polls until the device is parked with every output at its safe value, or in a fault.

    Parked alone does not tell: a device that was parked before ramps in that state.

    Raises:
        LinkError: it is still moving after half a minute of its own time.
    """
    status = session.request(wire.StatusRequest())
    last_tick = status.tick + int(PARK_S * TICK_HZ)
    while status.state != wire.State.FAULT and not (status.state == wire.State.PARKED and status.at_rest == ALL_AXES):
        if status.tick > last_tick:
            raise LinkError(f"the device on {session.name} did not park within {PARK_S:g} s; run `phaselead stop`")
        session.pump(max(64, pump_size))
        status = session.request(wire.StatusRequest())
    return status


def fault_text(status: wire.StatusReply) -> str:
    """One line about a latched fault."""
    known = status.fault in list(wire.Fault)
    name = wire.Fault(status.fault).name.lower() if known else f"number {status.fault}"
    axis = f" on axis {axes_of(1 << status.fault_axis)}" if status.fault_axis < 3 else ""
    why = f"`phaselead explain {name}` says why, " if known else ""
    return f"fault {name}{axis} at tick {status.fault_tick}; {why}`phaselead park` clears it"


def park_quietly(session: Session) -> None:
    """Parks and ends the stream as far as the device still answers; for use while an error is on its way."""
    interrupt.clear()
    try:
        session.request(wire.ParkRequest(), (0.2, 0.4))
        wait_parked(session)
        session.request(wire.StreamStopRequest(), (0.2,))
    except (LinkError, DeviceRefused):
        pass


def after_interrupt(session: Session) -> str:
    """What has become of the output: it is parked on Ctrl-C, which a broken line can prevent."""
    interrupt.clear()
    with contextlib.suppress(PhaseleadError, OSError):
        if session.request(wire.StatusRequest()).state == wire.State.PARKED:
            return "the output is parked"
    return "whether the output is parked is not known: look with phaselead status"
