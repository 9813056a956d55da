"""The feedback loop on a model: open loop, sensitivity, margins, at the device's tick.

The plant is discretised exactly for a held voltage (Franklin, Powell and Workman 1998, Digital Control of Dynamic
Systems, section 4.3 and appendix on fractional delays); the controller is that of
``firmware/core/pid.h`` and ``firmware/core/loop_filter.h``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from phaselead.errors import BadInput
from phaselead.model import HOLD_S, LATCH_S, TICK_S, AxisModel, Gains, SmallSignal, small_signal
from phaselead.record import Samples
from phaselead.result import Result, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Response = NDArray[np.complex128]

LOWEST_Hz = 0.1
NYQUIST_Hz = 0.5 / TICK_S
BANDWIDTH = 2**-0.5


@dataclass(frozen=True, repr=False)
class Loop(Result):
    """The loop of one axis at the lowest, the middle and the highest local gain of its model: arrays of shape (3, m)
    over ``f_Hz`` (m,). ``open_loop`` is L, from error to measured position; ``sensitivity`` S = 1/(1 + L), from
    disturbance to position; ``complementary`` T = L/(1 + L), from reference to position.

    >>> import phaselead as pl
    >>> with pl.connect() as dev:
    ...     model = pl.fit(dev.record("sine:5V@5Hz", duration=1))
    >>> loop = pl.loop(model)  # with the gains designed for it
    >>> loop.stable, 1 < loop.peak_sensitivity < 2.1
    (True, True)
    """

    axis: str
    gains: Gains
    plant: SmallSignal
    f_Hz: Samples
    open_loop: Response

    @property
    def gain_um_per_V(self) -> Samples:
        """Local gains, shape (3,)."""
        return local_gains(self.plant)

    @property
    def sensitivity(self) -> Response:
        """S, shape (3, m)."""
        return np.asarray(1 / (1 + self.open_loop))

    @property
    def complementary(self) -> Response:
        """T, shape (3, m)."""
        return np.asarray(self.open_loop / (1 + self.open_loop))

    @property
    def stable(self) -> bool:
        """At every one of the gains, by Nyquist's criterion."""
        return all(is_stable(row) for row in self.open_loop)

    @property
    def peak_sensitivity(self) -> float:
        """Largest |S| over frequencies and gains; infinite where it is not stable."""
        return peak_sensitivity(self.open_loop)

    @property
    def gain_margin_dB(self) -> float:
        """The smallest over the gains, of the crossing of the negative real axis that lies furthest out; negative where
        it is not stable, infinite without a crossing."""
        reached = max(_crossing(row, self.f_Hz)[0] for row in self.open_loop)
        return float(-20 * np.log10(reached)) if reached > 0 else np.inf

    @property
    def phase_margin_deg(self) -> float:
        """The smallest over the gains and over all crossings of |L| = 1; infinite without one."""
        found = [np.inf]
        for row in self.open_loop:
            crosses = np.flatnonzero(np.diff(np.abs(row) > 1))
            found += list(np.abs(np.degrees(np.angle(-row[crosses]))))
        return float(min(found))

    @property
    def bandwidth_Hz(self) -> Samples:
        """Where |T| first falls below -3 dB, by gain, shape (3,)."""
        below = np.abs(self.complementary) < BANDWIDTH
        return np.asarray([self.f_Hz[np.argmax(row)] if row.any() else self.f_Hz[-1] for row in below])

    @property
    def weakest_Hz(self) -> float:
        """Where it is nearest to instability: of the furthest crossing when not stable, else of the peak of |S|."""
        if not self.stable:
            return float(max(_crossing(row, self.f_Hz) for row in self.open_loop)[1])
        return float(self.f_Hz[np.argmax(np.abs(self.sensitivity).max(axis=0))])

    def reason(self) -> str:
        """What limits it, in a few words."""
        mode = min((f for _, f, _ in self.plant.modes), key=lambda f: abs(f - self.weakest_Hz), default=None)
        near = mode is not None and abs(np.log2(self.weakest_Hz / mode)) < 0.5
        where = f"mode at {mode:.4g} Hz" if near else f"delay of {1e3 * self.plant.delay_s:.3g} ms"
        margin = f"{self.gain_margin_dB:{'.0f' if abs(self.gain_margin_dB) >= 10 else '.2g'}}"
        phase = f", phase margin {self.phase_margin_deg:.0f} degrees" if self.stable else ""
        return f"{where}: gain margin {margin} dB{phase}"

    def as_dict(self) -> dict[str, Any]:
        """The figures, without the curves."""
        low, _, high = self.bandwidth_Hz
        return {
            "axis": self.axis,
            "stable": self.stable,
            "peak_sensitivity": self.peak_sensitivity,
            "gain_margin_dB": self.gain_margin_dB,
            "phase_margin_deg": self.phase_margin_deg,
            "bandwidth_Hz": [float(low), float(high)],
        }

    @property
    def columns(self) -> dict[str, Any]:
        """Frequency and the magnitudes of L, S and T, the largest over the gains, each (m,)."""
        parts = {"L": self.open_loop, "S": self.sensitivity, "T": self.complementary}
        return {"f_Hz": self.f_Hz} | {f"{name}_largest": np.abs(part).max(axis=0) for name, part in parts.items()}

    def tables(self) -> list[Table | str]:
        low, _, high = self.bandwidth_Hz
        lowest, _, highest = self.gain_um_per_V
        rows = (
            ("local gain (um/V)", f"{lowest:.3g} to {highest:.3g}"),
            ("peak sensitivity", f"{self.peak_sensitivity:.2f}"),
            ("gain margin (dB)", f"{self.gain_margin_dB:.1f}"),
            ("phase margin (deg)", f"{self.phase_margin_deg:.0f}"),
            ("bandwidth, -3 dB (Hz)", f"{low:.3g} to {high:.3g}" if self.stable else "none: not stable"),
        )
        return [Table(("", ""), rows, f"loop of axis {self.axis}")]

    def plot(self) -> Figure:
        """Magnitudes of L, S and T at the three gains."""
        from phaselead.control.pictures import loop_figure  # matplotlib is slow to load and is needed here only

        return loop_figure(self.f_Hz, self.gain_um_per_V, self.open_loop, self.sensitivity, self.complementary)

    def __repr__(self) -> str:
        return f"<Loop of axis {self.axis}: peak sensitivity {self.peak_sensitivity:.2f}>"


