"""Laws of the intervals of parameters that are taken from a covariance."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from phaselead.gap.error_rates import SURE, TWO_SIDED_95
from phaselead.gap.parameters import internal, internal_unit, is_logarithmic, parameters_of
from phaselead.gap.posterior.interval import intervals, shows_itself
from phaselead.model.effects import effect

SETS = (("softening",), ("rate_dependence",), ("delay", "softening"), ("resonance", "creep", "gain_change"))


@st.composite
def fitted(draw):
    """A set of effects about its typical values and a covariance of its parameters."""
    entries = []
    for name in draw(st.sampled_from(SETS)):
        params = {p.name: p.typical or (p.low + p.high) / 2 for p in effect(name).parameters}
        entries.append((effect(name), params))
    size = len(parameters_of(entries))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    spread = 10 ** rng.uniform(-2, 1, size=size)
    root = rng.normal(size=(size, 2 * size)) + draw(st.floats(0, 3)) * rng.normal(size=(1, 2 * size))
    return entries, spread[:, None] * (root @ root.T / (2 * size)) * spread


def at_given_shapes(entries, covariance, k):
    """Deviation of one size where the shapes of its effect are known, straight from the conditional distribution."""
    of = parameters_of(entries)
    shapes = [j for j, (i, p) in enumerate(of) if i == of[k][0] and p.role != "size"]
    if not shapes:
        return np.sqrt(covariance[k, k])
    to_shapes = np.linalg.solve(covariance[np.ix_(shapes, shapes)], covariance[shapes, k])
    return np.sqrt(covariance[k, k] - covariance[k, shapes] @ to_shapes)


@given(fitted())
def test_a_size_is_clear_of_nothing_where_it_is_at_its_shapes(case):
    """An effect of no size has no shape, so that what the shapes might be does not bring it to nothing."""
    entries, covariance = case
    at = internal(entries)
    for k, (i, p) in enumerate(parameters_of(entries)):
        value, unit, (low, high) = intervals(entries, covariance)[i][p.name]
        assert (value, unit) == (entries[i][1][p.name], p.unit)
        assert low <= value <= high
        if p.role != "size" or is_logarithmic(p):
            continue
        told = abs(at[k]) / (TWO_SIDED_95 * at_given_shapes(entries, covariance, k))
        if abs(told - 1) > 1e-6:
            assert (low > 0 or high < 0) == (told > 1)


@given(fitted())
def test_only_next_to_nothing_is_an_interval_cut_short(case):
    entries, covariance = case
    for k, (i, p) in enumerate(parameters_of(entries)):
        if is_logarithmic(p):
            continue
        value, _, (low, high) = intervals(entries, covariance)[i][p.name]
        half = TWO_SIDED_95 * np.sqrt(covariance[k, k]) * internal_unit(p)
        upper, lower = min(value + half, p.high), max(value - half, p.low)
        assert high - low >= 0.4 * (upper - lower) - 1e-12
        assert max(abs(high), abs(low)) >= min(abs(upper), abs(p.high)) * (1 - 1e-9)


def test_what_is_sure_of_its_sign_whatever_its_shape_bears_its_name():
    softening = effect("softening")
    params = {p.name: p.typical for p in softening.parameters}
    (size,) = (k for k, p in enumerate(softening.parameters) if p.role == "size")
    (shape,) = (k for k, p in enumerate(softening.parameters) if p.name == "exponent")
    covariance = np.diag(np.full(len(params), 0.01))
    covariance[size, size], covariance[shape, shape] = 0.5, 1.0
    for correlation, named in ((0.0, False), (0.99, True)):
        covariance[size, shape] = covariance[shape, size] = correlation * np.sqrt(0.5)
        assert shows_itself([(softening, params)], covariance) == [named]


@given(fitted(), st.floats(-0.5, 0.5))
def test_an_effect_of_one_size_shows_itself_where_that_is_surely_not_0(case, moved):
    """And has then an interval clear of nothing."""
    entries, covariance = case
    chosen = [(effect, {p.name: params[p.name] * (1 + moved) for p in effect.parameters}) for effect, params in entries]
    values, of = intervals(entries, covariance, chosen), parameters_of(entries)
    at, middle = internal(chosen), internal(entries)
    for i, (one, shown) in enumerate(zip(values, shows_itself(entries, covariance, chosen), strict=True)):
        sizes = [k for k, (j, p) in enumerate(of) if j == i and p.role == "size" and not p.by_itself]
        if len(sizes) != 1:
            continue
        (k,) = sizes
        least = np.sqrt(chi2.ppf(SURE, 1)) * at_given_shapes(entries, covariance, k) + abs(at[k] - middle[k])
        assert shown == (abs(at[k]) > least) or abs(at[k] / least - 1) < 1e-6
        if shown:
            _, _, (low, high) = one[of[k][1].name]
            assert low > 0 or high < 0


def friction(growth, stribeck, coulomb):
    """``rate_dependence`` alone, of these sizes in internal units."""
    entry = effect("rate_dependence")
    sizes = {"growth": growth, "stribeck": stribeck, "coulomb": coulomb}
    params = {p.name: sizes[p.name] * internal_unit(p) if p.name in sizes else p.typical for p in entry.parameters}
    return [(entry, params)]


@pytest.mark.parametrize(
    ("sizes", "named"), [((2.9, 0, 0), False), ((3.2, 0, 0), True), ((-3.2, 0, 0), True), ((0.5, 0, 9.0), False)]
)
def test_friction_that_is_the_same_at_every_rate_names_no_rate_dependence(sizes, named):
    entries = friction(*sizes)
    assert shows_itself(entries, np.eye(len(parameters_of(entries)))) == [named]


def test_sizes_that_cannot_be_told_from_each_other_are_asked_together():
    """A bow and an S, each known to 1.4 or less, their sum to a tenth of that: each may be 0, both cannot."""
    bent = effect("sensor_nonlinearity")
    params = {p.name: internal_unit(p) * (p.name in ("quadratic", "cubic")) for p in bent.parameters}
    for noise, shown in ((0.1, True), (1.0, False)):
        covariance = np.eye(4)
        covariance[:2, :2] = [[1 + noise**2, -1], [-1, 1 + noise**2]]
        (found,) = intervals([(bent, params)], covariance)
        assert all(low <= 0 <= high for _, _, (low, high) in found.values())
        assert shows_itself([(bent, params)], covariance) == [shown]


def test_the_slope_of_a_sensors_curve_alone_names_no_bend():
    """It is a change of gain."""
    bent = effect("sensor_nonlinearity")
    for name, shown in (("linear", False), ("cubic", True)):
        params = {p.name: 9.0 * internal_unit(p) * (p.name == name) for p in bent.parameters}
        assert shows_itself([(bent, params)], np.eye(4)) == [shown]


def test_two_ways_to_weigh_the_records_may_differ_in_another_size():
    """Between 10 and 10, and between -9 and 0: wherever between, or as far on the other side, 0 is far away."""
    bent = effect("sensor_nonlinearity")

    def of(*sizes):
        return [(bent, {p.name: x * internal_unit(p) for p, x in zip(bent.parameters, sizes, strict=True)})]

    assert shows_itself(of(10, -9, 0, 0), np.eye(4), of(10, 0, 0, 0)) == [True]
    assert shows_itself(of(1, -9, 0, 0), np.eye(4), of(1, 0, 0, 0)) == [False]
    assert shows_itself(of(10, -9, 0, 0), np.eye(4), of(1, 0, 0, 0)) == [False]


def test_of_sizes_that_are_nothing_one_in_a_hundred_shows_itself():
    bent, rng, draws = effect("sensor_nonlinearity"), np.random.default_rng(0), 2000
    root = rng.normal(size=(4, 4))
    found = 0
    for at in rng.normal(size=(draws, 4)) @ root.T:
        params = {p.name: 0.01 * internal_unit(p) * x for p, x in zip(bent.parameters, at, strict=True)}
        found += shows_itself([(bent, params)], 1e-4 * root @ root.T)[0]
    assert abs(found / draws - 0.01) < 3 * np.sqrt(0.01 * 0.99 / draws)


@pytest.mark.parametrize("away", [0.0, 0.3, 3.0])
def test_two_ways_to_weigh_the_records_may_both_be_right(away):
    late = effect("delay")
    (p,) = late.parameters
    (found,) = intervals([(late, {p.name: p.typical})], np.array([[1e-6]]), [(late, {p.name: (1 + away) * p.typical})])
    _, _, (low, high) = found[p.name]
    assert low <= p.typical * (1 + 1e-3)
    assert high >= (1 + away) * p.typical
