"""Evidence and intervals against the same by brute force, for an effect that is linear in its size."""

from __future__ import annotations

from types import SimpleNamespace as Made

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from phaselead.gap.posterior.evidence import SHARES, Solver, _mean_of_logs, uncertain_columns
from phaselead.gap.posterior.interval import intervals
from phaselead.gap.posterior.priors import prior_of
from phaselead.gap.posterior.space import Space, SpaceRecord
from phaselead.model.effects import effect

GAIN = effect("gain_change")
UNIT = GAIN.parameters[0].typical
ROWS, ROLES = (20, 30, 25), ("reference", "train", "holdout")
STEP_S = 1e-3


class LinearRun:
    """A run in which the effect is a column (n,) times its size in typical values, and nothing else moves."""

    def __init__(self, column, x_um, role):
        n = len(column)
        self.column = column
        self.run = Made(role=role, x_um=x_um, rows=slice(0, n), step_s=STEP_S, t_s=STEP_S * np.arange(n))
        self.axis = None

    def answer(self, entries=()):
        return self.column * sum(params["gain"] / UNIT for _, params in entries)

    def error(self, entries=()):
        return self.run.x_um - self.answer(entries)


class Toy:
    """Records drawn from the model: what the base misses, the effect, what its equation misses, noise."""

    def __init__(self, seed, amount=0.0, share=0.0, k=4, q=3):
        rng = np.random.default_rng(seed)
        self.columns = [np.cumsum(rng.normal(size=n)) for n in ROWS]
        self.bends = [c[:, None] * rng.normal(size=(len(c), q)) for c in self.columns]
        bases = [rng.normal(size=(n, k)) for n in ROWS]
        shared, own = np.diag(rng.uniform(0.2, 1, k)), np.diag(rng.uniform(0.1, 0.4, k))
        w, v = shared @ rng.normal(size=k), share * rng.normal(size=q)
        records = []
        for column, bend, base, role in zip(self.columns, self.bends, bases, ROLES, strict=True):
            x = base @ (w + own @ rng.normal(size=k)) + rng.normal(size=len(column))
            x += (role != "reference") * (amount * column + bend @ v)
            metric = Made(project=lambda index, columns: columns.copy())
            records.append(SpaceRecord(LinearRun(column, x, role), metric, 0, base))
        self.space = Space(tuple(records), shared, own, np.eye(len(shared)))
        self.solver = Solver(self.space, {GAIN.name: GAIN}, {})
        misfit = self.space.columns([None, *self.bends[1:]])
        self.solver._misfit_of = lambda entries, index: misfit
        self.misfit = self.solver._beyond(sized(1.0), 0, misfit)

    def dense(self, which):
        """Row masks, residual, column of the effect, bends, covariance of what is no effect, of the records
        ``which``."""
        kept = [i for i, wanted in enumerate(which) if wanted]
        bases = [self.space.records[i].base for i in kept]
        every = np.concatenate(bases)
        covariance = np.eye(len(every)) + every @ self.space.shared @ self.space.shared.T @ every.T
        start = 0
        for base in bases:
            rows = slice(start, start + len(base))
            covariance[rows, rows] += base @ self.space.own @ self.space.own.T @ base.T
            start += len(base)
        changed = [float(ROLES[i] != "reference") for i in kept]
        y = np.concatenate([self.space.records[i].modelled.run.x_um for i in kept])
        column = np.concatenate([c * self.columns[i] for i, c in zip(kept, changed, strict=True)])
        left = [np.zeros_like(b) if w is None else w for w, b in zip(self.misfit.white, self.bends, strict=True)]
        bends = np.concatenate([left[i] for i in kept])
        return y, column, bends, covariance


def sized(amount):
    return ((GAIN, {"gain": amount * UNIT}),)


def brute_force(toy, which, share):
    """Log evidence of the effect over that of nothing: the likelihood times the prior, summed over a fine grid."""
    y, column, bends, covariance = toy.dense(which)
    law = multivariate_normal(np.zeros(len(y)), covariance + share**2 * bends @ bends.T)
    grid = np.linspace(-1.0, 3.0, 8001)
    logs = np.array([law.logpdf(y - g * column) for g in grid[::40]])
    fine = np.polyval(np.polyfit(grid[::40], logs, 2), grid)  # the log likelihood is a parabola
    fine += [prior_of(sized(g), STEP_S).log_density for g in grid]
    return fine.max() + np.log(np.trapezoid(np.exp(fine - fine.max()), grid)) - law.logpdf(y)


