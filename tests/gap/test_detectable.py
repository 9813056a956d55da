"""The size from which an effect is expected to be named: laws over noise, excitation, rivals, and what is hidden."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace as Made

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_gap_laws import HIDDEN, parts
from test_posterior_likelihood import Toy

from phaselead.gap.findings import Bound, Detectable
from phaselead.gap.posterior.detectable import MOST_STATED, TRIED, _Expected, _least, detectable
from phaselead.gap.posterior.equation_misfit import MOST_MISSED, SHARES
from phaselead.gap.posterior.priors import KNOWN_BEFORE, SIZES
from phaselead.gap.posterior.shapes import Products, Shapes
from phaselead.gap.posterior.starts import at_all_sizes
from phaselead.gap.regressors import regressor_groups, typical_sizes
from phaselead.gap.run import run_gap
from phaselead.identify import fit
from phaselead.model import catalogue
from phaselead.report.gap import bound_row

LAGS = ("amplifier_lowpass", "delay", "sensor_lowpass")
KEPT = (*LAGS, "gain_change", "slew_limit")


@cache
def sizes(hidden: str = "", noise_um: float = 0.01, kept: tuple[str, ...] = KEPT) -> dict[str, float]:
    """What is stated for records that hide an effect, or none."""
    records = parts({hidden: HIDDEN[hidden]} if hidden else {}, noise_um=noise_um)
    reference, train, holdout = records
    left_out = [name for name in catalogue() if name not in kept]
    found = run_gap(fit(reference)[0], train, holdout, reference, without=left_out)
    return {one.name: one.size for one in found.detectable}


def test_what_the_records_hide_does_not_change_what_is_stated():
    """Only how the base's plays are taken to stand when a record begins is found from the record."""
    stated = sizes("")
    for hidden in ("delay", "gain_change"):
        assert sizes(hidden) == pytest.approx(stated, rel=0.3)


def test_more_noise_asks_for_more():
    quiet, loud = sizes(), sizes(noise_um=0.3)
    assert all(loud.get(name, np.inf) > quiet[name] for name in LAGS)  # what is beyond all sizes is not stated


@pytest.mark.parametrize("name", LAGS)
def test_a_lag_must_be_larger_to_be_told_from_other_lags_than_from_nothing(name):
    assert sizes()[name] > 1.5 * sizes(kept=(name,))[name]


def test_an_effect_with_no_rival_in_the_catalogue_is_told_from_nothing():
    """A larger catalogue asks for little more."""
    assert sizes()["gain_change"] == pytest.approx(sizes(kept=("gain_change",))["gain_change"], rel=0.25)


def test_a_rate_limit_is_stated_though_its_typical_size_may_show_nothing():
    quiet, loud = (found["slew_limit"] for found in (sizes(), sizes(noise_um=0.3)))
    (typical,) = typical_sizes(catalogue()["slew_limit"])
    assert 0 < quiet < loud < typical


def test_effects_that_are_not_linear_in_their_sizes_are_begun_at_all_usual_ones():
    """A rate limit shows nothing below the rates of a record, whatever its shape."""
    effects = [catalogue()["slew_limit"], catalogue()["delay"], catalogue()["gain_change"]]
    begun: dict[str, set[float]] = {}
    for group in at_all_sizes(regressor_groups(effects, 2e-4, 1.0)):
        typical = typical_sizes(group.effect)[0]
        begun.setdefault(group.effect.name, set()).add(group.steps[0] / typical)
    assert begun["gain_change"] == {1.0}
    for nonlinear in ("slew_limit", "delay"):
        assert sorted(begun[nonlinear]) == pytest.approx([*sorted(SIZES), KNOWN_BEFORE])


def test_a_size_that_is_never_near_enough_is_stated_as_far_as_it_was_followed():
    """What is needed stays half as much again as what was simulated."""
    found = _Expected._told(lambda times: 1.5 * times, 1.0, 0.0)
    assert 1 < found < MOST_STATED
    assert _Expected._told(lambda times: np.inf, 1.0, 0.0) == np.inf


@given(st.integers(0, len(TRIED) - 1))
def test_the_first_size_at_which_something_is_told_is_found_among_all_that_are_tried(first):
    assert _least(lambda times: times >= TRIED[first]) == TRIED[first]


def test_the_least_size_is_one_at_which_something_is_told():
    """Also where it is told at a few sizes and then at none for a while."""
    told = {TRIED[25], *TRIED[200:]}
    assert _least(lambda times: np.array([one in told for one in times])) in told


def test_what_is_told_nowhere_has_no_first_size():
    assert _least(lambda times: times < 0) == np.inf


