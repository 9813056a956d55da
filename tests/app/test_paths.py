"""What SET_AXIS, SET_PATH and the waveform commands take, and the words in which they refuse the rest."""

import struct
from zlib import crc32

import numpy as np
import pytest
from device_bench import UM, Bench, V, model, step_of

from phaselead.device import wire

HALF_TURN = 2**63
ONE = 1 << 30
PERIODIC = [wire.PathKind.SINE]


@pytest.fixture
def modelled(bench):
    assert bench.upload(model()).status == wire.Status.OK
    return bench


def refusal(bench, mode, **path):
    assert bench.set_axis(0, mode) == wire.Status.OK
    return bench.set_path(0, **path)


@pytest.mark.parametrize(
    ("fields", "status"),
    [
        ((3, 1, 0, 0, 0, 1), wire.Status.BAD_VALUE),
        ((0, 7, 0, 0, 0, 1), wire.Status.BAD_VALUE),
        ((0, 2, -1, 0, 0, 1), wire.Status.BAD_VALUE),
        ((0, 2, 0, -1, 0, 1), wire.Status.BAD_VALUE),
        ((0, 2, 0, 0, -1, 1), wire.Status.BAD_VALUE),
        ((0, 2, 0, 0, 0, 0), wire.Status.BAD_VALUE),
        ((0, 2, 0, 0, 0, -5), wire.Status.BAD_VALUE),
        ((0, 3, 0, 0, 0, 1), wire.Status.NO_MODEL),
        ((0, 4, 0, 0, 0, 1), wire.Status.NO_MODEL),
        ((0, 5, 0, 0, 0, 1), wire.Status.NO_MODEL),
        ((0, 6, 0, 0, 0, 1), wire.Status.NO_MODEL),
        ((2, 2, 2**31 - 1, 2**31 - 1, 2**31 - 1, 2**31 - 1), wire.Status.OK),
        ((0, 0, 0, 0, 0, 1), wire.Status.OK),
    ],
)
def test_set_axis(bench, fields, status):
    assert bench.status_of(wire.SetAxisRequest(*fields)) == status


@pytest.mark.parametrize("step", [0, HALF_TURN, 2**64 - 1])
@pytest.mark.parametrize("path", [wire.PathKind.SINE, wire.PathKind.MOVE])
def test_less_than_half_a_turn_and_more_than_none(bench, path, step):
    assert refusal(bench, wire.Mode.OPEN, path=path, step=step) == wire.Status.BAD_VALUE
    assert refusal(bench, wire.Mode.OPEN, path=path, step=HALF_TURN - 1) == wire.Status.OK


def test_a_path_needs_a_mode_first(bench):
    assert bench.set_path(0) == wire.Status.MODE_UNSUPPORTED
    assert bench.set_path(3) == wire.Status.BAD_VALUE
    assert bench.set_axis() == wire.Status.OK
    assert bench.set_path(0, path=4) == wire.Status.BAD_VALUE
    assert bench.set_path(0, swing=-1) == wire.Status.BAD_VALUE


@pytest.mark.parametrize("path", [wire.PathKind.SINE, wire.PathKind.MOVE])
def test_an_open_path_stays_within_the_voltage_limits(bench, path):
    for swing, offset, status in (
        (12 * V, -2 * V, wire.Status.OK),
        (12 * V + 1, -2 * V, wire.Status.OUTSIDE_LIMITS),
        (1, 10 * V, wire.Status.OUTSIDE_LIMITS),
        (0, 10 * V, wire.Status.OK),
        (V, -2 * V - 1, wire.Status.OUTSIDE_LIMITS),
        (2**31 - 1, 2**31 - 1, wire.Status.OUTSIDE_LIMITS),
    ):
        assert refusal(bench, wire.Mode.OPEN, path=path, swing=swing, offset=offset) == status
    down = {"swing": -3 * V, "path": wire.PathKind.MOVE}
    assert refusal(bench, wire.Mode.OPEN, offset=V, **down) == wire.Status.OK
    assert refusal(bench, wire.Mode.OPEN, offset=V - 1, **down) == wire.Status.OUTSIDE_LIMITS


