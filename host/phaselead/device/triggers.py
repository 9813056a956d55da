"""Trigger outputs of a device: where on a path each of them pulses (docs/firmware.md, "Triggers")."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from phaselead.device import wire
from phaselead.device.quantities import TICK_HZ, to_i32
from phaselead.device.stream import AXES, AxisStream
from phaselead.errors import BadInput

if TYPE_CHECKING:
    from phaselead.device.device import Device

OUTPUTS = 3
EDGE = 0x80
"""In the channel `trigger`: an edge has come at the input."""
LEAST_WAY_UM = 0.002


@dataclass(frozen=True)
class Pulses:
    """Where one output pulses on the path of ``axis``: ``turns``, so often a period, from its beginning on;
    ``every_s``, when a path begins and from then on; ``every_um``, when the reference passes ``from_um``, or is a
    multiple of this away from it (``rising``: on the way up alone); none of them: when a step has settled.
    ``name`` is what it is called."""

    name: str
    axis: str
    turns: int | None = None
    every_s: float | None = None
    every_um: float | None = None
    from_um: float = 0.0
    rising: bool = False

    @property
    def settles(self) -> bool:
        """Whether it pulses when a step has settled."""
        return self.turns is None and self.every_s is None and self.every_um is None

    def request(self, output: int) -> wire.TriggerSetRequest:
        """As it travels. Raises BadInput for what no tick can hold."""
        mark, every, start = wire.Mark.TARGET, 0, 0
        if self.turns is not None:
            mark, every = wire.Mark.TURN, self.turns
        elif self.every_s is not None:
            mark, every = wire.Mark.TIME, self._ticks(self.every_s)
        elif self.every_um is not None:
            if not self.every_um >= LEAST_WAY_UM:
                raise BadInput(f"trigger output {self.name}: {self.every_um:g} um apart, at least {LEAST_WAY_UM:g} um")
            mark, every = wire.Mark.WAY, to_i32(self.every_um, 16, self.name, "um")
            start = to_i32(self.from_um, 16, self.name, "um")
        return wire.TriggerSetRequest(output, mark, AXES.index(self.axis), int(self.rising), every, start)

    def _ticks(self, seconds: float) -> int:
        ticks = round(seconds * TICK_HZ)
        if not 1 <= ticks < 2**32 or abs(ticks - seconds * TICK_HZ) > 1e-6 * ticks:
            raise BadInput(
                f"trigger output {self.name}: {seconds * 1e3:g} ms must be a multiple of a tick, {1e3 / TICK_HZ:g} ms; "
                f"the nearest is {max(ticks, 1) / TICK_HZ * 1e3:g} ms"
            )
        return ticks


def set_outputs(device: Device, pulses: Sequence[Pulses]) -> None:
    """The first of ``pulses`` on output 1 and so on; what other outputs did before ends.

    Raises BadInput for more than there are outputs, Refused by a device of before revision 4 of the wire.
    """
    if len(pulses) > OUTPUTS:
        raise BadInput(f"{len(pulses)} trigger outputs: the device has {OUTPUTS}")
    requests = [one.request(output) for output, one in enumerate(pulses)]
    rest = range(len(pulses), OUTPUTS)
    requests += [wire.TriggerSetRequest(output, wire.Mark.NONE, 0, 0, 0, 0) for output in rest]
    for request in requests:
        device.session.request(request)


def pulses_of(axes: Mapping[str, AxisStream], output: int) -> NDArray[np.bool_] | None:
    """In which ticks an output pulsed, shape (n,); None when that was not recorded."""
    found = next((one.trigger for one in axes.values() if one.trigger is not None), None)
    return None if found is None else (found >> output & 1).astype(bool)
