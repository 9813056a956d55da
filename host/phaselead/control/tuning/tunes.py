"""The part of a controller that tunes."""

from __future__ import annotations

import os
from collections.abc import Callable

from phaselead.control.gains import MODE_SHIFT, PEAK_SENSITIVITY
from phaselead.control.kept_runs import KeptRuns
from phaselead.control.tuning.course import tune
from phaselead.control.tuning.result import Tuned
from phaselead.control.tuning.shaping import GAIN_SHARE
from phaselead.device import Device, says_when_interrupted
from phaselead.model import Stage, StageLike, as_stage
from phaselead.quantity import PURE, SHARES, VOLTS, Quantity, quantity, required


class Tunes:
    """A loop with margins, for one axis."""

    device: Device
    model: Stage | None

    def tune(
        self,
        axis: str = "x",
        *,
        model: StageLike | None = None,
        level: Quantity | None = None,
        middle: Quantity | None = None,
        peak: Quantity = PEAK_SENSITIVITY,
        mode_shift: Quantity = MODE_SHIFT,
        gain_share: Quantity = GAIN_SHARE,
        save: str | os.PathLike[str] | None = None,
        overwrite: bool = False,
        on_progress: Callable[[float], None] | None = None,
    ) -> Tuned:
        """Measures the response of an axis, shapes PID and filters on it, and measures the loop that they make.

        A multisine of ``level`` V, peak-to-peak, about ``middle`` V is played in open loop (default: a sixtieth of the
        limits, about their middle), then one of a micrometre or two in closed loop. The loop has a peak sensitivity of
        at most ``peak`` with modes ``mode_shift`` and gains ``gain_share`` up and down, and at every local gain of the
        model's time view. ``model``: default is the one last uploaded, else what the device holds. ``save`` is a folder
        that keeps every run; one that holds recordings is written over only with ``overwrite``.

        Give the result's ``model`` to ``track``, or ``save`` it. Raises BadInput where there is no coherence or no
        margin, and as ``track`` does.
        """
        stage = self.model if model is None else as_stage(model)
        said = "nothing is kept: tune measures anew" if save is None else f"what was measured is in {os.fspath(save)}"
        with says_when_interrupted(self.device, said):
            return tune(
                self.device,
                axis,
                stage=stage,
                level_V=quantity("level", level, VOLTS),
                middle_V=quantity("middle", middle, VOLTS),
                peak=required("peak", peak, PURE),
                mode_shift=required("mode_shift", mode_shift, SHARES),
                gain_share=required("gain_share", gain_share, SHARES),
                kept=KeptRuns(save, overwrite=overwrite),
                on_progress=on_progress,
            )
