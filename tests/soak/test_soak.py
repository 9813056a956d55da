"""Short lives of a device under the address and undefined-behaviour sanitizers; `make soak` runs long ones."""

import pytest
from driver import SANITIZE, build, run

from phaselead.device import wire

LIVES, TICKS = 4, 2_000_000
BY_TIME = {wire.Fault.NONE, wire.Fault.TICK_LOST}
"""No fault, and one that the host port's time cannot have."""


@pytest.fixture(scope="module")
def driver(tmp_path_factory):
    return build(tmp_path_factory.mktemp("soak") / "soak", *SANITIZE)


def test_nothing_a_host_sends_does_worse_than_an_error_reply(driver):
    """And everything it can bring about was among it, or the lives prove nothing."""
    lives = [run(driver, "random", seed, TICKS) for seed in range(LIVES)]

    def never(counter, names):
        return {name for name in names if not any(life[counter][name] for life in lives)}

    commands = {wire.MESSAGES[number] for number in wire.MESSAGES if issubclass(wire.MESSAGES[number], wire.Command)}
    assert never("done_of", {command.NUMBER for command in commands}) == set()
    assert never("ticks_in", wire.State) == set()
    assert never("faults_of", wire.Fault) == BY_TIME
    assert never("path_ticks_in", wire.Mode) == {wire.Mode.IDLE}
    assert never("filter_ticks", range(4)) == set()
    assert any(life["gains_under_way"] for life in lives)


def test_work_across_the_end_of_32_bits(driver):
    seen = run(driver, "day", 0.1)
    assert seen["last_tick"] > 2**32
    assert seen["streamed_ticks"] == seen["ticks"]
    assert seen["moves"] > 3 * 1000  # of three axes; each takes 1100 of 1.8e6 ticks, and they follow one another
