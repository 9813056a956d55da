"""A grid of sines tells where the thresholds of plays and dead zones are, between those of the fit's own grid."""

from __future__ import annotations

import numpy as np
import pytest

from phaselead.identify.modal.one_axis import FittedModes, fit_together
from phaselead.identify.operator import OperatorFit, place_operator
from phaselead.identify.operator.leaving_out import folds_of, left_out
from phaselead.identify.operator.placing import fewest_knots, paired_plays
from phaselead.identify.operator.regressors import Basis, nested_basis, rows_to_fit
from phaselead.identify.operator.solution import best_slopes, centred, moments
from phaselead.identify.runs import AxisRun
from phaselead.model import TimeView, behind_modes, predict_time_view

RATE_HZ, MODE = 5000.0, (1.0, 180.0, 0.02)
VIEW = TimeView(
    gain_um_per_V=10.0,
    play_r_V=(0.19, 0.55, 1.4),
    play_w_um_per_V=(2.0, 3.0, 1.0),
    deadzone_d_V=(2.5, 6.0),
    deadzone_s_um_per_V=(1.5, -2.0),
    delay_s=0.0003,
    rest_fraction=0.5,
    u_range_V=(0.0, 8.0),
    rate_Hz=RATE_HZ,
)


@pytest.fixture(scope="module")
def runs() -> list[AxisRun]:
    rng, found = np.random.default_rng(1), []
    for swing_V in (1.0, 2.0, 4.0, 6.0, 8.0):
        for f_Hz in (5.0, 13.0, 20.0):
            t_s = np.arange(round(4 / f_Hz * RATE_HZ)) / RATE_HZ
            u_V = swing_V / 2 * (1 - np.cos(2 * np.pi * f_Hz * t_s))
            x_um = behind_modes(predict_time_view(VIEW, t_s, u_V), (MODE,), 1 / RATE_HZ)
            x_um = x_um + 0.01 * rng.standard_normal(len(t_s))
            scored = slice(round(RATE_HZ / f_Hz), None)
            found.append(AxisRun(t_s, u_V, x_um, scored, "x", f"{swing_V:g}V-{f_Hz:g}Hz"))
    return found


@pytest.fixture(scope="module")
def fitted(runs: list[AxisRun]) -> tuple[OperatorFit, FittedModes | None]:
    return fit_together(runs)


def test_thresholds_are_where_they_are(fitted) -> None:
    view = fitted[0].view
    assert len(view.play_r_V) == 3
    assert view.play_r_V == pytest.approx(VIEW.play_r_V, rel=0.03)
    assert view.play_w_um_per_V == pytest.approx(VIEW.play_w_um_per_V, rel=0.05)
    d, s = np.array(view.deadzone_d_V), np.array(view.deadzone_s_um_per_V)
    assert s[d < 4].sum() == pytest.approx(1.5, rel=0.05)  # the grid of knots has no 2.5
    assert s[d == 6].sum() == pytest.approx(-2.0, rel=0.05)
    assert len(d) <= 5


def test_the_mode_is_fitted_with_them(fitted) -> None:
    """Alone, the operator bent its loop for what the mode adds at 20 Hz, 1.2 %: 1 um of 85."""
    operator, mode = fitted
    assert mode is not None
    assert mode.modes[0] == pytest.approx(MODE, rel=0.05)
    assert operator.view.delay_s == pytest.approx(VIEW.delay_s, abs=1e-5)
    assert operator.view.residual_um_rms < 0.04  # 0.3 without
    assert operator.choices[-1].chosen
    assert sum(choice.chosen for choice in operator.choices) == 1


def test_sines_of_one_frequency_stay_as_they_are(runs: list[AxisRun], fitted) -> None:
    slow = [run for run in runs if run.source.endswith("-5Hz")]
    assert place_operator(slow, fitted[0], ()) is fitted[0]


