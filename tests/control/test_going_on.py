"""Paths that go on from where the axes are held, or from another path: without parking and without a kick."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import phaselead as pl
from phaselead.control.moving import Mover
from phaselead.device import NoEdge, PointFeeder, QueuedPaths, Refused, left_running, motion, read_capture, wire
from phaselead.device.left_running import LeftRunning
from phaselead.model.axis import TableView
from phaselead.sim import built_in
from phaselead.sim.replaying import replay

TABLE = TableView(swing_V=(0.1, 9.0), f_Hz=(1.0, 30.0), a_um_per_V=(15.0, 0.1, 0.0), b_deg=(0.0,) * 6, c_um=(0.0,) * 6)
STAGE = built_in("xyz250")
STAGE = STAGE.model_copy(
    update={"axes": {axis: model.model_copy(update={"table": TABLE}) for axis, model in STAGE.axes.items()}}
)
MODES = ["pid", "ff+pid", "inverse", "inverse+pid"]
CODE_V = 20.48 / 2**16
LEAST_UM_PER_V = 10.0
NOISE_V = 0.04
"""Steps that feedback makes of the sensor's noise; the slew limit is 0.2 V a tick."""


@pytest.fixture
def dev():
    with pl.connect() as device:
        device.upload(STAGE)
        yield device


def standing(dev):
    """What a refusal must not change."""
    now = dev.where()
    return now.state, [(one.reference_um, one.target_um, one.held, one.moving, one.queued) for one in now.axes.values()]


def reference(capture, axis="x"):
    return capture.axes[axis].reference / 2**16


def steps(values):
    return np.abs(np.diff(np.asarray(values, float)))


def seen(dev, live, seconds):
    """Samples of so much of the device's time, joined: reference and output of x."""
    parts = live.read(0.005)
    while sum(part.ticks for part in parts) < seconds * 5000:
        assert dev.where().fault == "none"
        parts += live.read(0.005)
    assert sum(part.missing for part in parts) == 0
    return [np.concatenate([getattr(part.axes["x"], name) for part in parts]) for name in ("r_um", "u_V")]


# ---------------------------------------------------------------- recorded and judged as from rest
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(
    "paths",
    [
        {"x": "sine:20um+10um@5Hz"},
        {"x": "triangle:20um+10um@5Hz", "y": "sine:10um+5um@7Hz", "z": "triangle:5um+5um@3Hz"},
    ],
    ids=["sine", "three axes"],
)
def test_a_run_from_a_hold_is_that_from_rest(dev, mode, paths):
    """The same reference in the same ticks on every axis, which the figures are against; it ends parked."""
    rest = dev.track(paths, mode=mode, duration=0.6)
    dev.move(x=30, y=20, z=10, mode=mode)
    run = dev.track(paths, duration=0.6)
    assert dev.where().state == "parked"
    assert run.mode == mode
    assert set(run.recording.axes) == set(paths)
    for axis in paths:
        ours, theirs = run.recording.axes[axis], rest.recording.axes[axis]
        assert np.array_equal(ours.r_um, theirs.r_um)
    for (_, ours), (_, theirs) in zip(run.of_axes(), rest.of_axes(), strict=True):
        assert ours["range_um"] == pytest.approx(theirs["range_um"])
        assert ours["rms_um"] <= 1.5 * theirs["rms_um"] + 0.05


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("from_um", [10, 40])
def test_a_path_is_begun_from_a_hold_without_a_kick(dev, mode, from_um):
    """Neither the output nor the reference takes a larger step on the way into it than the path itself does and, from
    elsewhere, a move there in the time of the join."""
    dev.move(x=from_um, mode=mode)
    noise = NOISE_V / CODE_V if mode.endswith("pid") else 2
    for wave in ("sine:20um+10um@5Hz", "triangle:20um+10um@5Hz"):
        capture = dev.track(wave, duration=0.6, hold=True).capture
        dev.move(x=from_um)
        begun, ended = np.searchsorted(capture.ticks, [capture.start_tick, capture.end_tick])
        r_um, codes = reference(capture), capture.axes["x"].dac
        held = np.flatnonzero(r_um != from_um)[0]
        assert 100 < held < begun
        way_um = 1.875 * (from_um - 10) / (begun - held)
        for values, room in ((r_um, 2**-15 + way_um), (codes, noise + way_um / LEAST_UM_PER_V / CODE_V)):
            own = steps(values[begun:ended]).max()
            assert own > 0
            assert steps(values[: begun + 1]).max() <= own + room