@pytest.mark.parametrize(("seed", "amount"), [(0, 1.0), (1, 0.4), (2, 2.0)])
def test_the_evidence_of_a_linear_effect_is_the_integral_over_its_size(seed, amount):
    toy = Toy(seed, amount, 0.07)
    uncertain = uncertain_columns([(toy.misfit, True)])
    best = toy.solver.fit(sized(0.8 * amount), uncertain=uncertain)
    for start in (best, sized(best[0][1]["gain"] / UNIT + 0.01)):  # a little beside the maximum it is the same
        with_it, nothing = toy.solver.contest([start, ()], uncertain)
        for which, logs, bare in (
            (toy.space.all, with_it.logs, nothing.logs),
            (toy.space.fitted, with_it.fitted_logs, nothing.fitted_logs),
        ):
            for share in SHARES:
                assert logs[share] - bare[share] == pytest.approx(brute_force(toy, which, share), abs=0.1)


def test_evidences_at_two_shares_differ_as_their_densities_do():
    toy = Toy(3, 1.0, 0.2)
    (nothing,) = toy.solver.contest([()], uncertain_columns([(toy.misfit, True)]))
    y, _, bends, covariance = toy.dense(toy.space.all)
    logs = [
        multivariate_normal(np.zeros(len(y)), covariance + share**2 * bends @ bends.T).logpdf(y) for share in SHARES
    ]
    found = [nothing.logs[share] for share in SHARES]
    np.testing.assert_allclose(np.diff(found), np.diff(logs), atol=1e-6)
    assert nothing.log_evidence == pytest.approx(np.log(np.mean(np.exp(np.array(found) - max(found)))) + max(found))


def test_the_mean_of_evidences_does_not_overflow():
    assert _mean_of_logs([-1e5, -1e5]) == -1e5
    assert _mean_of_logs([1e5, -np.inf]) == pytest.approx(1e5 - np.log(2))


def test_a_fit_ends_at_the_most_likely_size_from_anywhere():
    toy = Toy(4, 1.0)
    same = uncertain_columns([(toy.misfit, True)])
    ends = [toy.solver.fit(sized(start), uncertain=same)[0][1]["gain"] / UNIT for start in (-3.0, 0.1, 5.0)]
    assert np.ptp(ends) < 1e-3
    assert toy.solver.fit(()) == ()


def test_reference_records_have_no_effect():
    toy = Toy(5, 1.0)
    fresh, residual = toy.solver.fresh(sized(1.0)), toy.solver.residual(sized(1.0))
    assert not fresh.white[0][:, :-1].any()
    np.testing.assert_allclose(fresh.white[0][:, -1], toy.space.records[0].modelled.run.x_um)
    np.testing.assert_allclose(residual.white[0], fresh.white[0][:, -1:])
    np.testing.assert_allclose(residual.white[1][:, 0], toy.space.records[1].modelled.error(sized(1.0)))


def test_what_an_equation_misses_is_nothing_that_its_parameters_do():
    toy = Toy(6, 1.0)
    tangent = toy.space.columns([None, *(c[:, None] for c in toy.columns[1:])])
    misfits = toy.solver._misfit_of(sized(1.0), 0), toy.misfit
    before, after = (toy.space.inner(tangent, c, toy.space.all) for c in misfits)
    assert np.abs(after).max() < 1e-6 * np.abs(before).max()


def test_intervals_hold_the_truth_in_95_of_100_draws():
    """Of records whose equation misfit is any of the shares that the posterior thinks of."""
    rng, held, draws = np.random.default_rng(0), 0, 400
    for seed in range(draws):
        truth = float(rng.uniform(0.5, 2.0))
        toy = Toy(seed, truth, float(rng.choice(SHARES)))
        entries, covariance = toy.solver.estimate(toy.solver.fit(sized(1.0)))
        ((found,),) = ((one["gain"] for one in intervals(entries, covariance)),)
        value, unit, (low, high) = found
        assert (value, unit) == (entries[0][1]["gain"], "1")
        assert low <= value <= high
        held += low <= truth * UNIT <= high
    assert 0.925 < held / draws < 0.975


def test_an_interval_ends_where_the_catalogue_does():
    late = effect("delay")
    (p,) = late.parameters
    ((found,),) = ((one[p.name] for one in intervals([(late, {p.name: 0.5 * p.typical})], np.array([[100.0]]))),)
    assert found[2][0] == p.low
