"""Which of the refitted effects the data demand: against none, against each other, and on held-out records."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from phaselead.gap.bench import Bench
from phaselead.gap.correction import Correction
from phaselead.gap.evidence import fair_weights
from phaselead.gap.noise import repetition
from phaselead.gap.panel import Panel, condition
from phaselead.gap.refit import Entry, Fitted, fresh_columns, refit
from phaselead.gap.residual import Track
from phaselead.gap.search import Tried, block_inflation, no_mode_of_its_own, penalty, projection
from phaselead.model import Effect
from phaselead.record import Samples

MARGIN = 10.0
"""Score by which an effect must beat none, and every rival it is not tied with."""
TIE = 37.0
"""Squared whitened distance below which two effects, each at its best, cannot be told apart: errors of 1 in 1000."""
HELD_OUT_Z = 3.3
KNOWN_SHARE, KNOWN_Z = 0.8, 3.0
"""Share of an effect, and how surely, that makes reference records show it too."""
ABSORBED = 0.05
"""Share of an effect's squares that must be left once the base absorbed what it can, for that question to be asked."""
ONE_LOOP = 0.5
"""Where all records show the same loop, rivals with this share of the best one's score are tied with it."""
RIVALS = 5
RICHER, RICHER_BESIDE = 0.001, 0.005
"""Of what is gained: the price of each parameter after an effect's first. No equation is the stage's own, and where
much is gained a richer one follows what a simpler one leaves of it; beside a base that was fitted to reference records
the more, since what that base misses is followed as well."""

PLENTY, AS_GOOD = 3000.0, 0.97
"""Points of a richer effect, and the share of them from which a simpler one is believed instead."""


@dataclass(frozen=True)
class Rival:
    """An effect beside the best one."""

    effect: Effect
    fitted: Fitted
    score: float
    """Over none, in the metric of the best one's residual."""
    distance: float
    """Squared, to the best, when this one is fitted to what the best says."""

    def tied_with(self, best: Rival) -> bool:
        """Whether these records cannot tell it from the best.

        A richer effect that can imitate a simpler one lies at no distance from it whatever the truth: there the
        price of its parameters decides, which is in the score.
        """
        richer = len(self.effect.parameters) > len(best.effect.parameters)
        behind = best.score - self.score
        return behind < MARGIN or (self.distance < TIE and behind < TIE and not richer)

    def about_as_good_as(self, best: Rival) -> bool:
        """The comparison left on one loop, of one frequency and level: any closed curve can be the operator's own
        shape, so that only what explains far less is ruled out."""
        return self.score > ONE_LOOP * best.score


@dataclass(frozen=True)
class Contest:
    """The refitted effects, best first, in the metric of the best one's residual."""

    bench: Bench
    before: Fitted
    rivals: tuple[Rival, ...]
    inflation: float
    one_loop: bool = False

    @property
    def best(self) -> Rival:
        return self.rivals[0]

    def tied(self) -> list[Rival]:
        """Those that cannot be told from the best, itself included."""
        return [self.best, *(r for r in self.rivals[1:] if self.is_tied(r))]

    def is_tied(self, rival: Rival) -> bool:
        """With the best."""
        beyond = self.one_loop and self.best.effect.name != "hysteresis"
        return rival.tied_with(self.best) or (beyond and rival.about_as_good_as(self.best))


def reweighed(bench: Bench, entries: Sequence[Entry]) -> Bench:
    """The bench with weights by what a model leaves of each track."""
    train = _weights(bench.slim, bench.correction, entries)
    return replace(
        bench,
        train=bench.train.reweighted(train),
        slim=bench.slim.reweighted(train),
        holdout=bench.holdout.reweighted(_weights(bench.holdout, bench.correction, entries)),
    )


def _weights(panel: Panel, correction: Correction, entries: Sequence[Entry]) -> list[Samples]:
    """Per track (blocks,): 1 over the mean whitened square, and over how far the track only repeats itself."""
    errors = [t.error(entries)[:, None] for t in panel.evidence.tracks]
    moments = panel.with_columns(errors)
    amounts = residual_amounts(moments, correction)
    left = panel.unweighted(np.einsum("i,bij,j->b", amounts, moments, amounts))
    found = []
    for i, error in enumerate(errors):
        white = panel.projected[i] @ amounts[panel.live] + panel.evidence.project(i, error)[:, 0]
        repeated = repetition(white, panel.evidence.tracks[i].period_rows)
        found.append(fair_weights(left[i], np.diff(panel.evidence.edges[i]).astype(np.float64), repeated))
    return found


