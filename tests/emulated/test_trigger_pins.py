"""The pins of the triggers on the emulated board: what the stream says, in the tick in which it says so."""

import numpy as np
import pytest
from talker import Talker, V

from phaselead.device import wire
from phaselead.device.stream import decode_samples
from phaselead.sim.emulated import BOARDS, Injection

CHANNELS = wire.Channel.REFERENCE | wire.Channel.DAC | wire.Channel.TRIGGER


def step(f_Hz):
    return round(f_Hz / 5000 * 2**64)


def recorded(talker):
    return decode_samples([bytes(wire.HEADER.size) + batch.pack() for batch in talker.samples])


@pytest.mark.parametrize("board", BOARDS)
def test_pins_rise_where_the_stream_says_and_an_edge_begins_a_path(start, board):
    emulated = start(board)
    talker = Talker(emulated, pause=20)
    here = wire.PathFlag.FROM_HERE
    talker.ok(
        wire.HelloRequest(),
        wire.SetTimeoutRequest(0),
        wire.SetAxisRequest(0, wire.Mode.OPEN, 0, 0, 0, 0x7FFFFFFF),
        wire.SetPathRequest(0, wire.PathKind.HOLD, 0, 0, 0, 0),
        wire.SetJoinsRequest(0, here, 0, 0),
        wire.TriggerSetRequest(0, wire.Mark.TURN, 0, 0, 1, 0),
        wire.TriggerSetRequest(1, wire.Mark.TIME, 0, 0, 3, 0),
        wire.TriggerSetRequest(2, wire.Mark.WAY, 0, 1, V // 4, V // 8),
        wire.StreamStartRequest(CHANNELS, 1, 1),
        wire.ArmRequest(0),
        wire.StartRequest(1),
    )
    sine = wire.Segment(wire.PathKind.SINE, 0, 4 * V, 0, step(20), 1000, 100, 100)
    nothing = wire.Segment(wire.PathKind.HOLD, 0, 0, 0, 0, 0, 0, 0)
    talker.ok(wire.QueueRequest(1, 0, 0, (sine, nothing, nothing), 1))
    talker.run(300)
    assert talker.ok(wire.StatusRequest()).first_tick == 0
    emulated.inject(Injection.TRIGGER)
    talker.run(1500)
    first_tick = talker.ok(wire.StatusRequest()).first_tick
    talker.ok(wire.StreamStopRequest())
    talker.run(100)

    stream = recorded(talker)
    (edge,) = stream.ticks[np.flatnonzero(stream.axes["x"].trigger & 0x80)]
    assert [(e.tick, e.value) for e in talker.events if e.kind == wire.EventKind.TRIGGER] == [(edge, 1)]
    assert first_tick == edge + 101
    emulated.codes()
    said = (stream.axes["x"].trigger[:, None] >> np.arange(3) & 1).astype(bool)
    seen = emulated.pulses[stream.ticks]
    assert np.array_equal(seen, said)
    turns = stream.ticks[said[:, 0]] - first_tick
    assert turns.tolist() == [0, 250, 500, 750]
    assert np.count_nonzero(said[:, 1]) == 334
    assert np.count_nonzero(said[:, 2]) == 4 * 16