@pytest.mark.parametrize("mode", ["pid", "inverse+pid"])
def test_a_run_from_a_hold_can_be_replayed(dev, mode, tmp_path):
    """The axes that are held beside it and the waveform that came just before included."""
    dev.move(x=40, y=20, mode=mode)
    for at, wave in enumerate(("triangle:20um+10um@5Hz", "triangle:30um@4Hz", "sine:20um@5Hz", "goto:60um")):
        file = tmp_path / f"{at}.h5"
        run = dev.track(wave, duration=0.5, hold=True, output=file)
        assert list(run.recording.axes) == ["x"]
        assert set(run.capture.axes) == {"x", "y", "z"}
        assert pl.replay(file)
        assert read_capture(file).command_log


def test_a_move_along_a_path_begins_where_the_axis_is_held(dev):
    dev.move(x=40)
    run = dev.track("goto:60um@0.1s", duration=0.3, hold=True)
    assert run.r_um[0] == 40
    assert run.r_um[-1] == 60
    assert np.all(np.diff(run.r_um) >= 0)
    assert dev.where().x.target_um == 60


@pytest.mark.parametrize("wave", ["sine:20um+20um@5Hz", "triangle:20um+20um@5Hz"])
@pytest.mark.parametrize("settled", [True, False], ids=["playing", "entering"])
def test_a_move_ends_a_path_that_goes_on(dev, wave, settled):
    """It was refused. The other axis goes on, and a target out of range ends nothing."""
    dev.play(x=wave, y="sine:10um@3Hz")
    if settled:
        dev.device.wait(0.5)
    with pytest.raises(pl.BadInput, match="outside"):
        dev.x.move(900)
    assert dev.where().x.moving
    assert dev.x.move(70).axes["x"].to_um == 70
    now = dev.where()
    assert (now.x.target_um, now.x.on_target, now.y.moving) == (70, True, True)


def test_axes_that_are_held_beside_a_path_stay(dev):
    dev.move(x=40, y=20)
    run = dev.track("sine:20um+30um@5Hz", duration=0.4, hold=True)
    assert set(reference(run.capture, "y")) == {20.0}
    assert dev.where().y.target_um == 20
    dev.play(y="sine:10um+15um@5Hz")
    dev.play(x="triangle:20um+10um@5Hz")
    assert dev.where().y.moving


def test_what_runs_by_itself_is_taken_up_and_recorded(dev):
    """A path from Python that goes on, then a run: the playing axis makes way, and the figures are the run's own."""
    dev.play("triangle:30um@5Hz", mode="inverse+pid")
    run = dev.track("triangle:20um+10um@5Hz", duration=0.6, hold=True)
    assert run.figures["max_um"] < 0.5
    assert replay(run.capture) is None


# ---------------------------------------------------------------- left running
WAYS = [
    ("sine:20um@5Hz", "sine:30um+5um@3Hz"),
    ("sine:20um@5Hz", "triangle:30um+5um@3Hz"),
    ("triangle:20um@5Hz", "sine:30um+5um@3Hz"),
    ("triangle:20um@5Hz", "triangle:30um+5um@3Hz"),
    ("sine:20um@5Hz", "goto:30um"),
    ("goto:60um@0.5s", "sine:20um@5Hz"),
]


@pytest.mark.parametrize(("old", "new"), WAYS)
@pytest.mark.parametrize("mode", ["pid", "inverse+pid"])
def test_a_path_makes_way_for_another_without_a_jump(dev, mode, old, new):
    """The reference is continuous with its velocity, the output without a step; at last the new path is played."""
    with dev.live("x") as live:
        dev.play(old, mode=mode)
        before = seen(dev, live, 0.3)
        dev.play(new)
        after = seen(dev, live, 1.2)
    r_um, u_V = (np.concatenate(parts) for parts in zip(before, after, strict=True))
    corners = 4 * 20 * 5 / 5000 if "triangle" in old + new else 0.0
    assert steps(np.diff(r_um)).max() <= 0.02 + corners
    assert steps(u_V).max() <= steps(r_um).max() / LEAST_UM_PER_V + NOISE_V
    span_um = {"goto:30um": (30, 30), "sine:20um@5Hz": (0, 20)}.get(new, (5, 35))
    assert (r_um[-2500:].min(), r_um[-2500:].max()) == pytest.approx(span_um, abs=0.2)


