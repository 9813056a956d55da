"""The figure of a tuning: the measured response, the loop about -1, and its sensitivities."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from matplotlib.figure import Figure

from phaselead.control.feedback_loop import frequencies, pid_response, plant_response
from phaselead.control.tuning.plant import FittedPlant
from phaselead.control.tuning.response import Measured, Response
from phaselead.control.tuning.shaping import Range
from phaselead.drawing import BLUE, GREY, ORANGE, RED, figure_style, new_figure
from phaselead.model import Gains
from phaselead.record import Samples

LOWEST_Hz = 1.0


class Closed(Protocol):
    """A closed loop as it was measured, at frequencies (m,)."""

    @property
    def f_Hz(self) -> Samples: ...
    @property
    def complementary(self) -> Response: ...
    @property
    def sensitivity(self) -> Response: ...


def tuning_figure(
    fitted: FittedPlant, gains: Gains, over: Range, measured: Measured, closed: Closed, open_loop: Response
) -> Figure:
    """Bode of the response above with what is not linear in it, Nyquist and sensitivities of the loop below."""
    plant, sure = fitted.plant, measured.reliable()
    f_Hz = frequencies(plant)
    f_Hz = f_Hz[f_Hz >= LOWEST_Hz]
    response = fitted.gain_um_per_V * plant_response(plant, f_Hz)
    with figure_style():
        figure = new_figure(10.4, 7.6)
        (bode, phase, besides), (nyquist, of_s, of_t) = figure.subplots(2, 3)
        bode.loglog(measured.f_Hz[sure], np.abs(measured.gain[sure]), ".", color=GREY, markersize=3, label="measured")
        bode.loglog(f_Hz, np.abs(response), color=BLUE, linewidth=1.0, label="fitted")
        bode.set(title="response", xlabel="frequency (Hz)", ylabel="gain (µm/V)")
        bode.legend()
        phase.semilogx(measured.f_Hz[sure], np.degrees(np.angle(measured.gain[sure])), ".", color=GREY, markersize=3)
        phase.semilogx(f_Hz, np.degrees(np.angle(response)), color=BLUE, linewidth=1.0)
        phase.set(title="its phase", xlabel="frequency (Hz)", ylabel="phase (deg)")
        parts = (("linear", BLUE), ("odd", RED), ("even", ORANGE), ("noise", GREY))
        for name, colour in parts:
            part = getattr(measured, name)
            besides.loglog(part.f_Hz, 1000 * part.um, ".", color=colour, markersize=3, label=name)
        besides.set(title="what is heard", xlabel="frequency (Hz)", ylabel="position (nm rms a line)")
        besides.legend()
        for moved in over.plants(plant):
            at_Hz = frequencies(moved)
            at_Hz = at_Hz[at_Hz >= LOWEST_Hz]
            for gain in over.gains():
                loop = gain * plant_response(moved, at_Hz) * pid_response(gains, at_Hz)
                nyquist.plot(loop.real, loop.imag, color=BLUE, linewidth=0.5, alpha=0.8)
                of_s.loglog(at_Hz, np.abs(1 / (1 + loop)), color=BLUE, linewidth=0.5, alpha=0.8)
                of_t.loglog(at_Hz, np.abs(loop / (1 + loop)), color=BLUE, linewidth=0.5, alpha=0.8)
        turn = np.exp(2j * np.pi * np.linspace(0, 1, 200))
        ring = turn / over.peak - 1
        nyquist.fill(ring.real, ring.imag, color=RED, alpha=0.15)
        lines = open_loop[sure]
        nyquist.plot(lines.real, lines.imag, ".", color=GREY, markersize=3)
        nyquist.set(
            xlim=(-3, 2), ylim=(-3, 2), title="loop about −1", xlabel="real part (1)", ylabel="imaginary part (1)"
        )
        of_s.loglog(closed.f_Hz, np.abs(closed.sensitivity), ".", color=RED, markersize=4, label="measured")
        of_s.axhline(over.peak, color=RED, linewidth=0.8)
        of_s.set(title="|S|, from disturbance", xlabel="frequency (Hz)", ylabel="error (µm/µm)", ylim=(1e-2, 5))
        of_s.legend()
        of_t.loglog(closed.f_Hz, np.abs(closed.complementary), ".", color=RED, markersize=4)
        of_t.axhline(2**-0.5, color=GREY, linewidth=0.8)
        of_t.set(title="|T|, from reference", xlabel="frequency (Hz)", ylabel="position (µm/µm)", ylim=(1e-2, 5))
        return figure
