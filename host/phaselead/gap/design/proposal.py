"""The experiment that a gap.json proposes: reading it, and running it on a device in open loop."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from phaselead.control import record_open_loop
from phaselead.device import TICK_HZ, Device
from phaselead.errors import BadInput
from phaselead.gap.design.excitation import RECORD, SHAPES, Excitation
from phaselead.identify import SAME_RATE
from phaselead.model import Stage, catalogue, small_signal
from phaselead.record import AXES
from phaselead.waveforms import POINTS

KEYS = ("waveform", "level", "band", "bias", "seconds")
LONGEST_ACCEPTED_s = 3600.0
"""That an experiment from a file may take."""


def read_proposal(path: str) -> Mapping[str, Any]:
    """The field ``next_experiment`` of a gap.json. Raises BadInput where it has none or cannot be run."""
    try:
        content = json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise BadInput(f"{path}: cannot be read ({error.strerror}); make it with phaselead gap --json") from None
    except ValueError:
        raise BadInput(f"{path}: is no gap.json; make one with phaselead gap --json") from None
    return proposal_of(content, path)


def proposal_of(content: Any, path: str) -> Mapping[str, Any]:
    """The next experiment in the content of a gap.json; ``path`` names it in messages. Raises BadInput."""
    try:
        ties, proposed = content["ties"], content["next_experiment"]
    except (KeyError, TypeError):
        raise BadInput(f"{path}: is no gap.json; make one with phaselead gap --json") from None
    if not ties and proposed is None:
        raise BadInput(f"{path}: holds no tie, so there is no experiment to run{_what_would_tell(content)}")
    if proposed is None:
        raise BadInput(f"{path}: proposes no experiment for its tie; record other waveforms, levels and biases")
    if not isinstance(proposed, Mapping):
        raise BadInput(f"{path}: its next_experiment is damaged; make gap.json anew with phaselead gap --json")
    if proposed.get("needs_sensor"):
        raise BadInput(
            f"{path}: no excitation is likely to tell the members of the tie apart; it takes "
            f"{proposed['needs_sensor']}, or more records of the unchanged stage (gap --reference)"
        )
    if "," in str(proposed.get("axis")):
        raise BadInput(
            f"{path}: its experiment drives {proposed['axis']} at once, and gap next drives one axis; play a file with "
            "a column of volts an axis: phaselead log record --drive path:FILE"
        )
    return proposed


def axis_driven(proposed: Mapping[str, Any], asked: str | None = None) -> str:
    """The axis on which a proposal is run: its own; where it names none, the one ``asked`` for, else x.

    Raises BadInput for another than its own, on which it would tell nothing, and for what is no axis.
    """
    own = proposed.get("drives") or proposed.get("axis")
    if asked is not None and asked not in AXES:
        raise BadInput(f"axis {asked!r}: gap next drives one axis; give one of {', '.join(AXES)}")
    if own is not None and asked not in (None, own):
        raise BadInput(
            f"axis {asked}: the tie is of axis {own}, and a record of {asked} cannot decide it; give {own}, or leave "
            "the axis out"
        )
    found = own or asked or AXES[0]
    if found not in AXES:
        raise BadInput(f"the next experiment names no axis but {found!r}; make gap.json anew")
    return str(found)


def _what_would_tell(content: Mapping[str, Any]) -> str:
    """Under the verdict unknown, the records that would test what could not be tested; otherwise empty."""
    untestable = content.get("untestable")
    if "unknown" not in content.get("verdicts", ()) or not isinstance(untestable, list):
        return ""
    known = catalogue()
    told = ", ".join(f"{name} ({known[name].reveals})" for name in map(str, untestable) if name in known)
    return (
        f". Something remains that has no name; record what would test what these records cannot: {told}"
        if told
        else ""
    )


def excitation_of(proposed: Mapping[str, Any]) -> Excitation:
    """The excitation that ``read_proposal`` found. Raises BadInput where its fields make none that can be played."""
    try:
        low, high = (float(f) for f in proposed["band"])
        found = Excitation(
            str(proposed["waveform"]), float(proposed["level"]), (low, high), float(proposed["bias"]),
            float(proposed["seconds"]), proposed.get("source"), _points(proposed.get("points")),
        )  # fmt: skip
    except (KeyError, TypeError, ValueError):
        raise BadInput(f"the next experiment lacks one of {', '.join(KEYS)}; make gap.json anew") from None
    numbers = (found.level_V, low, high, found.bias_V, found.seconds)
    sound = all(map(math.isfinite, numbers)) and 0 < low <= high and 0 < found.seconds <= LONGEST_ACCEPTED_s
    known = found.waveform in SHAPES or (found.waveform == RECORD and found.points is not None)
    if not sound or not (found.idle or (known and found.level_V > 0)):
        raise BadInput(
            f"the next experiment {found.waveform!r}, {found.level_V:g} V for {found.seconds:g} s cannot "
            "be run; make gap.json anew"
        )
    return found


def modes_crossed_Hz(proposed: Mapping[str, Any], stage: Stage | None, axis: str) -> list[float]:
    """Modes of the stage within what the proposed excitation drives; none where no stage says which there are. Raises
    BadInput as ``excitation_of``."""
    excitation = excitation_of(proposed)
    if stage is None or axis not in stage.axes or excitation.idle:
        return []
    low, high = excitation.driven_Hz
    try:
        modes = small_signal(stage.axes[axis]).modes
    except BadInput:
        return []
    return [f_Hz for _, f_Hz, _ in modes if low <= f_Hz <= high]


def _points(values: Any) -> tuple[float, ...] | None:
    """One period of a repeated waveform; None where there is none that can be played."""
    if values is None:
        return None
    points = tuple(float(value) for value in values)
    sound = len(points) == POINTS and all(0 <= p <= 1 for p in points) and max(points) > min(points)
    return points if sound else None


def run_proposal(
    proposed: Mapping[str, Any],
    port: str,
    axis: str,
    output: str,
    stage: Stage | None = None,
    on_progress: Callable[[float], None] | None = None,
) -> None:
    """Record the proposed excitation to ``output``.

    ``stage`` gives the device its limits and calibration. Raises BadInput for a proposal that cannot be run and
    PhaseleadError for what the device refuses.
    """
    excitation = excitation_of(proposed)
    refuse_other_rate(stage, axis)
    waveforms = None if excitation.idle else {axis: excitation.wave()}
    with Device.open(port) as device:
        record_open_loop(
            device, waveforms, axis, output=output, stage=stage, duration_s=excitation.seconds, on_progress=on_progress
        )


def refuse_other_rate(stage: Stage | None, axis: str) -> None:
    """Refuse a model beside whose records a device's would not be taken. Raises BadInput."""
    view = stage.axes[axis].time if stage is not None and axis in stage.axes else None
    if view is not None and abs(view.rate_Hz / TICK_HZ - 1) > SAME_RATE:
        raise BadInput(
            f"the model is of records at {view.rate_Hz:.6g} Hz, a device records at {TICK_HZ:.6g} Hz, and gap compares "
            "at one rate: make the experiment with what recorded the others, or fit a model to records of a device"
        )
