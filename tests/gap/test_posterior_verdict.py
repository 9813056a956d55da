"""From evidences to names: laws of the verdict on contests made up, and of the prior over sets."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from math import comb, exp, log
from types import SimpleNamespace as Made

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phaselead.gap.error_rates import INSIDE, SURE
from phaselead.gap.parameters import from_internal, is_logarithmic, parameters_of, to_internal
from phaselead.gap.posterior.contest import WITHIN, Contest, at_an_end
from phaselead.gap.posterior.priors import log_prior_of_set, prior_of
from phaselead.gap.posterior.sets import Fit
from phaselead.gap.posterior.verdict import MORE_LIKELY_THAN_NOT, MOST_TIED, judge
from phaselead.model.effects import effect

NAMES = ("delay", "amplifier_lowpass", "sensor_lowpass", "resonance", "creep", "gain_change", "saturation")
CATALOGUE = 20
LOOKED_AT = Made(effects=[Made(name=f"effect {i}") for i in range(CATALOGUE)])


def typical(name):
    found = effect(name)
    return found, {p.name: p.typical for p in found.parameters}


def terms_of(entries):
    entries = tuple(entries)
    return Made(entries=entries, prior=Made(centre=np.zeros(len(parameters_of(entries)))))


def contest(logs, held_out=None, named=None):
    """Of sets given as tuples of names with their log posterior odds; ``held_out`` is what of them the held-out
    records add, ``named`` how probable it is that they leave no more than their equations may miss, by default sure."""
    fits = {}
    for names, value in logs.items():
        log_evidence = value - log_prior_of_set(len(names), CATALOGUE)
        fitted = log_evidence - (held_out or {}).get(names, 0.4 * value)
        terms = terms_of(typical(name) for name in names)
        sure = (named or {}).get(names, 1.0)
        known = 1e-6 * np.eye(len(terms.prior.centre))
        fits[tuple(sorted(names))] = Fit(terms, log_evidence, fitted, sure, 0.05, known)
    return Contest(None, fits, LOOKED_AT)


sets = st.sets(st.sampled_from(NAMES), max_size=3).map(lambda s: tuple(sorted(s)))


@given(st.dictionaries(sets, st.floats(-30, 30), max_size=8).map(lambda d: {(): 0.0} | d))
def test_probabilities_are_probabilities_and_claims_are_sure(logs):
    found = judge(contest(logs))
    assert sum(found.sets.values()) == pytest.approx(1.0)
    assert all(0 <= p <= 1 for p in (*found.sets.values(), *found.probability.values()))
    assert found.sets[found.best.names] == max(found.sets.values())
    for name, p in found.probability.items():
        assert p == pytest.approx(sum(q for names, q in found.sets.items() if name in names), abs=1e-9)
    for claim in found.claims:
        group = set(claim.tied)
        assert claim.tied[0] == claim.effect.name in found.best.names
        assert len(group) == len(claim.tied) <= MOST_TIED
        assert sum(q for names, q in found.sets.items() if group & set(names)) >= SURE - 1e-9
        assert len(claim.tied) == 1 or claim.probability < SURE
        assert claim.borne_out
    assert found.nearest_only == pytest.approx(0.0)


@given(st.dictionaries(sets, st.floats(-30, 30), max_size=8).map(lambda d: {(): 0.0} | d), st.floats(-1e5, 1e5))
def test_only_differences_of_evidence_count(logs, shift):
    plain = contest(logs)
    shifted = {
        n: replace(f, log_evidence=f.log_evidence + shift, log_evidence_fitted=f.log_evidence_fitted + shift)
        for n, f in plain.fits.items()
    }
    found, again = judge(plain), judge(Contest(None, shifted, LOOKED_AT))
    assert found.sets == pytest.approx(again.sets, abs=1e-6)


def test_an_effect_is_named_from_the_stated_probability_on():
    odds = log(SURE / (1 - SURE))
    for more, named in ((0.01, True), (-0.01, False)):
        found = judge(contest({(): 0.0, ("delay",): odds + more}))
        assert [c.effect.name for c in found.claims] == (["delay"] if named else [])
        assert found.probability["delay"] == pytest.approx(SURE, abs=1e-3)


def test_of_a_named_effect_the_odds_are_against_the_best_set_without_it():
    logs = {(): 0.0, ("delay",): 40.0, ("creep",): 25.0, ("creep", "delay"): 60.0}
    claims = {c.effect.name: c for c in judge(contest(logs)).claims}
    assert claims["delay"].log_odds == pytest.approx(35.0)
    assert claims["creep"].log_odds == pytest.approx(20.0)
    assert claims["delay"].held_out_log_odds == pytest.approx(0.4 * 35)


def test_a_tie_is_the_smallest_group_of_rivals_that_is_sure_together():
    logs = {(): 0.0, ("delay",): 30.0, ("amplifier_lowpass",): 29.5, ("sensor_lowpass",): 24.0, ("resonance",): 22.0}
    (claim,) = judge(contest(logs)).claims
    assert claim.tied == ("delay", "amplifier_lowpass")
    assert [entries[-1][0].name for entries in claim.rivals] == list(claim.tied)
    logs["sensor_lowpass",] = 29.0
    (claim,) = judge(contest(logs)).claims
    assert claim.tied == ("delay", "amplifier_lowpass", "sensor_lowpass")


def test_beside_a_tie_another_effect_is_named():
    logs = {(): 0.0, ("creep", "delay"): 60.0, ("amplifier_lowpass", "creep"): 59.5, ("delay",): 20.0}
    claims = {c.effect.name: c.tied for c in judge(contest(logs)).claims}
    assert claims == {"creep": ("creep",), "delay": ("delay", "amplifier_lowpass")}


def test_more_rivals_than_say_something_are_no_tie():
    many = ("rate_dependence", "hysteresis", "backlash", "creep", "delay", "softening")
    assert len(many) == MOST_TIED + 1
    logs = {(): 0.0} | {(name,): 30.0 for name in many[1:]} | {("rate_dependence",): 30.01}
    assert not judge(contest(logs)).claims
    del logs[many[-1:]]
    assert judge(contest(logs)).claims


def flatter(logs, width):
    """A contest in which hysteresis surely takes a third of its typical ``lost`` off the travel, and opens its loop by
    so many deviations of ``width``."""
    made = contest(logs)
    loop = effect("hysteresis")
    sizes = {"width": 1e-3 * width * loop.parameter("width").typical, "lost": loop.parameter("lost").typical / 3}
    entry = loop, {**{p.name: p.typical for p in loop.parameters}, **sizes}
    fits = {
        names: replace(fit, terms=terms_of(entry if e.name == "hysteresis" else (e, p) for e, p in fit.entries))
        for names, fit in made.fits.items()
    }
    return replace(made, fits=fits)


def test_a_loop_that_does_not_open_counts_for_the_change_of_gain_that_it_is():
    """A gain of 3 % was `unknown`, since a loop that does not open and takes 3 % off was 3.4 log units behind it."""
    logs = {(): 0.0, ("gain_change",): 60.0, ("hysteresis",): 56.6}
    still, open_ = judge(flatter(logs, width=1.0)), judge(flatter(logs, width=9.0))
    assert [claim.tied for claim in still.claims] == [("gain_change",)]
    assert still.claims[0].log_odds == pytest.approx(60.0)
    assert not open_.claims
    # The more probable of the two is adopted by its name.
    swapped = judge(flatter({**logs, ("hysteresis",): 63.0}, width=1.0))
    assert swapped.best.names == ("gain_change",)
    assert [claim.tied for claim in swapped.claims] == [("gain_change",)]


def test_a_set_far_behind_does_not_stand_for_one_that_bears_its_names():
    far = judge(flatter({(): 0.0, ("gain_change",): 60.0 - 1.1 * WITHIN, ("hysteresis",): 60.0}, width=1.0))
    assert far.best.names == ("hysteresis",)
    assert not far.claims
    assert far.something_unnamed


def test_of_rivals_that_are_as_good_the_first_of_the_contest_is_taken():
    """It had been the first of a set of strings, another in every process."""
    logs = {(): 0.0, ("delay",): 60.0, ("amplifier_lowpass", "sensor_lowpass"): 59.5}
    (claim,) = judge(contest(logs)).claims
    assert claim.tied == ("delay", "amplifier_lowpass")
    assert list(judge(contest(logs)).probability) == ["delay", "amplifier_lowpass", "sensor_lowpass"]


def test_a_loop_that_does_not_open_has_no_name_where_a_change_of_gain_was_left_out():
    found = judge(flatter({(): 0.0, ("hysteresis",): 56.6}, width=1.0))
    assert not found.claims
    assert found.something_unnamed
    assert "gain_change" not in found.probability


BEND = "sensor_nonlinearity"


def scaled_by(gain, logs, looked_at=(BEND,)):
    """A contest in which the gain changed by so much, and in which these effects were looked at besides."""
    made = contest(logs)
    entry = (effect("gain_change"), {"gain": gain})
    fits = {
        names: replace(fit, terms=terms_of(entry if e.name == "gain_change" else (e, p) for e, p in fit.entries))
        for names, fit in made.fits.items()
    }
    effects = [*map(effect, looked_at), *made.starts.effects][:CATALOGUE]
    return replace(made, fits=fits, starts=Made(effects=effects))


@given(st.floats(-0.2, 0.2), st.floats(6.0, 60.0))
def test_a_gain_that_a_sensors_curve_may_have_is_tied_with_a_bend_whatever_its_odds(gain, odds):
    """Alone, that curve's slope is a change of gain: only the size tells them apart."""
    most = effect("gain_change").part_of.up_to
    (claim,) = judge(scaled_by(gain, {(): 0.0, ("gain_change",): odds})).claims
    assert claim.tied == (("gain_change", BEND) if abs(gain) <= most else ("gain_change",))


