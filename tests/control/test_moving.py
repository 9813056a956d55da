"""Moves one after another without parking, holds, and what is refused before anything moves."""

import threading

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import phaselead as pl
from phaselead.control import hold_and_move, keep_alive, motion_limits
from phaselead.control.feedback_loop import HOLD_S
from phaselead.control.hold_and_move import HoldsAndMoves
from phaselead.control.moving import stop_s
from phaselead.control.targets import Target, parse_target, parse_targets
from phaselead.device import TICK_HZ, MotionLimits, Where, left_running, motion, recall, remember, wire
from phaselead.device.left_running import LeftRunning
from phaselead.model import AxisModel
from phaselead.sim import built_in


@pytest.fixture(scope="module")
def stage():
    return built_in("xyz250")


@pytest.fixture
def dev(stage):
    with pl.connect() as device:
        device.upload(as_fitted(stage))
        yield device


def test_two_moves_in_a_row_without_parking(dev):
    states = []
    for target in (80, 20, "+5um"):
        moved = dev.x.move(target, duration=0.02).axes["x"]
        states.append(dev.status().state)
        assert abs(moved.x_um - moved.to_um) < 3 * moved.window_um
        assert moved.duration_s <= moved.settled_s < 0.1
    assert states == ["running"] * 3
    assert dev.x.where().target_um == 25


def test_what_the_rehearsal_says_comes_true(dev):
    """On the very model: to two periods of its mode."""
    dev.x.move(10)
    moved = dev.x.move(60).axes["x"]
    assert abs(moved.predicted_s - moved.settled_s) < 0.01


def test_axes_arrive_together(dev):
    dev.move(x=10, y=10, z=10)
    moved = dev.move(x=60, y="+1um")
    assert moved.axes["x"].duration_s == moved.axes["y"].duration_s
    found = dev.where()
    assert [round(found.axes[axis].target_um, 3) for axis in "xyz"] == [60, 11, 10]
    assert (found.x.on_target, found.y.on_target) == (True, True)


def as_fitted(stage):
    """The delay of a model counts from the lines between rows; a stage of the simulator holds and latches besides."""

    def late(model):
        return model.model_copy(update={"time": model.time.model_copy(update={"delay_s": model.time.delay_s + HOLD_S})})

    return stage.model_copy(update={"axes": {axis: late(model) for axis, model in stage.axes.items()}})


def arrived_s(reference_um, x_um, to_um):
    """From the last tick of rest until the sensor shows the target to 0.1 um for good."""
    begin = np.argmax(np.abs(reference_um - reference_um[0]) > 1e-3) - 1
    assert begin >= 0
    assert reference_um[0] == pytest.approx(to_um - 100, abs=0.1)
    return (np.flatnonzero(np.abs(x_um - to_um) > 0.1)[-1] + 1 - begin) / TICK_HZ


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("way", ["path", "queue"])
@pytest.mark.parametrize("mode", ["inverse", "inverse+pid"])
def test_a_hundred_micrometres_are_there_to_a_thousandth_in_twelve_milliseconds(stage, mode, way, seed):
    """Measured with the stage's own model, as a fit gives it: with one that knows nothing of the 0.13 ms of hold and
    latch feedback takes up what the reference runs ahead, and lets go of it for 5 ms after the move."""
    with pl.connect(f"sim://xyz250?seed={seed}") as device:
        device.upload(as_fitted(stage))
        if way == "path":
            run = device.track("goto:100um@0.01s", mode=mode, duration=0.1)
            assert arrived_s(run.r_um, run.x_um, run.r_um[-1]) <= 0.012
        else:
            device.move(x=10, mode=mode)
            device.x.move(110, duration=0.01, wait=False)
            taken = device.device.capture(200, start=False, park=False)
            found = taken.axes["x"]
            x_um = device.device.converters()["x"].x_um(found.adc)
            assert arrived_s(found.reference / 2**16, x_um, 110) <= 0.012


