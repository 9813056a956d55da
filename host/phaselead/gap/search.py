"""Growing the explanation one effect at a time: scan by sensitivities, refit the best few, score."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve, pinvh

from phaselead.gap.atoms import Atom
from phaselead.gap.bench import Bench
from phaselead.gap.correction import Correction, flexible_left
from phaselead.gap.mode_start import is_mode, mode_starts
from phaselead.gap.panel import Index, Panel
from phaselead.gap.refit import Entry, Fitted, bounded, fresh_columns, refit, squares
from phaselead.model import Effect
from phaselead.record import Samples

TOP = 3
"""How many effects are refitted to the end; the others only roughly."""
STARTS = 2
"""From how many shapes each."""
SIZES = (0.3, 1.0, 3.0)
"""Multiples of a linear estimate from which a refit may start: some effects are linear in their size only near 0."""
POWERLESS = 1e-6
"""Whitened squares of an atom at its typical size below which the records cannot show it at all."""
MARGIN_GAIN, SCATTERED, SCATTERED_BESIDE = 10.0, 0.1, 0.4
"""Least gain worth a refit; and of the penalty, least gain over the scatter of the residual along an effect; more of it
beside reference records, which say what the base leaves."""
PEAKLESS = 0.25
"""Damping above which what looks like a mode is none: those of flexures lie below 0.1."""
OWN_RATIO, OWN_SHARE = 1.15, 0.3
"""In frequency, and of the motion: a mode that is nearer to one of the base's and carries less is that one, moved."""
PLAIN_MODE = 0.05
"""Of the whitened squares: a mode that may take this much is worth a fine grid of starts."""
MOST_TRIED = 7
ROUGH_STEPS = 2


@dataclass(frozen=True)
class Scanned:
    """The best shape of one effect for the residual as it is. Squares are in units of the noise along the atom."""

    effect: Effect
    atom: Atom
    amounts: tuple[float, ...]
    gain: float
    score: float
    inflation: float
    std: tuple[float, ...]
    """Of the amounts, for white noise of unit variance."""


@dataclass(frozen=True)
class Tried:
    """An effect refitted together with those named before it."""

    effect: Effect
    fitted: Fitted


def scan(bench: Bench, fitted: Fitted, candidates: Sequence[Effect]) -> list[list[Scanned]]:
    """Per effect its shapes, best first; effects best first. Those without any power on these records are left out."""
    view = _scan_moments(bench, fitted)
    names = {e.name for e in candidates}
    by_name: dict[str, list[Scanned]] = {}
    for i, atom in enumerate(bench.layout.atoms):
        if atom.effect.name not in names:
            continue
        result = view.atom(bench.layout.of_atom(i))
        if result is None:
            continue
        amounts, std, gain, inflation = result
        inflation = max(inflation, bench.mistaken.get(atom.effect.name, 1.0))
        score = gain / inflation - penalty(bench, atom.effect)
        by_name.setdefault(atom.effect.name, []).append(
            Scanned(atom.effect, atom, tuple(amounts.tolist()), gain, score, inflation, tuple(std.tolist()))
        )
    found = [sorted(shapes, key=lambda s: -s.score) for shapes in by_name.values()]
    return sorted(found, key=lambda shapes: -shapes[0].score)


@dataclass(frozen=True)
class _View:
    """Training moments after the nuisances, with how the residual scatters from block to block along each column."""

    total: Samples
    inflation: Samples
    target: int

    def atom(self, columns: Index) -> tuple[Samples, Samples, float, float] | None:
        """Amounts, their deviations, gain in squares and inflation of one atom; None without power."""
        power = np.diag(self.total)[columns]
        seen = power > POWERLESS
        if not seen.any():
            return None
        live = columns[seen]
        normal = self.total[np.ix_(live, live)] + 1e-9 * np.diag(power[seen])
        amounts, std = np.zeros(len(columns)), np.full(len(columns), np.inf)
        inverse = _inverse(normal)
        amounts[seen] = inverse @ self.total[live, self.target]
        std[seen] = np.sqrt(np.maximum(np.diag(inverse), 1 / np.diag(normal)))
        return amounts, std, float(self.total[columns, self.target] @ amounts), float(self.inflation[live].max())