def test_a_tie_with_what_may_have_it_has_its_best_set_too():
    (claim,) = judge(scaled_by(0.004, {(): 0.0, ("gain_change",): 30.0, (BEND,): 20.0})).claims
    assert claim.tied == ("gain_change", BEND)
    assert [rival[-1][0].name for rival in claim.rivals] == ["gain_change", BEND]


def test_a_part_is_tied_with_no_effect_that_may_not_be_named():
    logs = {(): 0.0, ("gain_change",): 30.0}
    assert judge(scaled_by(0.004, logs, looked_at=("delay",))).claims[0].tied == ("gain_change",)
    assert judge(scaled_by(0.004, logs), frozenset({"gain_change"})).claims[0].tied == ("gain_change",)
    both = {(): 0.0, tuple(sorted(("gain_change", BEND))): 60.0}
    assert [claim.tied for claim in judge(scaled_by(0.004, both)).claims] == [("gain_change",), (BEND,)]


MODE_HZ = 217.0


def with_a_mode(c, zeros_Hz, looked_at=()):
    """A contest in which a mode of these zeros was found, 60 log units above nothing; its frequency is known to 0.1
    %."""
    made = contest({(): 0.0, ("resonance",): 60.0})
    entry = (effect("resonance"), {"c": c, "f_Hz": zeros_Hz * (1 - c) ** 0.5 if c < 1 else zeros_Hz, "zeta": 0.02})
    fits = {names: replace(fit, terms=terms_of([entry] * len(names))) for names, fit in made.fits.items()}
    effects = [*map(effect, looked_at), *made.starts.effects][:CATALOGUE]
    return replace(made, fits=fits, starts=Made(effects=effects))