def loop_of(axis: str, model: AxisModel, gains: Gains) -> Loop:
    """The loop of one axis' model under these gains. Raises BadInput where the model does not tell."""
    try:
        plant = small_signal(model)
    except BadInput as error:
        raise BadInput(f"{axis}: no loop can be computed: {error}") from None
    f_Hz = frequencies(plant)
    return Loop(axis, gains, plant, f_Hz, open_loop(plant, gains, f_Hz))


def local_gains(plant: SmallSignal) -> Samples:
    """Lowest, middle (geometric) and highest, um/V, shape (3,). A gain near 0 opens the loop and does no harm: it is
    taken as a tenth of the highest."""
    low, high = plant.gain_um_per_V
    return np.geomspace(max(low, 0.1 * high), high, 3)


def frequencies(plant: SmallSignal) -> Samples:
    """Logarithmic from 0.1 Hz to half the tick rate, dense about the modes, Hz, shape (m,)."""
    near = np.concatenate([-np.geomspace(0.2, 5e-4, 40), [0.0], np.geomspace(5e-4, 0.2, 40)])
    modes = [f * (1 + near) for _, f, _ in plant.modes if f < NYQUIST_Hz]
    return np.unique(np.concatenate([np.geomspace(LOWEST_Hz, NYQUIST_Hz, 400), *modes]).clip(LOWEST_Hz, NYQUIST_Hz))


def open_loop(plant: SmallSignal, gains: Gains, f_Hz: Samples) -> Response:
    """L at each of the local gains, shape (3, m)."""
    return np.asarray(local_gains(plant)[:, None] * plant_response(plant, f_Hz) * pid_response(gains, f_Hz))


def pid_response(gains: Gains, f_Hz: Samples) -> Response:
    """V/um, shape (m,): Kp + Ki Ts / (1 - 1/z) + Kd/Ts (1 - 1/z), the derivative behind its filter if it has one, all
    of it behind the filters of the loop."""
    back = np.exp(-2j * np.pi * f_Hz * TICK_S)
    derivative = gains.kd_V_s_per_um / TICK_S * (1 - back)
    if gains.derivative_filter_Hz is not None:
        kept = np.exp(-2 * np.pi * gains.derivative_filter_Hz * TICK_S)
        derivative = derivative * (1 - kept) / (1 - kept * back)
    found = np.asarray(gains.kp_V_per_um + gains.ki_V_per_um_s * TICK_S / (1 - back) + derivative)
    for one in gains.filters or ():
        found = found * one.section().response(f_Hz)
    return found


