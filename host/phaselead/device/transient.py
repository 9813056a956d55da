"""The transient recorder of a device: its trigger, and what it froze, as a recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from phaselead.device import wire
from phaselead.device.device import Device, axis_index
from phaselead.device.quantities import TICK_HZ
from phaselead.device.status import name_of, target_of
from phaselead.device.stream import AXES
from phaselead.errors import BadInput, DeviceRefused, LinkError
from phaselead.record import AxisRecord, Recording, t0_facts
from phaselead.result import Facts

ENTRIES = 400
"""What it holds; the device says so too."""
AXIS = [("reference", "<i4"), ("adc", "<u2"), ("dac", "<u2"), ("feedforward", "<i2"), ("feedback", "<i2")]
ENTRY = np.dtype([("tick", "<u4"), ("axes", AXIS, 3)])
OPEN_LOOP = (wire.Mode.IDLE, wire.Mode.OPEN)


@dataclass(frozen=True)
class Trigger:
    """What freezes the transient recorder beside a fault.

    ``on``: "fault" (nothing else), "set_point" (a path begins), "input" (the interlock's line opens, were it for a
    single tick), or "threshold": the position of ``axis`` rises above ``above_um`` or falls below ``below_um``.
    ``every`` keeps each so manieth tick only, ``after`` is the share that is kept after the trigger.
    """

    on: str = "fault"
    axis: str = "x"
    above_um: float | None = None
    below_um: float | None = None
    every: int = 1
    after: float = 0.25

    def request(self, device: Device) -> wire.TransientArmRequest:
        """As it travels. Raises BadInput for what makes no sense."""
        names = [trigger.name.lower() for trigger in wire.Trigger]
        if self.on not in names:
            raise BadInput(f"trigger {self.on!r}: must be one of {', '.join(names)}")
        levels = [level for level in (self.above_um, self.below_um) if level is not None]
        if (self.on == "threshold") != (len(levels) == 1) or len(levels) > 1:
            raise BadInput("a threshold takes one level, --above UM or --below UM, and nothing else takes any")
        if not 1 <= self.every <= 65535:
            raise BadInput(f"every {self.every}: between 1 and 65535 ticks")
        if not 0 <= self.after <= 1:
            raise BadInput(f"after {self.after:g}: a share between 0 and 1")
        index, level = axis_index(self.axis), 0
        if levels:
            converter = device.converters()[self.axis]
            level = round(levels[0] / converter.adc_um_per_code + converter.adc_zero_code)
            if not 0 < level < 65535:
                raise BadInput(f"a threshold of {levels[0]:g} um is beyond the sensor's range")
        return wire.TransientArmRequest(
            wire.Trigger[self.on.upper()],
            index,
            wire.Channel.ADC,
            int(self.below_um is not None),
            level,
            self.every,
            round(self.after * (ENTRIES - 1)),
        )


def set_trigger(device: Device, trigger: Trigger) -> Facts:
    """Empties the transient recorder and lets it wait. Gives how long before and after the trigger it will hold."""
    request = trigger.request(device)
    entries, tick_s = device.session.request(request).entries, request.decimation / TICK_HZ
    before_s, after_s = (entries - 1 - request.after) * tick_s, request.after * tick_s
    return Facts({"trigger": trigger.on, "before_s": round(before_s, 6), "after_s": round(after_s, 6)})


def pull(device: Device, *, keep: bool = False) -> Recording:
    """What the transient recorder froze; t_s = 0 is the trigger, and ticks that were never run are ``gaps``.

    It then waits again, for a fault alone, unless ``keep``. Raises DeviceRefused when nothing is frozen, LinkError when
    the recorder is set anew meanwhile.
    """
    head, data = _read(device)
    found = _recording(device, head, np.frombuffer(data, ENTRY))
    if not keep:
        set_trigger(device, Trigger())
    return found


def _read(device: Device) -> tuple[wire.TransientReadReply, bytes]:
    """The reply to the first read, and all entries. Raises LinkError when others are there before they are read."""
    head: wire.TransientReadReply | None = None
    out = b""

    def read(at: int, length: int, waits_s: Sequence[float]) -> tuple[int, int]:
        nonlocal head, out
        reply = device.session.request(wire.TransientReadRequest(at, length), waits_s)
        if head is None:
            if reply.state != wire.TransientState.FROZEN:
                doing = name_of(wire.TransientState, reply.state)
                raise DeviceRefused(
                    f"nothing is frozen: the recorder is {doing}; `phaselead log trigger` says what for"
                )
            head = reply
        if not reply.data or (reply.trigger_tick, reply.size) != (head.trigger_tick, head.size):
            raise LinkError(f"the recorder was set anew after {len(out)} of {head.size} bytes were read; pull again")
        out += reply.data
        return len(out), reply.size

    device.session.transfer(read)
    assert head is not None
    return head, out


def _recording(device: Device, head: wire.TransientReadReply, entries: NDArray[Any]) -> Recording:
    # The low half of each tick, as its distance from the trigger's.
    since = (entries["tick"].astype(np.int64) - head.trigger_tick + 2**31) % 2**32 - 2**31
    calibration, axes = device.converters(), {}
    for index, axis in enumerate(AXES):
        raw = entries["axes"][:, index]
        follows = head.modes[index] not in OPEN_LOOP
        axes[axis] = AxisRecord(
            calibration[axis].u_V(raw["dac"]),
            calibration[axis].x_um(raw["adc"]),
            raw["reference"] / 2.0**16 if follows else None,
        )
    missing = np.diff(since) - head.decimation
    gaps = [[int(since[i] + head.trigger_tick + head.decimation), int(missing[i])] for i in np.flatnonzero(missing)]
    meta = {
        "build_id": device.hello.build_id.hex(),
        "target": target_of(device.hello.target),
        "trigger": name_of(wire.Trigger, head.cause),
        "trigger_tick": head.trigger_tick,
        "missing_ticks": int(missing.sum()) // head.decimation,
        "gaps": gaps,
        **t0_facts(device.session.tick_0_unix_s, head.trigger_tick / TICK_HZ, device.session.nonce),
    }
    return Recording(since / TICK_HZ, axes, source=f"{meta['trigger']} at tick {head.trigger_tick}", meta=meta)
