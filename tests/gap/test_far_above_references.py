"""Whether names are all: far more left of held-out records than of reference records is not put down to equations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rig import Rig
from test_gap_laws import waves

from phaselead.gap import axis, run_gap
from phaselead.gap.scale import FarAbove
from phaselead.identify import fit
from phaselead.model import catalogue

KEPT = ("delay", "gain_change", "offset", "thermal_drift")
WITHOUT = tuple(name for name in catalogue() if name not in KEPT)


def sessions(
    reference_level: float = 1.0,
    delay_s: float = 0.0002,
    seconds: float = 2.0,
    reference_rest_s: float = 2.0,
    holdout_rest_s: float = 2.0,
):
    """Reference, training and held-out records, with one at rest in each, a minute apart."""
    rig, found = Rig(3, rate_Hz=1000.0), []
    for name, level, rest_s in (
        ("reference", reference_level, reference_rest_s), ("train", 1.0, 2.0), ("holdout", 1.0, holdout_rest_s),
    ):  # fmt: skip
        voltages = {kind: level * u for kind, u in waves(rig, seconds).items()}
        voltages["idle"] = np.zeros(round(rest_s * 1000))
        found.append([rig.record(u, f"{name}-{kind}") for kind, u in voltages.items()])
        rig.hidden = {"delay": delay_s}
        rig.now_s += 60
    return found


def _with(record, more_um):
    axes = {name: replace(one, x_um=one.x_um + more_um) for name, one in record.axes.items()}
    return replace(record, axes=axes)


def drifting(records, rate_um_per_s: float, began_s: float):
    return [_with(record, rate_um_per_s * (record.t_s - began_s)) for record in records]


def answer(reference, train, holdout):
    return run_gap(fit(reference)[0], train, holdout, reference, without=WITHOUT)


@pytest.mark.parametrize("other_um", [0.0, 0.3])
def test_what_a_named_drift_adds_is_nothing_else(other_um):
    """To records of two seconds it adds rate T / sqrt(12), far more than is left of the references."""
    rate_um_per_s, seconds = 0.2, 2.0
    reference, train, holdout = sessions(seconds=seconds)
    began_s = max(record.t_s[-1] for record in reference)
    holdout = [_with(r, other_um * np.sin(3 * np.pi * (r.t_s - r.t_s[0]) / seconds)) for r in holdout]
    found = answer(reference, *(drifting(records, rate_um_per_s, began_s) for records in (train, holdout)))
    assert "thermal_drift" in {one.name for one in found.effects}
    assert ("unknown" in found.verdicts) == bool(other_um)
    assert other_um or not found.unexplained.something_missing


def test_beside_an_exact_equation_what_follows_the_voltage_is_not_put_down_to_it():
    """A sensor that bends by 0.3 um of 50, ten times what the references leave, beside a dead time: that is exact."""
    reference, train, holdout = sessions(delay_s=0.002)
    found = answer(reference, *([_bent(record, 0.3) for record in records] for records in (train, holdout)))
    assert [one.name for one in found.effects] == ["delay"]
    assert found.verdicts == ("named", "unknown")
    assert not found.unexplained.of_equations


def _bent(record, bend_um):
    place = (record.axes["x"].x_um - 25) / 50
    return _with(record, 10 * bend_um * (place**2 - place**4))


def test_a_hum_that_is_named_is_nothing_else():
    """Of 0.5 um where references leave 0.01: what the training records tell of it is not all of it to the last."""
    reference, *later = sessions(delay_s=0.0)
    humming = [[_with(r, 0.5 * np.sin(2 * np.pi * 50.02 * r.t_s)) for r in records] for records in later]
    without = [name for name in WITHOUT if name != "mains_hum"]
    found = run_gap(fit(reference)[0], *humming, reference, without=without)
    assert [one.name for one in found.effects] == ["mains_hum"]
    assert found.verdicts == ("named",)


@pytest.mark.parametrize("other", [{"reference_level": 0.4}, {"reference_rest_s": 12.0}])
def test_references_that_move_less_or_rest_longer_make_no_name_doubtful(other):
    """They leave less, in um and over all their rows, of the same model."""
    found = answer(*sessions(delay_s=0.0001, seconds=0.8, **other))
    assert [one.name for one in found.effects] == ["delay"]
    assert found.verdicts == ("named",)


def test_what_the_base_still_creeps_of_at_rest_is_nothing_new():
    """A record at rest right after a move, under a model that creeps."""
    rig = Rig(3, rate_Hz=1000.0, hidden={"creep": 0.02})
    made = {kind: [rig.record(u, f"{role}-{kind}") for role in ("fit", "train", "holdout")] for kind, u in
            {**waves(rig), "steps": np.repeat([0.0, 6.0, 2.0, 7.0, 0.0], 4000)}.items()}  # fmt: skip
    stage = fit([records[0] for records in made.values()])[0]
    assert any(one.name == "creep" for one in stage.axes["x"].effects)
    train, holdout = ([records[i] for records in made.values()] for i in (1, 2))
    rig.record(np.full(60000, 8.0), "up")
    rest = rig.record(np.zeros(5000), "rest-after")
    found = run_gap(stage, train, [*holdout, rest], without=WITHOUT)
    assert not any("rest-after" in said for said in found.messages)


@pytest.mark.parametrize("far_um2", [0.0, 0.001])
def test_far_above_the_references_and_nothing_named_is_not_nothing(monkeypatch, far_um2):
    """In a closed loop a leak that the base lacks ended as none, with six times the floor left."""
    monkeypatch.setattr(
        axis, "far_above_known", lambda final, holdout: FarAbove(far_um2, "hold.csv", 0.1, "any reference record")
    )
    found = answer(*sessions(delay_s=0.0, seconds=0.8))
    assert found.verdicts == (("unknown",) if far_um2 else ("none",))
    assert any(said.endswith("look where it is, something is there") for said in found.messages) == bool(far_um2)


@pytest.mark.parametrize("rate_um_per_s", [0.0, 0.05])
@pytest.mark.parametrize("referenced", [False, True])
def test_what_moves_at_rest_is_never_nothing_without_driven_references_as_well(rate_um_per_s, referenced):
    """A held-out record at rest that drifted by 40 times what the fit left ended as none: only driven ones counted.
    References at rest alone do not say what the model leaves of driven ones."""
    reference, train, holdout = sessions(delay_s=0.0, seconds=0.8, holdout_rest_s=20.0)
    (last,) = (r for r in holdout if r.source == "holdout-idle.csv")
    last = drifting([last], rate_um_per_s, last.t_s[0])[0]
    rest = reference[-1:] if referenced else ()
    found = run_gap(fit(reference)[0], train, [*holdout[:-1], last], rest, without=WITHOUT)
    assert found.verdicts == (("unknown",) if rate_um_per_s else ("none",))
    told = [
        said
        for said in found.messages
        if "is left of holdout-idle.csv, far more than of what the model was fitted to" in said
    ]
    assert len(told) == bool(rate_um_per_s)


def test_records_with_nothing_new_are_not_far_and_those_that_wander_are_by_as_much():
    reference, train, holdout = sessions(delay_s=0.0, seconds=0.8)
    stage = fit(reference)[0]
    seen = []

    def kept(final, residuals):
        above = far(final, residuals)
        seen.append(above.um2)
        return above

    far = axis.far_above_known
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(axis, "far_above_known", kept)
        for wander_um in (0.0, 5.0):
            run_gap(stage, train, [_wandering(r, wander_um) for r in holdout], reference, without=WITHOUT)
    assert seen[0] == 0.0
    assert 1.0 < seen[1] < 5.0**2


def _wandering(record, size_um: float):
    return _with(record, size_um * np.sin(2 * np.pi * 1.3 * (record.t_s - record.t_s[0])))