def residual_amounts(moments: Samples, correction: Correction) -> Samples:
    """Amounts (k,) of the residual (last column) after the common columns took their share."""
    target, index = moments.shape[-1] - 1, correction.index
    shifted = correction.applied(moments, target).sum(axis=0)
    amounts = np.zeros(len(shifted))
    amounts[target] = 1.0
    inner = shifted[np.ix_(index, index)] + correction.precision
    amounts[index] = -np.linalg.solve(inner, shifted[index, target]) - correction.mean
    return amounts


def contest(bench: Bench, fitted: Fitted, tried: Sequence[Tried]) -> Contest:
    """Refit the best few once more in the metric of the best and compare them there."""
    closest = sorted(tried, key=lambda t: t.fitted.squares + penalty(bench, t.effect))[:RIVALS]
    bench = reweighed(bench, closest[0].fitted.entries)
    before = refit(bench.slim, bench.correction, fitted.entries)
    again = [(t.effect, refit(bench.slim, bench.correction, t.fitted.entries, steps=5)) for t in closest]
    best, inflation = min(again, key=lambda pair: pair[1].squares), 1.0
    for _ in range(2):
        inflation = max(_inflation(bench, before, best[1]), bench.mistaken.get(best[0].name, 1.0))
        best = min(again, key=lambda pair: pair[1].squares / inflation + penalty(bench, pair[0]))
    rivals = []
    richer = RICHER if bench.reference is None else RICHER_BESIDE
    most = max(before.squares - result.squares for _, result in again) / inflation
    for effect, result in again:
        score = (before.squares - result.squares) / inflation - penalty(bench, effect)
        score -= richer * max(most, 0.0) * (len(effect.parameters) - 1)
        distance = 0.0 if effect is best[0] else _distance(bench, before, best[1], result) / inflation
        rivals.append(Rival(effect, result, score, distance))
    rivals.sort(key=lambda rival: -rival.score)
    rivals = [r for r in rivals if not no_mode_of_its_own(bench, r.fitted.entries[-1])] or rivals
    if bench.reference is not None:
        rivals = _simple_first(rivals)
    return Contest(bench, before, tuple(rivals), inflation, one_loop(bench.tracks()))


def _simple_first(rivals: list[Rival]) -> list[Rival]:
    """A simpler effect before the best one that it is confused with, where much is gained and nearly as much by it: a
    heavier stage is not quite the base's mode moved, and a mode of its own follows the rest."""
    best = rivals[0]
    for rival in rivals[1:]:
        simpler = len(rival.effect.parameters) < len(best.effect.parameters)
        near = best.effect.name in rival.effect.confused_with or rival.effect.name in best.effect.confused_with
        if simpler and near and best.score > PLENTY and rival.score > AS_GOOD * best.score:
            return [rival, *(r for r in rivals if r is not rival and r is not best)]
    return rivals


def one_loop(tracks: Sequence[Track]) -> bool:
    """Whether all driven records go round one loop: one frequency, one level, one bias."""
    sines = [t.sine for t in tracks if t.run.driven]
    kinds = [(sine.f_Hz, sine.swing_V, sine.mean_V + sine.swing_V) for sine in sines if sine is not None]
    if not kinds or len(kinds) < len(sines):
        return False
    return bool((np.ptp(kinds, axis=0) <= 0.05 * np.abs(kinds).max(axis=0)).all())


def _inflation(bench: Bench, before: Fitted, best: Fitted) -> float:
    """How much more than white noise the residual scatters along what the best effect says."""
    fresh = []
    for track in bench.slim.evidence.tracks:
        after = track.answer(best.entries)
        fresh.append(np.stack([after - track.answer(before.entries), track.run.x_um[track.run.rows] - after], axis=1))
    moments = bench.slim.with_columns(fresh)
    left = residual_amounts(moments, bench.correction)
    total = moments.sum(axis=0)
    along = block_inflation(moments, projection(total, bench.correction), left)[-2]
    rows = bench.slim.evidence.rows
    return max(1.0, best.squares / rows, float(along))


def _distance(bench: Bench, before: Fitted, best: Fitted, other: Fitted) -> float:
    """Squared whitened distance from what the best says to the nearest that the other could say."""
    fresh = []
    for track in bench.slim.evidence.tracks:
        columns = fresh_columns(track, other.entries, other.free)
        columns[:, -1] = track.answer(best.entries) - track.answer(other.entries)
        fresh.append(columns)
    moment = bench.slim.with_columns(fresh).sum(axis=0)
    index = bench.correction.index
    moment = condition(moment, index, bench.correction.precision)
    tangents = np.arange(len(index), len(moment) - 1)
    return float(max(condition(moment, tangents)[-1, -1], 0.0))


