"""Laws of the likelihood on toy records, drawn from the model itself, of effects that are linear in their sizes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import gammaln, logsumexp
from scipy.stats import norm
from toy import BASE_SHARE, GAIN, LATE, NOISE_UM2, ROLES, ROWS, SLOW, Toy, amount_of, sized

from phaselead.gap.posterior import shared_misfit
from phaselead.gap.posterior.equation_misfit import LEAST_OF_MATERIAL, MOST_MISSED, OUTSIDE, SHARES, TIMES_BASE
from phaselead.gap.posterior.interval import intervals
from phaselead.gap.posterior.likelihood import Likelihood
from phaselead.gap.posterior.moments import Amounts
from phaselead.gap.posterior.priors import prior_of
from phaselead.gap.posterior.sets import confused
from phaselead.gap.posterior.shared_misfit import LIKE_RIVALS
from phaselead.model import Place
from phaselead.model.effects import effect


def powers(toy, entries, extra=None):
    """Mean powers (blocks,) of all residuals, less ``extra`` (n,) in every one."""
    errors = [run.modelled.error(entries if run.changed else ()) for run in toy.likelihood.runs]
    left = [error if extra is None else error - extra for error in errors]
    return np.concatenate([run.power(one) for run, one in zip(toy.likelihood.runs, left, strict=True)])


def density(toy, power, signal, share):
    """Log density (k,) of records of these powers (k, blocks): as many coefficients of each octave as count, of a scale
    of Student's t, and in each record any multiple of what the base misses."""
    ends = np.cumsum([len(run.sizes) for run in toy.likelihood.runs])[:-1]
    parts = zip(toy.likelihood.runs, np.split(power, ends, axis=-1), np.split(signal, ends), strict=True)
    return sum(_of_record(toy, run, mine, of_signal, share) for run, mine, of_signal in parts)


def _of_record(toy, run, power, signal, share):
    motion = run.spread(run.power(run.modelled.motion))
    *_, told = toy.likelihood.expected.of(run, motion)
    v = [NOISE_UM2 + times**2 * BASE_SHARE**2 * motion + share**2 * signal for times in TIMES_BASE]
    n = counted_coefficients(run, motion)
    # Given its scale a block is normal, and scales are of an inverse gamma distribution.
    logs = [
        (
            gammaln((told + n) / 2)
            - gammaln(told / 2)
            + told / 2 * np.log(told / 2)
            - n / 2 * np.log(2 * np.pi * one)
            - (told + n) / 2 * np.log((told + n * power / one) / 2)
        ).sum(axis=-1)
        for one in v
    ]
    return logsumexp(logs, axis=0) - np.log(len(TIMES_BASE))


def counted_coefficients(run, motion):
    """Coefficients (blocks,) of a run that count: those of noise each, what is missed once."""
    left = run.spread(run.power(run.modelled.error()))
    gap = np.maximum(left - NOISE_UM2 - BASE_SHARE**2 * motion, 0.0) * run.changed
    missed = BASE_SHARE**2 * motion + MOST_MISSED**2 * gap + NOISE_UM2 * np.sqrt(2 / run.sizes)
    return run.sizes * (NOISE_UM2 + missed) / (NOISE_UM2 + run.sizes * missed)


def integrated(logs, at):
    return max(logs) + np.log(np.trapezoid(np.exp(np.array(logs) - max(logs)), at))


def over_shares(of_share, shares=SHARES):
    """Log of the mean over the shares of what has these logs: all as likely on either side of what an equation may
    miss."""
    inside = sum(share <= MOST_MISSED for share in shares)
    outside = len(shares) - inside
    return logsumexp(
        [
            of_share(share)
            + np.log(1.0 if outside == 0 else (1 - OUTSIDE) / inside if share <= MOST_MISSED else OUTSIDE / outside)
            for share in shares
        ]
    )


