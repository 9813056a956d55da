"""PID gains: the paper's, the stage file's, or three numbers from the command line."""

from __future__ import annotations

import math

from phaselead.errors import BadInput
from phaselead.model import Gains, Stage

# Xu & Li 2010, section V. Unfiltered derivative: the stability of the loop hangs on it.
PAPER_GAINS = Gains(kp_V_per_um=0.017, ki_V_per_um_s=8.62, kd_V_s_per_um=2.33e-5, derivative_filter_Hz=None)


def parse_gains(text: str | None, stage: Stage | None, axis: str) -> Gains:
    """Gains for one axis: "paper"; "KP,KI,KD" in V/um, V/(um s), V s/um; None: the stage file's, else the paper's.

    Raises BadInput on anything else.
    """
    if text is None:
        own = stage.axes[axis].gains if stage is not None and axis in stage.axes else None
        return own or PAPER_GAINS
    if text == "paper":
        return PAPER_GAINS
    try:
        kp, ki, kd = (float(part) for part in text.split(","))
    except ValueError:
        raise BadInput(
            f"--gains {text!r}: write paper, or KP,KI,KD in V/um, V/(um s), V s/um, e.g. 0.017,8.62,2.33e-5"
        ) from None
    if not all(math.isfinite(gain) and gain >= 0 for gain in (kp, ki, kd)):
        raise BadInput(
            f"--gains {text!r}: gains must be finite and not negative; the loop's sign is fixed in the firmware"
        )
    return Gains(kp_V_per_um=kp, ki_V_per_um_s=ki, kd_V_s_per_um=kd, derivative_filter_Hz=None)
