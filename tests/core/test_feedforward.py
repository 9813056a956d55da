"""Tables against the polynomials they were made from, in rationals."""

import itertools
from fractions import Fraction

import numpy as np
import pytest
from core_bindings import (
    INT32_MAX,
    INT32_MIN,
    INT64_MAX,
    INT64_MIN,
    FeedforwardModel,
    FeedforwardTables,
    Point,
    Verdict,
    any_i32,
    any_i64,
    real,
    round_half_up,
    saturate,
)
from hypothesis import assume, example, given
from hypothesis import strategies as st

A = (15.2536, 1.9619, -0.1013)  # Xu & Li 2010, Table I, x axis
B_DEG = (1.9238, 0.7477, 0.0456, 0.0047, -0.0466, 0.0003)


def model_of(a=A, b_deg=B_DEG, swing_V=(0.5, 10), f_Hz=(1, 20)):
    limits = [round(v * 2**24) for v in swing_V] + [round(f * 2**16) for f in f_Hz]
    return FeedforwardModel(tuple(round(v * 2**32) for v in a), tuple(round(v / 360 * 2**40) for v in b_deg), *limits)


def expanded(core, model):
    tables = FeedforwardTables()
    return core.feedforward_expand(model, tables), tables


def a_of(model):
    return [Fraction(c, 2**32) for c in model.a_q32]


def gain(model, u):
    a = a_of(model)
    return a[0] + a[1] * u + a[2] * u * u


def rise(model, u):
    a = a_of(model)
    return a[0] + 2 * a[1] * u + 3 * a[2] * u * u


def lead(model, u, f):
    b = [Fraction(c, 2**40) for c in model.b_q40]
    return b[0] + b[1] * u + b[2] * f + b[3] * u * f + b[4] * u * u + b[5] * f * f


def extremes(c, low, high):
    """Of c0 + c1 u + c2 u^2 on [low, high], exactly."""
    places = [low, high]
    if c[2] != 0 and low < -c[1] / (2 * c[2]) < high:
        places.append(-c[1] / (2 * c[2]))
    values = [c[0] + c[1] * u + c[2] * u * u for u in places]
    return min(values), max(values)


def rise_extremes(model):
    a = a_of(model)
    return extremes(
        (a[0], 2 * a[1], 3 * a[2]), Fraction(model.swing_min_q24, 2**24), Fraction(model.swing_max_q24, 2**24)
    )


@st.composite
def stages(draw):
    """Models of stages from stiff to soft, anything a piezo could be and some that none is."""
    swing = sorted((draw(real(0, 20)), draw(real(0.1, 40))))
    assume(swing[1] - swing[0] > 0.01)
    f = sorted((draw(real(0, 50)), draw(real(0.1, 500))))
    assume(f[1] - f[0] > 0.01)
    k = draw(real(0.05, 200))
    a = (k, draw(real(-0.1, 0.3)) * k, draw(real(-0.03, 0.03)) * k)
    b = [draw(real(-s, s)) for s in (20, 5, 0.5, 0.05, 0.2, 0.001)]
    return model_of(a, b, swing, f)


@pytest.fixture(scope="module")
def table_one(core):
    verdict, tables = expanded(core, model_of())
    assert verdict == Verdict.OK
    return tables


def test_table_one_gives_the_papers_ranges(table_one):
    """112.65 um at 5 V, which the paper's 4.7 % = 5.31 um implies; about 250 um of travel at 10 V."""
    assert table_one.range_max_q16 / 65536 == pytest.approx(10 * (15.2536 + 19.619 - 10.13), abs=1e-4)
    assert table_one.range_min_q16 / 65536 == pytest.approx(0.5 * (15.2536 + 0.98095 - 0.025325), abs=1e-4)


@pytest.mark.parametrize("swing_V", [0.5, 1, 3, 5, 8, 10])
def test_table_one_static_voltage(core, table_one, swing_V):
    range_um = swing_V * (A[0] + A[1] * swing_V + A[2] * swing_V**2)
    u_V = core.feedforward_static_q24(table_one, round(range_um * 65536)) / 2**24
    assert u_V == pytest.approx(swing_V, abs=1.5e-3)


@pytest.mark.parametrize(
    ("range_um", "f_Hz", "swing_V", "lead_deg"),
    [(60, 5, 2.971856, 4.039627), (112.653, 5, 5.0, 4.8503), (112.653, 15, 5.0, 5.6013)],
)
def test_table_one_points(core, table_one, range_um, f_Hz, swing_V, lead_deg):
    """Solved by hand from eqs. 6-7: 60 um at 5 Hz takes 2.97 V, seen 4.04 degrees early."""
    point = Point()
    assert core.feedforward_lookup(table_one, round(range_um * 65536), f_Hz << 16, point)
    assert point.inverse_gain_q28 / 2**28 == pytest.approx(swing_V / range_um, rel=1e-4)
    assert point.lead_turn32 / 2**32 * 360 == pytest.approx(lead_deg, abs=1e-3)