def test_one_path_after_another_as_fast_as_they_are_asked_for(dev):
    """Joins that are still under way are waited for; the last path is the one that goes on."""
    for wave in ("triangle:20um@5Hz", "sine:20um@5Hz", "triangle:10um+40um@5Hz", "triangle:10um+60um@5Hz"):
        dev.play(wave, mode="inverse+pid")
    dev.device.wait(0.5)
    assert 60 <= dev.where().x.reference_um <= 70


def test_joins_are_over_before_a_run_begins():
    """What is due during a join begins later: its first tick would not be that of the record, and the memory of a
    waveform that is being left is not free."""
    with pl.connect() as dev:
        for wave in ("triangle:20um@5Hz", "sine:20um+10um@5Hz", "triangle:20um+20um@5Hz", "sine:20um+40um@5Hz"):
            dev.play(wave, mode="pid")
        run = dev.track("sine:10um+30um@5Hz", duration=0.4)
        assert run.r_um[0] == 30
        assert run.r_um[500] == 40


def test_a_path_with_an_end_is_held_there_and_goes_on(dev):
    dev.play("triangle:20um+10um@10Hz", mode="inverse+pid", duration=0.3)
    dev.play("triangle:20um+30um@10Hz", duration=0.3)
    dev.device.wait(1)
    assert not dev.where().x.moving
    run = dev.track("triangle:20um+10um@5Hz", duration=0.4)
    assert run.figures["max_um"] < 1


def test_gains_are_taken_with_a_path(dev):
    dev.move(x=20, mode="inverse+pid")
    dev.play("sine:20um+10um@5Hz", gains=(0, 20, 2e-5))
    assert dev._mover.gains["x"].ki_V_per_um_s == 20
    run = dev.track("sine:20um+10um@5Hz", duration=0.4, gains={"x": (0, 15, 2e-5)}, hold=True)
    assert [dev._mover.gains[axis].ki_V_per_um_s for axis in "xyz"] == [15, 20, 20]
    assert replay(run.capture) is None


def test_a_learned_table_is_played_from_a_hold(dev):
    wave = "sine:20um+10um@10Hz"
    learned = dev.learn(wave, mode="inverse+pid", trials=2)
    dev.move(x=20, mode="inverse+pid")
    run = dev.track(wave, learned=learned, hold=True)
    assert {axis: dev._mover.gains[axis] for axis in "x"} == learned.gains()
    assert run.figures["rms_um"] < 0.05


def test_a_path_in_points_goes_on_from_a_hold(dev, tmp_path):
    file = tmp_path / "scan.csv"
    t_s = np.linspace(0, 1.0, 501)
    np.savetxt(file, np.column_stack([t_s, 20 + 10 * np.sin(6 * t_s)]), delimiter=",", header="t_s,x_um", comments="")
    dev.move(x=30, mode="inverse+pid")
    for _ in range(2):  # the second where the first has played its ring
        run = dev.track(f"path:{file}", hold=True)
        assert run.figures["max_um"] < 0.5
        assert replay(run.capture) is None
    with pytest.raises(pl.BadInput, match="sent by `track`"):
        dev.play(f"path:{file}")
    assert dev.where().x.held


@pytest.mark.parametrize("asked", [{}, {"trigger_in": 5}])
def test_a_path_in_points_waits_for_an_axis_that_comes_from_afar(tmp_path, asked):
    """The device was given points of the time that x alone needs for its join, and refused its path with a riddle."""
    file = tmp_path / "scan.csv"
    t_s = np.linspace(0, 1.0, 51)
    np.savetxt(file, np.column_stack([t_s, 20 + 5 * np.sin(3 * t_s)]), delimiter=",", header="t_s,x_um", comments="")
    with pl.connect("sim://xyz250?trigger=2s") as dev:
        dev.move(x=20, y=0, mode="pid")
        run = dev.track(x=f"path:{file}", y="sine:20um+120um@5Hz", duration=0.9, **asked)
        assert run.recording.axes["x"].r_um[0] == pytest.approx(20, abs=0.01)
        assert run.recording.axes["y"].r_um[0] == pytest.approx(120, abs=0.01)
        assert replay(run.capture) is None


