"""Whether the closed loop was measured well enough to be believed."""

from __future__ import annotations

import numpy as np

from phaselead.control.feedback_loop import pid_response, plant_response
from phaselead.control.gains import WARN_ABOVE
from phaselead.control.tuning.plant import FittedPlant
from phaselead.control.tuning.result import ClosedLoop
from phaselead.errors import BadInput
from phaselead.model import Gains


def refuse_closed(
    axis: str, loop: ClosedLoop, fitted: FittedPlant, gains: Gains, *, level_V: float, usual_V: float
) -> None:
    """Raises BadInput for a peak sensitivity above 3, for one that no loop can have, and where the peak that is
    predicted was not measured: neither half of its height above 1 nor half of its lines.

    |S| exceeds 1 somewhere, whatever the loop, by Bode's integral (Skogestad and Postlethwaite 2005, Multivariable
    Feedback Control, section 5.3). ``usual_V`` is the level by default.
    """
    found = loop.response
    row = fitted.gain_um_per_V * plant_response(fitted.plant, found.f_Hz) * pid_response(gains, found.f_Hz)
    predicted = np.abs(1 / (1 + row))
    peak, at_Hz = float(predicted.max()), float(found.f_Hz[np.argmax(predicted)])
    if loop.peak_sensitivity > WARN_ABOVE:
        raise BadInput(
            f"{axis}: the closed loop has a peak sensitivity of {loop.peak_sensitivity:.2g}, {peak:.2g} was predicted: "
            "the stage is not what was measured in open loop; tune again, with a lower --level"
        )
    halfway, heard = (1 + peak) / 2, found.reliable()
    about = predicted >= halfway
    clear = loop.peak_sensitivity >= halfway or heard[about].sum() >= about.sum() / 2
    if clear and loop.peak_sensitivity >= 1:
        return
    raise BadInput(
        f"{axis}: the closed loop could not be measured: a peak sensitivity of {peak:.2g} is predicted at {at_Hz:.3g} "
        f"Hz, and {heard[about].sum()} of the {about.sum()} lines about there have coherence ({heard.sum()} of "
        f"{len(heard)} in all, at which it is {loop.peak_sensitivity:.2g} at most); tune again with "
        + _higher(level_V, usual_V)
    )


def _higher(level_V: float, usual_V: float) -> str:
    if level_V < usual_V:
        between = f"a --level between {_short(level_V)} and {_short(usual_V)}, the default"
        return f"{between}, or where its output is cut with a lower --peak too"
    return f"a --level above {_short(level_V)}"


def _short(level_V: float) -> str:
    return f"{level_V:.3g} V" if level_V >= 1 else f"{1e3 * level_V:.3g} mV"