@given(st.integers(1, 6), st.integers(0, 999))
def test_products_of_columns_are_those_of_their_parts(k, seed):
    """Of any columns, beside themselves, others and the shared ones."""
    likelihood = Toy(1).likelihood
    rng = np.random.default_rng(seed)
    shared = [rng.normal(size=(run.edges[-1], 3)) for run in likelihood.runs]
    drawn = [rng.normal(size=(run.edges[-1], k)) for run in likelihood.runs]
    products = Products(replace(likelihood, shared=tuple(shared)), Shapes((), ()))
    all_at_once = products.added([np.concatenate(pair, axis=1) for pair in zip(shared, drawn, strict=True)])
    apart = products.added(drawn)
    np.testing.assert_allclose(apart.own, all_at_once.own[:, 3:, 3:])
    np.testing.assert_allclose(apart.beside_shared, all_at_once.own[:, :3, 3:])
    one, other = apart.one(0), products.added(shared)
    np.testing.assert_allclose(products.across(other, one), all_at_once.own[:, :3, 3:4])
    assert products.across(one, one) is one.own


def test_what_is_told_at_no_size_is_left_out(monkeypatch):
    monkeypatch.setattr(_Expected, "__init__", lambda *_: None)
    monkeypatch.setattr(_Expected, "size", lambda *_: np.inf)
    shapes = Shapes(regressor_groups([catalogue()["delay"]], 2e-4, 1.0), ())
    assert detectable(None, shapes, 1.0) == {}


def expecting(products):
    """Of columns that stand for no effect of a catalogue."""
    expected = _Expected.__new__(_Expected)
    expected._products, expected._likelihood, expected._of_material = products, products.likelihood, False
    expected._last = None
    return expected


def test_beyond_its_range_an_effect_is_taken_to_grow_from_its_end():
    """A linear one shows as much for one typical size however large it was asked for."""
    run = Toy(1).likelihood.runs[1]
    (group,) = regressor_groups([catalogue()["delay"]], 1e-3, 1.0)
    size = group.effect.sizes[0]
    column = run.coefficients(run.modelled.columns["delay"][:, None] * group.steps[0] / size.typical)
    likelihood = Made(runs=[run], shared=[np.zeros((len(column), 0))])
    expected = expecting(Products(likelihood, Shapes([group], [column])))
    end = size.high / group.steps[0]
    for times in (0.5 * end, end, 20 * end):
        (simulated,) = expected._simulated("delay", 0, times).of_runs
        np.testing.assert_allclose(simulated, column, rtol=1e-6)


@pytest.mark.parametrize("references", [1, 2, 5])
@pytest.mark.parametrize("seed", range(4))
def test_it_is_told_however_much_of_it_the_base_may_lack_in_all_records(references, seed):
    """Records are outliers at most, those that have it or those that have it not, and may be few of either."""
    toy = Toy(seed, roles=(*["reference"] * references, "train", "train", "train", "holdout"))
    runs, base = toy.likelihood.runs, toy.likelihood.base
    v, counted = toy.likelihood.noise + base, toy.likelihood.counted_beside
    everywhere = [run.coefficients(run.modelled.columns["gain_change"][:, None]) for run in runs]
    column = [one * run.changed for run, one in zip(runs, everywhere, strict=True)]
    products, asked = Products(toy.likelihood, Shapes((), ())), 12.0
    found = expecting(products)._times(products.added(column), [products.added(everywhere)], [1e3], asked)

    def powers(columns):
        return [run.products(one, one)[:, 0, 0] for run, one in zip(runs, columns, strict=True)]

    def odds(times, lacks):
        past = np.concatenate(powers([a - lacks * b for a, b in zip(column, everywhere, strict=True)]))
        signal = np.concatenate([run.spread(one) for run, one in zip(runs, powers(column), strict=True)])
        n = counted(base + (MOST_MISSED * times) ** 2 * signal)
        return 0.5 * (n * np.log1p(times**2 * past / (v + (SHARES[0] * times) ** 2 * signal))).sum()

    least = min(odds(found, lacks) for lacks in np.linspace(-0.5, 1.5, 201))
    assert least > 0.7 * asked
    assert min(odds(0.9 * found, lacks) for lacks in (*np.linspace(0, 1, 11), 1.0)) < asked


@pytest.mark.parametrize(
    ("name", "stated", "said"),
    [
        ("delay", "delay", "0.3"),
        ("delay", "gain_change", "beyond 10 typical sizes, if at all"),
        ("delay", None, ""),
        ("offset", "delay", ""),
        ("thermal_drift", "delay", "beyond 10 typical sizes, if at all"),
    ],
)
def test_a_report_says_where_no_size_is_stated(name, stated, said):
    """Not of what no voltage predicts, nor where nothing was stated at all."""
    detectable = () if stated is None else (Detectable(stated, 0.0003, "s"),)
    unit = catalogue()[name].sizes[0].unit
    assert bound_row(Bound(name, 0.0004, unit), Made(detectable=detectable))["named_from"] == said