@given(st.floats(-0.5, 0.9), st.floats(-0.1, 0.1))
def test_a_mode_in_the_place_of_another_is_that_one_changed(c, off):
    """Its zeros take away the mode that the model has. With what changes modes it is tied; else it has no name."""
    zeros_Hz, modes = MODE_HZ * exp(off), [(0.02, 672.0, 0.03), (0.98, MODE_HZ, 0.03)]
    in_its_place = abs(off) <= 1.96 * np.hypot(1e-3, 0.5e-3 / (1 - c))
    if abs(abs(off) / (1.96 * np.hypot(1e-3, 0.5e-3 / (1 - c))) - 1) < 0.01:
        return
    (claim,) = judge(with_a_mode(c, zeros_Hz, ("load_change",)), modes=modes).claims
    assert claim.tied == (("resonance", "load_change") if in_its_place else ("resonance",))
    alone = judge(with_a_mode(c, zeros_Hz), modes=modes)
    assert len(alone.claims) == (not in_its_place)
    assert alone.something_unnamed == in_its_place


def test_beside_the_effect_that_changes_modes_a_mode_is_its_own():
    made = with_a_mode(0.1, MODE_HZ, ("load_change",))
    both = tuple(sorted(("load_change", "resonance")))
    load = (effect("load_change"), {"mass": 0.2, "damping": 0.1, "others": 1.0})
    entries = [load, *made.fits[("resonance",)].entries]
    known = 1e-6 * np.eye(len(parameters_of(entries)))
    fit = replace(made.fits[("resonance",)], terms=terms_of(entries), log_evidence=90.0, log_evidence_fitted=60.0)
    made = replace(made, fits={**made.fits, both: replace(fit, joint_covariance=known)})
    found = judge(made, modes=[(1.0, MODE_HZ, 0.03)])
    assert [claim.tied for claim in found.claims] == [("load_change",), ("resonance",)]
    assert not found.in_place


