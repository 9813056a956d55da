"""Paths that go on until told otherwise, and the stream that shows them."""

from __future__ import annotations

import numpy as np
import pytest

import phaselead as pl
from phaselead.device import Live


def read_for(live: Live, seconds: float) -> list:
    """What comes within so much of the device's time."""
    found = live.read(0.005)
    while sum(part.ticks for part in found) < seconds * 5000:
        found += live.read(0.005)
    return found


def test_a_path_goes_on_until_it_is_held_and_moves_go_on_from_there():
    with pl.connect() as dev, dev.live("xy") as live:
        dev.play(x="sine:20um@5Hz", y="sine:10um@3Hz", mode="pid")
        seen = read_for(live, 0.6)
        x_um = np.concatenate([part.axes["x"].x_um for part in seen])
        assert np.ptp(x_um) > 15
        assert dev.where().y.moving
        dev.hold()
        assert not dev.where().x.moving
        assert abs(dev.move(x=30).axes["x"].x_um - 30) < 1
        dev.park()
        dev.play("sine:2V@5Hz", mode="open")
        assert dev.where().state == "running"
        with pytest.raises(pl.DeviceRefused, match="the device is running, and holds no axis"):
            dev.play("sine:3V@5Hz", mode="open")


def test_a_path_that_has_ended_moves_no_more():
    """In a mode that looks ahead it was said to move for ever, and a move after it never began."""
    with pl.connect() as dev:
        dev.upload(pl.load("sim://xyz250"))
        dev.play(x="sine:20um@5Hz", y="sine:20um@5Hz", z="sine:20um@5Hz", mode="inverse+pid", duration=0.5)
        dev.device.wait(1)
        assert not dev.where().x.moving
        moved = dev.move(x=30, wait=False)
        dev.device.wait(0.5)
        assert moved.axes["x"].to_um == 30
        assert abs(dev.where().x.x_um - 30) < 0.2


def test_a_run_may_end_in_a_hold_that_moves_go_on_from():
    """Parking is a choice; the axes of the model that were not driven do not stand in the way."""
    with pl.connect() as dev:
        run = dev.track(
            "sine:20um+30um@5Hz", mode="inverse+pid", model=pl.load("sim://xyz250"), duration=0.6, hold=True
        )
        assert len(run.recording.t_s) == 3000
        held = dev.where()
        assert held.state == "running"
        assert held.x.held
        assert abs(held.x.x_um - 30) < 2
        assert not held.y.held
        there = dev.move(x="+5um").axes["x"]
        assert there.to_um - there.from_um == pytest.approx(5)
        assert abs(there.x_um - there.to_um) < 0.1
        dev.park()
        with pytest.raises(pl.BadInput, match="mode open holds no position"):
            dev.track("sine:2V@5Hz", mode="open", hold=True)
        assert dev.where().state == "parked"


def test_what_cannot_be_driven_is_refused_before_anything_moves():
    with pl.connect() as dev:
        for wave, mode in (("sine:60um@5Hz", "open"), ("sine:5V@5Hz", "pid"), ("sine:60um@5Hz", "inverse")):
            with pytest.raises(pl.BadInput):
                dev.play(wave, mode=mode)
        assert dev.where().state == "parked"


def test_every_tick_comes_once_in_the_units_of_a_recording():
    """Samples of a capture come through as they do from the stream itself, and are the same numbers."""
    with pl.connect() as dev, dev.live("x") as live:
        live.read(0.01)
        run = dev.track("sine:20um@5Hz", mode="pid", duration=0.4)
        seen = live.read(0.0)
        first, ticks = run.capture.start_tick, len(run.t_s)
        for column, name in ((run.x_um, "x_um"), (run.u_V, "u_V"), (run.r_um, "r_um")):
            values = np.full(ticks, np.nan)
            for part in seen:
                at = np.arange(part.first_tick, part.first_tick + part.ticks) - first
                values[at[(at >= 0) & (at < ticks)]] = getattr(part.axes["x"], name)[(at >= 0) & (at < ticks)]
            assert np.allclose(values, column, rtol=1e-6, atol=1e-5)


def test_lost_batches_are_counted_and_a_new_stream_is_no_loss():
    with pl.connect("faulty://sim://xyz250#lose=0.0005&seed=3") as dev, dev.live("x") as live:
        seen = read_for(live, 1.0)
        missing, came = sum(part.missing for part in seen), sum(part.ticks for part in seen)
        assert missing > 0
        assert seen[-1].first_tick + seen[-1].ticks == pytest.approx(seen[0].first_tick + came + missing)
    with pl.connect() as dev, dev.live("x") as live:
        read_for(live, 0.1)
        dev.record("sine:1V@5Hz", duration=0.2)
        live.start()
        assert sum(part.missing for part in read_for(live, 0.1)) == 0


def test_what_is_raised_on_the_way_ends_a_capture_and_parks():
    """A stop from elsewhere: it reaches a run of minutes within a read of the port."""

    class Ended(pl.PhaseleadError):
        pass

    def end() -> None:
        live.before_each = None
        raise Ended

    with pl.connect() as dev, dev.live("x") as live:
        live.before_each = end
        with pytest.raises(Ended):
            dev.record("sine:5V@5Hz", duration=600)
        assert dev.where().state == "parked"


@pytest.mark.parametrize("axes", ["", "xx", "q"])
def test_axes_that_make_no_sense(axes):
    with pl.connect() as dev, pytest.raises(pl.BadInput):
        dev.live(axes)