def _inverse(normal: Samples) -> Samples:
    """Of a normal matrix (k, k); a pseudo-inverse where columns are one behind what the nuisances took."""
    try:
        return np.asarray(cho_solve(cho_factor(normal), np.eye(len(normal))))
    except LinAlgError:
        return np.asarray(pinvh(normal, rtol=1e-9))


def _scan_moments(bench: Bench, fitted: Fitted) -> _View:
    """Everything fitted so far becomes a nuisance: common columns shrunk, tangents free."""
    moments = full_moments(bench.train, fitted)
    target = moments.shape[-1] - 1
    tangents = np.arange(bench.layout.size, target)
    nuisances = with_free(bench.common, tangents)
    shifted = nuisances.applied(moments, target)
    total = shifted.sum(axis=0)
    projector = projection(total, nuisances)
    conditioned = projector.T @ total
    amounts = flexible_left(moments, nuisances, np.arange(target), target)
    amounts[nuisances.index] += nuisances.mean  # shifted moments have the mean taken out already
    return _View(conditioned, block_inflation(shifted, projector, amounts), target)


def full_moments(panel: Panel, fitted: Fitted) -> Samples:
    """Moments (blocks, k, k) of [all fixed columns, tangents, residual] at a fit."""
    return panel.with_columns([fresh_columns(t, fitted.entries, fitted.free) for t in panel.evidence.tracks])


def with_free(correction: Correction, tangents: Index) -> Correction:
    """The correction with further columns that may take any amount."""
    k, n = len(correction.index), len(tangents)
    precision = np.zeros((k + n, k + n))
    precision[:k, :k] = correction.precision
    precision[k:, k:] = 1e-9 * np.eye(n)
    return Correction(
        np.concatenate([correction.index, tangents]).astype(np.intp),
        np.concatenate([correction.mean, np.zeros(n)]),
        precision,
    )


def projection(total: Samples, nuisances: Correction) -> Samples:
    """Matrix (k, k) whose columns are what is left of each column after the nuisances were fitted to it."""
    index = nuisances.index
    matrix = np.eye(len(total))
    if len(index):
        inner = total[np.ix_(index, index)] + nuisances.precision
        inner += 1e-10 * (np.trace(inner) / len(inner)) * np.eye(len(inner))
        matrix[index] -= cho_solve(cho_factor(inner), total[index])
    return matrix


def block_inflation(moments: Samples, projector: Samples, left: Samples) -> Samples:
    """(k,) at least 1: mean square of the blocks' scores over what white noise of unit variance would give."""
    scores = (moments @ left) @ projector
    information = np.einsum("kp,bkl,lp->bp", projector, moments, projector, optimize=True).sum(axis=0)
    squares = (scores**2).sum(axis=0)
    blocks = len(moments)
    return np.asarray(np.maximum(1.0, squares / np.maximum(information, 1e-300) * blocks / max(blocks - 1, 1)))


def try_effects(bench: Bench, fitted: Fitted, scanned: Sequence[list[Scanned]]) -> list[Tried]:
    """Refit what a scan found worth it jointly with what is fitted, the most promising to the end; best first."""
    rough = [_tried(bench, fitted, shapes, ROUGH_STEPS) for shapes in _promising(bench, scanned)]
    rough.sort(key=lambda t: t.fitted.squares + penalty(bench, t.effect))
    finished = [
        replace(t, fitted=refit(bench.slim, bench.correction, t.fitted.entries)) if i < TOP else t
        for i, t in enumerate(rough)
    ]
    finished = [t for t in finished if not at_a_bound(bench, t) and not no_mode_of_its_own(bench, t.fitted.entries[-1])]
    return sorted(finished, key=lambda t: t.fitted.squares + penalty(bench, t.effect))


def at_a_bound(bench: Bench, tried: Tried) -> bool:
    """Whether the largest of its sizes ran as far as the catalogue allows, or beside a fitted base a shape that no
    stage has: then it stands in for something else."""
    effect, params = tried.fitted.entries[-1]
    far = [*effect.sizes, *(p for p in effect.shapes if p.extreme and bench.reference is not None)]
    return any(params[p.name] >= 0.999 * p.high or params[p.name] <= p.low + 1e-3 * abs(p.low) < 0 for p in far)


