"""The part of a controller that tunes."""

from __future__ import annotations

from collections.abc import Callable

from phaselead.control.gains import MODE_SHIFT, PEAK_SENSITIVITY
from phaselead.control.tuning.course import GAIN_SHARE, tune
from phaselead.control.tuning.result import Tuned
from phaselead.device import Device, says_when_interrupted
from phaselead.model import Stage, StageLike, as_stage


class Tunes:
    """A loop with margins, for one axis."""

    device: Device
    model: Stage | None

    def tune(
        self,
        axis: str = "x",
        *,
        model: StageLike | None = None,
        level: float | None = None,
        middle: float | None = None,
        peak: float = PEAK_SENSITIVITY,
        mode_shift: float = MODE_SHIFT,
        gain_share: float = GAIN_SHARE,
        on_progress: Callable[[float], None] | None = None,
    ) -> Tuned:
        """Measures the response of an axis, shapes PID and filters on it, and measures the loop that they make.

        A multisine of ``level`` V, peak-to-peak, about ``middle`` V is played in open loop (default: a sixtieth of the
        limits, about their middle), then one of a micrometre or two in closed loop. The loop has a peak sensitivity of
        at most ``peak`` with modes ``mode_shift`` and gains ``gain_share`` up and down, and at every local gain of the
        model's time view. ``model``: default is the one last uploaded, else what the device holds.

        Give the result's ``model`` to ``track``, or ``save`` it. Raises BadInput where there is no coherence or no
        margin, and as ``track`` does.
        """
        stage = self.model if model is None else as_stage(model)
        with says_when_interrupted(self.device, "nothing is kept: tune measures anew"):
            return tune(
                self.device,
                axis,
                stage=stage,
                level_V=level,
                middle_V=middle,
                peak=peak,
                mode_shift=mode_shift,
                gain_share=gain_share,
                on_progress=on_progress,
            )
