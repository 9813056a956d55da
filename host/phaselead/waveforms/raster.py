"""``raster:60um x 40um/32@10Hz``: line by line."""

from __future__ import annotations

from collections.abc import Mapping

from phaselead.waveforms.scan import Scan, counted
from phaselead.waveforms.staircase import MOST_STEPS, Staircase
from phaselead.waveforms.triangle import Triangle
from phaselead.waveforms.waveform import Waveform
from phaselead.waveforms.written import Written


class Raster(Scan):
    """x goes to and fro, y goes up by a line where x turns, and down again line by line."""

    kind = "raster"
    written = (("raster:60um x 40um/32@10Hz", "32 lines of 60 um in x at 10 Hz, over 40 um in y, up and down again"),)
    order = 9

    @classmethod
    def parse(cls, written: Written) -> Mapping[str, Waveform]:
        levels, lines, f_Hz = counted(written, "lines", MOST_STEPS)
        fast, by, slow = levels.partition("x")
        if not by:
            raise written.refusal("it needs the length of a line and the height of all")
        x_swing, x_offset, x_unit = written.levels(fast)
        y_swing, y_offset, y_unit = written.levels(slow)
        if min(x_swing, y_swing) <= 0 or x_unit != y_unit:
            raise written.refusal("length and height must be above 0, and in the same unit")
        return {
            "x": Triangle(x_swing, x_offset, x_unit, f_Hz),
            "y": Staircase(y_swing, y_offset, y_unit, f_Hz / (2 * lines), lines),
        }
