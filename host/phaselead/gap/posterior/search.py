"""Which sets of effects are worth comparing: a beam search over sets, each effect started from several shapes.

A set grows by one effect at a time. Whether the larger set is worth more is asked under its own covariance, which both
get: with what its equations may miss, and with its effects as faults that the base might have in all records.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from phaselead.gap.plain_fits import each_fitted, plain_problem
from phaselead.gap.posterior.build import space_of
from phaselead.gap.posterior.evidence import SetFit, Solver, Uncertain, confused, together
from phaselead.gap.posterior.priors import log_prior_of_set
from phaselead.gap.problem import Problem, with_effects
from phaselead.gap.refit import Fitted, SizedEffect, refit
from phaselead.gap.scan import ScannedShape, different_shapes, is_mode, linear_start, mode_starts, scan
from phaselead.model import Effect

BEAM, LARGEST_SET, TRIED_BESIDE, TRIED_ALONE = 2, 4, 4, 9
"""Sets that grow at a time, the most effects of one, and how many effects are tried beside a set and alone: what the
time for an answer allows."""
WORTH_FITTING = 6.0
"""Whitened squares that an effect must explain by its sensitivities to be fitted: three log units, less than what its
prior takes off."""
ROUGH_STEPS, STARTS = 3, 2
"""Steps in which a start is refined by the scan's metric, and how many of them are fitted."""
WITHIN, MOST_EFFECTS = 15.0, 7
"""Log units behind the best set, beyond which a set has no part in the last contest (a probability of e^-15), and the
most effects in it."""

AT_END = 0.001
"""Relative distance to an end of its range from which a parameter stands at it."""

Names = tuple[str, ...]
"""Of a set of effects, sorted."""


@dataclass(frozen=True)
class Grown:
    """A set of effects in the beam."""

    entries: tuple[SizedEffect, ...]
    value: float
    """Log of posterior odds against nothing: the sum of its steps, each under the covariance of the larger set."""

    @property
    def names(self) -> Names:
        """Of its effects."""
        return names_of(self.entries)


@dataclass(frozen=True)
class Contest:
    """Sets of effects under one covariance."""

    solver: Solver
    fits: Mapping[Names, SetFit]
    grown: Mapping[Names, Grown]
    catalogue_size: int

    def log_posterior(self, names: Names) -> float:
        """Log evidence and log prior of a set."""
        return self.fits[names].log_evidence + log_prior_of_set(len(names), self.catalogue_size)


def names_of(entries: Sequence[SizedEffect]) -> Names:
    """Names of some effects, sorted."""
    return tuple(sorted(effect.name for effect, _ in entries))


def search_sets(problem: Problem, effects: Sequence[Effect], on_progress: Callable[[float], None]) -> Contest:
    """The sets of ``effects`` that the records of a problem with reference records leave in the contest."""
    bare = refit(problem.train_common, problem.discrepancy, [])
    alone = {fit.entries[0][0].name: [fit.entries] for fit in _plain_fits(problem, effects)}
    for name, starts in _starts_beside(problem, bare, effects, most=len(effects)).items():
        alone[name] = [*alone.get(name, []), *starts]
    solver = _solver(problem, effects, alone)
    nothing = Grown((), 0.0)
    pool: dict[Names, Grown] = {(): nothing}
    for i, starts in enumerate(list(alone.values())[:TRIED_ALONE]):
        _add(pool, _best_grown(solver, nothing, starts, len(effects)))
        on_progress(0.5 * (i + 1) / min(len(alone), TRIED_ALONE))
    frontier = _best([one for one in pool.values() if one.value > nothing.value])
    for depth in range(1, LARGEST_SET):
        new = [grown for parent in frontier for grown in _children(problem, solver, parent, effects, pool)]
        for one in new:
            _add(pool, one)
        frontier = _best(new)
        on_progress(0.5 + 0.4 * depth / LARGEST_SET)
    return _contest(solver, pool, len(effects))


def _solver(
    problem: Problem, effects: Sequence[Effect], alone: Mapping[str, Sequence[tuple[SizedEffect, ...]]]
) -> Solver:
    """A solver in whose space the base may have each promising effect as a fault, and which knows what each says."""
    first = {name: starts[0] for name, starts in alone.items()}
    return Solver(space_of(problem, list(first.values())), {e.name: e for e in effects}, first)


def _starts_beside(
    problem: Problem, fitted: Fitted, effects: Sequence[Effect], most: int = TRIED_BESIDE
) -> dict[str, list[tuple[SizedEffect, ...]]]:
    """Starts for the effects that explain most of what a fit leaves, the best effect first."""
    scanned = [shapes for shapes in scan(problem, fitted, effects) if _gain(shapes) > WORTH_FITTING]
    scanned.sort(key=_gain, reverse=True)
    return {shapes[0].effect.name: _starts(problem, fitted, shapes) for shapes in scanned[:most]}


def _plain_fits(problem: Problem, effects: Sequence[Effect]) -> list[Fitted]:
    """Fits of single effects to the records as they stand, the one that explains most first: a whitened metric hides
    what is slow, so that a search there may begin at the wrong end."""
    runs = [m.run for part in (problem.train, problem.holdout) for m in part.metric.modelled_runs]
    return sorted(each_fitted(plain_problem(problem.axis, runs, effects), effects), key=lambda fit: fit.squares)


def _gain(shapes: Sequence[ScannedShape]) -> float:
    return max(shape.gain for shape in shapes)


