"""What may be wrong with a base: reference records say how much, and none of it is named."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from phaselead.gap.base_operator import with_operator
from phaselead.gap.records import GapRun
from phaselead.gap.regressors import Freedom, base_columns
from phaselead.gap.residual import Began, modelled_run
from phaselead.model.axis import AdoptedEffect, AxisModel, TimeView
from phaselead.validation.trial import try_case

TRUTH = str(Path(__file__).parent / "truth")
STEP_s = 5e-4


def test_a_mode_that_the_base_has_a_little_wrong_gains_nothing():
    outcome = try_case(TRUTH, "tuning/none/nothing/0/fast/78", follow_up=False)
    assert outcome["verdicts"] == ["none"]
    gaining = [row[1] for row in outcome["candidates"] if row[2] >= 0]
    assert not [names for names in gaining if {"resonance", "load_change"} & {*names.split(" + ")}]


def a_track():
    t = np.arange(2000) * STEP_s
    u = 4 - 4 * np.cos(2 * np.pi * 5 * t)
    view = TimeView(
        gain_um_per_V=5.0, delay_s=2e-4, play_r_V=(0.5, 1.5), play_w_um_per_V=(2.0, 1.0),
        rest_fraction=-1.0, u_range_V=(0.0, 8.0), rate_Hz=1 / STEP_s, residual_um_rms=0.1,
    )  # fmt: skip
    mode = AdoptedEffect(name="resonance", params={"c": (0.9, 0.1), "f_Hz": (150.0, 420.0), "zeta": (0.02, 0.05)})
    run = GapRun("x", "train", t, u, np.zeros(2000), None, 0, 2000, "made.csv", "", {}, {})
    return modelled_run(AxisModel(time=view, effects=(mode,)), run)


def test_every_number_of_the_base_has_its_tangent_where_a_reference_can_say_how_wrong_it_is():
    made = a_track()
    refitted, learned = (base_columns(made, Freedom(learned=known)) for known in (False, True))
    own = learned[:, -7:]  # the delay, and two modes of three numbers
    assert learned.shape[1] > refitted.shape[1] + own.shape[1]  # and what plays miss of a denser memory
    view = made.axis.time
    later = view.model_copy(update={"delay_s": view.delay_s + 0.05 * STEP_s})
    np.testing.assert_allclose(
        own[:, 0], made.with_axis(made.axis.model_copy(update={"time": later})).answer() - made.answer()
    )
    assert np.linalg.matrix_rank(own / np.linalg.norm(own, axis=0), tol=1e-6) == 7


def test_a_line_that_gets_plays_keeps_its_delay():
    made = a_track()
    line = TimeView(gain_um_per_V=8.0, delay_s=2e-4, u_range_V=(0.0, 8.0), rate_Hz=1 / STEP_s)
    run = replace(made.run, x_um=made.answer())
    assert with_operator(AxisModel(time=line), [run]).time.delay_s == line.delay_s


def test_a_track_under_another_model_remembers_the_same():
    made = a_track()
    started = replace(made, began=Began(np.array([0.2, -0.3]), 1.5))
    assert started.with_axis(made.axis).began is started.began
