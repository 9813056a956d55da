"""No `none` where a voltage still predicts what is left: laws of the check, on residuals of systems that the catalogue
was not written for and on noise."""

from __future__ import annotations

import numpy as np
import outsiders
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

from phaselead.gap.findings import GapSize
from phaselead.gap.generic_model import FOLDS, columns_of, moments_of
from phaselead.gap.goodness_of_fit import excused_um2, more_than_equations_miss
from phaselead.gap.posterior.equation_misfit import MOST_MISSED
from phaselead.gap.records import GapRun
from phaselead.gap.residual import RunResidual
from phaselead.gap.unexplained import Unexplained, unexplained

RATE_Hz = 1000.0


def run(u, error_um, role="train", t0=0.0, r_um=None):
    """A record whose whole position is what the model leaves."""
    t = t0 + np.arange(len(u)) / RATE_Hz
    return RunResidual(GapRun("x", role, t, u, error_um, r_um, 0, len(u), "a.csv", {}, {}), error_um)


def part(system, seeds, noise_um=0.05, **drive):
    """Records of a system less its best straight line: what is left by a model without dynamics or memory."""
    found = []
    for seed in seeds:
        u = outsiders.noisy(2.0, RATE_Hz, **{"band": (0.5, 150.0), **drive}, seed=seed)
        x = system(u, 1 / RATE_Hz) + np.random.default_rng(100 + seed).normal(0, noise_um, len(u))
        found.append(run(u, x - np.polyval(np.polyfit(u, x, 1), u)))
    return found


def wandering(seeds, size_um=1.0):
    """Records whose residual has nothing to do with the voltage: noise with a memory of 0.1 s."""
    found = []
    for seed in seeds:
        rng = np.random.default_rng(500 + seed)
        u = outsiders.noisy(2.0, RATE_Hz, (0.5, 150.0), seed)
        found.append(run(u, size_um * lfilter([0.1], [1, -0.99], rng.normal(size=len(u)))))
    return found


def scaled(residuals, um=1.0, volts=1.0, volts_at_0=0.0):
    """The same in other units, or with the sensor or the amplifier turned round."""
    return [run(volts * r.run.u_V + volts_at_0, um * r.error_um) for r in residuals]


@pytest.mark.parametrize(
    "system",
    [outsiders.mode, outsiders.upside_down, outsiders.hardening, outsiders.gear, outsiders.tank],
    ids=lambda system: system.__name__,
)
def test_what_follows_the_voltage_by_whatever_law_is_not_nothing(system):
    train, held = part(system, range(3)), part(system, range(3, 5))
    assert unexplained(train, held).something_missing


@pytest.mark.parametrize("system", [outsiders.mode, outsiders.gear])
def test_slow_records_show_it_as_well(system):
    train, held = part(system, range(3), band=(0.5, 8.0)), part(system, range(3, 5), band=(0.5, 8.0))
    assert unexplained(train, held).something_missing


def test_noise_that_has_nothing_to_do_with_the_voltage_is_nothing():
    found = [unexplained(wandering(range(i, i + 3)), wandering(range(i + 3, i + 5))) for i in range(0, 50, 5)]
    assert not any(one.something_missing for one in found)


def test_a_record_that_is_still_says_nothing():
    idle = [run(np.zeros(2000), np.random.default_rng(9).normal(0, 0.1, 2000))]
    train, held = part(outsiders.mode, range(3)), part(outsiders.mode, range(3, 5))
    with_idle = unexplained([*train, *idle], [*held, *idle])
    assert with_idle.something_missing
    assert unexplained(train, idle) == Unexplained(0.0, 0.0)


@settings(max_examples=5, deadline=None)
@given(
    um=st.sampled_from([-1.0, 1e-6, 1e3]),
    volts=st.sampled_from([-1.0, 0.1, 1e3]),
    at_0=st.sampled_from([0.0, 5.0]),
    turned=st.booleans(),
)
def test_units_signs_zeros_and_order_change_nothing(um, volts, at_0, turned):
    train, held = part(outsiders.gear, range(4)), part(outsiders.gear, range(4, 6))
    expected = unexplained(train, held)
    found = unexplained(
        scaled(train, um, volts, at_0)[:: -1 if turned else 1], scaled(held, um, volts, at_0)[:: -1 if turned else 1]
    )
    assert found.share == pytest.approx(expected.share, abs=0.02)
    assert found.something_missing


def test_what_reference_records_show_too_is_known_and_what_is_new_is_not():
    reference, train, held = (part(outsiders.gear, seeds) for seeds in (range(3), range(3, 6), range(6, 8)))
    assert unexplained(train, held).something_missing
    assert not unexplained(train, held, reference).something_missing
    mode_as_well = [
        run(r.run.u_V, r.error_um + 0.3 * more.error_um)
        for part_of, seeds in ((train, range(3, 6)), (held, range(6, 8)))
        for r, more in zip(part_of, part(outsiders.mode, seeds), strict=True)
    ]
    assert unexplained(mode_as_well[:3], mode_as_well[3:], reference).something_missing