def test_a_hold_has_no_swing(bench):
    hold = {"path": wire.PathKind.HOLD, "step": 0}
    assert refusal(bench, wire.Mode.OPEN, swing=2**31 - 1, offset=5 * V, **hold) == wire.Status.OK
    assert refusal(bench, wire.Mode.OPEN, swing=0, offset=11 * V, **hold) == wire.Status.OUTSIDE_LIMITS


def test_a_position_stays_within_the_sensor(bench):
    for swing, offset, status in (
        (250 * UM, 0, wire.Status.OK),
        (250 * UM, 30 * UM, wire.Status.OUTSIDE_LIMITS),
        (10 * UM, -11 * UM, wire.Status.OUTSIDE_LIMITS),
    ):
        assert refusal(bench, wire.Mode.PID, swing=swing, offset=offset) == status


def test_the_rectangle_includes_its_edges_and_nothing_more(modelled):
    bench = modelled
    low, high = 16.2087 / 2, 247.4254  # K(um) um at 0.5 V and 10 V by Table I
    for f_Hz, status in ((1, wire.Status.OK), (20, wire.Status.OK)):
        assert refusal(bench, wire.Mode.FF, swing=60 * UM, step=step_of(f_Hz)) == status
    for f_Hz in (0.999, 20.001, 100, 2400):
        refused = refusal(bench, wire.Mode.FF, swing=60 * UM, step=step_of(f_Hz))
        assert refused == wire.Status.OUTSIDE_RECTANGLE
        assert refusal(bench, wire.Mode.PID, swing=60 * UM, step=step_of(f_Hz)) == wire.Status.OK
    assert refusal(bench, wire.Mode.FF, swing=round((low + 0.1) * UM)) == wire.Status.OK
    assert refusal(bench, wire.Mode.FF, swing=round((low - 0.1) * UM)) == wire.Status.OUTSIDE_RECTANGLE
    assert refusal(bench, wire.Mode.FF, swing=round((high - 0.1) * UM)) == wire.Status.OK
    assert refusal(bench, wire.Mode.FF, swing=round((high + 0.1) * UM)) == wire.Status.OUTSIDE_RECTANGLE


