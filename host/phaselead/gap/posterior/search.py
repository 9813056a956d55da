"""Which sets of effects are worth their evidence: a beam search over sets, each effect started from several shapes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
import sys
import numpy as np

from phaselead.gap.posterior.build import space_of
from phaselead.gap.posterior.evidence import SetFit, Solver, together
from phaselead.gap.posterior.priors import log_prior_of_set
from phaselead.gap.problem import Problem, with_effects
from phaselead.gap.refit import SizedEffect, bounded, fresh_columns, is_logarithmic, refit, to_internal, Fitted
from phaselead.gap.scan import ScannedShape, _different, _start, is_mode, mode_starts, scan
from phaselead.model import Effect
from phaselead.record import Samples

import os
BEAM, LARGEST, TRIED = 2, int(os.environ.get('LARGEST', 4)), 4
LEAST_GAIN = 6.0
ROUGH = 3


@dataclass
class Searched:
    solver: Solver
    fits: dict[tuple[str, ...], SetFit]
    catalogue: int


def starts(problem: Problem, fitted: Fitted, shapes: list[ScannedShape]) -> list[tuple[SizedEffect, ...]]:
    found = [_start(problem, fitted, s) for s in _different(shapes)]
    if is_mode(shapes[0].effect):
        found += mode_starts(problem.train_common, problem.discrepancy, fitted, shapes[0].effect)
    rough = [refit(problem.train_common, problem.discrepancy, s, ROUGH) for s in found]
    rough.sort(key=lambda f: f.squares)
    return [f.entries for f in rough[:2]]


@dataclass
class Tried:
    """A set in the beam."""

    entries: tuple[SizedEffect, ...]
    value: float
    """Log evidence over nothing, step by step, each step in the covariance of the larger set."""

    @property
    def names(self):
        return tuple(sorted(e.name for e, _ in self.entries))


def grown(solver: Solver, parent: Tried, starts: Sequence[Sequence[SizedEffect]], m: int) -> Tried | None:
    """The best of the starts, fitted, and by how much it beats its parent under its own covariance."""
    best = None
    for start in starts:
        try:
            entries = solver.fit(start)
            with_it, without = solver.contest([entries, parent.entries], solver.uncertain(entries))
        except np.linalg.LinAlgError:
            continue
        value = parent.value + with_it.log_evidence - without.log_evidence
        value += log_prior_of_set(len(entries), m) - log_prior_of_set(len(parent.entries), m)
        if best is None or value > best.value:
            best = Tried(tuple(entries), value)
    return best


def as_base_fault(modelled, entries) -> Samples:
    """Columns (n, k) in um: an effect as a fault of the base, one prior deviation of each of its parameters."""
    free = [(i, p) for i, (e, _) in enumerate(entries) for p in e.parameters]
    sd = np.array([
        abs(to_internal(p, entries[i][1][p.name])) if p.role == "size"
        else (0.3 if is_logarithmic(p) else 0.2 * abs(to_internal(p, p.high) - to_internal(p, p.low)))
        for i, p in free
    ])
    return fresh_columns(modelled, entries, free)[:, :-1] * sd


def search(problem: Problem, effects: Sequence[Effect], verbose: bool = False) -> Searched:
    empty = refit(problem.train_common, problem.discrepancy, [])
    shapes_of = {s[0].effect.name: s for s in scan(problem, empty, effects)}
    worth = [s for s in shapes_of.values() if max(x.gain for x in s) > LEAST_GAIN]
    worth.sort(key=lambda s: -max(x.gain for x in s))
    rough: dict[str, list] = {}
    for shapes in worth:
        rough[shapes[0].effect.name] = starts(problem, empty, sorted(shapes, key=lambda s: -s.gain))
    runs = [*problem.train_common.metric.modelled_runs, *problem.holdout.metric.modelled_runs, *problem.reference.metric.modelled_runs]
    more = [[] for _ in runs]
    names: list[str] = []
    for name, tried in rough.items():
        cols = [as_base_fault(m, tried[0]) for m in runs]
        for m, c in zip(more, cols):
            m.append(c)
        names += [f"{name} as a fault"] * cols[0].shape[1]
    space = space_of(problem, more, names)
    solver = Solver(space)
    solver.catalogue = {e.name: e for e in effects}
    for name, tried in rough.items():
        solver.rivals[name] = space.columns([
            (r.modelled.answer(tried[0]) - r.modelled.answer())[:, None] if r.changed else None for r in space.records])
    m = len(effects)
    nothing = Tried((), 0.0)
    pool: dict[tuple[str, ...], Tried] = {(): nothing}
    for name, tried in list(rough.items())[:9]:
        found = grown(solver, nothing, tried, m)
        if found is not None:
            pool[found.names] = found
    if verbose:
        print("singles", {k: round(f.value, 1) for k, f in sorted(pool.items(), key=lambda kf: -kf[1].value)}, file=sys.stderr)
    frontier = sorted((f for k, f in pool.items() if k and f.value > -3), key=lambda f: -f.value)[:BEAM]
    for _ in range(1, LARGEST):
        new: dict[tuple[str, ...], Tried] = {}
        for fit in frontier:
            beside = with_effects(problem, fit.entries)
            now = refit(beside.train_common, beside.discrepancy, fit.entries, 1)
            left = [e for e in effects if e.name not in fit.names]
            scanned = [s for s in scan(beside, now, left) if max(x.gain for x in s) > LEAST_GAIN]
            scanned.sort(key=lambda s: -max(x.gain for x in s))
            for shapes in scanned[:TRIED]:
                key = tuple(sorted((*fit.names, shapes[0].effect.name)))
                if key in pool or key in new:
                    continue
                found = grown(solver, fit, starts(beside, now, sorted(shapes, key=lambda s: -s.gain)), m)
                if found is not None and found.value > fit.value:
                    new[key] = found
        if not new:
            break
        pool.update(new)
        frontier = sorted(new.values(), key=lambda f: -f.value)[:BEAM]
    return _final(solver, pool, m, verbose)


def _final(solver: Solver, pool, m: int, verbose: bool) -> Searched:
    ranked = sorted(pool.values(), key=lambda f: -f.value)
    best = ranked[0]
    parts, names = [], set()
    for one in ranked[:6]:
        if one.value < best.value - 15:
            break
        fresh = [i for i, (e, _) in enumerate(one.entries) if e.name not in names]
        if fresh and len(names) < 7:
            parts.append(solver.uncertain(one.entries))
            names |= set(one.names)
    sets = {f.names: f.entries for f in ranked if f.value > best.value - 40 or len(f.entries) < 2}
    for i in range(len(best.entries)):
        rest = tuple(e for j, e in enumerate(best.entries) if j != i)
        key = tuple(sorted(e.name for e, _ in rest))
        if key not in sets:
            sets[key] = solver.fit(rest)
    if not parts:
        return Searched(solver, {(): SetFit((), {0.0: 0.0}, {0.0: 0.0})}, m)
    fits = solver.contest(list(sets.values()), together(*parts))
    out = Searched(solver, dict(zip(sets, fits, strict=True)), m)
    out.values = {k: f.value for k, f in pool.items()}
    return out


def posterior(found: Searched, temper: float = 1.0) -> tuple[dict[tuple[str, ...], float], dict[str, float]]:
    logs = {k: temper * f.log_evidence + log_prior_of_set(len(k), found.catalogue) for k, f in found.fits.items()}
    top = max(logs.values())
    w = {k: np.exp(v - top) for k, v in logs.items()}
    z = sum(w.values())
    p = {k: float(v / z) for k, v in w.items()}
    inc: dict[str, float] = {}
    for k, v in p.items():
        for n in k:
            inc[n] = inc.get(n, 0.0) + v
    return p, dict(sorted(inc.items(), key=lambda x: -x[1]))


SURE = 0.99


def decide(found: Searched, temper: float = 1.0):
    p, inc = posterior(found, temper)
    best = max(p, key=p.get)
    named, ties = [], []
    for n in best:
        if inc[n] >= SURE:
            named.append(n)
            continue
        group, covered = [n], inc[n]
        others = sorted((o for o in inc if o not in best), key=lambda o: -sum(v for k, v in p.items() if o in k and n not in k))
        for o in others:
            if covered >= SURE or len(group) >= 5:
                break
            group.append(o)
            covered = sum(v for k, v in p.items() if any(g in k for g in group))
        if covered >= SURE:
            ties.append(group)
    return named, ties, p, inc