def test_the_noise_that_a_controller_feeds_back_is_not_predicted_by_its_voltage():
    found = []
    for seed in range(5):
        r = 10 * outsiders.noisy(2.0, RATE_Hz, (0.5, 20.0), seed)
        noise = lfilter([0.1], [1, -0.99], np.random.default_rng(seed).normal(size=len(r)))
        found.append(run(r / 20 - 0.5 * noise, noise, r_um=r))
    assert not unexplained(found[:3], found[3:]).something_missing
    blind = [run(one.run.u_V, one.error_um) for one in found]
    assert unexplained(blind[:3], blind[3:]).something_missing


def test_no_more_than_all_is_told_of():
    """What the reference shows is the other way round in the records: taken out of them it alone hides what is new."""
    reference, train, held = (part(outsiders.gear, seeds) for seeds in (range(3), range(3, 6), range(6, 8)))
    other_way = [[run(r.run.u_V, -r.error_um) for r in records] for records in (train, held)]
    found = unexplained(*other_way, reference)
    assert found.something_missing
    assert found.share <= 1
    all_of_it = Unexplained(1.0, 0.1)
    assert all_of_it.sentence(named=True) == (
        "from the voltage a generic model predicts 100 % of what the names leave (chance alone: up to 10 %)"
    )
    assert "of what the model leaves (" in all_of_it.sentence(named=False)


def test_what_is_new_beside_much_that_references_show_is_missing_in_short_records_too():
    """Against these alone chance does little, against nothing it does much: each by itself, not the worst of both."""
    reference = part(outsiders.gear, range(3))
    train, held = (
        [
            run(r.run.u_V, r.error_um + 0.15 * more.error_um)
            for r, more in zip(part(outsiders.gear, seeds), part(outsiders.mode, seeds), strict=True)
        ]
        for seeds in (range(3, 6), range(6, 7))
    )
    short = [run(r.run.u_V[:1000], r.error_um[:1000]) for r in held]
    assert unexplained(train, short, reference).something_missing


def test_to_mend_what_other_records_show_predicts_nothing():
    """Held-out records of noise alone: that they do not show what the references do was taken for something new."""
    reference, train = (part(outsiders.gear, seeds) for seeds in (range(3), range(3, 6)))
    more = [run(r.run.u_V, 1.5 * r.error_um) for r in reference]
    found = unexplained(train, wandering(range(6, 8), size_um=0.1), more)
    assert not found.something_missing
    assert found.share < 0


@pytest.mark.parametrize(("more", "too_little"), [(0.9, False), (1.1, True)])
def test_names_are_not_vouched_for_where_more_is_left_than_their_equations_may_miss(more, too_little):
    """Of what a voltage predicts: noise beside it, however much, is no fault of a name."""
    gap_um, noise_um, predictable_um = 1.0, 0.8, more * MOST_MISSED
    after_um = np.hypot(noise_um, predictable_um)
    left = Unexplained((predictable_um / after_um) ** 2, 1e-4)
    gap = GapSize(gap_um, float(after_um), 0.1)
    assert more_than_equations_miss(left, gap, (MOST_MISSED * gap_um) ** 2) == too_little


@pytest.mark.parametrize(
    ("explained", "exactly", "beyond"),
    [(0.95, 0.0, False), (0.05, 0.0, True), (0.95, 0.3, False), (0.95, 0.9, True)],
)
def test_a_name_excuses_a_tenth_of_what_it_explains_not_of_the_gap(explained, exactly, beyond):
    """Of the power before 5 % can be predicted beside the name: little where it explains the rest, much where it does
    not, or where its equation is exact."""
    after_um = float(np.sqrt(1 - explained))
    left = Unexplained(min(0.05 / after_um**2, 1.0), 1e-4)
    gap = GapSize(1.0, after_um, 0.1)
    assert more_than_equations_miss(left, gap, excused_um2(gap, exactly)) == beyond


def test_what_may_be_chance_withdraws_no_name():
    assert not more_than_equations_miss(Unexplained(0.5, 0.6), GapSize(1.0, 1.0, 0.1), MOST_MISSED**2)


@pytest.mark.parametrize(("count", "whole"), [(3, False), (4, True), (9, True)])
def test_a_column_is_believed_when_it_predicts_other_records(count, whole):
    """A part of a record is told by the rest of it, also by columns that mislead in any other: a mode beside loops that
    a model had a little wrong was called nothing."""
    runs = part(outsiders.mode, range(count))
    columns = columns_of([r.run for r in runs])
    found = moments_of(columns, [r.run for r in runs], [r.error_um for r in runs])
    each = [moments_of(columns, [r.run], [r.error_um]).power.sum() for r in runs]
    by_record = [sum(each[fold::FOLDS]) for fold in range(FOLDS)]
    assert found.power.sum() == pytest.approx(sum(each))
    assert (found.power == pytest.approx(by_record)) is whole


@pytest.mark.parametrize("times", [0.2, 1.0, 5.0])
def test_without_references_what_was_learned_may_be_of_another_size(times):
    """A loop grows with the square of its level: what was learned from small ones is of the shape of large ones."""
    train, holdout = part(outsiders.mode, (1, 2, 3)), scaled(part(outsiders.mode, (4, 5)), um=times)
    holdout = [run(r.run.u_V / times, r.error_um) for r in holdout]
    assert unexplained(train, holdout, of_any_size=True).something_missing
    assert unexplained(train, holdout).something_missing == (times == 1.0)
    turned_round = [run(r.run.u_V, -r.error_um) for r in holdout]
    assert not unexplained(train, turned_round, of_any_size=True).something_missing