def first_step(f_q16):
    """The least step whose frequency is nearest to so many 2^-16 Hz."""
    return -((1 - 2 * f_q16) * 2**47 // 5000)


def test_a_frequency_is_within_the_rectangle_when_its_nearest_in_q16_is(modelled):
    for step, status in (
        (first_step(1 << 16) - 1, wire.Status.OUTSIDE_RECTANGLE),
        (first_step(1 << 16), wire.Status.OK),
        (first_step((20 << 16) + 1) - 1, wire.Status.OK),
        (first_step((20 << 16) + 1), wire.Status.OUTSIDE_RECTANGLE),
    ):
        assert refusal(modelled, wire.Mode.FF, swing=60 * UM, step=step) == status


@pytest.mark.parametrize("code", [0, 20_000, 60_000, 65_535])
def test_without_a_model_a_code_of_the_sensor_is_280_um_by_65536(bench, code):
    """And code 2340.57 is 0 um: the default converter of device.c."""
    assert refusal(bench, wire.Mode.PID, path=wire.PathKind.HOLD, swing=0) == wire.Status.OK
    bench.ok(wire.SetJoinsRequest(0, wire.PathFlag.FROM_HERE, 50, 0))
    bench.ok(wire.ArmRequest(0))
    bench.run(1, adc=code)
    bench.ok(wire.StartRequest(1))
    assert bench.ok(wire.WhereRequest()).end[0] == round((code - 599186 / 256) * 280)


def test_a_table_path_is_refused_where_its_voltage_would_clip(modelled):
    # 60 um ride on the gain of a 60 um swing; 200 um higher that asks for more than 10 V.
    assert refusal(modelled, wire.Mode.FF, swing=60 * UM, offset=100 * UM) == wire.Status.OK
    assert refusal(modelled, wire.Mode.FF, swing=60 * UM, offset=200 * UM) == wire.Status.OUTSIDE_LIMITS


def test_holds_and_moves_under_feed_forward(modelled):
    hold = {"path": wire.PathKind.HOLD, "swing": 0, "step": 0}
    assert refusal(modelled, wire.Mode.FF, offset=120 * UM, **hold) == wire.Status.OK
    assert refusal(modelled, wire.Mode.FF, offset=250 * UM, **hold) == wire.Status.OUTSIDE_RECTANGLE
    move = {"path": wire.PathKind.MOVE, "step": 2**64 // 5000}
    assert refusal(modelled, wire.Mode.FF, swing=100 * UM, offset=0, **move) == wire.Status.OK
    assert refusal(modelled, wire.Mode.FF, swing=248 * UM, offset=0, **move) == wire.Status.OUTSIDE_RECTANGLE


def test_the_looked_up_point_is_told(modelled):
    modelled.set_axis(0, wire.Mode.FF)
    reply = modelled.ok(wire.SetPathRequest(0, wire.PathKind.SINE, 60 * UM, 0, step_of(5), 0))
    gain = 2**28 / reply.inverse_gain_q28
    swing_V = 60 / gain
    assert gain == pytest.approx(15.2536 + 1.9619 * swing_V - 0.1013 * swing_V**2, rel=1e-4)
    theta = 1.9238 + 0.7477 * swing_V + 0.0456 * 5 + 0.0047 * swing_V * 5 - 0.0466 * swing_V**2 + 0.0003 * 25
    assert reply.lead_turn32 / 2**32 * 360 == pytest.approx(theta, abs=0.01)


def test_a_new_mode_drops_the_path(bench):
    bench.set_axis()
    bench.set_path()
    bench.set_axis(0, wire.Mode.PID)
    bench.ok(wire.ArmRequest(0))
    assert bench.status_of(wire.StartRequest(1)) == wire.Status.BAD_VALUE


@pytest.mark.parametrize("mask", [0, 8, 255])
def test_start_needs_axes_that_are_there(bench, mask):
    bench.set_axis()
    bench.set_path()
    bench.ok(wire.ArmRequest(0))
    assert bench.status_of(wire.StartRequest(mask)) == wire.Status.BAD_VALUE
    assert bench.status_of(wire.StartRequest(3)) == wire.Status.BAD_VALUE  # y has no path
    bench.ok(wire.StartRequest(1))


def test_paths_of_several_axes_begin_together_and_end_as_asked(bench):
    for axis, ticks in ((0, 100), (1, 250), (2, 0)):
        bench.set_axis(axis)
        assert bench.set_path(axis, ticks=ticks) == wire.Status.OK
    bench.ok(wire.ArmRequest(0))
    start = bench.ok(wire.StartRequest(7)).first_tick
    bench.run(300)
    done = {event.value: event.tick for event in bench.events if event.kind == wire.EventKind.PATH_DONE}
    assert done == {0: start + 99, 1: start + 249}
    moved = bench.dac[start : start + 100].astype(int)
    assert (moved[:, 0] == moved[:, 1]).all()
    assert (moved[:, 0] == moved[:, 2]).all()
    assert len(set(bench.dac[start + 101 :, 0])) == 1  # the last value is held
    assert bench.status().running_axes == 4
    assert bench.state == wire.State.RUNNING


# -------------------------------------------------------------------------------- waveforms


def send_wave(bench, points, axis=0, chunk=256, model_crc=0, path_crc=0):
    data = np.asarray(points, "<i4").tobytes()
    for at in range(0, len(data), 4 * chunk):
        bench.ok(wire.WaveChunkRequest(axis, at // 4, data[at : at + 4 * chunk]))
    return bench.status_of(wire.WaveCommitRequest(axis, crc32(data), model_crc, path_crc))


def test_a_waveform_is_played_point_by_point(bench):
    points = np.random.default_rng(1).integers(0, ONE, 1024, endpoint=True)
    assert send_wave(bench, points) == wire.Status.OK
    assert (
        bench.ok(wire.SnapshotReadRequest(wire.Region.WAVE_X, 1000, 1024)).data
        == points[250:506].astype("<i4").tobytes() + points[506:].astype("<i4").tobytes()[: 1024 - 4 * 256]
    )
    bench.set_axis()
    swing = V // 8  # slow enough for the slew limit
    assert bench.set_path(path=wire.PathKind.WAVE, swing=swing, step=2**54) == wire.Status.OK
    bench.ok(wire.ArmRequest(0))
    start = bench.ok(wire.StartRequest(1)).first_tick
    bench.run(1100)
    expected = np.round(32768 + points / ONE * 3200 / 8)
    assert abs(bench.dac[start : start + 1024, 0] - expected).max() <= 1


def test_a_wave_path_needs_a_whole_waveform(bench):
    wave = {"path": wire.PathKind.WAVE}
    assert refusal(bench, wire.Mode.OPEN, **wave) == wire.Status.BAD_VALUE
    assert send_wave(bench, np.zeros(1024)) == wire.Status.OK
    assert refusal(bench, wire.Mode.OPEN, **wave) == wire.Status.OK
    bench.ok(wire.WaveChunkRequest(0, 0, bytes(4)))  # begun anew, not committed
    bench.ok(wire.ArmRequest(0))
    assert bench.status_of(wire.StartRequest(1)) == wire.Status.BAD_VALUE
    assert bench.ok(wire.SnapshotReadRequest(wire.Region.WAVE_X, 0, 100)).size == 0


def test_bad_waveforms_are_refused(bench):
    def chunk(axis, offset, data):
        return bench.status_of(wire.WaveChunkRequest(axis, offset, data))

    word = (1).to_bytes(4, "little")
    assert chunk(3, 0, word) == wire.Status.BAD_VALUE
    assert chunk(0, 1024, word) == wire.Status.BAD_VALUE
    assert chunk(0, 1023, 2 * word) == wire.Status.BAD_VALUE
    assert chunk(0, 0, b"") == wire.Status.BAD_VALUE
    assert chunk(0, 0, word[:3]) == wire.Status.BAD_VALUE
    assert chunk(0, 0, (ONE + 1).to_bytes(4, "little")) == wire.Status.BAD_VALUE
    assert chunk(0, 0, (-1).to_bytes(4, "little", signed=True)) == wire.Status.BAD_VALUE
    assert chunk(0, 1023, word) == wire.Status.OK
    assert bench.status_of(wire.WaveCommitRequest(0, 1)) == wire.Status.CRC_MISMATCH
    assert bench.status_of(wire.WaveCommitRequest(3, 1)) == wire.Status.BAD_VALUE


STEP = 2**64 // 1000  # 5 Hz
LEARNED = {"swing": 20 * UM, "offset": 5 * UM, "step": STEP}


def learned_for(mode, path):
    return crc32(struct.pack("<BiiQ", mode, path["swing"], path["offset"], path["step"]))


@pytest.fixture
def learned(modelled):
    """Points of a path in mode inverse, learned with the model that is there."""
    model_crc = modelled.status().model_crc
    assert send_wave(modelled, np.zeros(1024), 0, 256, model_crc, learned_for(2, LEARNED)) == wire.Status.OK
    return modelled


@pytest.mark.parametrize(
    ("mode", "other", "status"),
    [
        (wire.Mode.PID, {}, wire.Status.OK),
        (wire.Mode.PID, {"ticks": 77}, wire.Status.OK),
        (wire.Mode.FF_PID, {}, wire.Status.LEARNED_FOR_OTHER),
        (wire.Mode.PID, {"swing": 20 * UM + 1}, wire.Status.LEARNED_FOR_OTHER),
        (wire.Mode.PID, {"offset": 5 * UM - 1}, wire.Status.LEARNED_FOR_OTHER),
        (wire.Mode.PID, {"step": STEP + 1}, wire.Status.LEARNED_FOR_OTHER),
        (wire.Mode.PID, {"step": STEP + 2**40}, wire.Status.LEARNED_FOR_OTHER),
        (wire.Mode.FF_PID, {"path": wire.PathKind.SINE}, wire.Status.OK),
    ],
)
def test_what_was_learned_is_played_for_its_path_and_mode_alone(learned, mode, other, status):
    assert refusal(learned, mode, **{"path": wire.PathKind.WAVE} | LEARNED | other) == status


def test_what_was_learned_is_queued_for_its_path_alone(learned):
    assert learned.set_axis(0, wire.Mode.PID) == wire.Status.OK
    assert learned.set_path(0, path=wire.PathKind.HOLD) == wire.Status.OK
    learned.ok(wire.ArmRequest(0))
    learned.ok(wire.StartRequest(1))
    nothing = wire.Segment(0, 0, 0, 0, 0, 0, 0, 0)
    for more, status in ((1, wire.Status.LEARNED_FOR_OTHER), (0, wire.Status.OK)):
        path = wire.Segment(wire.PathKind.WAVE, 0, LEARNED["swing"] + more, LEARNED["offset"], STEP, 0, 5000, 5000)
        assert learned.status_of(wire.QueueRequest(1, 0, 0, (path, nothing, nothing), 0)) == status


def test_what_was_learned_with_a_model_goes_with_it(learned):
    other = model(hash_byte=7)
    assert learned.upload(other).status == wire.Status.OK
    assert refusal(learned, wire.Mode.PID, path=wire.PathKind.WAVE, **LEARNED) == wire.Status.LEARNED_FOR_OTHER
    assert learned.upload(model()).status == wire.Status.OK
    assert refusal(learned, wire.Mode.PID, path=wire.PathKind.WAVE, **LEARNED) == wire.Status.OK


def test_what_was_learned_is_not_begun_on_a_path_that_was_set_before_it_came(modelled):
    assert send_wave(modelled, np.zeros(1024)) == wire.Status.OK
    assert refusal(modelled, wire.Mode.PID, path=wire.PathKind.WAVE, **LEARNED | {"swing": 30 * UM}) == wire.Status.OK
    model_crc = modelled.status().model_crc
    assert send_wave(modelled, np.zeros(1024), 0, 256, model_crc, learned_for(2, LEARNED)) == wire.Status.OK
    modelled.ok(wire.ArmRequest(0))
    assert modelled.status_of(wire.StartRequest(1)) == wire.Status.LEARNED_FOR_OTHER
    assert modelled.set_path(0, path=wire.PathKind.WAVE, **LEARNED) == wire.Status.OK
    modelled.ok(wire.StartRequest(1))


def test_what_was_learned_with_another_model_is_refused_and_leaves_no_waveform(bench):
    assert send_wave(bench, np.zeros(1024), model_crc=5) == wire.Status.LEARNED_FOR_OTHER
    assert refusal(bench, wire.Mode.OPEN, path=wire.PathKind.WAVE) == wire.Status.BAD_VALUE


def test_points_that_come_later_are_for_any_path(learned):
    assert send_wave(learned, np.zeros(1024)) == wire.Status.OK
    assert refusal(learned, wire.Mode.FF_PID, path=wire.PathKind.WAVE, **LEARNED | {"step": 2 * STEP}) == wire.Status.OK
    assert send_wave(learned, np.zeros(1024), path_crc=5) == wire.Status.OK
    assert refusal(learned, wire.Mode.PID, path=wire.PathKind.WAVE, **LEARNED) == wire.Status.LEARNED_FOR_OTHER
    learned.ok(wire.PointsBeginRequest(1, 0, 0, (ONE, 0, 0)))
    learned.ok(wire.PointsRequest(1, 0, 0, bytes(4 * 200)))
    ring = {"path": wire.PathKind.WAVE, "swing": UM, "offset": 0, "step": 2**54}
    assert learned.set_path(0, **ring) == wire.Status.OK


def test_snapshots_stay_inside_their_region(bench):
    def read(region, offset, length):
        return bench.ask(wire.SnapshotReadRequest(region, offset, length))

    assert read(0, 0, 100).size == 0  # nothing latched yet
    size = bench.ok(wire.StreamStartRequest(1, 1, 1)).state_size
    assert read(0, size - 1, 100).data != b""
    assert read(0, size, 100).data == b""
    assert read(0, size + 1, 1).status == wire.Status.BAD_VALUE
    assert read(0, 2**32 - 1, 1).status == wire.Status.BAD_VALUE
    assert read(5, 0, 1).status == wire.Status.BAD_VALUE
    assert read(0, 0, 2000).status == wire.Status.BAD_VALUE
    assert Bench  # one device a test
