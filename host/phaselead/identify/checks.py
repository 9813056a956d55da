"""What a recording must be before anything is estimated from it. Failures are BadInput lines that say the
fix."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from phaselead.errors import BadInput
from phaselead.identify.columns import turning_rows
from phaselead.model import plays
from phaselead.record import Recording, Samples, refuse_clipped, refuse_gapped

STILL_V = 1e-6
"""A voltage that spans less than this does not move (a 16-bit code of 20 V is 0.3 mV)."""
DRIVEN_SHARE = 0.02
"""An axis counts as driven when its voltage spans more than this share of the recording's largest span."""
SINE_RESIDUAL = 0.01
"""Rms departure from a sine, as a share of its amplitude, up to which a voltage is called one."""

ROWS_PER_PERIOD = 32
"""Enough of them to know a sine by."""
FEWEST_PERIODS = 2
"""Of a sine, before anything is fitted to it: one settles the memory."""


class Sine(NamedTuple):
    """A sine voltage ``mean + swing/2 cos(2 pi f t + phase)`` on the rows ``rows`` of the whole recording."""

    f_Hz: float
    swing_V: float
    mean_V: float
    rows: slice

    @property
    def starts_at_zero(self) -> bool:
        """Whether it is the paper's: between 0 V and its swing (eq. 4)."""
        return abs(self.mean_V - self.swing_V / 2) < 0.02 * self.swing_V


@dataclass(frozen=True)
class AxisRun:
    """One driven axis of one recording, checked: arrays (n,), the rows to score, and where it came from."""

    t_s: Samples
    u_V: Samples
    x_um: Samples
    scored: slice
    axis: str
    source: str

    @property
    def step_s(self) -> float:
        return float(self.t_s[-1] - self.t_s[0]) / (len(self.t_s) - 1)

    @cached_property
    def sine(self) -> Sine | None:
        """The sine that the scored voltage is, or None."""
        return sine_of(self)

    @cached_property
    def turning_rows(self) -> NDArray[np.uintp]:
        """The rows at which the voltage turns round."""
        return turning_rows(self.u_V)

    @property
    def range_um(self) -> float:
        """Measured peak-to-peak over the scored rows."""
        return float(np.ptp(self.x_um[self.scored]))


def driven_axes(recording: Recording) -> list[str]:
    """The axes whose voltage moves, in order. Raises BadInput when there is none."""
    spans = {name: float(np.ptp(a.u_V)) for name, a in recording.axes.items() if a.u_V is not None and len(a.u_V)}
    if not spans:
        raise BadInput(f"{recording.source}: has no voltage; record u_V beside x_um")
    largest = max(spans.values())
    if largest < STILL_V:
        raise BadInput(f"{recording.source}: the voltage never moves; record the stage while it is driven")
    return [name for name, span in spans.items() if span > DRIVEN_SHARE * largest]


def axis_run(recording: Recording, axis: str) -> AxisRun:
    """The checked arrays of one axis. Raises BadInput."""
    source = recording.source
    refuse_gapped(recording)
    refuse_clipped(recording)
    record = recording.axes.get(axis)
    if record is None or record.u_V is None or record.x_um is None:
        raise BadInput(f"{source}: needs both voltage and position of axis {axis}; map the missing column")
    u, x = record.u_V, record.x_um
    if not (np.isfinite(u).all() and np.isfinite(x).all()):
        raise BadInput(f"{source}: holds values that are not numbers; cut those rows or record again")
    scored = recording.scored
    if len(u[scored]) < 16:
        raise BadInput(f"{source}: {len(u[scored])} rows are too few to fit anything to; record at least 16")
    if np.ptp(u[scored]) < STILL_V:
        raise BadInput(f"{source}: the voltage of {axis} is constant where it is scored; choose rows where it moves")
    if np.ptp(x[scored]) == 0:
        raise BadInput(f"{source}: the position of {axis} never changes; is the sensor connected and mapped?")
    return AxisRun(recording.t_s, u, x, scored, axis, source)


