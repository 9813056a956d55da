"""A tuned loop on what was measured, before it is closed on the stage."""

from __future__ import annotations

from collections.abc import Mapping

from phaselead.control.rehearsal import CUT, trouble_on_model
from phaselead.control.tuning.measured_model import measured_model
from phaselead.control.tuning.plant import FittedPlant
from phaselead.errors import BadInput
from phaselead.model import AxisModel, Gains, Stage
from phaselead.waveforms import Waveform


def refuse_rehearsed(
    axis: str,
    parent: AxisModel,
    fitted: FittedPlant,
    steepest_um_per_V: float,
    at: tuple[float, float],
    gains: Gains,
    waves: Mapping[str, Waveform],
) -> None:
    """Runs the multisine of the closed loop on the measured plant in the simulator, firmware and all.

    ``steepest_um_per_V`` is the largest local gain that the loop is to stand, ``at`` the voltage and the position that
    the response was measured about. Raises BadInput when the loop ends in a fault there, or its output is cut by the
    limits: nothing has been closed.
    """
    stage = Stage(name="measured", axes={axis: measured_model(parent, fitted.plant, steepest_um_per_V, at)})
    said = trouble_on_model(waves, "pid", stage, {axis: gains}, None)
    if said is not None:
        level = "lower --level, by which this path is smaller too" if said.startswith(CUT) else "higher --level"
        raise BadInput(
            f"{axis}: on the response that was measured the tuned loop {said}; it was not closed on the stage; tune "
            f"again with a {level}, or a lower --peak"
        )
