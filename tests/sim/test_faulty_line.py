"""The line that goes wrong: what it does is what it was asked for, and what stands on it holds."""

from __future__ import annotations

from dataclasses import replace

import pytest
import serial
from hypothesis import given, settings
from hypothesis import strategies as st
from link_trial import ISSUE, OFTEN_FAIL, WORSE, run

from phaselead.device.device import Device
from phaselead.device.session import Session
from phaselead.errors import BadInput, LinkError
from phaselead.serial_ports import open_port
from phaselead.sim.faulty import FaultyLine, LineFaults, Way

FRAMES = [bytes([n + 1] * 10) + b"\0" for n in range(200)]


@pytest.mark.parametrize("faults", [ISSUE, WORSE], ids=["bytes", "everything"])
def test_every_command_is_carried_out_once_or_reported_failed(faults):
    """By the device's own account; ``make link-trial`` is the same with 10,000 commands of every kind."""
    trial = run(replace(faults, seed=3), 60)
    assert [line for tally in trial.tally.values() for line in tally.wrong] == []
    assert trial.uploads["WRONG"] == 0
    for kind, tally in trial.tally.items():
        assert tally.asked >= 60, kind
        assert tally.failed < 0.2 * tally.asked or kind in OFTEN_FAIL, kind
    assert trial.uploads["right"] >= 1  # of three: a pulled cable ends one
    assert trial.session.retries > 500


@settings(max_examples=50, deadline=None)
@given(cuts=st.lists(st.integers(1, 40), min_size=1), seed=st.integers(0, 2**32))
def test_a_line_without_faults_carries_everything(cuts, seed):
    line, out, way = b"".join(FRAMES), b"", Way(LineFaults(seed=seed), "up")
    at = 0
    for i in range(10**6):
        if at >= len(line):
            break
        cut = cuts[i % len(cuts)]
        out += way.carry(line[at : at + cut])
        at += cut
    assert out == line


def carried(**faults):
    way = Way(LineFaults(**faults), "up")
    return b"".join(way.carry(frame) for frame in FRAMES).split(b"\0")


def test_the_same_seed_does_the_same():
    assert carried(lose=0.01, duplicate=0.1, seed=1) == carried(lose=0.01, duplicate=0.1, seed=1)
    assert carried(lose=0.01, duplicate=0.1, seed=1) != carried(lose=0.01, duplicate=0.1, seed=2)


def test_as_many_bytes_and_bits_as_asked_for_go_wrong():
    zeros = bytes(200_000)
    lost = len(zeros) - len(Way(LineFaults(lose=0.01), "up").carry(zeros))
    assert 2000 - 180 < lost < 2000 + 180  # four standard deviations
    bent = Way(LineFaults(flip=1e-3), "up").carry(zeros)
    flipped = sum(byte.bit_count() for byte in bent)
    assert 1600 - 160 < flipped < 1600 + 160


@pytest.mark.parametrize("name", ["duplicate", "reorder", "delay"])
def test_late_frames_are_whole_and_none_is_missing(name):
    frames = carried(**{name: 0.3}, late_frames=5)[:-1]
    assert {frame + b"\0" for frame in frames} >= set(FRAMES[:-6])
    assert frames != [frame[:-1] for frame in FRAMES]
    assert (len(frames) > len(FRAMES)) == (name == "duplicate")


def test_a_cut_frame_runs_into_the_next():
    assert all(frame + b"\0" not in FRAMES for frame in carried(truncate=1.0)[:-1])


def test_an_unplugged_device_runs_on_and_is_found_again():
    url = "faulty://sim://xyz250#away_s=0.5"
    with Device.open(url) as device:
        before = device.status().tick
        port = device.session.port
        port.line.unplug()
        with pytest.raises(serial.SerialException):
            port.write(b"\0")
        with pytest.raises(LinkError, match=r"has gone away|cannot be written"):
            device.status()
        port.close()
        again = Session(open_port(url), url, nonce=device.session.nonce)
        device.session.port = again.port
        assert device.status().tick >= before + 2500


def test_a_device_that_restarts_says_so():
    device = Device.open("faulty://sim://xyz250")
    device.session.port.line.reset()
    with pytest.raises(LinkError, match="has restarted"):
        device.status()
    device.close()


@pytest.mark.parametrize(
    ("url", "told"),
    [
        ("faulty://", "names no port"),
        ("faulty://faulty://sim://xyz250", "names no port"),
        ("faulty://sim://xyz250#loose=1", "'loose' is no fault; there are lose, flip"),
        ("faulty://sim://xyz250#lose=much", "lose must be a number, not 'much'"),
        ("faulty://sim://xyz250#lose=2", "lose=2: a probability"),
        ("faulty://sim://xyz250#late_frames=0", "late_frames must be at least 1"),
        ("faulty://sim://nowhere.toml#lose=0.1", "nowhere.toml"),
    ],
)
def test_a_wrong_url_is_told(url, told):
    with pytest.raises(BadInput, match=told) as caught:
        open_port(url)
    assert "\n" not in str(caught.value)


def test_only_a_device_in_this_process_can_be_restarted():
    class Dumb:
        timeout = 0.0

    with pytest.raises(BadInput, match="reset: only a device in this process"):
        FaultyLine(Dumb(), LineFaults()).reset()
