"""Flash is written, and limits are exchanged, only while every output stands still: parked alone does not say so."""

from zlib import crc32

import pytest
from device_bench import MODEL_CHUNK, ZERO_V_CODE, Bench, V, model
from test_hard_limits import limits_set

from phaselead.device import wire

COMMANDS = (wire.ModelCommitRequest(), wire.ModelPersistRequest(), limits_set())


def receive(bench, blob):
    """A model but for its commit."""
    bench.ok(wire.ModelBeginRequest(len(blob), crc32(blob)))
    for at in range(0, len(blob), MODEL_CHUNK):
        bench.ok(wire.ModelChunkRequest(at, blob[at : at + MODEL_CHUNK]))


@pytest.fixture
def held():
    """Parked at 5 V, sent to 0 V and stopped on the way."""
    bench = Bench()
    bench.upload(model(u_park_q24=5 * V))
    bench.ok(wire.ArmRequest(0))
    bench.park()
    receive(bench, model(hash_byte=1).pack())
    assert bench.status_of(wire.UpdateRestartRequest()) == wire.Status.BUSY
    bench.run(100)
    bench.ok(wire.StopRequest())
    assert (bench.state, bench.status().at_rest) == (wire.State.PARKED, 6)
    return bench


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.NAME)
def test_on_the_way_to_the_safe_value_it_is_busy_and_there_it_is_done(held, command):
    held.ok(wire.ParkRequest())
    writes = held.firmware.flash()[1]
    assert held.status_of(command) == wire.Status.BUSY
    assert held.firmware.flash()[1] == writes
    assert held.state == wire.State.PARKED
    codes = held.run(500)[:, 0]
    assert codes[0] > codes[-1] == ZERO_V_CODE
    held.ok(command)


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.NAME)
def test_an_output_that_is_held_stands_still(held, command):
    before = held.dac[-1, 0]
    assert before > ZERO_V_CODE
    held.ok(command)
    assert (held.run(100)[:, 0] == before).all()
