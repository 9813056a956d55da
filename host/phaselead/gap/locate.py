"""Where model and measurement part: the residual in cells, ranked, each with a sentence.

Records are cut into blocks and every block into cells of six kinds: frequency, amplitude of the voltage, time since a
step, direction of motion, harmonic order, and the axis (``axis_cells``). A cell stands out when its share of the power
is larger than noise of the records' own colour would give it. One draw of the null takes each block from one of
several simulations of that noise; the largest standardised share over all cells of all kinds gives a p value that
holds for the whole family (max-T, Westfall and Young 1993).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_banded
from scipy.signal import lfilter

from phaselead.gap.cells import AXIS, STEP, Cut, Powers, cut
from phaselead.gap.noise import Noise
from phaselead.gap.records import Run
from phaselead.gap.result import Cell
from phaselead.gap.told import ALL, LEVEL, holds, told
from phaselead.record import Samples

__all__ = ["LEVEL", "Part", "axis_cells", "locate", "simulate_noise"]

DRAWS = 500
SIMULATIONS = 24
"""Of every record's noise; a draw picks one for each block."""
LEAST_SHARE = 0.02
MOST = 14


@dataclass(frozen=True)
class Part:
    """Residual of one run (n,) about its own offset, and the noise that is there when nothing is missing."""

    run: Run
    error_um: Samples
    noise: Noise


def locate(parts: Sequence[Part], seed: int, axis: str | None = None) -> list[Cell]:
    """Cells ranked by share of the unexplained power, those that stand out first; nothing when there is no residual."""
    power = sum(float(np.sum(p.error_um**2)) for p in parts)
    if not power > 0:
        return []
    cuts, names = cut([p.run for p in parts])
    rng = np.random.default_rng(seed)
    simulated = [_simulated(c, p, rng) for c, p in zip(cuts, parts, strict=True)]
    seen = [c.powers(p.error_um[None]) for c, p in zip(cuts, parts, strict=True)]
    blocks = _shares([_dealt(s, rng, by_block=True) for s in simulated])
    whole = _shares([_dealt(s, rng, by_block=False) for s in simulated])
    shares = _shares([_dealt(s, rng, by_block=False, draws=1) for s in seen])[0]
    p_values = _family_wise(shares, blocks, whole.std(axis=0))
    floor = sum(float(s.total.sum(axis=1).mean()) for s in simulated)
    excess = _excess(shares, whole.mean(axis=0), min(floor / power, 1.0))
    found = [
        Cell(by, name, float(share), told(by, name, float(share)), float(p), axis)
        for (by, name), share, p in zip(names, excess, p_values, strict=True)
        if share > LEAST_SHARE
    ]
    found += _after_steps(parts, found, axis)
    return sorted(found, key=lambda c: (c.p > LEVEL, -c.share))[:MOST]


def simulate_noise(noise: Noise, run: Run, rng: np.random.Generator) -> Samples:
    """(n,) over the scored rows: sensor noise, and misfit that wanders along the way of the voltage."""
    u, n = run.u_V[run.rows], run.stop - run.start
    lead = 8 * len(noise.sensor)
    drawn = lfilter([noise.sigma_um], noise.sensor, rng.standard_normal(n + lead))[lead:]
    if noise.misfit_um > 0:
        phi = np.exp(-np.abs(np.diff(u, prepend=u[0])) / noise.length_V)
        grown = noise.misfit_um**2 * (1 - phi**2) + noise.wander_um2_per_s * run.step_s
        grown[0] = noise.misfit_um**2
        banded = np.stack([np.ones(n), np.append(-phi[1:], 0.0)])
        drawn = drawn + solve_banded((1, 0), banded, np.sqrt(grown) * rng.standard_normal(n))
    return np.asarray(drawn - drawn.mean())


def _simulated(of_run: Cut, part: Part, rng: np.random.Generator) -> Powers:
    return of_run.powers(np.stack([simulate_noise(part.noise, part.run, rng) for _ in range(SIMULATIONS)]))


@dataclass(frozen=True)
class _Dealt:
    """One record in every draw: (draws, cells), (draws,) and (draws, orders)."""

    additive: Samples
    total: Samples
    orders: Samples


