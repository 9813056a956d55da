"""A fault that comes while flash is written."""

import pytest
from c_driver import build, numbers
from device_bench import ZERO_V_CODE

from phaselead.device import wire

TWO_V, FIVE_V = 2 * 3200, 5 << 24


@pytest.fixture(scope="module")
def during_write(tmp_path_factory):
    path = build(tmp_path_factory.mktemp("during_write"), "during_write")
    return lambda fault: numbers(path, int(fault))


@pytest.mark.parametrize(
    ("fault", "ends_at"), [(wire.Fault.INTERLOCK, 0), (wire.Fault.FLASH_ERROR, TWO_V), (wire.Fault.NONE, TWO_V)]
)
def test_limits_apply_and_the_reaction_of_a_fault_goes_on(during_write, fault, ends_at):
    (state, _, u_max_q24), (_, code, _) = during_write(fault)
    assert state == (wire.State.PARKED if fault == wire.Fault.NONE else wire.State.FAULT)
    assert FIVE_V <= u_max_q24 < FIVE_V + 10_000
    assert code - ZERO_V_CODE == ends_at