@pytest.mark.parametrize(("told", "within"), [(1e6, 0.1), (20.0, 0.3)])
@pytest.mark.parametrize(("share", "times"), [(0.02, 1.0), (0.1, 2.0), (0.4, 1.0)])
@pytest.mark.parametrize("amount", [1.0, -2.5, 6.0])
def test_the_evidence_of_a_linear_effect_is_the_integral_over_its_size(amount, share, times, told, within):
    """With what its equation misses as large as at the most likely size."""
    toy = Toy(1, [sized(amount)], share, times, told)
    fit = toy.likelihood.fit([sized(0.8 * amount)])
    half = 12 * np.sqrt(fit.covariance[0, 0])
    at = np.linspace(amount_of(fit) - half, amount_of(fit) + half, 401)
    of_sizes = np.stack([powers(toy, [sized(g)]) for g in at])
    prior = np.array([prior_of([sized(g)]).log_density for g in at])
    exact = {}
    for one in SHARES:
        exact[one] = integrated(prior + density(toy, of_sizes, fit.terms.signal, one), at)
    (at_fit,) = toy.likelihood._log_evidence(fit.terms, [fit.share], held_out=True)
    assert at_fit == pytest.approx(exact[fit.share], abs=within)
    assert fit.log_evidence == pytest.approx(over_shares(exact.__getitem__), abs=within)


@pytest.mark.parametrize("told", [3.0, 1e6])
def test_the_evidence_of_nothing_is_the_density_of_what_the_base_leaves(told):
    toy = Toy(1, told=told)
    power = powers(toy, ())
    found = over_shares(lambda share: density(toy, power, np.zeros_like(power), share), SHARES[:1])
    assert toy.likelihood.fit(()).log_evidence == pytest.approx(found, abs=1e-6)


def test_the_signal_of_an_effect_is_its_power_spread():
    toy = Toy(2, [sized(2.0)])
    found = np.split(toy.likelihood.terms([sized(2.0)]).signal, len(ROLES))
    for run, mine in zip(toy.likelihood.runs, found, strict=True):
        column = 2.0 * run.changed * run.modelled.columns[GAIN.name]
        np.testing.assert_allclose(mine, run.spread(run.power(column)), atol=1e-12)


def test_what_the_base_may_lack_in_all_records_is_integrated_out():
    toy = Toy(3, told=1e6)
    column = np.cumsum(np.random.default_rng(3).normal(size=ROWS))
    shared = tuple(run.coefficients(column[:, None]) for run in toy.likelihood.runs)
    at = np.linspace(-0.5, 0.5, 1001)
    of_amounts = np.stack([powers(toy, (), a * column) for a in at])
    signal = np.zeros(of_amounts.shape[1])
    exact = over_shares(
        lambda share: integrated(density(toy, of_amounts, signal, share) + norm.logpdf(at), at), SHARES[:1]
    )
    assert replace(toy.likelihood, shared=shared).fit(()).log_evidence == pytest.approx(exact, abs=0.15)  # Laplace's


@pytest.mark.parametrize("held_out", [True, False])
def test_a_student_variable_tends_to_a_normal_one_as_more_is_told(held_out):
    rng = np.random.default_rng(4)
    blocks = len(Toy(4).likelihood.noise)
    power, variance = rng.exponential(size=(1, blocks)), rng.uniform(0.2, 3, (1, blocks))
    alike = np.stack([variance] * len(TIMES_BASE), axis=1)
    off, apart = [], []
    for told in (1e2, 1e4, 1e6):  # beyond as many as count
        among = Toy(4, told=told).likelihood
        n, which = among.counted, held_out | among.fitted
        assert held_out or not which.all()
        exact = -0.5 * (n * (np.log(2 * np.pi * variance) + power / variance))[:, which].sum()
        off.append(abs(among.log_density(power, alike, held_out)[0] - exact))
        apart.append(np.abs((among.weights(power, alike, held_out) * variance / n)[:, which] - 1).max())
    for gap in (off, apart):
        assert sorted(gap, reverse=True) == gap
        assert gap[-1] < 0.01


