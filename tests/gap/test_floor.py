"""The noise that no model is expected to beat: that of the references, or what the richest model leaves."""

from __future__ import annotations

import numpy as np
import pytest

from phaselead.gap.floor import noise_of
from phaselead.gap.posterior import Contest, Starts, likelihood_of
from phaselead.gap.records import GapRun
from phaselead.gap.residual import modelled_run
from phaselead.model import catalogue
from phaselead.model.axis import AxisModel, TimeView

STEP_s, NOISE_um = 1e-3, 0.01
LINE = AxisModel(time=TimeView(gain_um_per_V=8.0, u_range_V=(0.0, 8.0), rate_Hz=1 / STEP_s))
EFFECTS = [one for one in catalogue().values() if one.kind == "response"]
"""Many of their shapes are nearly the same; some have no column where one axis moves."""


def contest(rows, roles, added=lambda u: 0.0 * u):
    runs = []
    for i, role in enumerate(roles):
        rng = np.random.default_rng(i)
        u = 4 + np.cumsum(rng.normal(0, 0.1, rows)) if role != "idle" else np.full(rows, 4.0)
        x = 8 * u + added(u) + rng.normal(0, NOISE_um, rows)
        t_s, of_role = np.arange(rows) * STEP_s, "reference" if role == "idle" else role
        run = GapRun("x", of_role, t_s, u, x, None, 0, rows, "a", str(i), {}, {})
        runs.append(modelled_run(LINE, run))
    likelihood = likelihood_of(runs)
    return Contest(likelihood, {}, len(EFFECTS), starts=Starts(likelihood, EFFECTS))


@pytest.mark.parametrize("rows", [300, 4000])
def test_without_references_it_is_what_the_sensor_adds_however_short_the_records(rows):
    """Of 300 rows the many amounts that are fitted leave but three quarters of the noise."""
    noise = noise_of(contest(rows, ["train", "holdout"], lambda u: 0.3 * u + 0.02 * np.sin(u)))
    assert noise.level_um == pytest.approx(NOISE_um, rel=0.1)


@pytest.mark.parametrize("roles", [["idle", "reference"], ["reference", "reference"], ["idle"]])
def test_with_references_it_is_what_the_base_leaves_of_them(roles):
    noise = noise_of(contest(3000, [*roles, "train", "holdout"]))
    assert noise.sigma_um == pytest.approx(NOISE_um, rel=0.2)
    assert noise.misfit_um < 0.5 * NOISE_um
