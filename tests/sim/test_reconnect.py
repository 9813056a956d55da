"""A cable that is pulled, a device that restarts, a host that sleeps: the program goes on, the recording does not."""

from __future__ import annotations

import json

import h5py
import numpy as np
import pytest
from click.testing import CliRunner

import phaselead as pl
from phaselead.cli import main
from phaselead.control import record_to_file, recover_run, track_to_file
from phaselead.device import DeviceFault, device_model, encode_frame, wire
from phaselead.device.device import Device
from phaselead.errors import LinkError
from phaselead.model import AxisModel, Sensor, Stage
from phaselead.sim import protocol_faulty
from phaselead.waveforms import parse_wave

URL = "faulty://sim://xyz250"
SINE = {"x": parse_wave("sine:5V@5Hz")}


@pytest.fixture
def device():
    opened = Device.open(URL)
    yield opened
    opened.session.port.close()
    protocol_faulty._unplugged.clear()


def line_of(device):
    return device.session.port.line


def no_pause(_seconds):
    """In place of time.sleep."""


def driven(device):
    device.set_axis("x", "open")
    device.set_path("x", "sine", swing=5, f_Hz=5)
    device.arm()
    device.start("x")


def test_a_cable_that_is_in_again_at_once_changes_nothing():
    with Device.open(f"{URL}#away_s=0.1") as device:
        driven(device)
        line_of(device).unplug()
        assert device.reconnect(pause=no_pause)
        assert device.status().state == "running"


def test_a_device_without_its_host_has_parked_and_says_why(device):
    driven(device)
    line_of(device).unplug()
    with pytest.raises(LinkError):
        device.status()
    assert device.reconnect(pause=no_pause)
    status = device.status()
    assert (status.state, status.fault) == ("fault", "host_timeout")
    assert status.at_rest == "xyz"
    device.park()
    driven(device)
    assert device.status().state == "running"


def test_a_device_that_restarted_is_a_fresh_one(device):
    model = device_model(Stage(name="mine", axes={"x": AxisModel()}))
    device.upload(model)
    driven(device)
    old = device.session.nonce
    line_of(device).unplug()
    line_of(device).reset()
    assert not device.reconnect(pause=no_pause)
    assert device.session.nonce != old
    status = device.status()
    assert (status.fault, status.modes, status.model_crc) == ("core_lost", ("idle",) * 3, "00000000")
    assert device.read_model() is None


def test_a_restart_without_unplugging_is_found_too(device):
    line_of(device).reset()
    with pytest.raises(LinkError, match="has restarted"):
        device.status()
    assert not device.reconnect(pause=no_pause)
    assert device.status().at_rest == "xyz"


def test_a_port_that_stays_away_is_told_after_the_time_that_was_given(device, monkeypatch):
    line_of(device).unplug()
    waited = []

    def gone(url, **_):
        raise LinkError(f"port {url} does not exist")

    monkeypatch.setattr("phaselead.device.device.open_port", gone)
    with pytest.raises(LinkError):
        device.reconnect(2.0, pause=waited.append)
    assert sum(waited) == pytest.approx(1.8)
    monkeypatch.undo()
    assert device.reconnect(pause=no_pause)


def pull_after(device, fraction, act):
    def progress(done):
        nonlocal act
        if done >= fraction and act is not None:
            now, act = act, None
            now()

    return progress


@pytest.mark.parametrize("kind", ["unplug", "reset"])
def test_a_run_that_is_broken_off_says_so_and_is_not_written_as_if_whole(device, tmp_path, kind):
    output = tmp_path / "run.h5"
    act = getattr(line_of(device), kind)
    with pytest.raises(LinkError, match="log recover"):
        track_to_file(
            device, SINE, "open", output=str(output), duration_s=2.0, on_progress=pull_after(device, 0.5, act)
        )
    assert not output.exists()
    device.reconnect(pause=no_pause)
    with pytest.raises(pl.BadInput, match="not finished"):  # the next run does not write over what there is
        track_to_file(device, SINE, "open", output=str(output), duration_s=0.2)
    facts = recover_run(f"{output}.journal", str(output))
    assert 4000 < facts["samples"] < 9000
    assert facts["ended"] == "broken off"


def test_the_journal_of_a_run_that_goes_on_is_left_to_it(device, tmp_path):
    output, other = tmp_path / "run.h5", tmp_path / "other.h5"
    said = []

    def recover():
        with pytest.raises(pl.BadInput, match="still goes on") as caught:
            recover_run(f"{output}.journal", str(other))
        said.append(str(caught.value))

    track_to_file(
        device, SINE, "open", output=str(output), duration_s=0.5, on_progress=pull_after(device, 0.5, recover)
    )
    assert said
    assert output.exists()
    assert not other.exists()


