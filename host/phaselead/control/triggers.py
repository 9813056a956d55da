"""Trigger outputs as a user writes them, ``frame,line,pixel=256``, on the paths that are played."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

from phaselead.control.motion_limits import WINDOW_S, window_um
from phaselead.device import OUTPUTS, TICK_HZ, Device, MotionLimits, Pulses, motion, set_outputs
from phaselead.errors import BadInput
from phaselead.model import Stage
from phaselead.waveforms import Waveform

WAYS_TO_WRITE = (
    "start, frame, line, pixel=256, pixel=2ms, pixel=0.5um, pixel=+0.5um (on the way up alone), target, none"
)
WRITTEN = re.compile(r"(?:([xyz]):)?(start|frame|line|target|pixel)(?:=(.+))?")
PIXEL = re.compile(r"(\+?)(\d+(?:\.\d*)?|\.\d+)\s*(um|nm|ms|s|)")
UM = {"um": 1.0, "nm": 1e-3}
SECONDS = {"s": 1.0, "ms": 1e-3}
FOREVER_S = (2**32 - 1) / TICK_HZ
"""Ten days: the next one after the first."""


def parse_outputs(text: str | None, waveforms: Mapping[str, Waveform]) -> list[Pulses] | None:
    """What each output does, the first one first, on the paths of these axes; None: what it did before.

    ``line`` is a period of the fastest path and ``frame`` one of the slowest, ``start`` and ``target`` are of the first
    axis; ``y:line`` names another. Raises BadInput, in one line.
    """
    if text is None or text.strip() == "none":
        return None if text is None else []
    parts = [part.strip() for part in text.split(",")]
    if len(parts) > OUTPUTS:
        raise BadInput(f"trigger outputs {text!r}: the device has {OUTPUTS}")
    return [_parse(part, waveforms) for part in parts]


def set_pulses(device: Device, pulses: Sequence[Pulses] | None, stage: Stage | None) -> None:
    """Gives the outputs of a device that has its model what they do; None changes nothing. Raises as
    ``set_outputs``."""
    if pulses is None:
        return
    set_outputs(device, pulses)
    for axis in {one.axis for one in pulses if one.settles}:
        model = None if stage is None else stage.axes.get(axis)
        # A path that is queued is held against no limits, as one that is started is not.
        motion.set_motion(device, axis, MotionLimits(), window_um(model), WINDOW_S)


def _parse(text: str, waveforms: Mapping[str, Waveform]) -> Pulses:
    match = WRITTEN.fullmatch(text)
    if match is None or (match[2] == "pixel") != (match[3] is not None):
        raise BadInput(
            f"trigger output {text!r} makes no sense; there are {WAYS_TO_WRITE}, and y:line for another axis"
        )
    axis = match[1] or _own_axis(match[2], waveforms)
    if axis not in waveforms:
        raise BadInput(f"trigger output {text}: axis {axis} follows no path")
    pulses = Pulses(text, axis)
    if match[2] == "target":
        return pulses if waveforms[axis].unit == "um" else _refuse_volts(text)
    if match[2] == "start":
        return replace(pulses, every_s=FOREVER_S)
    if match[2] == "pixel":
        return _pixel(pulses, match[3], waveforms[axis])
    return replace(pulses, turns=_a_period(text, 1, waveforms[axis]))


def _own_axis(what: str, waveforms: Mapping[str, Waveform]) -> str:
    axes = sorted(waveforms)
    if what in ("start", "target"):
        return axes[0]
    if what == "frame":
        return min(axes, key=lambda axis: waveforms[axis].f_Hz)
    return max(axes, key=lambda axis: waveforms[axis].f_Hz)


def _pixel(pulses: Pulses, text: str, path: Waveform) -> Pulses:
    match = PIXEL.fullmatch(text.strip())
    if match is None or (match[1] and match[3] not in UM) or (not match[3] and "." in match[2]):
        raise BadInput(f"trigger output {pulses.name}: write pixel=256 a line, pixel=2ms, pixel=0.5um or pixel=+0.5um")
    number = float(match[2])
    if number <= 0:
        raise BadInput(f"trigger output {pulses.name}: give a number above 0")
    if not match[3]:
        return replace(pulses, turns=_a_period(pulses.name, int(number), path))
    if match[3] in SECONDS:
        return replace(pulses, every_s=number * SECONDS[match[3]])
    if path.unit != "um":
        _refuse_volts(pulses.name)
    every_um = number * UM[match[3]]
    if every_um / 2 > abs(path.swing):
        raise BadInput(
            f"trigger output {pulses.name}: the path spans {abs(path.swing):g} um and never comes to the first pixel, "
            f"{every_um / 2:g} um above its lowest place; put the pixels closer together"
        )
    if path.steepest() > every_um * TICK_HZ:
        raise BadInput(
            f"trigger output {pulses.name}: the path goes up to {path.steepest() / TICK_HZ:.3g} um in a tick of "
            f"{1e3 / TICK_HZ:g} ms, and a tick has one pulse; put the pixels further apart, or go slower"
        )
    return replace(pulses, every_um=every_um, from_um=path.lowest + every_um / 2, rising=bool(match[1]))


def _a_period(name: str, turns: int, path: Waveform) -> int:
    if path.played_as not in ("sine", "wave"):
        raise BadInput(
            f"trigger output {name}: {path.kind} has no period; there are start, pixel=2ms, pixel=0.5um and target"
        )
    if turns * path.f_Hz > TICK_HZ:
        raise BadInput(
            f"trigger output {name}: {turns} in {1e3 / path.f_Hz:.3g} ms, and a tick of {1e3 / TICK_HZ:g} ms has one "
            f"pulse; at most {int(TICK_HZ / path.f_Hz)}"
        )
    return turns


def _refuse_volts(name: str) -> Pulses:
    raise BadInput(
        f"trigger output {name} needs a path in micrometres; in volts there are start, frame, line, pixel=2ms"
    )
