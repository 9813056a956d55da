"""The noise that no model is expected to beat: that of the references, or what the richest model leaves.

A person is told which of them it is."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from phaselead.gap.findings import GapSize
from phaselead.gap.floor import floor_of
from phaselead.gap.goodness_of_fit import OF_THE_RICHEST, FinalFit
from phaselead.gap.posterior import Contest, likelihood_of
from phaselead.gap.posterior.starts import Starts
from phaselead.gap.records import GapRun
from phaselead.gap.residual import modelled_run
from phaselead.gap.run import _gap
from phaselead.model import catalogue
from phaselead.model.axis import AxisModel, TimeView

STEP_s, NOISE_um = 1e-3, 0.01
LINE = AxisModel(time=TimeView(gain_um_per_V=8.0, u_range_V=(0.0, 8.0), rate_Hz=1 / STEP_s))
EFFECTS = [one for one in catalogue().values() if one.kind == "response"]
"""Many of their shapes are nearly the same; some have no column where one axis moves."""


def contest(rows, roles, added=lambda u: 0.0 * u, noise_um=None):
    runs = []
    for i, role in enumerate(roles):
        rng = np.random.default_rng(i)
        u = 4 + np.cumsum(rng.normal(0, 0.1, rows)) if role != "idle" else np.full(rows, 4.0)
        x = 8 * u + added(u) + (rng.normal(0, NOISE_um, rows) if noise_um is None else noise_um[i])
        t_s, of_role = np.arange(rows) * STEP_s, "reference" if role == "idle" else role
        run = GapRun("x", of_role, t_s, u, x, None, 0, rows, "a", {}, {})
        runs.append(modelled_run(LINE, run))
    likelihood = likelihood_of(runs)
    return Contest(likelihood, {}, Starts(likelihood, EFFECTS))


@pytest.mark.parametrize("rows", [300, 4000])
def test_without_references_it_is_what_the_sensor_adds_however_short_the_records(rows):
    """Of 300 rows the many amounts that are fitted leave but three quarters of the noise."""
    floor = floor_of(contest(rows, ["train", "holdout"], lambda u: 0.3 * u + 0.02 * np.sin(u)))
    assert floor.rms_um == pytest.approx(NOISE_um, rel=0.1)


def test_noise_that_wanders_counts_whole():
    """Of noise in which each row is mostly the one before, what is new in a row is the smaller part. The richest model
    takes some of its slow part."""
    drawn = np.random.default_rng(5).normal(0, NOISE_um, 8000)
    wandering = np.split(lfilter([1.0], [1.0, -0.9], drawn), 2)
    floor = floor_of(contest(4000, ["train", "holdout"], noise_um=wandering))
    assert floor.rms_um == pytest.approx(np.std(wandering[0]), rel=0.2)
    assert floor.rms_um > 2 * NOISE_um


@pytest.mark.parametrize("roles", [["idle", "reference"], ["reference", "reference"], ["idle"]])
def test_with_references_it_is_what_the_base_leaves_of_them(roles):
    noise = floor_of(contest(3000, [*roles, "train", "holdout"])).noise
    assert noise.sigma_um == pytest.approx(NOISE_um, rel=0.2)
    assert noise.misfit_um < 0.5 * NOISE_um


@pytest.mark.parametrize(("richest_um", "own"), [(0.005, False), (0.1, True)])
def test_a_floor_says_whose_it_is(richest_um, own):
    """Where nothing leaves less than the next model, the floor is what that leaves, and none of other records."""
    runs = tuple(run.modelled for run in contest(300, ["train", "holdout"], lambda u: 0.3 * u).likelihood.runs)
    alone = FinalFit(LINE, (), runs, runs, GapSize(2.0, 1.0, richest_um), richest_um)
    gain = catalogue()["gain_change"]
    closed = alone.with_entries([(gain, {"gain": 0.3 / 8})]).gap
    assert 0.005 < closed.after < 0.1
    assert closed.floor == min(richest_um, closed.after)
    assert closed.floor_is_after is own
    assert (closed.floor_from == OF_THE_RICHEST) is not own
    assert closed.floor_from.startswith("what the next model leaves itself; ") is own


def test_a_floor_that_is_not_the_same_on_all_axes_names_them():
    kept = [SimpleNamespace(axis=a, gap=GapSize.below(1.0, 0.2, f, "noise"), rows=9) for a, f in (("x", 0.1), ("y", 1))]
    joined = _gap(kept)
    assert joined.floor_from == "on x noise; on y what the next model leaves itself; noise is no less"
    assert not joined.floor_is_after
    assert _gap(kept[:1]).floor_from == "noise"
    assert _gap(kept[1:]).floor_is_after
