"""The device on a pseudo-terminal: any serial program, any number of times, one device."""

import contextlib
import os
import signal
import subprocess
import sys

import pytest

from phaselead.device.device import Device
from phaselead.device.encode_model import device_model
from phaselead.errors import BadInput, PhaseleadError
from phaselead.serial_ports import open_port
from phaselead.sim.device import Firmware
from phaselead.sim.plant import built_in
from phaselead.sim.pty import serve

SERVE = "import sys; from phaselead.sim.pty import serve; serve(sys.argv[1], sys.argv[2])"


@contextlib.contextmanager
def served(link, url="sim://xyz250"):
    with subprocess.Popen([sys.executable, "-c", SERVE, url, str(link)], stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process, process.stdout.readline().strip()
        finally:
            process.kill()


def test_a_device_outlives_its_clients(tmp_path):
    link = tmp_path / "stage"
    with served(link) as (process, path):
        assert os.readlink(link) == path
        with Device.open(str(link)) as device:
            first = device.status().tick
            device.upload(device_model(built_in("xyz250")))
        with Device.open(path) as device:
            assert device.status().tick > first  # the clock ran on: nothing was reset
            assert device.hello.model_flags & 1
            device.set_axis("x", "open")
            device.set_path("x", "sine", swing=2, f_Hz=20)
            capture = device.capture(500)
        assert capture.gaps == []
        process.send_signal(signal.SIGTERM)
        assert process.wait(120) == 0
        assert not link.is_symlink()


def test_the_port_is_taken_exclusively(tmp_path):
    with served(tmp_path / "stage") as (_, path):
        port = open_port(path)
        with pytest.raises(PhaseleadError, match="in use"):
            open_port(path)
        port.close()


def test_ctrl_c_ends_it_cleanly_and_keeps_the_flash(tmp_path):
    state = tmp_path / "flash.bin"
    with served(tmp_path / "stage", f"sim://xyz250?state={state}") as (process, path):
        with Device.open(path) as device:
            device.upload(device_model(built_in("xyz250")))
            device.persist()
        process.send_signal(signal.SIGINT)
        assert process.wait(120) == 0
    with Firmware() as erased:
        assert state.stat().st_size == len(erased.flash()[0])
        assert state.read_bytes() != erased.flash()[0]


def test_a_file_in_the_way_of_the_link_is_left_alone(tmp_path):
    taken = tmp_path / "precious"
    taken.write_text("data")
    with pytest.raises(BadInput, match="cannot be made"):
        serve("sim://xyz250", taken)
    assert taken.read_text() == "data"


def test_a_wrong_url_is_told_before_anything_is_served():
    with pytest.raises(BadInput, match="no built-in stage"):
        serve("sim://nosuch")