@pytest.mark.parametrize("seed", range(5))
def test_a_fit_ends_at_the_same_size_from_anywhere(seed):
    toy = Toy(seed, [sized(1.0)], 0.05)
    ends = [toy.likelihood.fit([sized(start)]) for start in (-3.0, 0.1, 5.0, 30.0)]
    deviation = np.sqrt(ends[0].covariance[0, 0])
    assert np.ptp([amount_of(end) for end in ends]) < 0.2 * deviation  # each ends within LEAST_GAIN of the best
    assert amount_of(ends[0]) == pytest.approx(1.0, abs=5 * deviation)
    assert np.ptp([end.log_evidence for end in ends]) < 0.1
    assert ends[0].names == (GAIN.name,)
    assert (toy.likelihood.fit(()).entries, toy.likelihood.fit(()).covariance.shape) == ((), (0, 0))


def test_reference_records_have_no_effect():
    toy = Toy(5, [sized(1.0)])
    reference, train, *_ = toy.likelihood.runs
    for amount in (0.5, 4.0):
        np.testing.assert_allclose(
            reference.simulated([sized(amount)]).columns, reference.coefficients(reference.modelled.error()[:, None])
        )
        assert not reference.simulated([sized(amount)]).power.any()
        found = train.simulated([sized(amount)])
        left = train.modelled.error([sized(amount)])[:, None]
        assert found.columns[:, :-1].any()
        np.testing.assert_allclose(found.columns[:, -1:], train.coefficients(left))
        signal = np.split(toy.likelihood.terms([sized(amount)]).signal, len(ROLES))
        assert [bool(one.any()) for one in signal] == [False, True, True, True]


def test_held_out_records_have_no_part_in_the_evidence_of_those_that_were_fitted():
    toy = Toy(6, [sized(1.0)])
    before = toy.likelihood.fit(())
    alone = Likelihood(toy.likelihood.runs[:-1], toy.likelihood.expected, toy.likelihood.shared[:-1])
    assert before.log_evidence_fitted == pytest.approx(alone.fit(()).log_evidence)
    assert before.log_evidence_fitted != pytest.approx(before.log_evidence, abs=1.0)


@pytest.mark.parametrize("seed", range(4))
def test_a_fault_that_references_show_is_not_the_effect(seed):
    """Unless it may be one: without that the effect would be favoured, and a residual in changed records only is."""
    seen = Toy(seed, fault=[sized(3.0)])
    new = Toy(seed, [sized(3.0)])
    suspect = [sized(3.0)]
    assert seen.log_odds(suspect) > 5
    assert seen.log_odds(suspect, beside=seen.likelihood.knowing(suspect)) < 0
    assert new.log_odds(suspect, beside=new.likelihood.knowing(suspect)) > 5


def test_without_references_nothing_is_taken_for_a_fault():
    toy = Toy(7, [sized(3.0)], roles=("train", "train", "holdout"))
    knowing = toy.likelihood.knowing([sized(3.0)])
    assert toy.log_odds([sized(3.0)], beside=knowing) == pytest.approx(toy.log_odds([sized(3.0)]))
    assert knowing.known == (sized(3.0),)


def test_knowing_twice_is_knowing_both():
    toy = Toy(8, [sized(2.0), sized(1.0, LATE)], fault=[sized(0.5, SLOW)])
    first, second = sized(2.0), sized(0.5, SLOW)
    twice, once = toy.likelihood.knowing([first]).knowing([second]), toy.likelihood.knowing([first, second])
    assert twice.known == once.known == (first, second)
    for entries in ((), [first], [sized(2.0), sized(1.0, LATE)]):
        assert twice.fit(entries).log_evidence == pytest.approx(once.fit(entries).log_evidence)
    assert toy.likelihood.known == ()


