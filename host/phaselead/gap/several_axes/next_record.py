"""The record of all axes that would tell rivals in front of shared modes apart, or the power of the level.

A training record of the strongest level is predicted again at other levels by every rival. Half a squared distance
between two predictions is the log odds that the record is expected to bring, in units of what the model leaves of
held-out records, octave by octave. Every line of one period counts once: what a model misses repeats with the period.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np

from phaselead.gap.design import passes, sensor_for
from phaselead.gap.error_rates import INSIDE, SURE
from phaselead.gap.findings import NextExperiment
from phaselead.gap.posterior import MORE_LIKELY_THAN_NOT
from phaselead.gap.several_axes.common_modes import CommonModes
from phaselead.gap.several_axes.joint_records import JointRecord, level_groups, scaled
from phaselead.gap.several_axes.results import StageFit
from phaselead.identify import common_period
from phaselead.model import catalogue
from phaselead.record import Samples

BEYOND = (0.5, 1.5)
"""Of the weakest and of the strongest level: what is tried where no level between those of the records tells."""
DRIVEN = 1e-3
"""Of the largest amplitude: lines below it are not driven."""
FEWEST_LINES = 3
"""Of a multisine."""


@dataclass(frozen=True)
class _Predicted:
    record: JointRecord
    log_odds: float
    """The least between two rivals."""

    @property
    def chance(self) -> float:
        """Probability that it tells as surely as a name needs."""
        return float(passes(self.log_odds, np.log(SURE / (1 - SURE))))

    @property
    def good(self) -> bool:
        """Whether it is expected to tell."""
        return self.chance >= INSIDE


def propose_together(found: StageFit) -> NextExperiment | None:
    """The record for the first tie, or for a power of the level that is not determined; None where neither is."""
    tie = found.ties[0] if found.ties else None
    if tie is None and not found.exponent_open:
        return None
    members = tie.fits if tie is not None else found.fit.other_powers
    levels = [float(np.mean([r.level_V for r in group])) for group in level_groups(found.train)]
    played = level_groups(found.train)[0][0]
    between = [float(np.sqrt(a * b)) for a, b in pairwise(levels)]
    tried = [_predicted(found, played, members, level) for level in between]
    if not any(one.good for one in tried):
        beyond = (BEYOND[0] * levels[-1], BEYOND[1] * levels[0])
        tried += [_predicted(found, played, members, level) for level in beyond if _allowed(found, played, level)]
    if not tried:
        return None
    best = max((one for one in tried if one.good), default=None, key=lambda one: one.log_odds)
    best = best or max(tried, key=lambda one: one.log_odds)
    unlikely = best.chance <= MORE_LIKELY_THAN_NOT
    sensor = sensor_for([catalogue()[n] for n in tie.names]) if tie is not None and unlikely else None
    return _experiment(found, best, sensor, () if tie is None else tie.names)


def _at_level(found: StageFit, record: JointRecord, level_V: float) -> JointRecord:
    return scaled(record, found.models, level_V / record.level_V)


def _allowed(found: StageFit, record: JointRecord, level_V: float) -> bool:
    """Whether the voltages of a record keep to the limits of every axis, or to what was played before."""
    if level_V <= record.level_V:
        return True
    u = _at_level(found, record, level_V).u_V
    for i, axis in enumerate(found.axes):
        limits = found.stage.axes[axis].limits
        steepest = float(np.max(np.abs(np.diff(u[:, i])))) / record.step_s
        inside = limits.u_min_V <= u[:, i].min() and u[:, i].max() <= limits.u_max_V
        if not inside or steepest > limits.slew_V_per_s:
            return False
    return True


def _predicted(found: StageFit, played: JointRecord, members: Sequence[CommonModes], level_V: float) -> _Predicted:
    made = _at_level(found, played, level_V)
    period = common_period([r.experiment for r in (played, *found.held_out)])
    noise = _power_left(found, made.level_V, period)
    answers = [_last(member.answer(made), made, period) for member in members]
    odds = [float(np.sum(np.abs(_lines(a - b)) ** 2 / _per_line(noise, len(a)))) for a, b in combinations(answers, 2)]
    return _Predicted(made, min(odds))


def _last(x: Samples, record: JointRecord, period: int | None) -> Samples:
    """The last period (rows, axes) of the scored rows, or all of them."""
    scored = x[record.rows]
    return scored if period is None else scored[-period:]


def _lines(x: Samples) -> Samples:
    """(lines, axes), scaled so that white noise of any length has the same power a line."""
    return np.asarray(np.fft.rfft(x, axis=0)[1:] / np.sqrt(len(x)))


def _octaves(count: int, rows: int) -> Samples:
    """For each of the lines (count,) of so many rows, the octave below the sampling rate that it lies in."""
    return np.asarray(np.floor(np.log2(rows / np.arange(1, count + 1))).astype(int))


def _power_left(found: StageFit, level_V: float, period: int | None) -> dict[int, Samples]:
    """By octave: power a line (axes,) that the model leaves of the held-out records nearest in level. Those of a weaker
    drive are taken to leave more at this one, in proportion."""
    groups = level_groups(found.held_out)
    nearest = min(groups, key=lambda g: abs(float(np.log(g[0].level_V / level_V))))
    by_octave: dict[int, list[Samples]] = {}
    for record in nearest:
        error = _last(record.x_um - found.fit.answer(record), record, period)
        power = np.abs(_lines(error)) ** 2 * max(1.0, level_V / record.level_V) ** 2
        octaves = _octaves(len(power), len(error))
        for octave in np.unique(octaves):
            by_octave.setdefault(int(octave), []).append(power[octaves == octave].mean(axis=0))
    return {octave: np.mean(powers, axis=0) for octave, powers in by_octave.items()}


def _per_line(noise: dict[int, Samples], rows: int) -> Samples:
    """(lines, axes) power, for a record of so many rows; an octave that was not seen counts as the one next to it."""
    octaves = _octaves(rows // 2, rows)
    known = sorted(noise)
    at = [noise[min(known, key=lambda k: abs(k - octave))] for octave in octaves.tolist()]
    return np.maximum(np.array(at), 1e-300)


def _experiment(found: StageFit, one: _Predicted, sensor: str | None, names: tuple[str, ...]) -> NextExperiment:
    record = one.record
    period = common_period([record.experiment])
    scored = record.u_V[record.experiment.rows]
    u = scored if period is None else scored[-period:]
    lines = np.abs(np.fft.rfft(u - u.mean(axis=0), axis=0)).max(axis=1)
    driven = np.flatnonzero(lines > DRIVEN * lines.max())
    per_line_Hz = 1 / (len(u) * record.step_s)
    multisine = period is not None and len(driven) >= FEWEST_LINES
    return NextExperiment(
        waveform="multisine" if multisine else "record",
        level=float(np.max(np.ptp(u, axis=0))),
        band=(per_line_Hz, float(driven[-1]) * per_line_Hz),
        bias=float(np.mean((u.max(axis=0) + u.min(axis=0)) / 2)),
        seconds=len(record.u_V) * record.step_s,
        separation=one.log_odds,
        chance=one.chance,
        needs_sensor=sensor,
        source=None if multisine else record.source,
        tells_apart=names,
        drives=",".join(found.axes),
        axis=",".join(found.axes),
    )
