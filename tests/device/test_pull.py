"""What the recorder that is always on froze, as a recording."""

from dataclasses import replace

import numpy as np
import pytest

from phaselead.control import connect
from phaselead.device import TICK_HZ, wire
from phaselead.device.capture import DeviceFault
from phaselead.device.session import NoReplyError
from phaselead.device.transient import ENTRY
from phaselead.errors import BadInput, DeviceRefused, LinkError
from phaselead.record import t0_unix_s

URL = "sim://xyz250"


def test_a_fault_is_kept_without_a_stream_or_a_word():
    with connect(URL) as device:
        with pytest.raises(DeviceFault) as caught:
            device.track("sine:60um@5Hz", mode="pid", gains=(0.1, 8.62, 0), force=True)
        pulled, captured = device.pull(), caught.value.capture
    tick = captured.status.fault_tick
    assert (pulled.meta["trigger"], pulled.meta["trigger_tick"], pulled.meta["gaps"]) == ("fault", tick, [])
    assert (pulled.t_s[0], pulled.t_s[-1]) == (pytest.approx(-min(tick, 299) / 5000, abs=3e-3), 0.02)
    ticks = np.rint(pulled.t_s * 5000).astype(int) + tick
    _, there, here = np.intersect1d(captured.ticks, ticks, return_indices=True)
    assert len(there) > 150
    x_um = (captured.axes["x"].adc[there].astype(float) - 599186 / 256) * 280 / 65536
    assert np.allclose(pulled.axes["x"].x_um[here], x_um)
    assert np.allclose(pulled.axes["x"].r_um[here], captured.axes["x"].reference[there] / 2**16)
    assert pulled.axes["y"].r_um is None


def test_a_threshold_gives_what_was_before_and_after_it():
    with connect(URL) as device:
        facts = device.trigger("threshold", above_um=30, every=2, after=0.5)
        assert (facts["before_s"], facts["after_s"]) == (0.0796, 0.08)
        device.track("sine:60um@5Hz", mode="pid", duration=0.4)
        pulled = device.pull()
    at = int(np.searchsorted(pulled.t_s, -1e-9))
    assert (pulled.axes["x"].x_um[: at - 1] < 30.1).all()
    assert pulled.axes["x"].x_um[at] == pytest.approx(30, abs=0.5)
    assert np.allclose(np.diff(pulled.t_s), 0.0004)


def test_a_pull_empties_it_unless_it_is_kept():
    with connect(URL) as device:
        with pytest.raises(DeviceRefused, match="nothing is frozen: the recorder is waiting"):
            device.pull()
        device.trigger("set_point")
        device.track("sine:20um@5Hz", mode="pid", duration=0.4)
        kept, again = device.pull(keep=True), device.pull()
        assert np.array_equal(kept.t_s, again.t_s)
        with pytest.raises(DeviceRefused, match="nothing is frozen"):
            device.pull()


def test_it_says_when_the_trigger_was():
    with connect(URL) as device:
        device.device.session.tick_0_unix_s = 1.7e9  # a simulated device has no clock of its own
        device.trigger("set_point")
        device.track("sine:20um@5Hz", mode="pid", duration=0.4)
        pulled = device.pull()
    assert t0_unix_s(pulled.meta) == pytest.approx(1.7e9 + pulled.meta["trigger_tick"] / TICK_HZ, abs=1e-5)


def changed(monkeypatch, session, change):
    """The session with ``change`` applied to every reply of the recorder."""
    request = session.request

    def answered(command, *arguments):
        reply = request(command, *arguments)
        return change(command, reply) if isinstance(command, wire.TransientReadRequest) else reply

    monkeypatch.setattr(session, "request", answered)


def test_gaps_are_in_ticks_whatever_is_kept_of_them(monkeypatch):
    """They were in rows: with every second tick kept, half of what is missing."""
    with connect(URL) as device:
        device.trigger("set_point", every=2, after=0.5)
        device.track("sine:20um@5Hz", mode="pid", duration=0.2)
        pieces = {}
        with monkeypatch.context() as patch:
            changed(patch, device.device.session, lambda command, reply: pieces.setdefault(command.offset, reply))
            whole = device.pull(keep=True)
        there = b"".join(reply.data for reply in pieces.values())
        there = there[: 100 * ENTRY.itemsize] + there[103 * ENTRY.itemsize :]

        def without_three(command, reply):
            return replace(reply, size=len(there), data=there[command.offset :][: command.length])

        changed(monkeypatch, device.device.session, without_three)
        gapped = device.pull()
    ticks = np.rint(whole.t_s * 5000).astype(int) + whole.meta["trigger_tick"]
    assert whole.meta["gaps"] == []
    assert gapped.meta["gaps"] == [[ticks[100], 6]]
    assert gapped.meta["missing_ticks"] == 3
    assert len(gapped.t_s) == len(whole.t_s) - 3


@pytest.mark.parametrize("other", [{"size": 0, "data": b"", "state": 0}, {"trigger_tick": 77}])
def test_a_recorder_that_is_set_anew_while_it_is_read_is_told(monkeypatch, other):
    """It was read for ever: nothing came, and the end was never reached."""
    with connect(URL) as device:
        device.trigger("set_point")
        device.track("sine:20um@5Hz", mode="pid", duration=0.2)
        changed(
            monkeypatch,
            device.device.session,
            lambda command, reply: replace(reply, **other) if command.offset > 2000 else reply,
        )
        with pytest.raises(LinkError, match=r"set anew after \d+ of \d+ bytes were read; pull again"):
            device.pull()


def test_what_is_read_is_read_once_and_in_pieces_that_come_through(monkeypatch):
    with connect(URL) as device:
        device.trigger("set_point")
        device.track("sine:20um@5Hz", mode="pid", duration=0.2)
        whole = device.pull(keep=True)
        asked = []

        def only_short(command, reply):
            if command.length > 256:
                raise NoReplyError("lost")
            asked.append(command.offset)
            return reply

        changed(monkeypatch, device.device.session, only_short)
        again = device.pull()
    assert np.array_equal(again.axes["x"].x_um, whole.axes["x"].x_um)
    assert asked == sorted(set(asked))


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ({"on": "moon"}, "must be one of fault, set_point, threshold, input"),
        ({"on": "threshold"}, "a threshold takes one level"),
        ({"on": "threshold", "above_um": 1, "below_um": 2}, "a threshold takes one level"),
        ({"on": "fault", "above_um": 1}, "nothing else takes any"),
        ({"on": "threshold", "above_um": 500}, "beyond the sensor's range"),
        ({"every": 0}, "between 1 and 65535"),
        ({"after": 1.5}, "between 0 and 1"),
        ({"axis": "q"}, "must be x, y or z"),
    ],
)
def test_triggers_that_make_no_sense(how, words):
    with connect(URL) as device, pytest.raises(BadInput, match=words):
        device.trigger(**how)