def test_trigger_outputs_count_on_the_new_path(dev):
    dev.move(x=20, mode="pid")
    run = dev.track("triangle:20um+10um@5Hz", duration=1, hold=True, trigger_out="line,target")
    assert run.figures["triggers"]["line"] == 5
    assert run.triggers["line"] == pytest.approx(np.arange(5) / 5)
    assert replay(run.capture) is None


def test_an_edge_begins_a_path_out_of_a_hold():
    with pl.connect("sim://xyz250?trigger=1s") as dev:
        dev.move(x=20, mode="pid")
        run = dev.track("triangle:20um+10um@5Hz", duration=0.4, hold=True, trigger_in=5)
        assert run.r_um[0] == pytest.approx(10, abs=1e-3)
        assert replay(run.capture) is None


def test_without_an_edge_the_axes_hold_where_they_were(dev):
    dev.move(x=20, mode="pid")
    before = standing(dev)
    with pytest.raises(pl.DeviceRefused, match="no edge came"):
        dev.track("sine:20um@5Hz", trigger_in=0.5)
    assert standing(dev) == before
    assert dev.move(x=30).axes["x"].to_um == 30


def test_no_later_edge_begins_what_was_given_up():
    """It stayed queued, and began while somebody thought the axis held."""
    with pl.connect("sim://xyz250?trigger=2s") as dev:
        dev.move(x=20, mode="pid")
        path = dev.device.path_segment("x", "sine", swing=5, offset=20, f_Hz=2, enter_ticks=250, leave_ticks=250)
        queued = QueuedPaths(motion.queue_request({"x": path}, at_trigger=True), 250, None, 0.3)
        with dev._mover.without_limits(), pytest.raises(NoEdge):
            dev.device.capture(1000, queued=queued)
        dev.device.wait(3)
        now = dev.where()
        assert now.tick > 2 * 5000
        assert (now.state, now.x.reference_um, now.x.moving, now.x.queued) == ("running", 20, False, 0)


# ---------------------------------------------------------------- refused: held where they were
def test_what_is_refused_after_a_path_has_begun_parks(dev, tmp_path, monkeypatch):
    """Nothing had moved, it was thought: x went on along what it had of a path that nobody sent any more."""
    file = tmp_path / "scan.csv"
    t_s = np.linspace(0, 3.0, 1501)
    np.savetxt(file, np.column_stack([t_s, 20 + 10 * np.sin(6 * t_s)]), delimiter=",", header="t_s,x_um", comments="")
    feed, calls = PointFeeder.feed, []

    def refused(self):
        calls.append(dev.where().x.moving)
        if len(calls) > 20:
            raise Refused("points", wire.Status.BAD_VALUE)
        feed(self)

    monkeypatch.setattr(PointFeeder, "feed", refused)
    dev.move(x=30, mode="inverse+pid")
    with pytest.raises(Refused):
        dev.track(f"path:{file}", hold=True, force=True)
    assert calls[-1]
    assert dev.where().state == "parked"


@pytest.mark.parametrize("way", ["play", "track"])
@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"mode": "inverse"}, "held in mode inverse[+]pid; park"),
        ({"mode": "open", "x": "sine:2V@5Hz"}, "held in mode inverse[+]pid; park"),
        ({"y": "sine:20um@5Hz"}, "axis y is not held"),
        ({"model": STAGE.model_copy(update={"name": "other"})}, "held by another model than other"),
        ({"gains": (0, 300, 0)}, "not stable"),
        ({"x": "sine:400um@5Hz"}, "outside"),
        ({"x": "triangle:100um@100Hz", "gains": (0, 25, 2e-5)}, "on the model this"),
        ({"x": "sine:5V@5Hz"}, "volts need --mode open"),
        ({"x": 5}, "5 is no path"),
        ({"gains": {"z": (0, 20, 2e-5)}}, "gains for axis z, which is not held"),
        ({"x": "sine:20um@5Hz", "duration": 1e-5}, "shorter than one tick"),
    ],
)
def test_what_is_refused_leaves_the_axes_held(way, asked, said):
    with pl.connect() as dev:
        dev.move(x=40, mode="inverse+pid", model=STAGE.model_copy(update={"axes": {"x": STAGE.axes["x"]}}))
        if "model" in asked:
            asked = asked | {"model": asked["model"].model_copy(update={"axes": {"x": STAGE.axes["x"]}})}
        before, gains = standing(dev), dict(dev._mover.gains)
        with pytest.raises(pl.BadInput, match=said) as refusal:
            getattr(dev, way)(**({} if "y" in asked else {"x": "sine:20um@5Hz"}) | asked)
        assert "\n" not in str(refusal.value)
        assert standing(dev) == before
        assert dev._mover.gains == gains
        assert dev.move(x=41).axes["x"].to_um == 41