def test_a_record_that_ends_in_a_fault_says_where_it_is(device, tmp_path):
    output = tmp_path / "run.h5"
    slept = pull_after(device, 0.5, lambda: line_of(device).let_pass(30.0))
    with pytest.raises(DeviceFault, match=f"host_timeout.*; the recording is kept in {output}"):
        record_to_file(device, SINE, output=str(output), duration_s=1.0, on_progress=slept)
    assert output.exists()


def test_a_host_that_slept_finds_its_run_ended_by_the_device(device, tmp_path):
    """The recording ends with the fault, and every tick of before is in it or in a gap."""
    output = tmp_path / "run.h5"
    slept = pull_after(device, 0.5, lambda: line_of(device).let_pass(30.0))
    with pytest.raises(DeviceFault, match="host_timeout") as caught:
        track_to_file(device, SINE, "open", output=str(output), duration_s=2.0, on_progress=slept)
    capture = caught.value.capture
    assert capture.missing > 1000
    with h5py.File(output) as file:
        assert file.attrs["gaps.json"] != "[]"
        assert file.attrs["missing_ticks"] == capture.missing
        assert file.attrs["ended"] == "fault host_timeout"
    with pytest.raises(pl.BadInput, match="has gaps"):
        pl.fit(output)


@pytest.mark.parametrize("seed", range(3))
def test_what_comes_through_a_bad_line_is_at_its_tick(seed):
    """Every tick that was asked for is there, with the reference of that tick, or is counted as missing."""
    with Device.open(f"{URL}#lose=1e-4&flip=1e-5&duplicate=0.1&reorder=0.05&delay=0.05&seed={seed}") as device:
        device.set_axis("x", "open")
        device.set_path("x", "sine", swing=5, f_Hz=5)
        taken = device.capture(5000)
    rows = (taken.ticks >= taken.start_tick) & (taken.ticks < taken.end_tick)
    assert rows.sum() + taken.missing == 5000
    assert taken.missing > 100
    wanted_V = 2.5 * (1 - np.cos(2 * np.pi * 5 * (taken.ticks[rows] - taken.start_tick) / 5000))
    reference = taken.axes["x"].reference
    assert reference is not None
    assert np.abs(reference[rows] / 2**24 - wanted_V).max() < 1e-5


def test_a_line_too_bad_for_samples_is_named(device):
    with Device.open(f"{URL}#lose=0.01&flip=1e-4&seed=1") as device:
        with pytest.raises(LinkError, match=r"no samples come whole .* frames arrived damaged"):
            device.capture(5000, start=False)
        assert device.status().state == "parked"


def test_the_command_line_tells_of_missing_ticks():
    words = ["track", "sine:60um@5Hz", "--mode", "pid", "--json", "-", "--port", f"{URL}#lose=1e-4&seed=2"]
    result = CliRunner().invoke(main, words)
    assert result.exit_code == 0, result.stderr
    figures = json.loads(result.stdout)
    assert figures["dropped"] > 0
    assert figures["dropped"] + figures["ticks"] == 10_000
    assert f"{figures['dropped']} of 10000 ticks are missing" in result.stderr


def test_a_session_of_the_api_goes_on():
    with pl.connect(URL) as dev:
        dev.device.session.port.line.reset()
        with pytest.raises(pl.LinkError):
            dev.status()
        assert not dev.reconnect()
        assert dev.park().state == "parked"
        assert dev.track("sine:20um@5Hz", mode="pid", duration=0.4).figures["dropped"] == 0


def test_micrometres_after_a_restart_are_not_by_the_model_that_it_lost(device):
    shifted = AxisModel(sensor=Sensor(x_min_um=90.0, x_max_um=370.0))
    device.upload(device_model(Stage(name="shifted", axes={"x": shifted})))
    before = device.converters()["x"]
    line_of(device).reset()
    with pytest.raises(LinkError):
        device.status()
    assert not device.reconnect(pause=no_pause)
    assert device.converters()["x"] != before


def test_a_late_hello_does_not_pass_a_restarted_device_for_the_old_one(device):
    """A copy of the hello that comes after a restart opens the very same session again."""
    device.wait(0.1)
    line_of(device).reset()
    body = wire.HEADER.pack(wire.HelloRequest.NUMBER, 1, device.session.nonce)
    line_of(device).write(encode_frame(body))
    device.session.pump(1000)
    with pytest.raises(LinkError, match="has restarted"):
        device.arm()
    assert not device.reconnect(pause=no_pause)