def test_moves_queue_behind_each_other(dev):
    dev.x.move(10)
    dev.x.move(60, duration=0.2, wait=False)
    dev.x.move(20, duration=0.2, wait=False)
    assert dev.x.where().target_um == 20
    dev.device.wait(0.5)
    assert abs(dev.x.where().x_um - 20) < 0.2


def test_a_move_begins_in_the_tick_that_was_asked_for(dev):
    dev.x.move(10)
    tick = dev.where().tick
    dev.move(x=60, duration=0.05, begin_tick=tick + 2000, wait=False)
    dev.move(x=20, duration=0.05, begin_tick=tick + 6000, wait=False)
    seen = []
    while (now := dev.where()).tick < tick + 8000:
        seen.append((now.tick - tick, now.x.reference_um))
        dev.device.session.pump(64)
    assert {um for at, um in seen if at < 2000} == {10}
    assert {um for at, um in seen if 2300 < at < 6000} == {60}
    assert {um for at, um in seen if at > 6400} == {20}
    moved = dev.move(x=40, duration=0.05, begin_tick=dev.where().tick + 2000)
    assert 0.05 <= moved.axes["x"].settled_s < 0.2
    with pytest.raises(pl.DeviceRefused, match="begin_tick has passed"):
        dev.move(x=60, begin_tick=5)


def test_hold_stops_a_move(dev):
    dev.x.move(10)
    dev.x.move(150, duration=0.5, wait=False)
    dev.device.wait(0.25)
    stopped = dev.hold().x
    assert 60 < stopped.target_um < 110
    assert abs(stopped.x_um - stopped.target_um) < 0.5
    assert not stopped.moving


def test_hold_stops_a_move_that_is_as_fast_as_the_limits_allow():
    """It was refused: the queue's bound of the join to a hold is above the limit that the move itself takes."""
    with pl.connect() as dev:
        dev.x.move(10)
        moved = dev.x.move(150, wait=False).axes["x"]
        dev.device.wait(moved.duration_s / 3)
        stopped = dev.hold().x
        assert 12 < stopped.target_um < 110
        assert abs(stopped.x_um - stopped.target_um) < 0.5
        with pytest.raises(pl.DeviceRefused, match="faster than its limits"):  # which hold again
            motion.queue(dev.device, {"x": motion.move_segment(200, moved.duration_s / 10)})


limit = st.one_of(st.just(0.0), st.floats(1e2, 1e9))


@given(limit, limit, limit)
def test_a_stop_keeps_the_limits_of_acceleration_and_jerk(v, a, j):
    """From a steady velocity: the join, differentiated on paper (docs/firmware.md has w)."""
    T = stop_s(MotionLimits(v, a, j))
    s = np.linspace(0, 1, 2001)
    w, w1 = 10 * s**3 - 15 * s**4 + 6 * s**5, 30 * s**2 * (1 - s) ** 2
    w2, w3 = 60 * s - 180 * s**2 + 120 * s**3, 60 - 360 * s + 360 * s**2
    assert np.abs((1 - w) + w1 * (0.5 - s)).max() < 1.18
    assert not a or np.abs(-2 * w1 + w2 * (0.5 - s)).max() * v / T <= a * (1 + 1e-9)
    assert not j or np.abs(-3 * w2 + w3 * (0.5 - s)).max() * v / T**2 <= j * (1 + 1e-9)


def test_where_a_move_may_go_and_how_long_it_takes(dev):
    dev.hold()
    low, high = dev.range_um("x")
    for end in (low, high):
        assert dev.plan(x=end).target_um == {"x": end}
    for beyond in (low - 0.1, high + 0.1):
        with pytest.raises(pl.BadInput, match="outside"):
            dev.plan(x=beyond)
    planned = dev.plan(x="+20um")
    assert dev.where().x.target_um == planned.start_um["x"]
    assert dev.x.move("+20um").axes["x"].duration_s == planned.duration_s


