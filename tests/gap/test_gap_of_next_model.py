"""The gap after is what the stage file that is written leaves, each record from the memory that suits it best."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rig import Rig
from scipy.signal import lfilter
from test_gap_laws import HIDDEN, hidden_in, parts, waves

from phaselead.gap import left_um, run_gap
from phaselead.identify import fit
from phaselead.model import catalogue
from trials import in_trials

KEPT = ("charge_leakage", "creep", "gain_change")
LEAK_PER_S, SECONDS = 0.02, 8.0


def leaking(role: str):
    """Records of one stage, each from rest at 0 V. Outside the references its charge leaks away."""
    found, rng = [], np.random.default_rng({"reference": 0, "train": 1, "holdout": 2}[role])
    kinds = waves(Rig(3, rate_Hz=500.0), SECONDS)
    for kind in kinds:
        rig = Rig(3, rate_Hz=500.0)
        rig.rng = rng
        u = waves(rig, SECONDS)[kind]
        kept = np.exp(-LEAK_PER_S / rig.rate_Hz)
        v = u if role == "reference" else lfilter([1, -1], [1, -kept], u)
        (name, seen), *_ = (record := rig.record(v, f"{role}-{kind}")).axes.items()
        found.append(replace(record, axes={name: replace(seen, u_V=u)}))
    return found


def test_what_a_leak_does_is_not_taken_for_another_memory():
    """Each record begins at rest. What suited the base without the leak made the gap after larger than before,
    and the name doubtful."""
    reference, train, holdout = (leaking(role) for role in ("reference", "train", "holdout"))
    without = [name for name in catalogue() if name not in KEPT]
    found = run_gap(fit(reference)[0], train, holdout, reference, without=without)
    assert found.verdicts == ("named",)
    assert [one.name for one in found.effects] == ["charge_leakage"]
    assert found.gap.after < 0.2 * found.gap.before
    assert left_um(found.stage, holdout) == pytest.approx(found.gap.after, rel=1e-3)


@pytest.mark.parametrize("name", ["gain_change", *in_trials("delay", "resonance")])
def test_it_is_what_the_written_stage_leaves(name):
    holdout = parts({name: HIDDEN[name]})[2]
    found = hidden_in(name)
    assert left_um(found.stage, holdout) == pytest.approx(found.gap.after, rel=1e-3)