@pytest.mark.parametrize(
    ("c", "modes"),
    [(0.99999999, [(1.0, MODE_HZ, 0.02)]), (1.0, [(1.0, MODE_HZ, 0.02)]), (1.5, [(1.0, MODE_HZ, 0.02)]), (0.1, [])],
)
def test_a_mode_without_zeros_or_of_a_stage_without_modes_is_in_no_other_s_place(c, modes):
    assert [claim.tied for claim in judge(with_a_mode(c, MODE_HZ), modes=modes).claims] == [("resonance",)]


def test_what_the_catalogue_does_not_confuse_is_no_tie():
    assert not judge(contest({(): 0.0, ("delay",): 30.0, ("gain_change",): 30.0})).claims
    assert judge(contest({(): 0.0, ("delay",): 30.0, ("sensor_lowpass",): 30.0})).claims


@pytest.mark.parametrize(("held_out", "named"), [(12.0, True), (0.0, True), (-5.0, True), (31.0, False)])
def test_what_only_the_held_out_records_show_is_not_named(held_out, named):
    """With 30 log units in all, of which the held-out records add these."""
    found = judge(contest({(): 0.0, ("delay",): 30.0}, {("delay",): held_out}))
    assert bool(found.claims) is named


@pytest.mark.parametrize(("of_held_out", "tied"), [(5.0, ("delay",)), (25.0, ("delay", "amplifier_lowpass"))])
def test_rivals_that_only_the_held_out_records_tell_apart_are_tied(of_held_out, tied):
    """Both against nothing by far, and ten log units apart, of which the held-out records add these."""
    logs = {(): 0.0, ("delay",): 60.0, ("amplifier_lowpass",): 50.0}
    held_out = {("delay",): 5.0 + of_held_out, ("amplifier_lowpass",): 5.0}
    (claim,) = judge(contest(logs, held_out)).claims
    assert claim.tied == tied
    assert claim.borne_out


def test_the_training_records_choose_their_own_best_rival():
    """They prefer the amplifier; held-out records alone turn that round, and put the sensor before it."""
    logs = {(): 0.0, ("delay",): 60.0, ("amplifier_lowpass",): 40.0, ("sensor_lowpass",): 45.0}
    held_out = {("delay",): 35.0, ("amplifier_lowpass",): 5.0, ("sensor_lowpass",): 40.0}
    (claim,) = judge(contest(logs, held_out)).claims
    assert claim.tied == ("delay", "amplifier_lowpass")
    assert claim.borne_out