def test_a_path_of_a_length_is_held_at_its_end(dev):
    dev.play("sine:20um+10um@50Hz", mode="pid", duration=0.1)
    assert dev.where().x.moving
    dev.device.wait(0.5)
    ended = dev.where()
    assert (ended.state, ended.x.moving, ended.x.held) == ("running", False, True)


def test_hold_arms_a_parked_device(dev):
    found = dev.hold()
    assert (found.state, found.x.held) == ("running", True)
    assert abs(found.x.reference_um) < 0.1


@pytest.mark.parametrize(
    ("target", "how", "words"),
    [
        ({"x": 400}, {}, "outside"),
        ({"x": -30}, {}, "outside"),
        ({"x": 60}, {"duration": 0.001}, "the shortest is"),
        ({"x": 60}, {"speed": 1e6}, "the shortest is"),
        ({"x": 60}, {"speed": -1}, "above 0"),
        ({"x": 60}, {"duration": -1}, "above 0"),
        ({"x": True}, {}, "give a place"),
        ({"x": "5V"}, {}, "takes micrometres"),
        ({"x": "near"}, {}, "is no number"),
        ({"x": float("nan")}, {}, "give a place"),
        ({}, {}, "where to"),
        ({"x": 5}, {"mode": "open"}, "holds no position"),
    ],
)
def test_what_cannot_be_is_refused_before_it_moves(dev, target, how, words):
    with pytest.raises(pl.BadInput, match=words):
        dev.move(**target, **how)
    assert dev.where().state == "parked"


def test_what_ends_a_held_axis_is_said_to_who_would_learn(dev):
    """It said that set_axis was refused, "not in this state"."""
    dev.move(x=20)
    with pytest.raises(pl.DeviceRefused, match=r"held or driven, .*dev.park\(\)"):
        dev.learn("sine:20um@5Hz", trials=1)
    assert dev.where().x.held
    dev.park()
    assert dev.track("sine:20um@5Hz", mode="inverse+pid", duration=0.2).figures["max_pct"] < 1


def test_the_shortest_that_an_error_names_is_kept(dev):
    with pytest.raises(pl.BadInput, match="shortest is") as refusal:
        dev.move(x=60, duration=0.001)
    named_ms = float(str(refusal.value).partition("shortest is ")[2].split()[0])
    assert dev.move(x=60, duration=named_ms / 1e3).axes["x"].duration_s == pytest.approx(named_ms / 1e3)


def test_a_mode_or_an_axis_is_chosen_with_the_first_move():
    with pl.connect() as device:
        device.move(x=20, mode="pid")
        with pytest.raises(pl.BadInput, match="held in mode pid"):
            device.move(x=30, mode="ff")
        with pytest.raises(pl.BadInput, match="axis y is not held"):
            device.move(y=30)
        device.park()
        assert device.move(y=30).axes["y"].to_um == 30


def test_a_model_is_chosen_with_the_first_move(stage):
    """Another one was taken for the limits, the window and the prediction, while the device went on with the first."""
    other = stage.model_copy(update={"name": "other"})
    with pl.connect() as device:
        device.move(x=20, model=stage)
        with pytest.raises(pl.BadInput, match=r"held by another model than other .*; park .*--park"):
            device.move(x=30, model=other)
        assert device.where().axes["x"].target_um == 20
        assert device.move(x=30, model=stage).axes["x"].to_um == 30
        assert device.model == stage
        device.park()
        device.move(x=25, model=other)
        assert device.model == other


def test_a_model_is_not_chosen_after_a_move_without_one(stage):
    with pl.connect() as device:
        device.move(x=20)
        with pytest.raises(pl.BadInput, match="held by another model"):
            device.move(x=30, model=stage.model_copy(update={"axes": {"x": stage.axes["x"]}}))


def test_a_loop_that_the_model_cannot_stand_is_refused(dev):
    with pytest.raises(pl.BadInput):
        dev.move(x=20, mode="pid", gains=(0.3, 500, 0))
    assert dev.status().state == "parked"


