"""Where model and measurement disagree: cells of the residual ranked by their share of its power, each in words.

Records are cut into blocks, and blocks into cells of six kinds: frequency, voltage, time since a step, direction of
motion, harmonic order and axis. A cell stands out when its share of the power is larger than noise with the spectrum of
the records would give it. To test that, the noise of every record is simulated several times, and each draw of the null
distribution takes each block from one of these simulations. The largest standardised share over all cells gives p
values that hold for all cells together (max-T, Westfall and Young 1993).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from phaselead.gap.error_rates import ERROR_RATE
from phaselead.gap.findings import Cell
from phaselead.gap.locate.cells import AXIS, STEP, Cut, Powers, cut
from phaselead.gap.locate.sentences import sentence_of
from phaselead.gap.locate.steps import ALL, slow_response
from phaselead.gap.noise import Noise
from phaselead.gap.residual import RunResidual
from phaselead.record import Samples

NULL_DRAWS = 500
"""Of the null distribution."""
SIMULATIONS = 24
"""Of the noise of every record; a draw picks one for each block."""
LEAST_CELL_SHARE = 0.02
"""Of the unexplained power, below which a cell is not listed."""
MOST_RANKED = 14
SCATTER_BLOCKS = 24
"""Per record, from which the scatter of an axis' power is taken."""


def rank_cells(parts: Sequence[RunResidual], noise: Noise, seed: int = 0) -> list[Cell]:
    """Cells ranked by their share of the unexplained power, those that stand out first.

    At most MOST_RANKED of at least LEAST_CELL_SHARE; empty where the residual is 0 everywhere. ``noise`` is what
    the records have when nothing is missing; ``seed`` fixes the draws.
    """
    power = sum(float(np.sum(p.error_um**2)) for p in parts)
    if not power > 0:
        return []
    cuts, names = cut([p.run for p in parts])
    rng = np.random.default_rng(seed)
    simulated = [_simulated(c, p, noise, rng) for c, p in zip(cuts, parts, strict=True)]
    seen = [c.powers(p.error_um[None]) for c, p in zip(cuts, parts, strict=True)]
    blocks = _shares([_drawn(s, rng, by_block=True) for s in simulated])
    whole = _shares([_drawn(s, rng, by_block=False) for s in simulated])
    shares = _shares([_drawn(s, rng, by_block=False, draws=1) for s in seen])[0]
    p_values = _family_wise(shares, blocks, whole.std(axis=0))
    floor = sum(float(s.total.sum(axis=1).mean()) for s in simulated)
    excess = _excess(shares, whole.mean(axis=0), min(floor / power, 1.0))
    found = [
        Cell(by, name, float(share), sentence_of(by, name, float(share)), float(p))
        for (by, name), share, p in zip(names, excess, p_values, strict=True)
        if share > LEAST_CELL_SHARE
    ]
    found += _after_steps(parts, found)
    return sorted(found, key=lambda c: (c.p > ERROR_RATE, -c.share))[:MOST_RANKED]


def _simulated(of_run: Cut, part: RunResidual, noise: Noise, rng: np.random.Generator) -> Powers:
    run = part.run
    draws = [noise.drawn(run.u_V[run.rows], run.step_s, rng) for _ in range(SIMULATIONS)]
    return of_run.powers(np.stack([one - one.mean() for one in draws]))


@dataclass(frozen=True)
class _Drawn:
    """Power (um^2) of one record in every draw: (draws, cells), (draws,) and (draws, orders)."""

    additive: Samples
    total: Samples
    orders: Samples


def _drawn(powers: Powers, rng: np.random.Generator, *, by_block: bool, draws: int = NULL_DRAWS) -> _Drawn:
    """Draws from simulations: each block from one picked at random, or all blocks from the same one."""
    simulations, blocks = powers.total.shape
    picked = rng.integers(simulations, size=(draws, blocks if by_block else 1))
    at = (picked, np.arange(blocks))
    return _Drawn(
        powers.additive[at].sum(axis=1), powers.total[at].sum(axis=1), np.abs(powers.coherent[at].sum(axis=1)) ** 2
    )


def _shares(records: Sequence[_Drawn]) -> Samples:
    """Share (draws, cells) of each cell in the power of all records."""
    total = np.sum([r.total for r in records], axis=0)
    cells = np.sum([np.concatenate([r.additive, r.orders], axis=1) for r in records], axis=0)
    return np.asarray(cells / total[:, None])


def _family_wise(shares: Samples, null: Samples, spread: Samples) -> Samples:
    """p values (cells,) from the largest standardised share in each draw of the null distribution (draws, cells).

    ``spread`` is the scatter of the shares over draws of whole records: neighbouring blocks share their misfit, so it
    may be larger than draws block by block show.
    """
    centre, own = null.mean(axis=0), null.std(axis=0)
    live = own > 1e-9
    seen, drawn = np.zeros(len(shares)), np.zeros_like(null)
    seen[live] = (shares[live] - centre[live]) / np.maximum(own, spread)[live]
    drawn[:, live] = (null[:, live] - centre[live]) / own[live]
    largest = drawn.max(axis=1)
    return np.asarray((1 + (largest[:, None] >= seen).sum(axis=0)) / (len(null) + 1))


def _excess(shares: Samples, expected: Samples, floor: float) -> Samples:
    """Shares (cells,) of the power beyond the noise, whose own share is ``floor`` and lies as ``expected``."""
    if floor > 0.5:
        return shares
    return np.asarray(np.clip((shares - floor * expected) / (1 - floor), 0.0, 1.0))


def _after_steps(parts: Sequence[RunResidual], found: Sequence[Cell]) -> list[Cell]:
    """One cell for all times after steps, where the residual follows the logarithm of time, as creep does."""
    p_values = [c.p for c in found if c.by == STEP]
    slow = slow_response([(p.run, p.error_um) for p in parts]) if p_values else None
    return [] if slow is None else [Cell(STEP, ALL, slow.share, slow.sentence(), min(p_values))]


def axis_cells(errors: Mapping[str, Sequence[Samples]], floors_um: Mapping[str, float]) -> list[Cell]:
    """Share of each axis in the power, where there are several: residuals (n,) by axis, and the noise of each (um rms).

    Under the null hypothesis every axis has the power of its noise, with the scatter that blocks of its residual show.
    """
    power = {a: float(sum(np.sum(e**2) for e in of_axis)) for a, of_axis in errors.items()}
    total = sum(power.values())
    if len(errors) < 2 or not total > 0:
        return []
    floor = {a: floors_um[a] ** 2 * sum(len(e) for e in of_axis) for a, of_axis in errors.items()}
    ratios = np.array([power[a] / max(floor[a], 1e-30) for a in errors])
    scatter = np.array([_scatter(of_axis) for of_axis in errors.values()])
    rng = np.random.default_rng(0)
    null = np.exp(scatter * rng.standard_normal((NULL_DRAWS, len(errors))))
    null = null / null.mean(axis=1, keepdims=True) / scatter
    p = _family_wise(ratios / ratios.mean() / scatter, null, np.zeros(len(ratios)))
    return [
        Cell(AXIS, a, power[a] / total, sentence_of(AXIS, a, power[a] / total), float(p[i]), a)
        for i, a in enumerate(errors)
    ]


def _scatter(errors: Sequence[Samples]) -> float:
    """Relative standard deviation of the mean power."""
    blocks = np.array([float(np.mean(part**2)) for e in errors for part in np.array_split(e, SCATTER_BLOCKS)])
    mean = float(blocks.mean())
    return max(float(blocks.std() / np.sqrt(len(blocks)) / mean), 1e-3) if mean > 0 else 1.0