def refuse_too_short(run: AxisRun) -> None:
    """Raise BadInput when the voltage does not go round often enough to show a loop, warm-up rows
    included."""
    sine = run.sine
    if sine is not None:
        first = int(np.flatnonzero(np.diff(run.u_V))[0])
        periods = (sine.rows.stop - first) * run.step_s * sine.f_Hz
        if periods < FEWEST_PERIODS - 0.05:
            raise BadInput(
                f"{run.source}: {periods:.2g} periods of {sine.f_Hz:.4g} Hz are too few; "
                f"record at least {FEWEST_PERIODS}, one of them to settle"
            )
    elif turning_points(run.u_V) < 2:
        raise BadInput(
            f"{run.source}: the voltage of {run.axis} turns round less than twice, too little to show a loop; "
            f"record at least {FEWEST_PERIODS} periods"
        )


def turning_points(u: Samples) -> int:
    """How often ``u`` (n,) turns round by more than a tenth of its span."""
    slack = 0.1 * float(np.ptp(u))
    # What a play of that slack makes of u turns only where u turns by more.
    moved, _ = plays(u, [slack / 2], [u[0]])
    steps = np.diff(moved[:, 0])
    directions = np.sign(steps[steps != 0])
    return int(np.count_nonzero(np.diff(directions)))


def moving_rows(run: AxisRun) -> slice:
    """The scored rows without the still ones at either end."""
    start, stop, _ = run.scored.indices(len(run.u_V))
    moves = np.flatnonzero(np.abs(np.diff(run.u_V[start:stop])) > 0)
    return slice(start + int(moves[0]), start + int(moves[-1]) + 2)


def sine_of(run: AxisRun, f_Hz: float | None = None) -> Sine | None:
    """The sine that the scored voltage is, or None when it is something else. ``f_Hz``: known beforehand."""
    rows = moving_rows(run)
    u = run.u_V[rows]
    if len(u) < 16:
        return None
    rough_Hz = _strongest_line(u, run.step_s) if f_Hz is None else f_Hz
    stride = max(1, int(1.0 / (rough_Hz * run.step_s * ROWS_PER_PERIOD)))
    t, u = run.t_s[rows][::stride] - run.t_s[rows.start], u[::stride]
    f_Hz = _refined(t, u, rough_Hz) if f_Hz is None else f_Hz
    if not f_Hz > 0 or f_Hz * (t[-1] - t[0]) < 0.9:
        return None
    (mean, even, odd), left = _sine_fit(t, u, f_Hz)
    amplitude = float(np.hypot(even, odd))
    if not amplitude > 0 or np.sqrt(left / len(u)) > SINE_RESIDUAL * amplitude:
        return None
    return Sine(f_Hz, 2 * amplitude, float(mean), rows)


def _strongest_line(u: Samples, step_s: float) -> float:
    """Its frequency in Hz, to about one over the length of ``u``."""
    spectrum = np.abs(np.fft.rfft((u - u.mean()) * np.hanning(len(u))))
    return max(int(np.argmax(spectrum)), 1) / (len(u) * step_s)


def _refined(t: Samples, u: Samples, rough_Hz: float) -> float:
    """The frequency near ``rough_Hz`` that leaves least, to six digits."""
    wide = 1.5 / float(t[-1] - t[0])
    found = minimize_scalar(
        lambda f: _sine_fit(t, u, f)[1],
        bounds=(max(rough_Hz - wide, 0.2 * wide), rough_Hz + wide),
        method="bounded",
        options={"xatol": 1e-7 * rough_Hz},
    )
    return float(f"{found.x:.6g}")


def _sine_fit(t: Samples, u: Samples, f_Hz: float) -> tuple[Samples, float]:
    """(mean, cosine, sine) of the best sine, and the sum of squares it leaves."""
    turn = 2 * np.pi * f_Hz * t
    basis = np.stack([np.ones_like(t), np.cos(turn), np.sin(turn)])
    coefficients = np.linalg.solve(basis @ basis.T + 1e-12 * len(t) * np.eye(3), basis @ u)
    return coefficients, float(np.sum((u - coefficients @ basis) ** 2))