def test_two_neighbours_are_one_play_between_them() -> None:
    basis = Basis(np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6]), np.array([0.0, 8.0]))
    plays = paired_plays(basis, np.array([10.0, 0.0, 3.0, 1.0, 0.0, 0.0, 2.0]))
    assert plays.play_r_V.tolist() == pytest.approx([0.225, 0.6])
    three = paired_plays(basis, np.array([10.0, 0.0, 1.0, 1.0, 2.0, 0.0, 0.0]))
    assert three.play_r_V.tolist() == pytest.approx([0.25, 0.4])


def test_plays_without_weight_are_none_also_beside_fading_ones() -> None:
    """Pairs of plays without weight have no place between them: a fit of two axes ended in a division by zero."""
    basis = Basis(np.array([0.1, 0.2, 0.3, 0.4]), np.array([0.0, 8.0]), np.array([0.5]))
    plays = paired_plays(basis, np.array([10.0, 0.0, 0.0, 3.0, 1.0, 2.0]))
    assert plays.play_r_V.tolist() == pytest.approx([0.325])
    assert plays.fading_r_V.tolist() == [0.5]


def test_knots_that_nobody_misses_are_dropped(runs: list[AxisRun]) -> None:
    still = [
        AxisRun(r.t_s, r.u_V, predict_time_view(VIEW, r.t_s, r.u_V), r.scored, "x", r.source) for r in runs
    ]  # without mode and noise
    fits = [rows_to_fit(run, 400, i, 1) for i, run in enumerate(still)]
    basis = Basis(np.array(VIEW.play_r_V), nested_basis(8.0, 0.0, 8.0, 0, 16).knots_V)
    of_groups = centred(moments(fits, basis, VIEW.delay_s, VIEW.rest_fraction))
    chosen, choice = fewest_knots(basis, of_groups, folds_of(fits))
    assert chosen.knots_V.tolist() == [0.0, 2.5, 6.0, 8.0]
    again = centred(moments(fits, chosen, VIEW.delay_s, VIEW.rest_fraction))
    # Nothing is left of records without noise but the root of what rounding leaves of their squares.
    assert left_out(again, chosen.n_segments, folds_of(fits)) == pytest.approx(choice.left_out, abs=1e-7)
    assert best_slopes(fits, chosen, VIEW.delay_s, VIEW.rest_fraction, False).error < 1e-6


# One after the other the records are six folds: the seventh is in that of the first.
BEYOND_OTHERS = [
    ([(0, 8), (0, 7), (0, 6), (0, 7)], {0}),
    ([(0, 7), (0, 6), (0, 7), (0, 8)], {3}),
    ([(-3, 7), (0, 7), (0, 7), (0, 7)], {0}),
    ([(0, 8), (0, 7), (0, 8), (0, 7)], set()),
    ([(0, 7.9), (0, 8), (0, 7), (0, 7)], set()),
    ([(0, 8), (0, 4), (0, 4), (0, 4), (0, 4), (0, 4), (0, 8)], {0, 6}),
    ([(0, 8), (0, 4), (0, 4), (0, 4), (0, 4), (0, 8), (0, 4)], set()),
]


@pytest.mark.parametrize(("ends_V", "always"), BEYOND_OTHERS)
def test_a_stretch_that_reaches_beyond_all_others_is_never_left_out(ends_V, always) -> None:
    """What a basis says beyond all data is extrapolation: the size was chosen by that."""
    fits = []
    for i, (low_V, high_V) in enumerate(ends_V):
        u_V = np.interp(np.arange(1200) / 300, np.arange(5), [low_V, high_V, low_V, high_V, low_V])
        fits.append(rows_to_fit(AxisRun(np.arange(1200) / RATE_HZ, u_V, 10 * u_V, slice(0, None), "x", ""), 400, i, 1))
    for of_all, kept in ((folds_of(fits), always), (folds_of(fits, leave_out_ends=True), set())):
        left_out_once = {int(group) for fold in of_all for group in np.flatnonzero(fold)}
        assert set(range(len(fits))) - left_out_once == kept