@pytest.mark.parametrize("in_all", [True, False], ids=["the same in all records", "of each record's own"])
def test_the_covariance_holds_the_truth_in_95_of_100_draws(in_all):
    """Of records that miss any share with which an equation bears its name and any multiple of the base, and where what
    is missed looks most like the effect: all coefficients of an octave, and all records, say it once. Where records
    differ in what is missed it holds more often."""
    rng, held, draws = np.random.default_rng(0), 0, 300
    shares = [share for share in SHARES if share <= MOST_MISSED]
    for seed in range(draws):
        truth = float(rng.uniform(0.5, 2.0) * rng.choice([-1, 1]))
        share, times = float(rng.choice(shares)), float(rng.choice(TIMES_BASE))
        toy = Toy(seed, [sized(truth)], share, times, 50.0, ROLES[1:], like_effect=True, rows=128, in_all=in_all)
        fit = toy.likelihood.fit([sized(truth)])
        (found,) = intervals(fit.entries, fit.covariance)
        value, _, (low, high) = found["gain"]
        assert low <= value <= high
        held += low <= sized(truth)[1]["gain"] <= high
    assert held / draws > 0.92
    assert not in_all or held / draws < 0.98


def test_records_that_repeat_others_narrow_no_interval_that_the_misfit_sets():
    toy = Toy(0, [sized(1.0)], 0.2, 1.0, 50.0, ("train",), like_effect=True)
    (run,), shared = toy.likelihood.runs, toy.likelihood.shared
    widths = []
    for count in (1, 6):
        fit = replace(toy.likelihood, runs=(run,) * count, shared=shared * count).fit([sized(1.0)])
        (found,) = intervals(fit.entries, fit.covariance)
        _, _, (low, high) = found["gain"]
        widths.append(high - low)
    assert widths[1] > 0.7 * widths[0]  # the noise and the share are known better; of records of their own 0.4


@pytest.mark.parametrize("at_rest", [0.0, 1.0])
def test_records_narrow_an_interval_that_noise_sets(at_rest):
    """Which is new in every record, whether records at rest tell it or not."""
    toy = Toy(0, [sized(1e-4)], times=0.0, told=1e4, roles=("train",))
    (run,), shared, all_octaves = toy.likelihood.runs, toy.likelihood.shared, np.ones(len(toy.expected.share))
    quiet = replace(toy.expected, share=1e-12 * all_octaves, noise_spread=at_rest * all_octaves)
    widths = []
    for count in (1, 16):
        fit = Likelihood((run,) * count, quiet, shared * count).fit([sized(1e-4)])
        (found,) = intervals(fit.entries, fit.covariance)
        _, _, (low, high) = found["gain"]
        widths.append(high - low)
    assert widths[1] < 0.35 * widths[0]


def test_a_name_is_lost_as_more_of_an_effect_is_missed_than_its_equation_may():
    shares, seeds = (0.05, 0.15, MOST_MISSED, 0.45, 0.7), range(12)
    named = [
        float(np.mean([Toy(seed, [sized(2.0)], share).likelihood.fit([sized(2.0)]).named for seed in seeds]))
        for share in shares
    ]
    assert sorted(named, reverse=True) == named
    assert min(named[:2]) > 0.95
    assert named[3] < 0.5 < named[2]
    assert named[4] < 0.05
    assert Toy(0).likelihood.fit(()).named == 1.0