def _starts(problem: Problem, fitted: Fitted, shapes: Sequence[ScannedShape]) -> list[tuple[SizedEffect, ...]]:
    """The fitted effects and one more from the shapes that explain most, refined a little."""
    by_gain = sorted(shapes, key=lambda shape: -shape.gain)
    found = [linear_start(problem, fitted, shape) for shape in different_shapes(by_gain)]
    if is_mode(by_gain[0].effect):
        found += mode_starts(problem.train_common, problem.discrepancy, fitted, by_gain[0].effect)
    rough = [refit(problem.train_common, problem.discrepancy, start, ROUGH_STEPS) for start in found]
    return [one.entries for one in sorted(rough, key=lambda one: one.squares)[:STARTS]]


def _best_grown(
    solver: Solver, parent: Grown, starts: Sequence[tuple[SizedEffect, ...]], catalogue_size: int
) -> Grown | None:
    """The best set of the starts, fitted; None where none can be."""
    found = []
    for start in starts:
        try:
            uncertain = solver.uncertain(start)
            entries = solver.fit(start, uncertain=uncertain)
            larger, smaller = solver.contest([entries, parent.entries], uncertain)
        except np.linalg.LinAlgError:
            continue
        gained = larger.log_evidence - smaller.log_evidence
        before = log_prior_of_set(len(parent.entries), catalogue_size)
        found.append(Grown(entries, parent.value + gained + log_prior_of_set(len(entries), catalogue_size) - before))
    return max(found, key=lambda one: one.value, default=None)


def _children(
    problem: Problem, solver: Solver, parent: Grown, effects: Sequence[Effect], pool: Mapping[Names, Grown]
) -> list[Grown]:
    """Sets of one effect more that are worth more than their parent."""
    beside = with_effects(problem, parent.entries)
    fitted = refit(beside.train_common, beside.discrepancy, parent.entries, 1)
    left = [e for e in effects if e.name not in parent.names]
    new = {
        name: starts
        for name, starts in _starts_beside(beside, fitted, left).items()
        if tuple(sorted((*parent.names, name))) not in pool
    }
    found = [_best_grown(solver, parent, starts, len(effects)) for starts in new.values()]
    return [one for one in found if one is not None and one.value > parent.value]


def _add(pool: dict[Names, Grown], one: Grown | None) -> None:
    """Keep a set where it is new or better than it was."""
    if one is not None and (one.names not in pool or one.value > pool[one.names].value):
        pool[one.names] = one


def _best(sets: Sequence[Grown]) -> list[Grown]:
    return sorted(sets, key=lambda one: -one.value)[:BEAM]


def _contest(solver: Solver, pool: Mapping[Names, Grown], catalogue_size: int) -> Contest:
    """Nothing, the best sets, and each of these less one of its effects, under one covariance: that in which the
    equations of all of them may be wrong, and all may be faults of the base."""
    ranked = sorted((one for one in pool.values() if not at_an_end(one.entries)), key=lambda one: -one.value)
    best = ranked[0]
    close = [one for one in ranked if one.value > best.value - WITHIN]
    contested, covered = list[tuple[SizedEffect, ...]](), set[str]()
    for one in [*close[:1], *_rivals(best, ranked), *close[1:]]:
        new = set(one.names) - covered
        if new and len(covered | new) <= MOST_EFFECTS:
            contested.append(one.entries)
            covered |= new
    if not contested:
        return Contest(solver, {(): solver.contest([()], None)[0]}, pool, catalogue_size)
    as_others = solver.misfit_as_others(contested)
    uncertain = together([*(solver.uncertain(entries) for entries in contested), as_others])
    share = _likeliest_share(solver, best.entries, uncertain)
    largest = solver.fit_from([best.entries], uncertain, share)
    starts = {one.names: [one.entries] for one in ranked if set(one.names) <= covered}
    for i in range(len(largest)):
        rest = largest[:i] + largest[i + 1 :]
        starts[names_of(rest)] = [*starts.get(names_of(rest), []), rest]
    starts[best.names] = [largest]
    sets = {names: solver.fit_from(several, uncertain, share) if names else () for names, several in starts.items()}
    sets.setdefault((), ())
    fits = solver.contest(list(sets.values()), uncertain)
    return Contest(solver, dict(zip(sets, fits, strict=True)), pool, catalogue_size)


def _likeliest_share(solver: Solver, entries: tuple[SizedEffect, ...], uncertain: Uncertain) -> float:
    """The share of equation misfit under which a set explains the records best."""
    logs = solver.contest([entries], uncertain)[0].logs
    return max(logs, key=lambda share: logs[share])


def _rivals(best: Grown, ranked: Sequence[Grown]) -> list[Grown]:
    """Single effects that one of the best set is confused with: their values are under other covariances, and say
    little."""
    alone = [one for one in ranked if len(one.entries) == 1]
    mine = [effect for effect, _ in best.entries]
    return [one for one in alone if any(confused(one.entries[0][0], effect) for effect in mine)]


def at_an_end(entries: Sequence[SizedEffect]) -> bool:
    """Whether a parameter of one of the effects stands at an end of its range beyond which no stage lies, where it is
    no longer that effect: an end of 0 is where it vanishes or takes another form."""
    found = [(p, params[p.name]) for effect, params in entries for p in effect.parameters]
    return any(value >= (1 - AT_END) * p.high or value <= p.low + AT_END * abs(p.low) != 0 for p, value in found)