@given(real(0.5, 10), real(1, 20))
def test_table_one_everywhere(core, table_one, swing_V, f_Hz):
    model, u, f_q16 = model_of(), Fraction(swing_V), round(f_Hz * 2**16)
    range_q16 = round(gain(model, u) * u * 2**16)
    point = Point()
    assert core.feedforward_lookup(table_one, range_q16, f_q16, point)
    assert abs(point.inverse_gain_q28 / 2**28 * float(gain(model, u)) - 1) < 4e-4
    assert abs(point.lead_turn32 / 2**32 - float(lead(model, u, Fraction(f_q16, 2**16)))) * 360 < 0.002


@given(stages())
def test_verdict_is_that_of_the_exact_polynomials(core, model):
    """Not only at the nodes: K and its product with um are judged on the whole rectangle."""
    verdict, tables = expanded(core, model)
    low, high = Fraction(model.swing_min_q24, 2**24), Fraction(model.swing_max_q24, 2**24)
    least, largest = extremes(a_of(model), low, high)
    slightly = Fraction(1, 10**6)
    if least < Fraction(1, 8) - slightly or largest > 4096 or high * gain(model, high) > 32768:
        assert verdict == Verdict.GAIN_OUT_OF_RANGE
    elif least > Fraction(1, 8) + slightly and rise_extremes(model)[0] < -slightly:
        assert verdict == Verdict.NOT_MONOTONE
    elif least > Fraction(1, 8) + slightly and rise_extremes(model)[0] > slightly:
        largest_lead = largest_lead_turns(model, tables)
        assert (verdict == Verdict.OK) == (largest_lead < 0.5) or abs(largest_lead - 0.5) < slightly


def frequencies(model):
    low, high = Fraction(model.f_min_q16, 2**16), Fraction(model.f_max_q16, 2**16)
    return [low + (high - low) * j / 16 for j in range(17)]


def largest_lead_turns(model, tables):
    """Over all nodes, in float64."""
    b = np.array(model.b_q40) / 2**40
    u = np.array(tables.swing_q24)[:, None] / 2**24
    f = np.array([float(f) for f in frequencies(model)])
    return np.abs(b[0] + b[1] * u + b[2] * f + b[3] * u * f + b[4] * u * u + b[5] * f * f).max()


@given(stages())
@example(model_of())
def test_nodes_solve_the_range(core, model):
    """K(um) um = R at each node: to half an LSB of um, and at the ends to the rounding of R itself."""
    verdict, tables = expanded(core, model)
    assume(verdict == Verdict.OK)
    steepest = rise_extremes(model)[1]
    span = Fraction(tables.range_max_q16 - tables.range_min_q16, 2**16)
    for i, swing_q24 in enumerate(tables.swing_q24):
        u = Fraction(swing_q24, 2**24)
        wanted = Fraction(tables.range_min_q16, 2**16) + span * i / 64
        rounding = (u * (1 + u) + 1) / 2**32  # of K and of K um, twice
        bound = steepest / 2**25 + rounding + (Fraction(1, 2**17) if i in (0, 64) else 0)
        assert abs(gain(model, u) * u - wanted) <= bound
        of_gain = (2 + u) / 2**32 / gain(model, u) ** 2  # K itself is good to 1 LSB of q32 and one per volt
        assert (
            abs(tables.inverse_gain_q28[i] / Fraction(2**28) - 1 / gain(model, u))
            <= Fraction(51, 100) / 2**28 + of_gain
        )
    assert list(tables.swing_q24) == sorted(tables.swing_q24)


@given(stages())
@example(model_of())
def test_leads_at_nodes(core, model):
    verdict, tables = expanded(core, model)
    assume(verdict == Verdict.OK)
    for j, f in enumerate(frequencies(model)):
        f = Fraction(round_half_up(int(f * 2**32), 16), 2**16)
        for i in (0, 1, 31, 63, 64):
            u = Fraction(tables.swing_q24[i], 2**24)
            roundings_q40 = 1 + u + 2 * f  # of the sums, as volts and hertz magnify them
            bound = Fraction(51, 100) + roundings_q40 / 256
            assert abs(tables.lead_turn32[j][i] - lead(model, u, f) * 2**32) <= bound