class TestRivals:
    """A large delay, a small lag that the catalogue says it is confused with, a gain that it is not."""

    @staticmethod
    def toy(seed):
        return Toy(seed, [sized(4.0, LATE), sized(0.5 * 4.0 * LIKE_RIVALS, SLOW), sized(1.0)], roles=ROLES[1:])

    def test_who_is_confused(self):
        assert confused(LATE, SLOW)
        assert confused(SLOW, LATE)
        assert not confused(LATE, LATE)
        assert not confused(LATE, GAIN)

    @pytest.mark.parametrize("seed", range(4))
    def test_what_a_large_effect_misses_may_look_like_a_small_rival(self, seed):
        toy, large, small, other = self.toy(seed), sized(4.0, LATE), sized(0.2, SLOW), sized(1.0)
        knowing = toy.likelihood.knowing([large, small, other])
        among = knowing.with_misfit_of([large])
        for one, change in ((small, -3.0), (other, 0.0)):
            rest = [e for e in (large, small, other) if e is not one]
            before, after = (toy.log_odds([large, small, other], rest, beside) for beside in (knowing, among))
            assert before > 5
            assert after < before + change if change else after == pytest.approx(before, abs=1.0)
        assert toy.log_odds([large], beside=among) > 20

    def test_how_large_the_rival_stood_does_not_matter(self):
        toy, large = self.toy(5), sized(4.0, LATE)
        found = [
            toy.likelihood.knowing([sized(size, SLOW)]).with_misfit_of([large]).fit([large]).log_evidence
            for size in (0.1, 10.0)
        ]
        assert found[0] == pytest.approx(found[1], abs=0.01)
        assert found[0] != pytest.approx(toy.likelihood.fit([large]).log_evidence, abs=0.1)

    def test_nothing_unknown_and_no_reference_looks_like_a_rival(self):
        large = sized(4.0, LATE)
        toy = Toy(6, [large])
        assert toy.likelihood.with_misfit_of([large]).shared[1].shape[1] == 0
        among = toy.likelihood.knowing([large, sized(1.0, SLOW)])
        added = self.added(among, large)
        assert [one.shape[1] for one in added] == [2, 2, 2, 2]  # like the rival, and like the effect itself
        assert [bool(one.any()) for one in added] == [False, True, True, True]
        assert self.power(added) == pytest.approx(self.expected_power(among, large))

    @pytest.mark.parametrize("rivals", [2, 5])
    def test_many_rivals_share_what_an_equation_misses(self, rivals):
        """Were each given as much, what an effect looks like most would be free wherever it has rivals enough."""
        large = sized(4.0, LATE)
        among = Toy(6, [large]).likelihood.knowing([sized(0.3 * (1 + i), SLOW) for i in range(rivals)])
        added = self.added(among, large)
        assert [one.shape[1] for one in added] == [rivals + 1] * 4
        assert self.power(added) == pytest.approx(self.expected_power(among, large))

    def test_it_is_a_tenth_in_all_however_large_the_columns_are(self, monkeypatch):
        large = sized(4.0, LATE)
        among = Toy(6, [large]).likelihood.knowing([sized(0.1, SLOW), sized(10.0, SLOW)])
        deviations = shared_misfit.fault_deviations
        monkeypatch.setattr(shared_misfit, "fault_deviations", lambda rival: 3 * deviations(rival))
        added = self.added(among, large)
        assert self.power(added) == pytest.approx(self.expected_power(among, large))
        each = [self.power([one[:, [i]] for one in added]) for i in range(3)]
        assert each == pytest.approx([self.power(added) / 3] * 3)

    @pytest.mark.parametrize("seed", range(4))
    def test_a_name_that_stands_in_for_a_rival_is_not_given_what_the_rival_is_not(self, seed):
        """What is there is the lag, of which the equation misses a fifth that looks like a delay. That the delay then
        stands better must not be held against the lag: where the misfit of either is given to both, it is not."""
        there = [sized(4.0, SLOW), sized(0.8 * 4.0 * LIKE_RIVALS, LATE)]
        toy = Toy(seed, there, roles=ROLES[1:])
        knowing = toy.likelihood.knowing([sized(4.0, SLOW), sized(1.0, LATE)])
        among = knowing.with_misfit_of([sized(4.0, LATE)])
        before, after = (toy.log_odds(there, there[:1], beside) for beside in (knowing, among))
        assert before > 3
        assert after < before - 2

    @staticmethod
    def added(among, large):
        """Columns that the misfit of an effect brings."""
        pairs = zip(among.shared, among.with_misfit_of([large]).shared, strict=True)
        return [after[:, before.shape[1] :] for before, after in pairs]

    @staticmethod
    def power(columns):
        return sum(float(np.sum(one**2)) for one in columns)

    def expected_power(self, among, large):
        runs = [run for run in among.runs if run.changed]
        moved = [run.coefficients((run.modelled.answer([large]) - run.modelled.motion)[:, None]) for run in runs]
        return LIKE_RIVALS**2 * self.power(moved)


