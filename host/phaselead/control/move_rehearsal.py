"""A move on the model before it is made: whether it ends in a fault, and when it will have settled."""

from __future__ import annotations

import tempfile
from pathlib import Path

from phaselead.control.motion_limits import rests_unseen
from phaselead.control.moved import Planned
from phaselead.control.moving import Mover
from phaselead.device import Device
from phaselead.errors import BadInput, DeviceRefused
from phaselead.sim import virtual_stage

APPROACH_S = 0.1
"""Of the way to where the move begins, from rest."""


def rehearse_move(mover: Mover, planned: Planned, window_um: float | None = None) -> dict[str, float | None]:
    """Seconds from the begin until each axis is on target for good, on the model; None for one that is not within a
    second. Empty without a model of every axis, and for models that the simulator cannot play. ``window_um``: None for
    the one that was chosen.

    Raises BadInput when the device would end in a fault.
    """
    stage, axes = mover.stage, "".join(sorted(planned.target_um))
    if stage is None or any(axis not in stage.axes or stage.axes[axis].time is None for axis in axes):
        return {}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.toml"
        virtual_stage(stage).save(path)
        try:
            with Device.open(f"sim://{path}") as device:
                twin = Mover(device, window_um=mover.window_um if window_um is None else window_um)
                twin.choose(axes, stage, mover.mode, mover.gains, force=True)
                twin.engage()
                approach_s = max(APPROACH_S, twin.plan(planned.start_um).duration_s)
                twin.move(twin.plan(planned.start_um, duration_s=approach_s))
                moved = twin.move(twin.plan(planned.target_um, duration_s=planned.duration_s))
        except DeviceRefused as fault:
            unseen = next((f"{a}: {said}" for a in axes if (said := rests_unseen(stage.axes[a]))), None)
            what = unseen or "make the move longer, or choose other gains"
            said = str(fault).partition(";")[0]  # what it adds is of a stage
            raise BadInput(f"on the model {said}; {what}; or --force") from None
        except BadInput:  # the model cannot be played, or starts out of its range
            return {}
    return {axis: one.settled_s for axis, one in moved.axes.items()}
