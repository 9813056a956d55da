"""One set of effects: its most likely parameters, and its evidence.

The likelihood is that of ``Space``. What the equations of the effects miss, what slow effects had done before a record
began and how the base's own misfit looks behind a lag are normal too and integrated out with the rest; the parameters
of the effects are found by steps of Levenberg and Marquardt and integrated by Laplace's method (MacKay 2003, chapter
27).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from phaselead.gap.posterior.misfit import (
    as_fault,
    as_fault_of,
    before_record,
    equation_misfit,
    parameters_of,
    signal_of,
)
from phaselead.gap.posterior.priors import prior_of
from phaselead.gap.posterior.space import Columns, Mask, Space, SpaceRecord, joined
from phaselead.gap.refit import SizedEffect, bounded, fresh_columns, from_internal, is_logarithmic, to_internal
from phaselead.gap.residual import ModelledRun
from phaselead.model import Effect
from phaselead.record import Samples

SHARES = (0.02, 0.07, 0.2)
"""Deviation of what an equation of the catalogue misses, as a share of its effect: all as likely. Published models of
hysteresis, creep and modes leave 2 to 20 % of what they describe."""
FITTED_AT = 0.07
"""The share at which the parameters are looked for."""
STEPS, LEAST_GAIN = 6, 0.1
"""Of a fit at most, and the gain in log units that ends it."""
DAMPINGS, FIRST_DAMPING, CALMER, BOLDER = 4, 1e-3, 10.0, 5.0
"""How many dampings are tried in a step, the first, and by what they grow and fall."""
MOST_KEPT = 40
"""Sets whose tangents are kept: those of one contest, some tens of megabytes."""
MOST_BEYOND = 3.0
"""Most log units that are credited for a maximum a Newton step away."""


@dataclass(frozen=True)
class SetFit:
    """A set of effects at its most likely parameters."""

    entries: tuple[SizedEffect, ...]
    logs: Mapping[float, float] = field(default_factory=dict)
    """Log evidence of all records by share of equation misfit."""
    fitted_logs: Mapping[float, float] = field(default_factory=dict)
    """The same without the held-out records."""
    covariance: Samples = field(default_factory=lambda: np.zeros((0, 0)))
    """(parameters, parameters) in internal units, averaged over the shares by their evidence."""

    @property
    def names(self) -> tuple[str, ...]:
        """Of the effects, sorted."""
        return tuple(sorted(effect.name for effect, _ in self.entries))

    @property
    def log_evidence(self) -> float:
        """Of all records, averaged over the shares."""
        return _mean_of_logs(self.logs.values())

    @property
    def log_evidence_fitted(self) -> float:
        """Without the held-out records."""
        return _mean_of_logs(self.fitted_logs.values())


def _mean_of_logs(logs: Collection[float]) -> float:
    values = np.array(list(logs))
    return float(values.max() + np.log(np.mean(np.exp(values - values.max()))))


@dataclass(frozen=True)
class Uncertain:
    """Columns that are integrated out."""

    columns: Columns
    of_equation: Samples
    """(q,) whether the deviation of a column is the share of equation misfit rather than 1."""

    def precision(self, share: float) -> Samples:
        """Of each column, (q,)."""
        return np.where(self.of_equation, 1 / share**2, 1.0)


def uncertain_columns(parts: Sequence[tuple[Columns, bool]]) -> Uncertain:
    """Columns, each with whether its deviation is the share of equation misfit."""
    of_equation = np.concatenate([np.full(part.count, flag) for part, flag in parts])
    return Uncertain(joined(*(part for part, _ in parts)), of_equation)


def together(parts: Sequence[Uncertain]) -> Uncertain:
    """All of them; there is one at least."""
    return Uncertain(joined(*(p.columns for p in parts)), np.concatenate([p.of_equation for p in parts]))


class Solver:
    """Fits sets of effects in one space."""

    def __init__(
        self,
        space: Space,
        catalogue: Mapping[str, Effect],
        alone: Mapping[str, Sequence[SizedEffect]],
    ) -> None:
        """``alone``: every promising effect by itself, by its name."""
        self.space = space
        self._catalogue = catalogue
        self.step_s = space.records[0].modelled.run.step_s
        self._changed = space.changed
        errors = [None if c else r.modelled.error()[:, None] for r, c in zip(space.records, self._changed, strict=True)]
        self._reference_error = space.columns(errors)
        self._missed = space.missed()
        self._fresh: dict[object, Columns] = {}
        nothing = self.space.from_white([np.zeros((len(r.base), 0)) for r in space.records])
        self._nothing = Uncertain(nothing, np.zeros(0))
        self.alone = alone
        self._signals = {name: self._signal(entries, 0) for name, entries in alone.items()}
        self._alone_power = {name: self._power(signal) for name, signal in self._signals.items()}

    def residual(self, entries: Sequence[SizedEffect]) -> Columns:
        """The residual of every record."""
        return self._with_reference(self.changed_columns(lambda r: r.modelled.error(entries)[:, None]))

    def fresh(self, entries: Sequence[SizedEffect]) -> Columns:
        """What one internal unit of each parameter does, 0 in reference records, and the residual last."""
        free = parameters_of(entries)
        return self._with_reference(self.changed_columns(lambda r: fresh_columns(r.modelled, entries, free)))

    def _with_reference(self, columns: Columns) -> Columns:
        """With the residuals of the reference records as the last column."""
        wide = [list(part) for part in (columns.white, columns.taken, columns.shared)]
        known = (self._reference_error.white, self._reference_error.taken, self._reference_error.shared)
        for i in np.flatnonzero(~self._changed):
            for part, of_reference in zip(wide, known, strict=True):
                last = of_reference[i]
                assert last is not None
                part[i] = np.concatenate([np.zeros((len(last), columns.count - 1)), last], axis=1)
        return Columns(*map(tuple, wide))

    def _signal(self, entries: Sequence[SizedEffect], index: int) -> Columns:
        """What one effect adds to the others, one column."""
        return self.changed_columns(lambda r: signal_of(r.modelled, entries, index))

    def uncertain(self, entries: Sequence[SizedEffect]) -> Uncertain:
        """What is uncertain with these effects beside their parameters."""
        beyond = [self._beyond(entries, i, self._misfit_of(entries, i)) for i in range(len(entries))]
        parts = [*((one, True) for one in beyond), *self.of_records(entries)]
        if not self._changed.all():
            parts.append((self.faults(entries), False))
        return uncertain_columns(parts)

    def faults(self, entries: Sequence[SizedEffect]) -> Columns:
        """The effects as faults of the base in every record, one deviation each."""
        return self.space.columns([as_fault(r.modelled, entries) for r in self.space.records])

    def misfit(self, entries: Sequence[SizedEffect]) -> Columns:
        """What the equations of the effects may miss, for a share of 1."""
        return joined(*(self._misfit_of(entries, i) for i in range(len(entries))))

    def _misfit_of(self, entries: Sequence[SizedEffect], index: int) -> Columns:
        """The same of one of the effects."""
        bent = self.changed_columns(lambda r: equation_misfit(r.modelled, entries, index))
        near = self._neighbours(entries, index)
        return joined(bent, *(self._signals[name].scaled(size) for name, size in near))

    def misfit_in(self, entries: Sequence[SizedEffect]) -> Callable[[ModelledRun], Samples]:
        """The same columns (n, q) in um of any other record."""
        near = [self._neighbours(entries, i) for i in range(len(entries))]

        def of(modelled: ModelledRun) -> Samples:
            found = []
            for i, names in enumerate(near):
                found.append(equation_misfit(modelled, entries, i))
                found += [size * signal_of(modelled, self.alone[name], 0) for name, size in names]
            return np.concatenate(found, axis=1)

        return of

    def of_records(self, entries: Sequence[SizedEffect]) -> list[tuple[Columns, bool]]:
        """What goes with the effects in single records, and is no misfit of theirs."""
        return [(one, False) for one in (self._before(entries), self._through(entries)) if one is not None]

    def changed_columns(self, of: Callable[[SpaceRecord], Samples]) -> Columns:
        """Columns of the records in which effects may act."""
        return self.space.columns(
            [of(r) if c else None for r, c in zip(self.space.records, self._changed, strict=True)]
        )

    def _beyond(self, entries: Sequence[SizedEffect], index: int, columns: Columns) -> Columns:
        """Columns without what other parameters of the effect would do: that is no misfit of its equation."""
        free = [(i, p) for i, p in parameters_of(entries) if i == index]
        tangents = self.changed_columns(lambda r: fresh_columns(r.modelled, entries, free)[:, :-1])
        normal = self.space.inner(tangents, tangents, self.space.all)
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-30))
        inverse = np.linalg.pinv(normal / np.outer(scale, scale), rcond=1e-6, hermitian=True) / np.outer(scale, scale)
        return columns.minus(tangents, inverse @ self.space.inner(tangents, columns, self.space.all))

    def _neighbours(self, entries: Sequence[SizedEffect], index: int) -> list[tuple[str, float]]:
        """The other effects, and how often to take what each says alone: what an equation leaves looks like some other
        effect, most of all like those that it is confused with."""
        effect, power = entries[index][0], self._power(self._signal(entries, index))
        return [
            (name, self._looks_like(effect, self._catalogue[name]) * float(np.sqrt(power / self._alone_power[name])))
            for name in self._signals
            if name != effect.name
        ]

    def _looks_like(self, effect: Effect, other: Effect) -> float:
        """Of what the equation of an effect misses, the share that may be as another effect would have it."""
        return 1.0 if confused(effect, other) else 1 / float(np.sqrt(len(self._catalogue)))

    def _power(self, columns: Columns) -> float:
        """Squares of all columns together."""
        return max(float(np.trace(self.space.inner(columns, columns, self.space.all))), 1e-12)

    def misfit_as_others(self, sets: Sequence[Sequence[SizedEffect]]) -> Uncertain:
        """What the equations of the effects of some sets miss that looks like the others, as these are fitted there."""
        found: list[tuple[Effect, float, Columns]] = []
        for entries in sets:
            for i, (effect, _) in enumerate(entries):
                found.append((effect, self._power(self._signal(entries, i)), self._near(entries, i)))
        largest: dict[str, tuple[Effect, float]] = {}
        for effect, power, _ in found:
            if power > largest.get(effect.name, (effect, 0.0))[1]:
                largest[effect.name] = (effect, power)
        parts = [
            (near.scaled(self._looks_like(effect, other) * float(np.sqrt(most / power))), True)
            for other, power, near in found
            for effect, most in largest.values()
            if effect.name != other.name
        ]
        return uncertain_columns(parts) if parts else self._nothing

    def _near(self, entries: Sequence[SizedEffect], index: int) -> Columns:
        """One effect of a set as large as it is, of shapes near its own."""
        return self.changed_columns(lambda r: as_fault_of(r.modelled, entries, index))

    def _before(self, entries: Sequence[SizedEffect]) -> Columns | None:
        """What slow effects had done before each record began: an initial state for each of their lags and records."""
        if all(effect.before_record is None for effect, _ in entries):
            return None
        per_record = [
            before_record(r.modelled, entries) if c else None
            for r, c in zip(self.space.records, self._changed, strict=True)
        ]
        count = next((c.shape[1] for c in per_record if c is not None), 0)
        white = [None if c is None else self.space.whitened(i, c) for i, c in enumerate(per_record)]
        found: list[Samples | None] = []
        places = np.cumsum([w is not None for w in white]) - 1
        total = count * int(sum(w is not None for w in white))
        for w, place in zip(white, places, strict=True):
            if w is None:
                found.append(None)
                continue
            wide = np.zeros((len(w), total))
            wide[:, place * count : (place + 1) * count] = w
            found.append(wide)
        return self.space.from_white(found)

    def _through(self, entries: Sequence[SizedEffect]) -> Columns | None:
        """What the base misses passes through a lag like everything else: how that changes it, to second order."""
        lag_s = sum(
            abs(f(params)) for effect, params in entries for f in (effect.lag_s, effect.dead_time_s) if f is not None
        )
        if not lag_s:
            return None
        rows = lag_s / self.step_s
        found: list[Samples | None] = []
        for missed, changed in zip(self._missed, self._changed, strict=True):
            slope = np.gradient(missed)
            found.append(np.stack([rows * slope, 0.5 * rows**2 * np.gradient(slope)], axis=1) if changed else None)
        return self.space.from_white(found)

    def fit(
        self,
        entries: Sequence[SizedEffect],
        steps: int = STEPS,
        uncertain: Uncertain | None = None,
        share: float = FITTED_AT,
    ) -> tuple[SizedEffect, ...]:
        """The most likely parameters near those of ``entries`` at a share of equation misfit; what is uncertain with
        them stays that of the start, or is ``uncertain``."""
        if not entries:
            return ()
        reduced = self._reduction(uncertain or self.uncertain(entries), share, self.space.all)
        return self._fitted(entries, steps, reduced)

    def fit_from(
        self, starts: Sequence[Sequence[SizedEffect]], uncertain: Uncertain, share: float
    ) -> tuple[SizedEffect, ...]:
        """The most likely parameters of one set near any of several starts."""
        reduced = self._reduction(uncertain, share, self.space.all)
        return min((self._fitted(start, STEPS, reduced) for start in starts), key=lambda e: self._cost(e, reduced))

    def _cost(self, entries: Sequence[SizedEffect], reduced: Callable[[Columns], Samples]) -> float:
        """Minus the log of likelihood and prior."""
        return 0.5 * float(reduced(self.residual(entries))[-1, -1]) - prior_of(entries, self.step_s).log_density

    def _fitted(
        self, start: Sequence[SizedEffect], steps: int, reduced: Callable[[Columns], Samples]
    ) -> tuple[SizedEffect, ...]:
        entries: tuple[SizedEffect, ...] = tuple((effect, dict(params)) for effect, params in start)
        best, damping = self._cost(entries, reduced), FIRST_DAMPING
        for _ in range(steps):
            moments, prior = reduced(self.fresh(entries)), prior_of(entries, self.step_s)
            x = _internal(entries)
            normal = moments[:-1, :-1] + np.diag(prior.precision)
            right = moments[:-1, -1] - prior.precision * (x - prior.centre)
            gained = 0.0
            for _ in range(DAMPINGS):
                step: Samples = np.asarray(np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-12), right))
                tried = _moved(entries, x, step)
                value = self._cost(tried, reduced)
                if value < best:
                    gained, best, entries = best - value, value, tried
                    damping = max(damping / BOLDER, 1e-8)
                    break
                damping = max(damping, 1e-4) * CALMER
            if gained < LEAST_GAIN:
                break
        return entries

    def products_beside(self, entries: Sequence[SizedEffect]) -> Callable[[Columns], Samples]:
        """Products of columns over the fitted records with a set of effects integrated out: its parameters and all
        that its equations may miss."""
        if not entries:
            return lambda columns: self.space.inner(columns, columns, self.space.fitted)
        free, spread = parameters_of(entries), 1 / np.sqrt(prior_of(entries, self.step_s).precision)
        tangents = self.changed_columns(lambda r: fresh_columns(r.modelled, entries, free)[:, :-1] * spread)
        by = uncertain_columns([(self.misfit(entries), True), *self.of_records(entries), (tangents, False)])
        return self._reduction(by, FITTED_AT, self.space.fitted)

    def _reduction(self, by: Uncertain, share: float, which: Mask) -> Callable[[Columns], Samples]:
        """Products of columns over some records with the uncertain ones integrated out."""
        uncertain = by.columns
        factor = cho_factor(self.space.inner(uncertain, uncertain, which) + np.diag(by.precision(share)))

        def reduced(columns: Columns) -> Samples:
            cross = self.space.inner(uncertain, columns, which)
            return np.asarray(self.space.inner(columns, columns, which) - cross.T @ cho_solve(factor, cross))

        return reduced

    def contest(self, sets: Sequence[Sequence[SizedEffect]], uncertain: Uncertain | None) -> list[SetFit]:
        """Every set under the same covariance, with the ``uncertain`` columns integrated.

        Only so can their evidences be compared: a set that brought its own would win by its freedom alone.
        """
        uncertain = uncertain if uncertain is not None else self._nothing
        found = []
        for which in (self.space.all, self.space.fitted):
            own = self.space.inner(uncertain.columns, uncertain.columns, which)
            found.append([self._logs(entries, uncertain, own, which) for entries in sets])
        pairs = zip(sets, *found, strict=True)
        return [SetFit(tuple(entries), every[0], fitted[0], every[1]) for entries, every, fitted in pairs]

    def estimate(self, entries: Sequence[SizedEffect]) -> tuple[tuple[SizedEffect, ...], Samples]:
        """A set that is there at its most likely parameters, and their covariance (parameters, parameters) in internal
        units: both with all that its equations may miss, also what other parameters of the effects would do, and
        without the fault of the base that it might have been."""
        uncertain = self._if_there(entries)
        logs = self.contest([entries], uncertain)[0].logs
        entries = self.fit(entries, uncertain=uncertain, share=max(logs, key=lambda share: logs[share]))
        return entries, self.spread(entries)

    def spread(self, entries: Sequence[SizedEffect]) -> Samples:
        """Covariance (parameters, parameters) in internal units of the parameters of a set that is there."""
        return self.contest([entries], self._if_there(entries))[0].covariance

    def _if_there(self, entries: Sequence[SizedEffect]) -> Uncertain:
        """What is uncertain with effects that are there, also what other parameters of theirs would do."""
        return uncertain_columns([(self.misfit(entries), True), *self.of_records(entries)])

    def _logs(
        self, entries: Sequence[SizedEffect], uncertain: Uncertain, own: Samples, which: Mask
    ) -> tuple[dict[float, float], Samples]:
        """Log evidence by share of equation misfit over some records, and the covariance of the parameters."""
        fresh, prior = self._remembered_fresh(entries), prior_of(entries, self.step_s)
        n = len(prior.centre)
        cross, alone = self.space.inner(uncertain.columns, fresh, which), self.space.inner(fresh, fresh, which)
        x = _internal(entries)
        logs: dict[float, float] = {}
        spreads = []
        for share in SHARES:
            precision = uncertain.precision(share)
            factor = cho_factor(own + np.diag(precision))
            left = alone - cross.T @ cho_solve(factor, cross)
            occam = np.log(np.diag(factor[0])).sum() - 0.5 * np.log(precision).sum()
            logs[share] = -0.5 * float(left[-1, -1]) - occam + prior.log_density
            if n:
                normal = left[:-1, :-1] + np.diag(prior.precision)
                right = left[:-1, -1] - prior.precision * (x - prior.centre)
                solved = cho_factor(normal + 1e-9 * np.diag(np.diag(normal)))
                beyond = min(0.5 * float(right @ cho_solve(solved, right)), MOST_BEYOND)
                logs[share] += 0.5 * n * np.log(2 * np.pi) - np.log(np.diag(solved[0])).sum() + beyond
                spreads.append(cho_solve(solved, np.eye(n)))
        weights = np.exp(np.array(list(logs.values())) - max(logs.values()))
        spread = np.einsum("s,sij->ij", weights / weights.sum(), np.array(spreads)) if n else np.zeros((0, 0))
        return logs, spread

    def _remembered_fresh(self, entries: Sequence[SizedEffect]) -> Columns:
        key = tuple((effect.name, *sorted(params.items())) for effect, params in entries)
        if key not in self._fresh:
            if len(self._fresh) > MOST_KEPT:
                self._fresh.clear()
            self._fresh[key] = self.fresh(entries) if entries else self.residual(())
        return self._fresh[key]


def confused(one: Effect, other: Effect) -> bool:
    """Whether two effects are hard to tell apart by what the catalogue says of either."""
    mine, theirs = ({*e.confused_with, *e.hard_to_tell_from} for e in (one, other))
    return one.name != other.name and (other.name in mine or one.name in theirs)


def _internal(entries: Sequence[SizedEffect]) -> Samples:
    """All parameters in internal units, (parameters,)."""
    return np.array([to_internal(p, entries[i][1][p.name]) for i, p in parameters_of(entries)])


def _moved(entries: Sequence[SizedEffect], x: Samples, step: Samples) -> tuple[SizedEffect, ...]:
    """The entries after a step from ``x``, at most a factor e in what is logarithmic."""
    moved = [(effect, dict(params)) for effect, params in entries]
    for (i, p), at, change in zip(parameters_of(entries), x, step, strict=True):
        limited = float(np.clip(change, -1.0, 1.0)) if is_logarithmic(p) else float(change)
        moved[i][1][p.name] = from_internal(p, float(at) + limited)
    return tuple((effect, bounded(effect, params)) for effect, params in moved)