def test_held_out_records_move_no_parameter_that_is_learned_without_them():
    toy = Toy(5, [sized(2.0)], 0.05)
    learned = toy.likelihood.without_held_out().fit([sized(1.0)])
    for run in toy.likelihood.runs:
        if run.modelled.run.role == "holdout":
            run.modelled.run.x_um = run.modelled.answer([sized(-4.0)])
    assert amount_of(toy.likelihood.fit([sized(1.0)])) != pytest.approx(amount_of(learned), rel=0.05)
    assert amount_of(toy.likelihood.without_held_out().fit([sized(1.0)])) == amount_of(learned)


@pytest.mark.parametrize("amount", [3.0, 30.0, 300.0])
def test_what_is_integrated_out_settles_where_it_is_likeliest(amount):
    """However far it lies off where it is looked for first, and however sure the noise is."""
    toy = Toy(7, fault=[sized(amount)], told=5.0)
    faulty = replace(
        toy.likelihood,
        shared=tuple(400 * run.coefficients(run.modelled.columns[GAIN.name][:, None]) for run in toy.likelihood.runs),
    )
    typical = next(iter(sized(1.0)[1].values())) / GAIN.parameters[0].typical
    terms = faulty.terms(())
    shares = SHARES[:1]

    def joint(size):
        of_size = Amounts(np.array([[[size]]]), np.zeros((1, len(ROLES), 0, 1)))
        (left,) = faulty.log_density(terms.moments.power(of_size), faulty.variance(terms, shares))
        return left - 0.5 * size**2

    found = faulty.settled(terms, shares).amounts
    at = np.linspace(0, 2 * amount * typical / 400, 4001)
    assert joint(found.common.item()) >= max(joint(size) for size in at) - 0.05  # within SETTLED prior deviations


def test_an_effect_and_what_looks_like_it_in_all_records_are_known_together_alone():
    """How much of a gain is of the effect and how much is lacking anyway nobody knows; their sum is."""
    toy = Toy(11, [sized(2.0)], roles=("train", "train", "holdout"))
    like_it = [run.coefficients(run.modelled.columns[GAIN.name][:, None]) for run in toy.likelihood.runs]
    covariance = replace(toy.likelihood, shared=tuple(like_it)).fit([sized(1.0)]).joint_covariance
    assert covariance[0, 1] / np.sqrt(np.prod(np.diag(covariance))) < -0.99
    assert toy.likelihood.fit([sized(1.0)]).joint_covariance.shape == (1, 1)


@pytest.mark.parametrize("told", [3.0, 1e4])
def test_shares_are_looked_at_together_as_one_by_one(told):
    toy = Toy(9, [sized(2.0)], 0.1, 2.0, told, fault=[sized(1.0, SLOW)])
    among = toy.likelihood.knowing([sized(1.0, SLOW), sized(2.0, LATE)])
    every = among.terms([sized(2.0)])
    together = among.log_joint(every, SHARES, False), among._log_evidence(every, SHARES, True)
    alone = among.terms([sized(2.0)])
    for i, one in enumerate(SHARES):
        assert together[0][i] == pytest.approx(among.log_joint(alone, [one], False)[0], abs=1e-9)
        assert together[1][i] == pytest.approx(among._log_evidence(alone, [one], True)[0], abs=1e-9)
    assert np.ptp(together[1]) > 1


def test_no_equation_of_the_ceramic_is_trusted_beyond_what_is_published():
    """A loop leaves 5 % of itself at least; what is no loop may leave as little as the grid has."""
    loop, gain = effect("hysteresis"), sized(2.0)
    assert loop.place is Place.HYSTERESIS
    toy = Toy(3)
    terms = toy.likelihood.terms([gain])
    of_loop = replace(terms, of_material=terms.signal)
    (as_loop, same_as_loop), (as_gain, same) = (
        toy.likelihood.variance(t, [SHARES[0], 0.3])[:, 0] for t in (of_loop, terms)
    )
    assert as_loop - as_gain == pytest.approx((LEAST_OF_MATERIAL**2 - SHARES[0] ** 2) * terms.signal)
    assert same_as_loop == pytest.approx(same)