@given(stages(), real(0, 1))
@example(model_of(), 0.0)
@example(model_of(), 1.0)
def test_static_voltage_gives_the_position(core, model, share):
    """Between nodes: within the error of linear interpolation, h^2/8 max|um''|, and an LSB."""
    verdict, tables = expanded(core, model)
    assume(verdict == Verdict.OK)
    least, steepest = rise_extremes(model)
    assume(least > Fraction(1, 100))
    h = Fraction(tables.range_max_q16 - tables.range_min_q16, 2**16) / 64
    a = a_of(model)
    bend = max(abs(2 * a[1] + 6 * a[2] * Fraction(u, 2**24)) for u in (model.swing_min_q24, model.swing_max_q24))
    of_first_node = Fraction(tables.range_min_q16, 2**21)  # 1/K in q28 is used up to there
    bound = steepest * (h * h / 8 * bend / least**3 + (3 + of_first_node) / 2**24) + Fraction(1, 2**16)
    position_q16 = tables.range_min_q16 + round(share * (tables.range_max_q16 - tables.range_min_q16))
    u = Fraction(core.feedforward_static_q24(tables, position_q16), 2**24)
    assert abs(gain(model, u) * u - Fraction(position_q16, 2**16)) <= bound


@given(stages(), st.lists(any_i32, min_size=2, max_size=20))
@example(model_of(), [INT32_MIN, INT32_MIN + 1, -1, 0, 1, INT32_MAX])
@example(model_of(swing_V=(1e-7, 5)), [0, 1])  # begins with a voltage but without a range
def test_static_voltage_is_odd_rising_and_clamped(core, model, positions):
    verdict, tables = expanded(core, model)
    assume(verdict == Verdict.OK)
    positions += [tables.range_min_q16 + d for d in (-1, 0, 1)] + [tables.range_max_q16 + d for d in (-1, 0)]
    volts = [core.feedforward_static_q24(tables, p) for p in sorted(positions)]
    last = tables.swing_q24[64]
    seam = 1 + tables.range_min_q16 / 2**21  # at the first node, from the rounding of 1/K in q28
    assert all(b - a >= -seam for a, b in itertools.pairwise(volts))
    assert all(-last <= u <= last for u in volts)
    for p in positions:
        if p != INT32_MIN:
            assert core.feedforward_static_q24(tables, -p) == -core.feedforward_static_q24(tables, p)
    assert core.feedforward_static_q24(tables, 0) == 0
    assert core.feedforward_static_q24(tables, INT32_MIN) == -last


beyond = st.sampled_from([-1, 0, 1])


@given(stages(), any_i32, any_i32, beyond, beyond)
def test_lookup_refuses_what_lies_outside(core, model, range_q16, f_q16, range_beyond, f_beyond):
    """Anywhere, and within an LSB of every edge and corner."""
    verdict, tables = expanded(core, model)
    assume(verdict == Verdict.OK)
    ranges = [range_q16, tables.range_min_q16 + range_beyond, tables.range_max_q16 + range_beyond]
    fs = [f_q16, tables.f_min_q16 + f_beyond, tables.f_max_q16 + f_beyond]
    for range_q16, f_q16 in itertools.product(ranges, fs):
        point = Point(7, 8)
        inside = tables.range_min_q16 <= range_q16 <= tables.range_max_q16
        inside = inside and model.f_min_q16 <= f_q16 <= model.f_max_q16
        assert core.feedforward_lookup(tables, range_q16, f_q16, point) == inside
        if not inside:
            assert (point.inverse_gain_q28, point.lead_turn32) == (7, 8)


POWERS_OF_TWO = model_of((16, 0, 0), B_DEG, (0, 8), (0, 16))
"""Widths whose inverse is exact, so that the far end falls on a node no interval follows."""


@given(stages(), real(0, 1), real(0, 1))
@example(POWERS_OF_TWO, 1.0, 1.0)
def test_lookup_interpolates_between_its_nodes(core, model, range_share, f_share):
    """Bilinear in the nodes, within 2 LSB; on the edges and corners too."""
    verdict, t = expanded(core, model)
    assume(verdict == Verdict.OK)
    range_q16 = t.range_min_q16 + round(range_share * (t.range_max_q16 - t.range_min_q16))
    f_q16 = t.f_min_q16 + round(f_share * (t.f_max_q16 - t.f_min_q16))
    point = Point()
    assert core.feedforward_lookup(t, range_q16, f_q16, point)
    x = Fraction(range_q16 - t.range_min_q16, t.range_max_q16 - t.range_min_q16) * 64
    y = Fraction(f_q16 - t.f_min_q16, t.f_max_q16 - t.f_min_q16) * 16
    i, j = min(int(x), 63), min(int(y), 15)

    def between(nodes):
        return nodes[i] + (nodes[i + 1] - nodes[i]) * (x - i)

    low, high = between(t.lead_turn32[j]), between(t.lead_turn32[j + 1])
    # node positions are good to 2^-26: far less than an LSB of what a node's step can be, but not of 2^32
    slack = 2 + Fraction(max(map(abs, t.lead_turn32[j])), 2**24)
    assert abs(point.inverse_gain_q28 - between(t.inverse_gain_q28)) <= 2 + Fraction(t.inverse_gain_q28[i], 2**24)
    assert abs(point.lead_turn32 - (low + (high - low) * (y - j))) <= slack