def without_peak(bench: Bench, entry: Entry) -> bool:
    """Whether it is a mode so strongly damped that it has no peak: then it stands in for a lag.

    Not asked while a base is made from nothing: there a jump's lag and ringing are found one after the other, and the
    mode sharpens when the lag is beside it.
    """
    if bench.reference is None:
        return False
    zeta = entry[1].get("zeta")
    return zeta is not None and zeta > PEAKLESS


def no_mode_of_its_own(bench: Bench, entry: Entry) -> bool:
    """Whether it is a mode without a peak, or one that stands where the base has one: then that one has moved."""
    return without_peak(bench, entry) or beside_own_mode(bench, entry)


def beside_own_mode(bench: Bench, entry: Entry) -> bool:
    """Whether a mode lies so close to one of the base's that both are one. Asked beside reference records, to which the
    base was fitted."""
    effect, params = entry
    if bench.reference is None or not is_mode(effect):
        return False
    own_Hz = [
        f for e in bench.axis.effects if e.name == effect.name for f in np.atleast_1d(np.asarray(e.params["f_Hz"]))
    ]
    small = abs(params[effect.sizes[0].name]) < OWN_SHARE
    return small and any(abs(np.log(params["f_Hz"] / f)) < np.log(OWN_RATIO) for f in own_Hz)


def _promising(bench: Bench, scanned: Sequence[list[Scanned]]) -> list[list[Scanned]]:
    """Those that gain their penalty by their sensitivities, most by gain first.

    How the residual scatters along an effect counts only against those that gain little: while something large is
    missing, it is what scatters.
    """
    scattered = SCATTERED if bench.reference is None else SCATTERED_BESIDE
    worth = [
        shapes
        for shapes in scanned
        if max(s.gain for s in shapes) > max(penalty(bench, shapes[0].effect), MARGIN_GAIN)
        and max(s.gain / s.inflation for s in shapes) > scattered * penalty(bench, shapes[0].effect)
    ]
    return sorted(worth, key=lambda shapes: -max(s.gain for s in shapes))[:MOST_TRIED]


def penalty(bench: Bench, effect: Effect) -> float:
    """What an effect must gain to be even: ln n for each of its parameters."""
    return float(np.log(max(bench.train.evidence.rows, 2))) * len(effect.parameters)


def _tried(bench: Bench, fitted: Fitted, shapes: list[Scanned], steps: int) -> Tried:
    best: Fitted | None = None
    starts = [_start(bench, fitted, start) for start in _different(shapes)]
    if is_mode(shapes[0].effect) and max(s.gain for s in shapes) > PLAIN_MODE * fitted.squares:
        starts += mode_starts(bench.slim, bench.correction, fitted, shapes[0].effect)
    for start in starts:
        result = refit(bench.slim, bench.correction, start, steps)
        if best is None or result.squares < best.squares:
            best = result
    assert best is not None
    return Tried(shapes[0].effect, best)


def _start(bench: Bench, fitted: Fitted, scanned: Scanned) -> list[Entry]:
    """The fitted effects and the new one at the multiple of its linear estimate that leaves least."""
    effect = scanned.effect
    tries = [
        [*fitted.entries, (effect, bounded(effect, scanned.atom.params([factor * a for a in scanned.amounts])))]
        for factor in SIZES
    ]
    return min(tries, key=lambda entries: squares(bench.slim, bench.correction, entries))


def _different(shapes: list[Scanned]) -> list[Scanned]:
    """The best shape, and the best that is not its neighbour."""
    chosen = shapes[:1]
    for other in shapes[1:]:
        if len(chosen) == STARTS:
            break
        if other.score > 0.5 * chosen[0].score and _apart(other, chosen[0]):
            chosen.append(other)
    return chosen


def _apart(a: Scanned, b: Scanned) -> bool:
    return any(abs(np.log(max(a.atom.shapes[n], 1e-12) / max(b.atom.shapes[n], 1e-12))) > 1 for n in a.atom.shapes)
