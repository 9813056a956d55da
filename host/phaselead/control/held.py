"""The model that a device holds, as far as it can be read back: enough to drive by, without its stage file."""

from __future__ import annotations

from collections.abc import Mapping

from phaselead.control.gains import UNSEEN_MODE, are_designed
from phaselead.control.motion_limits import first_mode_Hz
from phaselead.device import Device, from_device_model
from phaselead.model import Gains, Stage
from phaselead.sim import DEFAULT_STAGE, data_sheet


def held_stage(device: Device, axes: str = "") -> Stage | None:
    """Limits, converters, tables and operators of the model on the device; None when it holds none. An axis without
    tables and operator is left out, but for those in ``axes``.

    It is for checks and for gains, never for upload: modes and creep do not come back. Gains designed for it are those
    of a stage that shows no mode, an integrator for one anywhere above 100 Hz.
    """
    blob = device.read_model()
    if blob is None:
        return None
    held = from_device_model(blob)
    known = {
        axis: model
        for axis, model in held.axes.items()
        if axis in axes or model.table is not None or model.time is not None
    }
    return Stage(name=f"held by the device (stage file {held.stage_sha256[:12]})", axes=known or held.axes)


def held_sha256(device: Device) -> str | None:
    """The hash of the stage file that the model on the device was made of; None when it holds none."""
    blob = device.read_model()
    return None if blob is None else from_device_model(blob).stage_sha256


def unknown_warning(device: Device, known: Stage | None, mode: str, *, gains_given: bool) -> list[str]:
    """What to say where nobody has a model or chose gains: they are then those of the paper's stage."""
    sheet = data_sheet(device.session.name)
    theirs = sheet is not None and sheet.name == DEFAULT_STAGE
    if known is not None or gains_given or theirs or not mode.endswith("pid"):
        return []
    return [
        "nothing is known of this stage, and the gains are those published for another, so that it may run away: "
        "--model STAGE.toml (`phaselead identify`) has its own, --gains paper asks for these"
    ]


def low_gains_warning(stage: Stage | None, held: Stage | None, mode: str, gains: Mapping[str, Gains]) -> list[str]:
    """What to say of gains that were designed, not tuned, for a model without modes, be it ``stage``'s, or what a
    device tells of the one that is ``held``."""
    designed = [axis for axis, own in gains.items() if are_designed(own)]
    if not mode.endswith("pid"):
        return []
    if stage is not None:
        low = [axis for axis in designed if axis in stage.axes and first_mode_Hz(stage.axes[axis]) is None]
        why, better = "the model shows no mode", "`phaselead tune` measures better ones"
    else:
        low = designed if held is not None else []
        why = "the device does not tell the modes of its model"
        better = "a move or a path with --model STAGE.toml has better ones"
    if not low:
        return []
    return [f"{', '.join(low)}: {why}: gains are low, for a mode anywhere above {UNSEEN_MODE[1]:g} Hz; {better}"]