@given(any_i32, any_i32)
@example(INT32_MIN, INT32_MIN)
def test_step_is_position_over_gain(core, inverse_gain, position):
    expected = saturate(round_half_up(position * inverse_gain, 20))
    assert core.flagged("feedforward_step_q24", Point(inverse_gain, 0), position) == expected


@given(st.tuples(*[any_i64] * 3), st.tuples(*[any_i64] * 6), st.tuples(any_i32, any_i32, any_i32, any_i32))
@example((INT64_MIN,) * 3, (INT64_MIN,) * 6, (0, INT32_MAX, 0, INT32_MAX))
@example((INT64_MAX,) * 3, (INT64_MAX,) * 6, (0, INT32_MAX, 0, INT32_MAX))
@example((2**36, 0, 0), (INT64_MAX,) * 6, (0, 2**24, 0, INT32_MAX))
@example((2**36, 0, INT64_MIN), (0,) * 6, (0, 2**24, 0, INT32_MAX))
def test_any_coefficients_are_judged(core, a, b, rectangle):
    model = FeedforwardModel(a, b, *rectangle)
    verdict, tables = expanded(core, model)
    if verdict == Verdict.OK:
        assert min(tables.inverse_gain_q28) > 0
    if rectangle[0] >= rectangle[1] or rectangle[2] >= rectangle[3] or rectangle[0] < 0 or rectangle[2] < 0:
        assert verdict == Verdict.RECTANGLE_EMPTY


@given(st.tuples(*[any_i64] * 6), stages())
@example((0, 0, INT64_MAX, INT64_MAX, 0, INT64_MAX), model_of())
@example((0, 0, INT64_MIN, INT64_MIN, 0, INT64_MIN), model_of())
def test_any_lead_is_judged(core, b, model):
    """Coefficients whose sums leave 64 bits are refused, not wrapped."""
    model.b_q40 = b
    verdict, tables = expanded(core, model)
    if verdict == Verdict.OK:
        assert largest_lead_turns(model, tables) < 0.5 + 1e-6


@pytest.mark.parametrize(
    ("change", "verdict"),
    [
        ({"swing_V": (5, 5)}, Verdict.RECTANGLE_EMPTY),
        ({"swing_V": (-1, 5)}, Verdict.RECTANGLE_EMPTY),
        ({"f_Hz": (5, 5)}, Verdict.RECTANGLE_EMPTY),
        ({"f_Hz": (-1, 5)}, Verdict.RECTANGLE_EMPTY),
        ({"a": (-15, 0, 0)}, Verdict.GAIN_OUT_OF_RANGE),
        ({"a": (0.12, 0, 0)}, Verdict.GAIN_OUT_OF_RANGE),
        ({"a": (5000, 0, 0), "swing_V": (0.5, 1)}, Verdict.GAIN_OUT_OF_RANGE),
        ({"a": (4000, 0, 0)}, Verdict.GAIN_OUT_OF_RANGE),  # 40 mm of range
        ({"a": (15, 0, -0.06)}, Verdict.NOT_MONOTONE),  # falls at the end
        ({"a": (20, -7, 0.7)}, Verdict.NOT_MONOTONE),  # falls in the middle only, with K > 0 throughout
        ({"b_deg": (181, 0, 0, 0, 0, 0)}, Verdict.LEAD_OUT_OF_RANGE),
        ({"b_deg": (-181, 0, 0, 0, 0, 0)}, Verdict.LEAD_OUT_OF_RANGE),
        ({"b_deg": (0, 0, 10, 0, 0, 0)}, Verdict.LEAD_OUT_OF_RANGE),
        ({"b_deg": (179.9, 0, 0, 0, 0, 0)}, Verdict.OK),
        ({"b_deg": (-179.9, 0, 0, 0, 0, 0)}, Verdict.OK),
    ],
)
def test_verdicts(core, change, verdict):
    assert expanded(core, model_of(**change))[0] == verdict
