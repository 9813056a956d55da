"""Records that are not in the model's units, or not of its stage: said, since a base that is refitted hides it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from rig import Rig

from phaselead.gap.records import axis_runs
from phaselead.gap.run import run_gap
from phaselead.gap.scale import LEAST_GAIN, MOST_GAIN, scale_doubts
from phaselead.identify import fit
from phaselead.model import catalogue
from phaselead.record.recording import AxisRecord

WAVES = ("multisine0.9", "multisine0.25")


@cache
def records():
    rig = Rig(5, rate_Hz=1000.0)
    each = [[rig.record(u, f"{name}-{kind}") for kind, u in rig.waves(1.0).items()] for name in ("one", "two")]
    return tuple([r for r in part if r.source[4:-4] in WAVES] for part in each)


@cache
def stage():
    return fit(records()[0])[0]


def as_written(part, change):
    """The records with other columns: ``change`` gives voltage and position."""
    return [replace(r, axes={"x": AxisRecord(*change(r.axes["x"].u_V, r.axes["x"].x_um))}, sha256="") for r in part]


def doubts(change, of=(True, True)):
    train, holdout = (as_written(part, change) if off else part for part, off in zip(records(), of, strict=True))
    return scale_doubts(stage(), axis_runs(stage(), train, holdout, []))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda u, x: (u, -x), "move -1.0 times"),
        (lambda u, x: (1000 * u, x), "move 0.00"),
        (lambda u, x: (u, x / 1000), "move 0.0010 times"),
        (lambda u, x: (x, u), "move 0.0"),
    ],
    ids=["turned round", "mV for V", "mm for um", "exchanged"],
)
def test_another_unit_sign_or_column_is_said_in_one_line(change, said):
    (line,) = doubts(change)
    assert line.startswith("x: the records")
    assert said in line
    assert "check units, signs and columns" in line


def test_what_a_stage_can_come_to_is_no_doubt():
    rng = np.random.default_rng(1)
    for gain in (1.0, 1.05 * LEAST_GAIN, 0.95 * MOST_GAIN):
        assert doubts(lambda u, x, gain=gain: (u, gain * x)) == ()
    assert doubts(lambda u, x: (u, 30 * rng.normal(size=len(x)))) == ()  # nothing but noise


def test_records_of_one_part_alone_are_named():
    (line,) = doubts(lambda u, x: (u, -x), of=(False, True))
    assert "the held-out records move -1.0 times" in line


def test_the_answer_says_it():
    train, holdout = (as_written(part, lambda u, x: (u, -x)) for part in records())
    found = run_gap(stage(), train, holdout, without=tuple(name for name in catalogue() if name != "delay"))
    assert [line for line in found.messages if "-1.0 times" in line]
    assert "-1.0 times" in str(found)


def test_every_role_that_is_off_is_said():
    train = as_written(records()[0], lambda u, x: (u, -x))
    holdout = as_written(records()[1], lambda u, x: (u, 1000 * x))
    (line,) = scale_doubts(stage(), axis_runs(stage(), train, holdout, records()[0]))
    assert line.startswith("x: the training and held-out records move -1.0 and 1.0e+03 times")
