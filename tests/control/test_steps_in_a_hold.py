"""A jump of the reference out of a hold: what follows it is as near to its path as without the jump."""

import pytest

import phaselead as pl
from phaselead.sim import built_in


@pytest.mark.parametrize("mode", ["inverse", "inverse+pid"])
def test_a_step_leaves_the_memory_of_loops_as_the_stage_has_it(mode):
    """What undoes the mode asks for far more than the slew limit gives; the memory turned where the output never was,
    and what came next was several times as far off until a larger move."""
    left_um = {}
    for wave in (None, "step:5um", "step:-5um"):
        with pl.connect("sim://xyz250?seed=4") as dev:
            dev.upload(built_in("xyz250"))
            dev.move(x=75, mode=mode)
            if wave is not None:
                dev.track(wave, hold=True)
            run = dev.track("sine:30um+60um@20Hz", hold=True)
            left_um[wave] = run.figures["true"]["max_um_mean_removed"]
    assert left_um["step:5um"] < 1.2 * left_um[None]
    assert left_um["step:-5um"] < 1.2 * left_um[None]