def test_a_member_that_another_makes_needless_leaves_the_tie():
    """The sensor makes the delay sure; the amplifier, which the training records prefer, does both by itself."""
    logs = {(): -60.0, ("delay",): 0.0, ("sensor_lowpass",): log(0.008), ("amplifier_lowpass",): log(0.006)}
    held_out = {("delay",): 40.0, ("sensor_lowpass",): 40.0, ("amplifier_lowpass",): 0.0, (): 0.0}
    (claim,) = judge(contest(logs, held_out)).claims
    assert claim.tied == ("delay", "amplifier_lowpass")


@given(
    st.dictionaries(sets, st.tuples(st.floats(-8, 8), st.floats(-8, 8)), max_size=8).map(
        lambda d: {(): (-40.0, 0.0)} | d
    )
)
def test_no_member_of_a_tie_can_be_left_out(both):
    made = contest({n: value for n, (value, _) in both.items()}, {n: held for n, (_, held) in both.items()})
    found = judge(made)
    for claim in found.claims:
        for name in claim.tied[1:]:
            rest = set(claim.tied) - {name}
            sure = sum(p for names, p in found.sets.items() if rest & set(names)) >= SURE
            fitted = {names: made.log_posterior_fitted(names) for names in found.sets}
            mine = max(value for names, value in fitted.items() if rest & set(names))
            assert not (sure and mine > max(value for names, value in fitted.items() if not rest & set(names)))


@pytest.mark.parametrize(("short", "claimed"), [(0.01, True), (-0.01, False)])
def test_the_nearest_set_names_nothing_where_it_is_probably_no_more_than_that(short, claimed):
    """Neither an effect nor a tie. Its probability stays what it was."""
    named = MORE_LIKELY_THAN_NOT + short
    for logs in (
        {(): 0.0, ("delay",): 40.0},
        {(): 0.0, ("delay",): 40.0, ("amplifier_lowpass",): 39.8},
        {(): 0.0, ("creep", "delay"): 60.0, ("amplifier_lowpass", "creep"): 59.5, ("delay",): 20.0},
    ):
        found = judge(contest(logs, named=dict.fromkeys(logs, named) | {(): 1.0}))
        assert found.nearest_only == pytest.approx(1 - named, abs=1e-6)
        assert bool(found.claims) is claimed
        assert found.sets == judge(contest(logs)).sets


@given(
    st.dictionaries(sets, st.tuples(st.floats(-30, 30), st.floats(0, 1)), max_size=8).map(
        lambda d: {(): (0.0, 1.0)} | d
    )
)
def test_the_nearest_only_is_what_every_set_may_miss_by_its_probability(both):
    found = judge(contest({n: value for n, (value, _) in both.items()}, named={n: q for n, (_, q) in both.items()}))
    assert found.nearest_only == pytest.approx(sum(found.sets[n] * (1 - q) for n, (_, q) in both.items()), abs=1e-9)
    assert not (found.claims and found.nearest_only > MORE_LIKELY_THAN_NOT)
    assert not (found.something_unnamed and found.sets[()] > 1 - INSIDE)


@pytest.mark.parametrize(("short", "something"), [(0.001, False), (-0.001, True)])
def test_something_remains_where_it_is_sure_that_something_is_there_and_not_what(short, something):
    """Two that nobody takes for one another, as likely: neither is named. One record in twenty with nothing hidden may
    look like that."""
    empty = 1 - INSIDE + short
    other = np.log((1 - empty) / empty / 2)
    found = judge(contest({(): 0.0, ("creep",): other, ("backlash",): other}))
    assert found.claims == ()
    assert found.sets[()] == pytest.approx(empty)
    assert found.something_unnamed is something


@pytest.mark.parametrize("something", [False, True])
def test_beside_a_name_something_may_remain_as_well(something):
    both = 60.0 if something else 20.0
    found = judge(contest({(): 0.0, ("delay",): 40.0, ("creep", "delay"): both, ("backlash", "delay"): both}))
    assert [claim.effect.name for claim in found.claims] == ["delay"]
    assert found.something_unnamed is something