def plant_response(plant: SmallSignal, f_Hz: Samples) -> Response:
    """From the held voltage to the sampled position, static gain 1, shape (m,)."""
    back = np.exp(-2j * np.pi * f_Hz * TICK_S)
    kept = [float(np.exp(-TICK_S / tau_s)) for tau_s in plant.lags_s]
    # A sampled lag is quicker than the one it stands for; what it lacks at low frequencies is dead time.
    lacking_s = sum(tau_s - p / (1 - p) * TICK_S for tau_s, p in zip(plant.lags_s, kept, strict=True))
    dead_s = max(plant.delay_s - HOLD_S, 0.0) + LATCH_S + lacking_s
    whole = int(dead_s / TICK_S)
    part_s = dead_s - whole * TICK_S
    rigid = 1 - sum(c for c, _, _ in plant.modes)
    found = rigid * back + sum(c * _held_mode(2 * np.pi * f, zeta, part_s, back) for c, f, zeta in plant.modes)
    for p in kept:
        found = found * (1 - p) / (1 - p * back)
    return np.asarray(found * back**whole)


def _held_mode(w: float, zeta: float, late_s: float, back: Response) -> Response:
    """w^2/(s^2 + 2 zeta w s + w^2) behind a hold that is ``late_s`` < TICK_S late, as a function of 1/z."""
    step, _ = _moved(w, zeta, TICK_S)
    rest, new = _moved(w, zeta, TICK_S - late_s)
    _, old = _moved(w, zeta, late_s)
    old = rest @ old  # what the voltage of the tick before does until the new one is latched
    drive = new[:, None] + old[:, None] * back
    ahead = 1 / back
    determinant = (ahead - step[0, 0]) * (ahead - step[1, 1]) - step[0, 1] * step[1, 0]
    return np.asarray(((ahead - step[1, 1]) * drive[0] + step[0, 1] * drive[1]) / determinant)


@lru_cache(maxsize=1024)
def _moved(w: float, zeta: float, seconds: float) -> tuple[Samples, Samples]:
    """Transition (2, 2) of position and velocity/w, and what a constant 1 V adds (2,)."""
    system = np.zeros((3, 3))
    system[:2] = w * np.array([[0.0, 1.0, 0.0], [-1.0, -2 * zeta, 1.0]])
    from scipy.linalg import expm  # a word with the device does without scipy

    moved = expm(system * seconds)
    return moved[:2, :2], moved[:2, 2]


def is_stable(row: Response) -> bool:
    """Nyquist's criterion for a stable plant: 1 + L, whose phase is followed from the lowest frequency to half the tick
    rate, where it is real, has not gone round 0. L (m,) must be fine enough for its phase to be followed."""
    phase = np.unwrap(np.angle(1 + row))
    return bool(abs(phase[-1]) < np.pi / 2)


def goes_round_0(row: Response) -> bool:
    """Whether a curve (m,) that begins and ends near 1 goes round 0. It is (1 + L) / (1 + L') that is followed where L'
    is known to be stable and L is not fine enough for its own phase: wherever L' is nearly L it stays at 1."""
    phase = np.unwrap(np.angle(row))
    return bool(abs(phase[-1] - phase[0]) > np.pi)


def peak_sensitivity(rows: Response) -> float:
    """Largest |1/(1 + L)| of L (k, m); infinite where one of them is not stable."""
    if not all(is_stable(row) for row in rows):
        return np.inf
    return float(1 / np.abs(1 + rows).min())


def _crossing(row: Response, f_Hz: Samples) -> tuple[float, float]:
    """How far out the negative real axis is crossed at most, and where in Hz; 0 without a crossing."""
    imaginary = row.imag
    i = np.flatnonzero(imaginary[:-1] * imaginary[1:] <= 0)
    share = imaginary[i] / np.where(imaginary[i] == imaginary[i + 1], 1, imaginary[i] - imaginary[i + 1])
    reached = -(row.real[i] + share * (row.real[i + 1] - row.real[i]))
    if not (reached > 0).any():
        return 0.0, float(f_Hz[-1])
    furthest = int(np.argmax(reached))
    return float(reached[furthest]), float(f_Hz[i[furthest]])
