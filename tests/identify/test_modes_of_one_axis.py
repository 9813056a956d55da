"""The first modes are found where there are some, and not where there are none."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter, lsim, lti

from phaselead.identify.modal.one_axis import find_modes, fit_together
from phaselead.identify.operator import fit_operator
from phaselead.identify.operator.solution import strayed
from phaselead.identify.runs import AxisRun
from phaselead.model import behind_modes, respond, rest_plays
from phaselead.model.axis import TimeView
from trials import in_trials

RATE_HZ = 5000.0
VIEW = TimeView(gain_um_per_V=20.0, u_range_V=(0.0, 10.0), rate_Hz=RATE_HZ, delay_s=0.0002)


def triangle_run(f_Hz: float, mode: tuple[float, float] | None, seed: int) -> AxisRun:
    """A triangle (its corners ring) through a linear stage with this mode, integrated by scipy's own simulator."""
    t_s = np.arange(round(4 / f_Hz * RATE_HZ)) / RATE_HZ
    u_V = 5 * (1 - np.abs(2 * ((t_s * f_Hz) % 1.0) - 1))
    late_V = np.interp(t_s - VIEW.delay_s, t_s, u_V, left=0.0)
    x_um = 20 * late_V
    if mode is not None:
        w, zeta = 2 * np.pi * mode[0], mode[1]
        _, x_um, _ = lsim(lti([20 * w**2], [1, 2 * zeta * w, w**2]), late_V, t_s)
    x_um = x_um + 0.01 * np.random.default_rng(seed).standard_normal(len(t_s))
    return AxisRun(t_s, u_V, x_um, slice(len(t_s) // 4, None), "x", f"{f_Hz:g} Hz")


@pytest.mark.parametrize("mode", [(160.0, 0.02), (333.0, 0.05), (60.0, 0.1)])
def test_a_mode_is_found_and_its_lag_taken_out_of_the_delay(mode):
    runs = [triangle_run(f, mode, i) for i, f in enumerate((3.0, 5.0, 7.0, 11.0))]
    zeta_lag_s = 2 * mode[1] / (2 * np.pi * mode[0])
    view = VIEW.model_copy(update={"delay_s": VIEW.delay_s + zeta_lag_s})  # what a fit without a mode would call delay
    found = find_modes(view, runs)
    assert found is not None
    assert len(found.modes) == 1
    assert found.modes[0] == pytest.approx((1.0, *mode), rel=0.1)
    assert found.modes[0][1] == pytest.approx(mode[0], rel=0.01)
    assert found.delay_s == pytest.approx(VIEW.delay_s, abs=3e-5)
    assert found.share_left < 0.1


def test_no_mode_rings_of_where_a_stage_already_stood():
    """Records begin at mid-range: were the stage to jump there in the first row, a mode so light would ring to the end,
    and the fit with it would be thrown away."""
    f_Hz, zeta = 596.0, 0.005
    w = 2 * np.pi * f_Hz
    runs = []
    for seed, (level_V, to_Hz) in enumerate([(0.02, 900.0), (0.03, 800.0), (2.0, 40.0)]):
        t_s = np.arange(10000) / RATE_HZ
        about_V = level_V * np.sin(2 * np.pi * (5 * t_s + (to_Hz - 5) * t_s**2 / 4))
        _, x_um, _ = lsim(lti([20 * w**2], [1, 2 * zeta * w, w**2]), about_V, t_s)
        noise_um = 0.001 * np.random.default_rng(seed).standard_normal(len(t_s))
        runs.append(AxisRun(t_s, 5 + about_V, 100 + x_um + noise_um, slice(100, None), "x", f"{to_Hz:g} Hz"))
    fitted, found = fit_together(runs)
    assert found is not None
    assert found.modes[0][1:] == pytest.approx((f_Hz, zeta), rel=0.02)
    assert max(record.rms_um / record.range_um for record in fitted.records) < 0.01


def test_a_second_mode_and_its_share_are_found():
    runs = [triangle_run(f, (160.0, 0.02), i) for i, f in enumerate((3.0, 5.0, 7.0, 11.0))]
    w, zeta, share = 2 * np.pi * 490.0, 0.03, 0.05
    both = []
    for run in runs:
        late_V = np.interp(run.t_s - VIEW.delay_s, run.t_s, run.u_V, left=0.0)
        _, second_um, _ = lsim(lti([20 * w**2], [1, 2 * zeta * w, w**2]), late_V, run.t_s)
        both.append(replace(run, x_um=(1 - share) * run.x_um + share * second_um))
    found = find_modes(VIEW, both)
    assert found is not None
    assert found.modes[0] == pytest.approx((1 - share, 160.0, 0.02), rel=0.05)
    assert found.modes[1] == pytest.approx((share, 490.0, zeta), rel=0.1)


def test_no_mode_is_adopted_where_there_is_none():
    runs = [triangle_run(f, None, i) for i, f in enumerate((3.0, 5.0, 7.0, 11.0))]
    assert find_modes(VIEW, runs) is None


def test_slow_records_have_no_mode():
    run = triangle_run(3.0, (160.0, 0.02), 0)
    slow = AxisRun(run.t_s[::50], run.u_V[::50], run.x_um[::50], slice(None), "x", "slow")
    assert find_modes(VIEW, [slow, slow]) is None


MODE = (1.0, 200.0, 0.02)
PLAYS = VIEW.model_copy(
    update={"play_r_V": (0.3, 1.0, 2.5), "play_w_um_per_V": (2.0, 2.0, 2.0), "rest_fraction": 0.3, "delay_s": 0.0}
)


def session(levels_V: tuple[float, ...], frequencies_Hz: tuple[float, ...]) -> tuple[list[AxisRun], list[float]]:
    """Sines from 0 V one after the other on a stage with a mode, each from the memory that the last one left."""
    runs, plays_V = [], rest_plays(PLAYS)
    rng = np.random.default_rng(0)
    for level_V in levels_V:
        for f_Hz in frequencies_Hz:
            t_s = np.arange(round(4 / f_Hz * RATE_HZ) + 1) / RATE_HZ
            u_V = level_V / 2 * (1 - np.cos(2 * np.pi * f_Hz * t_s))
            still_um, plays_V = respond(PLAYS, u_V, plays_V)
            x_um = behind_modes(still_um, (MODE,), 1 / RATE_HZ) + 0.01 * rng.standard_normal(len(t_s))
            runs.append(AxisRun(t_s, u_V, x_um, slice(None), "x", f"{level_V:g} V, {f_Hz:g} Hz"))
    return runs, [run.u_V.max() for run in runs]


def test_a_mode_is_judged_from_where_each_record_began():
    """From rest, what the memory of a record does is left of it, mode or not: the mode explained 3 % and was refused
    where a few more records began elsewhere."""
    runs, tops_V = session((2.0, 4.0, 8.0), (10.0, 15.0, 20.0))
    memories = [None, *[(top_V,) for top_V in tops_V[:-1]]]
    assert find_modes(PLAYS, runs, memories).share_left < 0.1
    without = find_modes(PLAYS, runs)
    assert without is None or without.share_left > 0.3


def test_the_memory_of_a_record_is_found_behind_its_ringing():
    """The fastest sine of each level is the first that begins at the memory of the one before, and rings most: with
    that ringing left over, other starts did not pay."""
    runs, _ = session((1.0, 2.0, 4.0, 6.0, 8.0, 10.0), (40.0, 20.0, 10.0))
    found, mode = fit_together(runs)
    assert mode.modes[0] == pytest.approx(MODE, rel=0.05)
    assert [one.source for one in found.records if one.turned_V is None] == ["1 V, 40 Hz"]


def creeping(run: AxisRun, share: float) -> AxisRun:
    """The run on a stage that creeps by this share of its way in each decade of time from 0.1 to 10 s."""
    each_um = [lfilter([1 - q], [1, -q], run.x_um) for q in np.exp(-1 / (RATE_HZ * np.array([0.1, 1.0, 10.0])))]
    return replace(run, x_um=run.x_um + share * np.sum(each_um, axis=0))


@pytest.mark.parametrize("share", [0.01, *in_trials(0.003)])
def test_a_mode_does_not_stand_for_creep(share):
    """Searched from a few hertz, one went down to 1.5 Hz and up to the most damping there is; gains and moves were then
    designed for a stage that rings at 1.5 Hz."""
    runs, _ = session((0.5, 3.5, 10.0), (20.0, 7.0, 1.0))
    fitted = fit_operator([creeping(run, share) for run in runs], ((0.02, 5.0, 0.45), MODE))
    assert [mode[1] for mode in fitted.modes] == [pytest.approx(MODE[1], rel=0.01)]


def test_a_damped_stage_that_creeps_keeps_its_mode(monkeypatch):
    """Each stood for something else beside the other, and both were left out."""
    monkeypatch.setattr(sys.modules[__name__], "MODE", (1.0, 40.0, 0.7))
    runs, _ = session((0.5, 3.5, 10.0), (20.0, 7.0, 1.0))
    fitted = fit_operator([creeping(run, 0.01) for run in runs], ((0.02, 5.0, 0.45), (1.0, 40.0, 0.45)))
    assert len(fitted.modes) == 1
    assert fitted.modes[0][1] > 25.0


BEGAN = ((1.0, 150.0, 0.3), (0.1, 300.0, 0.02))


@pytest.mark.parametrize(
    ("modes", "out"),
    [
        (BEGAN, None),
        (((0.5, 95.0, 0.3), (0.1, 310.0, 0.02)), None),
        (((0.5, 90.0, 0.3), (0.1, 310.0, 0.02)), 0),
        (((0.5, 90.0, 0.3), (0.1, 30.0, 0.02)), 1),  # the one that moved most
        (((0.5, 140.0, 0.5), (0.1, 310.0, 0.02)), 0),
        (((0.5, 140.0, 0.5), (0.1, 30.0, 0.02)), 1),
    ],
)
def test_a_mode_strays_by_its_frequency_or_beside_others_by_its_damping(modes, out):
    assert strayed(modes, BEGAN) == out
    assert strayed(((0.5, 140.0, 0.5),), BEGAN[:1]) is None
    assert strayed(((0.5, 140.0, 0.55), BEGAN[1]), ((0.5, 140.0, 0.58), BEGAN[1])) is None