@pytest.mark.parametrize("plays", [False, True], ids=["held", "playing"])
def test_a_move_and_a_sine_do_not_begin_in_the_same_tick_out_of_a_hold(dev, plays):
    dev.move(x=20, y=20)
    if plays:
        dev.play(x="triangle:10um+15um@5Hz", y="sine:10um+15um@5Hz")
    before = standing(dev)
    with pytest.raises(pl.BadInput, match="cannot begin in the same tick"):
        dev.track(x="goto:30um", y="sine:20um@5Hz")
    now = standing(dev)
    assert [one[2:] for one in now[1]] == [one[2:] for one in before[1]]
    assert plays or now == before


def test_a_path_that_cannot_be_left_running_is_refused_while_another_goes_on(dev, tmp_path):
    """It brought the axis to a hold first."""
    (tmp_path / "scan.csv").write_text("t_s,x_um\n" + "".join(f"{t / 100:g},{20 + t % 50 / 10}\n" for t in range(200)))
    dev.move(x=20)
    dev.play("triangle:10um+15um@5Hz")
    with pytest.raises(pl.BadInput, match="to leave one running use file:"):
        dev.play(f"path:{tmp_path}/scan.csv")
    assert dev.where().x.moving


def test_older_firmware_is_not_asked_for_what_it_cannot_do(dev, monkeypatch):
    dev.move(x=20)
    monkeypatch.setattr(dev.device, "hello", replace(dev.device.hello, wire_revision=4))
    with pytest.raises(pl.BadInput, match="phaselead flash"):
        dev.track("triangle:20um@5Hz")
    assert dev.where().x.held


@pytest.mark.parametrize("way", ["play", "track"])
@pytest.mark.parametrize("wave", ["sine:40um+10um@5Hz", "triangle:40um+10um@5Hz"])
def test_what_the_device_itself_refuses_leaves_the_axes_held(way, wave):
    """Its hard limits, which no model knows of: gains are those of before, moves are held against their limits again,
    and the next path goes on."""
    with pl.connect() as dev:
        dev.set_limits("x", x_min_um=-5, x_max_um=45)
        dev.move(x=20, mode="pid")
        before, gains = standing(dev), dict(dev._mover.gains)
        with pytest.raises(pl.DeviceRefused, match="outside_limits"):
            getattr(dev, way)(wave, gains=(0, 20, 2e-5))
        assert standing(dev) == before
        assert dev._mover.gains == gains
        with pytest.raises(pl.DeviceRefused, match="faster than its limits"):
            motion.queue(dev.device, {"x": motion.move_segment(40, 0.002)})
        run = dev.track("triangle:20um+10um@5Hz", duration=0.4)
        assert replay(run.capture) is None


def test_a_path_that_is_faster_than_moves_may_be_goes_on_as_it_does_from_rest():
    """Without a model moves keep to 1000 um/s."""
    with pl.connect() as dev:
        dev.move(x=20, mode="pid", gains="paper")
        run = dev.track("sine:40um@10Hz", duration=0.5, hold=True)
        assert steps(run.r_um).max() * 5000 > 1000
        with pytest.raises(pl.DeviceRefused, match="faster than its limits"):
            motion.queue(dev.device, {"x": motion.move_segment(40, 0.002)})


def test_a_window_that_was_chosen_outlives_a_run(dev):
    dev.move(x=20, window=5.0)
    dev.track("sine:20um+10um@5Hz", duration=0.4, hold=True, trigger_out="target")
    assert dev.move(x=20).axes["x"].window_um == 5.0