@pytest.mark.parametrize(("short", "something"), [(0.002, False), (-0.002, True)])
def test_beside_a_name_what_remains_must_be_as_sure_as_a_name(short, something):
    """Where nothing is named to be sure of something in 95 of 100 is enough not to say that there is nothing."""
    alone = 1 - SURE + short
    other = 40.0 + np.log((1 - alone) / alone / 2)
    found = judge(contest({(): 0.0, ("delay",): 40.0, ("creep", "delay"): other, ("backlash", "delay"): other}))
    assert [claim.effect.name for claim in found.claims] == ["delay"]
    assert found.sets["delay",] == pytest.approx(alone)
    assert found.something_unnamed is something


@given(st.integers(1, 40))
def test_the_prior_of_all_sets_sums_to_one_and_every_number_of_effects_is_as_likely(size):
    by_number = [comb(size, k) * exp(log_prior_of_set(k, size)) for k in range(size + 1)]
    assert by_number == pytest.approx([1 / (size + 1)] * (size + 1))
    names = range(min(size, 6))
    every = (s for k in range(len(names) + 1) for s in combinations(names, k))
    assert sum(exp(log_prior_of_set(len(s), len(names))) for s in every) == pytest.approx(1.0)


@pytest.mark.parametrize("name", ["gain_change", "delay", "asymmetric_hysteresis"])
def test_a_larger_size_is_less_likely(name):
    found = effect(name)
    shapes = {p.name: p.typical for p in found.shapes}
    first, *others = found.sizes
    fixed = shapes | {p.name: 0.0 for p in others}
    unit = first.typical / to_internal(first, first.typical)

    def density(x):
        return exp(prior_of([(found, fixed | {first.name: float(x * unit)})]).log_density)

    assert density(1.0) > density(3.0) > density(6.0)


@pytest.mark.filterwarnings("error")
def test_an_overflow_ends_at_the_bound_without_a_warning():
    f = next(p for p in effect("resonance").parameters if p.name == "f_Hz")
    assert is_logarithmic(f)
    assert (from_internal(f, 1e4), from_internal(f, -1e4)) == (f.high, f.low)


def test_a_shape_at_an_end_of_its_range_is_no_longer_that_effect():
    mode, params = typical("resonance")
    (f_Hz,) = (p for p in mode.parameters if p.name == "f_Hz")
    assert not at_an_end([(mode, params)])
    for value, end in ((f_Hz.low, True), (f_Hz.high, True), (1.01 * f_Hz.low, False), (0.99 * f_Hz.high, False)):
        assert at_an_end([typical("delay"), (mode, params | {"f_Hz": value})]) is end


def test_an_end_of_nothing_is_where_it_vanishes():
    late, params = typical("delay")
    assert late.parameters[0].low == 0.0
    assert not at_an_end([(late, params | {"delay_s": 0.0})])
    assert at_an_end([(late, {"delay_s": late.parameters[0].high})])
    assert not at_an_end([])


@pytest.mark.parametrize("name", ["hysteresis", "asymmetric_hysteresis"])
def test_plays_that_reach_as_far_as_the_range_are_ordinary(name):
    """A larger threshold would not move within the range. A leak beside an asymmetric loop was found, and dropped for
    a reach of 0.5."""
    effect, params = typical(name)
    reach = next(p for p in effect.parameters if p.name == "reach")
    assert not at_an_end([(effect, params | {"reach": reach.high})])
    assert at_an_end([(effect, params | {"reach": reach.low})])


def test_what_is_in_the_place_of_a_mode_is_said():
    modes = [(1.0, MODE_HZ, 0.03)]
    assert judge(with_a_mode(0.1, MODE_HZ), modes=modes).in_place == ("resonance",)
    assert judge(with_a_mode(0.1, 1.1 * MODE_HZ), modes=modes).in_place == ()
