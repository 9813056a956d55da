"""A frequency response measured on a device: from voltage to position in open loop, from reference in a closed one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from phaselead.control.kept_runs import KeptRuns
from phaselead.control.tracking import track
from phaselead.control.tuning.excitation import Grid, Lines, multisine
from phaselead.device import TICK_HZ, Device
from phaselead.errors import BadInput
from phaselead.model import Gains, Stage
from phaselead.record import Samples, Source

Response = NDArray[np.complex128]
Spectra = NDArray[np.complex128]

REALISATIONS = 2
"""Draws of the phases: what differs between them beyond the noise is what the stage is not linear in."""
NEIGHBOURS = 4
WINDOW = np.ones(2 * NEIGHBOURS + 1) / (2 * NEIGHBOURS + 1)
LEAST_COHERENCE = 0.95
"""Of a line that counts: its gain is then uncertain by less than 6 % after 16 periods (Bendat and Piersol 2010, Random
Data, table 9.6)."""


@dataclass(frozen=True)
class Plan:
    """How long and how fine: a settling time, then ``periods`` that count."""

    grid: Grid
    settle_periods: int
    periods: int

    @property
    def seconds(self) -> float:
        return (self.settle_periods + self.periods) * self.grid.ticks / TICK_HZ


@dataclass(frozen=True)
class Distortion:
    """What was heard besides the linear response, um rms a line at the lines (m,) that listened."""

    f_Hz: Samples
    um: Samples


@dataclass(frozen=True)
class Measured:
    """Frequencies (m,), complex gain (m,), coherence (m,) and standard deviation of the gain (m,), as a share of it.

    ``linear`` is the response itself, um rms a line; ``odd``, ``even`` and ``noise`` what came besides.
    """

    f_Hz: Samples
    gain: Response
    coherence: Samples
    deviation: Samples
    middle_um: float
    """Position about which it was measured."""
    linear: Distortion
    odd: Distortion
    even: Distortion
    noise: Distortion
    sources: tuple[Source, ...] = ()
    """The recordings it was made of."""

    def levels_dB(self) -> dict[str, float]:
        """Of odd and even distortion and of noise against the linear response, each the rms over its lines below
        ``f_Hz``'s middle (geometric), where position counts."""
        edge_Hz = float(np.sqrt(self.f_Hz[0] * self.f_Hz[-1]))
        rms = {name: _rms(getattr(self, name), edge_Hz) for name in ("linear", "odd", "even", "noise")}
        return {name: float(20 * np.log10(rms[name] / rms["linear"])) for name in ("odd", "even", "noise")}

    def joined(self, faster: Measured) -> Measured:
        """The two as one, what the other has at higher frequencies added. Levels stay those of this one."""
        more = faster.f_Hz > self.f_Hz[-1]
        return replace(
            self,
            f_Hz=np.concatenate([self.f_Hz, faster.f_Hz[more]]),
            gain=np.concatenate([self.gain, faster.gain[more]]),
            coherence=np.concatenate([self.coherence, faster.coherence[more]]),
            deviation=np.concatenate([self.deviation, faster.deviation[more]]),
            sources=(*self.sources, *faster.sources),
        )

    def reliable(self) -> NDArray[np.bool_]:
        """Lines with enough coherence, (m,)."""
        return self.coherence >= LEAST_COHERENCE


def _rms(part: Distortion, edge_Hz: float) -> float:
    low = part.um[part.f_Hz < edge_Hz]
    return float(np.sqrt(np.mean((low if len(low) else part.um) ** 2))) or 1e-12