def test_the_reference_keeps_the_limits_of_the_stage(dev, stage):
    """Velocity, acceleration and jerk of two moves as recorded, against the limits that were derived from the model."""
    dev.x.move(10)
    limits = motion_limits.motion_limits(stage.axes["x"])
    dev.x.move(60, wait=False)
    dev.x.move(20, wait=False)
    run = dev.device.capture(400, start=False, park=False)
    reference = run.axes["x"].reference / 2**16
    for order, limit in enumerate((limits.velocity_um_per_s, limits.acceleration_um_per_s2, limits.jerk_um_per_s3), 1):
        assert np.abs(np.diff(reference, order)).max() * 5000**order <= limit * 1.01 + 8 * 5000**order / 2**16


def test_limits_of_a_model():
    assert motion_limits.motion_limits(None) == MotionLimits(velocity_um_per_s=1000.0)
    assert motion_limits.motion_limits(AxisModel()) == MotionLimits(velocity_um_per_s=1000.0)
    limits = MotionLimits(1000.0, 0.0, 0.0)
    assert limits.shortest_s(100) == pytest.approx(0.1875, abs=4e-4)
    assert limits.shortest_s(0) == pytest.approx(4e-4)


def test_targets():
    assert parse_targets("x=50um, y=+5um") == {"x": Target(50, False), "y": Target(5, True)}
    assert parse_targets("-500nm", "z") == {"z": Target(-0.5, True)}
    assert parse_target(3) == Target(3.0, False)
    for wrong in ("w=5um", "x=5um,x=6um", "x=5"):
        with pytest.raises(pl.BadInput, match="target"):
            parse_targets(wrong)


def test_where_prints_as_a_table(dev):
    text = str(dev.where())
    assert "parked" in text
    assert isinstance(dev.where(), Where)
    assert set(dev.where().as_dict()["axes"]) == {"x", "y", "z"}
    with pytest.raises(AttributeError):
        dev.where().w  # noqa: B018


def test_a_queue_that_ran_dry_is_flagged(dev):
    dev.move(x=20)
    motion.queue(dev.device, {"x": motion.move_segment(30.0, 0.05, more=True)})
    dev.device.wait(0.3)
    assert "ran dry" in str(dev.where())
    assert (dev.where().x.reference_um, dev.where().x.held) == (30, True)
    dev.move(x=10)
    assert "ran dry" not in str(dev.where())


# ---------------------------------------------------------------- between two calls
class Asked:
    """A session that only counts."""

    def __init__(self):
        self.virtual, self.lock, self.count = False, threading.RLock(), 0
        self.three = threading.Event()

    def request(self, command):
        assert isinstance(command, wire.StatusRequest)
        self.count += 1
        if self.count == 3:
            self.three.set()


def test_the_device_is_kept_alive_between_two_cells(monkeypatch):
    monkeypatch.setattr(keep_alive, "PERIOD_S", 0.001)
    session = Asked()
    alive = keep_alive.KeepAlive(session)
    alive.begin()
    assert session.three.wait(10)
    alive.end()
    counted = session.count
    with session.lock:
        assert session.count == counted
    alive.end()


def test_a_device_that_was_away_is_kept_alive_again(monkeypatch):
    """The first error of the line ended it for good: the device parked a second after the next move."""
    monkeypatch.setattr(keep_alive, "PERIOD_S", 0.001)
    session, failed = Asked(), threading.Event()

    def fail(command):
        failed.set()
        raise pl.LinkError("gone")

    alive, answers = keep_alive.KeepAlive(session), session.request
    session.request = fail
    alive.begin()
    assert failed.wait(10)
    alive._thread.join(10)
    session.request = answers
    alive.begin()
    assert session.three.wait(10)
    alive.end()