@dataclass(frozen=True)
class HeldOut:
    """How much of what an effect adds is found in the held-out records: 1 is all of it."""

    slope: float
    z: float
    power: float
    """The z that the whole of it would have: what the held-out records can show."""
    drive: float
    """Squares of the whole of it beside white noise of unit variance, whatever else is in the held-out records."""
    worse: float
    """By how much it changes the plain mean square of the held-out records, as a share; above 0 it does harm."""

    @property
    def testable(self) -> bool:
        """Whether the held-out records could show it at all."""
        return self.power >= HELD_OUT_Z

    @property
    def contradicted(self) -> bool:
        """Whether they show that it is not there as the training records say."""
        return abs(self.z - self.power) > HELD_OUT_Z


def _worse(bench: Bench, before: Sequence[Entry], after: Sequence[Entry]) -> float:
    """Relative change of the held-out mean square about each record's own offset; 0 where the base moves with every
    effect and says nothing before it was fitted anew."""
    if bench.open_plays:
        return 0.0
    was, now = (sum(_about_offset(t, e) for t in bench.holdout.evidence.tracks) for e in (before, after))
    return now / was - 1 if was > 0 else 0.0


def _about_offset(track: Track, entries: Sequence[Entry]) -> float:
    error = track.error(entries)
    return float(np.sum((error - error.mean()) ** 2))


def held_out(bench: Bench, before: Sequence[Entry], after: Sequence[Entry], least: float = 1.0) -> HeldOut:
    """Regress the held-out residual on what the new effect says, everything else projected out.

    ``least``: inflation of its variance at least.
    """
    found = _regression(bench.holdout, bench.correction, before, after)
    if not found.power > 0:
        return HeldOut(0.0, 0.0, 0.0, 0.0, 0.0)
    whole = float(np.sqrt(found.power / max(least, found.inflation)))
    return HeldOut(found.slope, found.slope * whole, whole, found.power, _worse(bench, before, after))


def known_before(bench: Bench, new: Entry) -> bool:
    """Whether the reference records, which are without it, seem to show the new effect too: then it is the base's
    fault. They are without whatever was named before it, too. Only what the base could absorb is projected out, since
    the correction has learned from these very records; of an effect that the base absorbs nearly whole, they can show
    nothing.
    """
    panel = bench.reference
    if panel is None:
        return False
    index = panel.layout.base
    base = Correction(index, np.zeros(len(index)), np.eye(len(index)))
    found = _regression(panel, base, (), (new,))
    if found.power < ABSORBED * found.whole:
        return False
    return found.slope > KNOWN_SHARE and found.slope * float(np.sqrt(found.power / found.inflation)) > KNOWN_Z


class Regression(NamedTuple):
    """Of a panel's residual on what a new effect says."""

    slope: float
    """Share of it that the residual shows."""
    power: float
    """Whitened squares of all of it, after the nuisances were fitted to it."""
    inflation: float
    whole: float
    """Its squares before."""


def _regression(panel: Panel, correction: Correction, before: Sequence[Entry], after: Sequence[Entry]) -> Regression:
    fresh = []
    for track in panel.evidence.tracks:
        was = track.answer(before)
        fresh.append(np.stack([track.answer(after) - was, track.run.x_um[track.run.rows] - was], axis=1))
    moments = panel.with_columns(fresh)
    target = moments.shape[-1] - 1
    total = correction.conditioned(moments.sum(axis=0), target)
    power = float(total[target - 1, target - 1])
    whole = float(moments[:, target - 1, target - 1].sum())
    if not power > 1e-9:
        return Regression(0.0, 0.0, 1.0, whole)
    slope = float(total[target - 1, target]) / power
    explained = np.zeros(len(total))
    explained[target - 1] = 1.0
    projector = projection(moments.sum(axis=0), correction)
    left = residual_amounts(moments, correction) - slope * (projector @ explained)
    squares_left = float(total[target, target]) - slope**2 * power
    scatter = float(block_inflation(moments, projector, left)[target - 1])
    return Regression(slope, power, max(1.0, squares_left / panel.evidence.rows, scatter), whole)


__all__ = ["Contest", "HeldOut", "Rival", "contest", "held_out", "known_before", "reweighed"]