def measure(
    device: Device,
    axis: str,
    plan: Plan,
    *,
    swing: float,
    middle: float,
    stage: Stage,
    gains: Gains | None = None,
    name: str = "response",
    kept: KeptRuns | None = None,
    on_progress: Callable[[float], None] | None = None,
) -> Measured:
    """Drives ``REALISATIONS`` multisines about ``middle``: volts in open loop, micrometres under ``gains``.

    In open loop the gain is from applied voltage to measured position, um/V; in a closed one from reference to
    measured position. ``kept`` takes the runs, under ``name`` and a number.

    Raises BadInput for a path outside limits, DeviceFault as ``track``.
    """
    unit, mode = ("V", "open") if gains is None else ("um", "pid")
    kept = kept or KeptRuns(None)
    spectra, middles_um, sources = [], [], []
    for number in range(REALISATIONS):
        wave = multisine(plan.grid, swing, middle, unit, seed=number)  # type: ignore[arg-type]
        run = track(
            device,
            {axis: wave},
            mode,
            stage=stage,
            gains=None if gains is None else {axis: gains},
            duration_s=plan.seconds + 1.0,
            force=True,
        )
        sources.append(kept.add(f"{name}-{number + 1}", run))
        record = run.recording.axes[axis]
        assert record.x_um is not None
        given = record.u_V if gains is None else record.r_um
        assert given is not None
        first = int(np.searchsorted(run.t_s, run.t_s[-1] - (plan.periods * plan.grid.ticks) / TICK_HZ))
        middles_um.append(float(record.x_um[first:].mean()))
        spectra.append([_periods(column[first:], plan) for column in (given, record.x_um)])
        if on_progress is not None:
            on_progress((number + 1) / REALISATIONS)
    given_of, found_of = (np.array([pair[i] for pair in spectra]) for i in (0, 1))
    found = response_of(given_of, found_of, plan.grid, float(np.mean(middles_um)))
    return replace(found, sources=tuple(sources))


def _periods(values: Samples, plan: Plan) -> Spectra:
    """Amplitudes by period and line, (p, n), rms; a drift over several periods is taken out: straight lines between the
    means of periods, the first and the last of which go on to the ends."""
    n = plan.grid.ticks
    rows = values[: plan.periods * n].reshape(plan.periods, n)
    means, centres = rows.mean(axis=1), (np.arange(plan.periods) + 0.5) * n
    before, behind = 2 * means[0] - means[1], 2 * means[-1] - means[-2]
    around = [centres[0] - n, *centres, centres[-1] + n]
    drift = np.interp(np.arange(rows.size), around, [before, *means, behind]).reshape(rows.shape)
    return np.asarray(np.fft.rfft(rows - drift, axis=1) * np.sqrt(2) / n)


def response_of(given: Spectra, found: Spectra, grid: Grid, middle_um: float = 0.0) -> Measured:
    """From amplitudes (draws, periods, lines). Raises BadInput where nothing that was driven is heard."""
    lines = grid.excited
    u, y = given[:, :, lines], found[:, :, lines]
    cross, power = (y * u.conj()).mean(axis=(0, 1)), (np.abs(u) ** 2).mean(axis=(0, 1))
    heard = power * (np.abs(y) ** 2).mean(axis=(0, 1))
    coherence = np.divide(np.abs(cross) ** 2, heard, out=np.zeros(len(lines)), where=heard > 0)
    if not (coherence >= LEAST_COHERENCE).any():
        raise BadInput(
            f"no coherence: at none of {len(lines)} frequencies does the position follow what is driven (at best "
            f"{coherence.max():.2f}, {LEAST_COHERENCE} is needed); is the amplifier on, the sensor connected, "
            "and --level large enough?"
        )
    gain = cross / power
    draws, periods = found.shape[:2]
    deviation = _smooth(np.abs((y.mean(axis=1) / u.mean(axis=1)) / gain - 1).max(axis=0)) / np.sqrt(draws)
    noise = np.sqrt(found[:, :, lines].var(axis=1).mean(axis=0) / periods)
    f_Hz = grid.frequencies(lines)
    odd, even = (_besides(given, found, gain, grid, silent) for silent in (grid.odd, grid.even))
    linear = Distortion(f_Hz, np.abs(y.mean(axis=1)).mean(axis=0))
    return Measured(f_Hz, gain, coherence, deviation, middle_um, linear, odd, even, Distortion(f_Hz, noise))


def _smooth(values: Samples) -> Samples:
    """Over neighbours: from two draws one line alone does not tell how far it may be off."""
    return np.asarray(np.convolve(np.pad(values, NEIGHBOURS, mode="edge"), WINDOW, mode="valid"))


def _besides(given: Spectra, found: Spectra, gain: Response, grid: Grid, silent: Lines) -> Distortion:
    """What comes at lines that are not driven, less what the linear response makes of what is driven there anyhow."""
    re, im = (np.interp(silent, grid.excited, part) for part in (gain.real, gain.imag))
    left = found[:, :, silent].mean(axis=1) - (re + 1j * im) * given[:, :, silent].mean(axis=1)
    return Distortion(grid.frequencies(silent), np.sqrt((np.abs(left) ** 2).mean(axis=0)))
