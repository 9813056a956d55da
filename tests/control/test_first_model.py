"""The first model of a device that drove its stage before: the inverse begins where the stage's memory is."""

from __future__ import annotations

import numpy as np
import pytest

import phaselead as pl
from phaselead.sim import built_in
from phaselead.waveforms import Sine

STAGE = built_in("xyz250")
WITHOUT_CREEP = STAGE.model_copy(
    update={
        "axes": {
            name: axis.model_copy(update={"effects": tuple(e for e in axis.effects if e.name != "creep")})
            for name, axis in STAGE.axes.items()
        }
    }
)
"""What creeps is not remembered before the first model."""


def voltages(model_first, before):
    """What mode ``inverse`` does after ``before`` was driven in open loop, under a model or before the first one."""
    with pl.connect() as dev:
        if model_first:
            dev.upload(WITHOUT_CREEP)
        for path, duration in before:
            dev.record(path, duration=duration)
        if not model_first:
            dev.upload(WITHOUT_CREEP)
        return dev.track("sine:20um@5Hz", mode="inverse", duration=0.4).recording.axes["x"].u_V


BOTH_SIDES = Sine(swing=9.5, offset=-1.5, unit="V", f_Hz=4)


@pytest.mark.parametrize(
    ("before", "codes"),
    [
        ([("sine:8V@4Hz", 0.5)], 1),
        ([("sine:3V@4Hz", 0.5), ("sine:9V@4Hz", 0.5), ("sine:2V@4Hz", 0.5)], 1),
        ([(BOTH_SIDES, 0.5)], 1),
        ([(BOTH_SIDES, 0.3)], 8),
    ],
    ids=["one", "three", "both sides", "the other side last"],
)
def test_what_was_driven_before_the_first_model_is_remembered(before, codes):
    """Exactly, or but for a turn that came near to the furthest one."""
    then = voltages(True, before)
    assert np.abs(voltages(False, before) - then).max() <= codes * 20.48 / 2**16
    assert np.abs(voltages(False, []) - then).max() > 0.05