# ---------------------------------------------------------------- bookkeeping
@pytest.mark.parametrize("way", ["play", "track"])
def test_a_join_is_as_long_as_the_way_from_where_the_last_path_is(way):
    """Two paths ago the axis went elsewhere, and the join was sized from there."""
    with pl.connect() as dev:
        dev.play("sine:5um@5Hz", mode="pid")
        dev.device.wait(0.5)
        if way == "play":
            dev.play("sine:150um+60um@1Hz", duration=20)
            dev.device.wait(1.3)
            while dev.where().x.reference_um < 150:
                dev.device.wait(0.02)
        else:
            dev.track("sine:150um+60um@1Hz", duration=1.4, hold=True)
        assert dev.where().x.reference_um > 150
        with dev.live("x") as live:
            dev.play("sine:5um@5Hz")
            r_um, _ = seen(dev, live, 0.8)
        assert steps(r_um).max() * 5000 < 1.2 * 1000


def test_gains_that_are_asked_for_are_sent(dev):
    """After a program before had chosen others the usual ones were taken for those of the device, and not sent."""
    dev.move(x=20, mode="pid", gains=(0, 20, 2e-5))
    dev._mover = Mover(dev.device)
    dev.take_up(LeftRunning(dev.device.session.nonce, 0, "pid", "x", None))
    sent = []
    dev.device.set_gains = lambda axis, gains: sent.append((axis, gains))
    dev.play("sine:20um+10um@5Hz", gains=dev._mover.gains)
    assert [axis for axis, _ in sent] == ["x"]


def test_gains_outlive_the_program_that_chose_them(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.setattr(left_running, "is_virtual", lambda url: False)
    with pl.connect() as dev:
        dev.move(x=20, y=5, mode="pid", gains=(0, 20, 2e-5))
        chosen = dict(dev._mover.gains)
        dev.leave_running()
        left = left_running.recall(dev.device.session.name)
        dev._mover = Mover(dev.device)
        dev.take_up(left)
        assert dev._mover.gains == chosen
        assert dev._mover.gains_given
        dev.take_up(replace(left, gains={"x": {"kp_V_per_um": "much"}}))
        assert dev._mover.gains["x"] != chosen["x"]
        dev.park()


@pytest.mark.parametrize("way", ["play", "track"])
def test_what_goes_on_from_a_session_that_was_left_has_its_host_timeout(dev, way):
    """It was left without one, so that the stage went on when the program was killed."""
    dev.move(x=20, mode="pid")
    dev.leave_running()
    told = []
    dev.device.set_timeout = told.append
    dev.track("sine:20um+10um@5Hz", duration=0.4, hold=True) if way == "track" else dev.play("sine:20um+10um@5Hz")
    assert told == [5000]


def test_a_waveform_that_a_program_before_left_playing_is_recorded(dev):
    """What it plays is not known to the next program: it holds first, and a capture reads the points all the same."""
    dev.play("triangle:20um@5Hz", mode="pid")
    dev.device._waves.clear()
    dev._mover = Mover(dev.device)
    dev.take_up(LeftRunning(dev.device.session.nonce, 0, "pid", "x", None))
    listened = dev.device.capture(500, start=False, park=False)
    assert replay(listened) is None
    dev.play("triangle:20um+10um@5Hz")
    assert dev.where().x.moving


def test_a_join_is_all_it_takes_where_it_can_be(monkeypatch):
    """A hold is not brought to a hold, nor is a sine that gives way to another path."""
    with pl.connect() as dev:
        dev.move(x=20, mode="pid")
        monkeypatch.setattr(Mover, "hold", lambda *_given: pytest.fail("it holds already"))
        dev.track("triangle:20um+10um@5Hz", duration=0.4, hold=True)
        for wave in ("sine:20um+10um@5Hz", "sine:20um+20um@5Hz", "triangle:20um@5Hz", "sine:20um@3Hz"):
            dev.play(wave)
        assert dev.where().x.moving


# ---------------------------------------------------------------- what the stage has been through
@pytest.mark.parametrize("again", ["the same", "another", "none"])
def test_an_upload_keeps_what_the_stage_has_been_through(again):
    """The inverse began as after a start: of 30 um it was 3.5 um off, where 0.04 um were predicted."""
    with pl.connect() as dev:
        dev.upload(STAGE)
        dev.x.move(100)
        dev.park()
        if again != "none":
            axes = STAGE.axes if again == "the same" else {axis: STAGE.axes[axis] for axis in "xy"}
            dev.upload(STAGE.model_copy(update={"name": again, "axes": axes}))
        assert dev.track("sine:30um@20Hz", mode="inverse", duration=0.5).figures["max_um"] < 0.4
