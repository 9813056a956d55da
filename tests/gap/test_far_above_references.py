"""Whether names are all: far more left of held-out records than of reference records is not put down to equations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rig import Rig
from test_gap_laws import waves

from phaselead.gap import axis, run_gap
from phaselead.identify import fit
from phaselead.model import catalogue

KEPT = ("delay", "gain_change", "offset", "thermal_drift")
WITHOUT = tuple(name for name in catalogue() if name not in KEPT)


def sessions(
    reference_level: float = 1.0, delay_s: float = 0.0002, seconds: float = 2.0, reference_rest_s: float = 2.0
):
    """Reference, training and held-out records, with one at rest in each, a minute apart."""
    rig, found = Rig(3, rate_Hz=1000.0), []
    for name, level, rest_s in (
        ("reference", reference_level, reference_rest_s), ("train", 1.0, 2.0), ("holdout", 1.0, 2.0),
    ):  # fmt: skip
        voltages = {kind: level * u for kind, u in waves(rig, seconds).items()}
        voltages["idle"] = np.zeros(round(rest_s * 1000))
        found.append([rig.record(u, f"{name}-{kind}") for kind, u in voltages.items()])
        rig.hidden = {"delay": delay_s}
        rig.now_s += 60
    return found


def drifting(records, rate_um_per_s: float, began_s: float):
    moved = []
    for record in records:
        drift_um = rate_um_per_s * (record.t_s - began_s)
        axes = {name: replace(one, x_um=one.x_um + drift_um) for name, one in record.axes.items()}
        moved.append(replace(record, axes=axes))
    return moved


def answer(reference, train, holdout):
    return run_gap(fit(reference)[0], train, holdout, reference, without=WITHOUT)


@pytest.mark.parametrize(("other_um2", "unknown"), [(0.001, False), (0.008, True)])
def test_what_a_named_drift_adds_is_nothing_else(monkeypatch, other_um2, unknown):
    """To records of two seconds it adds rate^2 T^2 / 12, which the residual holds beside what is not known."""
    rate_um_per_s, seconds = 0.2, 2.0
    left_um2 = rate_um_per_s**2 * seconds**2 / 12 + other_um2
    monkeypatch.setattr(axis, "far_above_references_um2", lambda final, holdout: left_um2)
    monkeypatch.setattr(axis, "excused_um2", lambda gap: 0.004)
    reference, *later = sessions(seconds=seconds)
    began_s = max(record.t_s[-1] for record in reference)
    found = answer(reference, *(drifting(records, rate_um_per_s, began_s) for records in later))
    assert {one.name for one in found.effects} == {"delay", "thermal_drift"}
    assert ("unknown" in found.verdicts) == unknown


@pytest.mark.parametrize("other", [{"reference_level": 0.4}, {"reference_rest_s": 12.0}])
def test_references_that_move_less_or_rest_longer_make_no_name_doubtful(other):
    """They leave less, in um and over all their rows, of the same model."""
    found = answer(*sessions(delay_s=0.0001, seconds=0.8, **other))
    assert [one.name for one in found.effects] == ["delay"]
    assert found.verdicts == ("named",)