def _dealt(powers: Powers, rng: np.random.Generator, *, by_block: bool, draws: int = DRAWS) -> _Dealt:
    """Each draw takes each block from a simulation of its own, or all of them from one."""
    simulations, blocks = powers.total.shape
    picked = rng.integers(simulations, size=(draws, blocks if by_block else 1))
    at = (picked, np.arange(blocks))
    return _Dealt(
        powers.additive[at].sum(axis=1), powers.total[at].sum(axis=1), np.abs(powers.coherent[at].sum(axis=1)) ** 2
    )


def _shares(records: Sequence[_Dealt]) -> Samples:
    """(draws, cells) of the power of all records."""
    total = np.sum([r.total for r in records], axis=0)
    cells = np.sum([np.concatenate([r.additive, r.orders], axis=1) for r in records], axis=0)
    return np.asarray(cells / total[:, None])


def _family_wise(shares: Samples, null: Samples, spread: Samples) -> Samples:
    """p values (cells,) by the largest standardised share of each draw of the null (draws, cells).

    Misfit that wanders ties the blocks of a record together, so that shares may scatter by more (``spread``, of whole
    records) than blocks dealt one by one say.
    """
    centre, own = null.mean(axis=0), null.std(axis=0)
    live = own > 1e-9
    seen, drawn = np.zeros(len(shares)), np.zeros_like(null)
    seen[live] = (shares[live] - centre[live]) / np.maximum(own, spread)[live]
    drawn[:, live] = (null[:, live] - centre[live]) / own[live]
    largest = drawn.max(axis=1)
    return np.asarray((1 + (largest[:, None] >= seen).sum(axis=0)) / (len(null) + 1))


def _excess(shares: Samples, expected: Samples, floor: float) -> Samples:
    """Shares (cells,) of what is beyond the noise, which has ``floor`` of the power and lies as ``expected``."""
    if floor > 0.5:
        return shares
    return np.asarray(np.clip((shares - floor * expected) / (1 - floor), 0.0, 1.0))


def _after_steps(parts: Sequence[Part], found: Sequence[Cell], axis: str | None) -> list[Cell]:
    """All times after steps as one cell, where the residual goes on in a line over the logarithm of time."""
    sure = [c.p for c in found if c.by == STEP]
    line = holds([(p.run, p.error_um) for p in parts]) if sure else None
    return [] if line is None else [Cell(STEP, ALL, line.share, line.sentence(), min(sure), axis)]


def axis_cells(errors: Mapping[str, Sequence[Samples]], floors_um: Mapping[str, float]) -> list[Cell]:
    """Which axis the power is on, for several: residuals (n,) by axis beside the noise that each axis has.

    The null deals every axis its noise's power; how far that scatters is taken from blocks of the residual.
    """
    power = {a: float(sum(np.sum(e**2) for e in of_axis)) for a, of_axis in errors.items()}
    total = sum(power.values())
    if len(errors) < 2 or not total > 0:
        return []
    floor = {a: floors_um[a] ** 2 * sum(len(e) for e in of_axis) for a, of_axis in errors.items()}
    ratios = np.array([power[a] / max(floor[a], 1e-30) for a in errors])
    scatter = np.array([_scatter(of_axis) for of_axis in errors.values()])
    rng = np.random.default_rng(0)
    null = np.exp(scatter * rng.standard_normal((DRAWS, len(errors))))
    null = null / null.mean(axis=1, keepdims=True) / scatter
    p = _family_wise(ratios / ratios.mean() / scatter, null, np.zeros(len(ratios)))
    return [
        Cell(AXIS, a, power[a] / total, told(AXIS, a, power[a] / total), float(p[i]), a) for i, a in enumerate(errors)
    ]


def _scatter(errors: Sequence[Samples]) -> float:
    """Relative standard deviation of the mean power, from blocks."""
    blocks = np.array([float(np.mean(part**2)) for e in errors for part in np.array_split(e, 24)])
    mean = float(blocks.mean())
    return max(float(blocks.std() / np.sqrt(len(blocks)) / mean), 1e-3) if mean > 0 else 1.0
