"""Running a proposed experiment on a device, open loop."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from phaselead.control.journal import journalled_track
from phaselead.errors import BadInput
from phaselead.gap.next_experiment import SHAPES, Option
from phaselead.link.device import Device
from phaselead.stage.waveform import POINTS, Waveform

KEYS = ("waveform", "level", "band", "bias", "seconds")


def option_of(proposed: Mapping[str, Any]) -> Option:
    """The excitation of a gap.json. Raises BadInput."""
    try:
        low, high = (float(f) for f in proposed["band"])
        option = Option(
            str(proposed["waveform"]), float(proposed["level"]), (low, high), float(proposed["bias"]),
            float(proposed["seconds"]),
        )  # fmt: skip
    except (KeyError, TypeError, ValueError):
        raise BadInput(f"the next experiment lacks one of {', '.join(KEYS)}; make gap.json anew") from None
    if option.waveform not in SHAPES or not option.seconds > 0:
        raise BadInput(f"the next experiment {option.waveform!r} of {option.seconds:g} s is none that can be run")
    return option


def perform(proposed: Mapping[str, Any], port: str, axis: str, output: str) -> int:
    """Record the excitation and write it; how many samples. Raises BadInput and what the device says."""
    option = option_of(proposed)
    t = np.arange(POINTS) / POINTS * option.seconds
    low = option.bias_V - option.level_V / 2
    points = ((option.voltage(t) - low) / option.level_V).clip(0.0, 1.0)
    wave = Waveform("file", option.level_V, low, "V", 1 / option.seconds, points)
    with Device.open(port) as device:
        run = journalled_track(device, {axis: wave}, "open", output=output, duration_s=option.seconds)
    return len(run.recording.t_s)
