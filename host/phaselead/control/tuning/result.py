"""What a tuning found: the measured response, the gains for it, and the loop predicted and measured."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from phaselead.control.feedback_loop import BANDWIDTH, pid_response
from phaselead.control.tuning.plant import FittedPlant, rings
from phaselead.control.tuning.response import Measured, Response
from phaselead.control.tuning.shaping import Predicted, Range, bandwidth_Hz
from phaselead.model import Gains, Stage, save_stage
from phaselead.record import Samples, Source
from phaselead.result import Result, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class ClosedLoop:
    """T = y/r as measured at the lines of ``response``, and S = 1 - T."""

    response: Measured

    @property
    def f_Hz(self) -> Samples:
        """Of the lines with enough coherence, (m,)."""
        return self.response.f_Hz[self.response.reliable()]

    @property
    def complementary(self) -> Response:
        return np.asarray(self.response.gain[self.response.reliable()])

    @property
    def sensitivity(self) -> Response:
        return np.asarray(1 - self.complementary)

    @cached_property
    def peak_sensitivity(self) -> float:
        return float(np.abs(self.sensitivity).max())

    @cached_property
    def bandwidth_Hz(self) -> float:
        """Where |T| first falls below -3 dB. A line that lacks coherence counts too where |T| and its standard
        deviation are below: in a notch the position follows so little that none has coherence."""
        measured = self.response
        small = np.abs(measured.gain) * (1 + measured.deviation) < BANDWIDTH
        told = measured.reliable() | small
        return float(bandwidth_Hz(measured.f_Hz[told], measured.gain[told][None])[0])


@dataclass(frozen=True, repr=False)
class Tuned(Result):
    """A tuned axis. ``model`` is the stage with the new gains; ``predicted`` is over the whole ``over``, ``expected``
    at the measured gain with the modes where they are, which ``closed`` was measured at.

    >>> import phaselead as pl
    >>> with pl.connect() as dev:
    ...     tuned = dev.tune()
    >>> tuned.predicted.peak_sensitivity <= 2, tuned.closed.bandwidth_Hz > 100
    (True, True)
    >>> tuned.save("tuned.toml")
    """

    axis: str
    model: Stage
    measured: Measured
    plant: FittedPlant
    over: Range
    predicted: Predicted
    expected: Predicted
    closed: ClosedLoop

    @property
    def gains(self) -> Gains:
        """Of the loop that was shaped, filters included."""
        gains = self.model.axis(self.axis).gains
        assert gains is not None
        return gains

    @property
    def sources(self) -> tuple[Source, ...]:
        """The recordings it rests on: the open loop's, then the closed one's."""
        return (*self.measured.sources, *self.closed.response.sources)

    @property
    def open_loop(self) -> Response:
        """L on the measured lines, at the measured gain, (m,)."""
        return np.asarray(self.measured.gain * pid_response(self.gains, self.measured.f_Hz))

    def save(self, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
        """Writes the stage file with the new gains. Raises BadInput where it exists and ``overwrite`` is False."""
        save_stage(os.fspath(path), self.model, overwrite=overwrite)

    def as_dict(self) -> dict[str, Any]:
        """The figures, without the curves."""
        modes = [{"share": c, "f_Hz": f, "zeta": z} for c, f, z in self.plant.plant.modes]
        return {
            "axis": self.axis,
            "gains": self.gains.model_dump(exclude_none=True),
            "gain_um_per_V": self.plant.gain_um_per_V,
            "modes": modes,
            "levels_dB": self.measured.levels_dB(),
            "lines": int(self.measured.reliable().sum()),
            "over": {
                "gain_um_per_V": list(self.over.gain_um_per_V),
                "mode_shift": self.over.mode_shift,
                "peak_sensitivity": self.predicted.peak_sensitivity,
                "bandwidth_Hz": list(self.predicted.bandwidth_Hz),
            },
            "predicted": {
                "peak_sensitivity": self.expected.peak_sensitivity,
                "bandwidth_Hz": self.expected.bandwidth_Hz[0],
            },
            "measured": {
                "peak_sensitivity": self.closed.peak_sensitivity,
                "bandwidth_Hz": self.closed.bandwidth_Hz,
            },
            "sources": [one._asdict() for one in self.sources],
        }

    @property
    def columns(self) -> dict[str, Any]:
        """The measured response: frequency, magnitude in um/V, phase in degrees, coherence, each (m,)."""
        return {
            "f_Hz": self.measured.f_Hz,
            "gain_um_per_V": np.abs(self.measured.gain),
            "phase_deg": np.degrees(np.unwrap(np.angle(self.measured.gain))),
            "coherence": self.measured.coherence,
        }

    def tables(self) -> list[Table | str]:
        low, high = self.over.gain_um_per_V
        g, levels = self.gains, self.measured.levels_dB()
        rings, rest = self._modes(ringing=True), self._modes(ringing=False)
        response = (
            ("gain (um/V)", f"{self.plant.gain_um_per_V:.3g}"),
            ("modes", rings or "none"),
            *([("damped terms (hysteresis, creep)", rest)] if rest else []),
            ("odd, even distortion, noise (dB)", ", ".join(f"{levels[name]:.0f}" for name in ("odd", "even", "noise"))),
            ("lines with coherence", f"{self.measured.reliable().sum()} of {len(self.measured.f_Hz)}"),
        )
        wide = f"gains {low:.3g} to {high:.3g} um/V, modes +-{100 * self.over.mode_shift:g} %"
        loop = (
            (
                f"predicted, {wide}",
                f"{self.predicted.peak_sensitivity:.2f}",
                f"{self.predicted.bandwidth_Hz[0]:.3g} to {self.predicted.bandwidth_Hz[1]:.3g}",
            ),
            ("predicted as it was measured", *_pair(self.expected.peak_sensitivity, self.expected.bandwidth_Hz[0])),
            ("measured", *_pair(self.closed.peak_sensitivity, self.closed.bandwidth_Hz)),
        )
        filters = (
            f"filter: zeros {one.zeros_Hz:g} Hz (zeta {one.zeros_zeta:g}), poles {one.poles_Hz:g} Hz "
            f"(zeta {one.poles_zeta:g})"
            for one in g.filters or ()
        )
        return [
            Table(("", ""), response, f"response of axis {self.axis}"),
            f"gains {g.kp_V_per_um:g},{g.ki_V_per_um_s:g},{g.kd_V_s_per_um:g}",
            *filters,
            Table(("loop", "peak sensitivity", "bandwidth, -3 dB (Hz)"), loop),
        ]

    def _modes(self, *, ringing: bool) -> str:
        """Frequency, share and damping of the fitted modes that ring, or of the others, which stand for hysteresis and
        creep."""
        found = [mode for mode in self.plant.plant.modes if rings(mode) == ringing]
        by_frequency = sorted(found, key=lambda mode: mode[1])
        return ", ".join(
            f"{f:.4g} Hz ({100 * c:{'.0f' if abs(c) > 0.1 else '.2g'}} %, zeta {z:.2g})" for c, f, z in by_frequency
        )

    def plot(self) -> Figure:
        """Bode, Nyquist and sensitivity, predicted and measured."""
        from phaselead.control.tuning.pictures import tuning_figure  # matplotlib is slow to load, needed here only

        return tuning_figure(self.plant, self.gains, self.over, self.measured, self.closed, self.open_loop)

    def __repr__(self) -> str:
        return f"<Tuned axis {self.axis}: bandwidth {self.closed.bandwidth_Hz:.3g} Hz>"


def _pair(peak: float, bandwidth: float) -> tuple[str, str]:
    return f"{peak:.2f}", f"{bandwidth:.3g}"