def test_a_session_that_was_left_running_is_taken_up_by_port(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    left = LeftRunning(7, 12, "pid", "x", None)
    remember("/dev/ttyX", left)
    assert recall("/dev/ttyX") == left
    assert recall("/dev/ttyY") is None
    remember("sim://xyz250", left)
    assert recall("sim://xyz250") is None
    remember("/dev/ttyX", None)
    assert recall("/dev/ttyX") is None
    (tmp_path / "phaselead" / "sessions.json").write_text("{")
    assert recall("/dev/ttyX") is None


def test_the_next_program_goes_on_where_the_last_one_left(dev):
    dev.move(x=40, mode="pid")
    next_one = HoldsAndMoves(dev.device)
    next_one.take_up(LeftRunning(dev.device.session.nonce, 0, "pid", "xyz", None))
    assert next_one.x.move("+2um", duration=0.1).axes["x"].to_um == 42


def test_a_session_that_is_parked_on_the_way_out_is_forgotten(tmp_path, monkeypatch):
    """It stayed written down as left running."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.setattr(left_running, "is_virtual", lambda url: False)
    name = "sim://xyz250"
    with pl.connect(name) as device:
        device.move(x=20, mode="pid")
        left = LeftRunning(device.device.session.nonce, 0, "pid", "x", None)
        remember(name, left)
        device.take_up(left)
        assert recall(name) == left
    assert recall(name) is None
    with pl.connect(name) as device:
        device.move(x=20, mode="pid")
        device.leave_running()
    assert recall(name).axes == "x"


def test_joins_have_a_longest():
    with pytest.raises(pl.BadInput, match="at most"):
        motion.join_ticks(20.0)


def test_new_gains_are_taken_while_it_holds_and_while_it_moves(dev, stage):
    """Without a jump of the output."""
    dev.move(x=40, mode="inverse+pid")
    with dev.live("x") as live:
        live.read(0.02)
        dev.set_gains((0, 20, 2e-5))
        before = live.read(0.02)
        dev.x.move(60, wait=False)
        dev.set_gains((0, 25, 2.4e-5))
        after = live.read(0.1)
        dev.x.move(40, wait=False)
        undisturbed = live.read(0.1)
    held = np.concatenate([part.axes["x"].u_V for part in before])
    assert np.ptp(held) < 0.05
    of_both = [np.concatenate([part.axes["x"].u_V for part in parts]) for parts in (after, undisturbed)]
    changed, own = (np.abs(np.diff(u)).max() for u in of_both)
    assert changed < own + 0.02
    assert dev.device.session.request(wire.WhereRequest()).fault == 0
    kept = dict(dev._mover.gains)
    with pytest.raises(pl.BadInput, match="not stable"):
        dev.set_gains((0, 300, 0))
    assert dev._mover.gains == kept
    assert dev.x.move(50, duration=0.1).axes["x"].settled_s is not None


def test_gains_of_a_later_move_are_not_taken_for_nothing(dev):
    """They were."""
    dev.move(x=40, mode="pid")
    dev.move(x=41, gains=(0, 20, 2e-5))
    assert dev._mover.gains["x"].ki_V_per_um_s == 20
    with pytest.raises(pl.DeviceRefused, match="no axis is held"):
        pl.connect("sim://xyz250").set_gains((0, 20, 2e-5))


@pytest.mark.parametrize(
    ("asked", "said"),
    [({"trigger_out": "nothing"}, "nothing"), ({"duration": "1us"}, "unit of s"), ({}, "on the model")],
)
def test_a_move_that_is_refused_changes_no_window(monkeypatch, dev, stage, asked, said):
    """On target was counted by the window of the move that was not made."""

    def refused(*_given):
        raise pl.BadInput("on the model it ends in a fault")

    dev.move(x=20, window=0.5, model=stage)
    if not asked:
        monkeypatch.setattr(hold_and_move, "rehearse_move", refused)
    with pytest.raises(pl.BadInput, match=said):
        dev.move(x=30, window=5.0, **asked)
    monkeypatch.undo()
    assert dev.move(x=25).axes["x"].window_um == 0.5


def test_a_move_is_rehearsed_by_the_window_it_is_given(dev, stage):
    narrow, wide = (dev.move(x=to, window=window, model=stage).axes["x"] for to, window in ((20, 1e-4), (40, 15.0)))
    assert narrow.predicted_s is None
    assert wide.predicted_s == wide.duration_s
