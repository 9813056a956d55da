"""Short lives of a device under the address and undefined-behaviour sanitizers; `make soak` runs long ones."""

import pytest
from driver import SANITIZE, build, run

from phaselead.device import wire

NOT_ON_ITS_OWN = {wire.Fault.NONE, wire.Fault.TICK_LOST}


@pytest.fixture(scope="module")
def driver(tmp_path_factory):
    return build(tmp_path_factory.mktemp("soak") / "soak", *SANITIZE)


@pytest.mark.parametrize("seed", range(4))
def test_nothing_a_host_sends_does_worse_than_an_error_reply(driver, seed):
    seen = run(driver, "random", seed, 2_000_000)
    # It must have got somewhere, or it proves nothing.
    assert seen["replies"] > seen["frames"] // 2
    assert seen["ok"] > seen["frames"] // 10
    assert min(seen["ticks_in"]) > 100
    assert seen["path_ticks"] > seen["ticks"] // 50
    assert seen["inverse_ticks"] > seen["path_ticks"] // 40
    met = {fault for fault in wire.Fault if seen["faults_of"][fault]}
    assert len(met) >= len(wire.Fault) - len(NOT_ON_ITS_OWN) - 2


def test_work_across_the_end_of_32_bits(driver):
    seen = run(driver, "day", 0.1)
    assert seen["last_tick"] > 2**32
    assert seen["streamed_ticks"] == seen["ticks"]
    assert seen["moves"] > 3 * 1000
