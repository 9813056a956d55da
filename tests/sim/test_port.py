"""sim:// as a serial port: virtual time, fresh devices, kept flash, and errors in one line."""

import contextlib
from zlib import crc32

import numpy as np
import pytest
import serial
from hypothesis import given, settings
from hypothesis import strategies as st

from phaselead.device import wire
from phaselead.device.device import Device
from phaselead.device.encode_model import device_model
from phaselead.device.session import Session
from phaselead.errors import BadInput, PhaseleadError
from phaselead.model.stage_file import save_stage
from phaselead.serial_ports import open_port
from phaselead.sim.plant import built_in
from phaselead.sim.protocol_sim import open_device, parse_url

URL = "sim://xyz250"


def test_hello_over_the_built_in_stage():
    with Device.open(URL) as device:
        assert device.hello.target.rstrip(b"\0") == b"host"
        assert device.status().state == "parked"


def capture(url, ticks=3000):
    with Device.open(url, park_on_exit=False) as device:
        device.session.nonce = 42
        device.session = Session(device.session.port, url, nonce=42)
        device.hello = device.session.hello()
        device.set_axis("x", "open")
        device.set_path("x", "sine", swing=4, f_Hz=10)
        return device.capture(ticks, park=False)


def test_the_same_seed_gives_the_same_recording_and_another_another():
    one, again, other = (capture(URL + query) for query in ("", "?seed=0", "?seed=1"))
    assert np.array_equal(one.axes["x"].adc, again.axes["x"].adc)
    assert np.array_equal(one.ticks, again.ticks)
    assert one.command_log == again.command_log
    assert not np.array_equal(one.axes["x"].adc, other.axes["x"].adc)


def test_each_opening_is_a_device_fresh_from_power_on():
    for _ in range(2):
        with Device.open(URL) as device:
            assert device.hello.tick == 0
            device.upload(device_model(built_in("xyz250")))
            assert device.read_model() is not None


def test_a_stage_file_takes_the_same_road(tmp_path):
    path = tmp_path / "stage with space.toml"
    save_stage(path, built_in("xyz250"))
    from_file = capture(f"sim://{path}".replace(" ", "%20"))
    assert np.array_equal(from_file.axes["x"].adc, capture(URL).axes["x"].adc)


def test_the_flash_is_kept_where_the_url_says(tmp_path):
    model = device_model(built_in("xyz250"))
    url = f"{URL}?state={tmp_path / 'flash.bin'}"
    with Device.open(url) as device:
        assert device.hello.model_flags == 0
        device.upload(model)
        device.persist()
    with Device.open(url) as device:
        assert (device.hello.model_flags, device.hello.model_crc) == (5, crc32(model))
    with Device.open(URL) as device:
        assert device.hello.model_flags == 0
    assert [file.name for file in tmp_path.iterdir()] == ["flash.bin"]  # nothing half-written is left


def test_a_save_is_in_the_file_before_its_reply_is_read(tmp_path):
    state = tmp_path / "flash.bin"
    device = Device.open(f"{URL}?state={state}")
    device.upload(device_model(built_in("xyz250")))
    before = state.read_bytes()  # this start is counted there
    device.persist()
    kept = state.read_bytes()  # as after a kill -9
    assert kept != before
    device.close()
    assert kept == state.read_bytes()


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("sim://", "names no stage"),
        ("sim://nosuch", "no built-in stage"),
        ("sim:///no/such/file.toml", "cannot be read"),
        ("sim://xyz250?seed=x", "seed must be a whole number"),
        ("sim://xyz250?seed=-1", "seed must be"),
        ("sim://xyz250?seed=18446744073709551616", "seed must be"),
        ("sim://xyz250?baud=300", "baud must be"),
        ("sim://xyz250?colour=red", "'colour' is no option"),
        ("sim://xyz250?state=", "'state' is no option"),
        ("sim://xyz250?state=/", "state file cannot be read"),
        ("sim://xyz250?force=x:1um", "write it as force=x:1um@2s"),
        ("sim://xyz250?force=w:1um@2s", "write it as force=x:1um@2s"),
        ("sim://xyz250?force=x:1.1.1um@2s", "write it as force=x:1um@2s"),
        ("xyz250", "no simulated port"),
    ],
)
def test_a_wrong_url_is_one_clear_line(url, words):
    with pytest.raises(BadInput, match=words) as refusal:
        open_device(parse_url(url))
    assert "\n" not in str(refusal.value)


def test_errors_reach_the_user_through_open_port(tmp_path):
    with pytest.raises(PhaseleadError, match="no built-in stage"):
        open_port("sim://nosuch")
    state = tmp_path / "not-flash"
    state.write_bytes(b"hello")
    with pytest.raises(PhaseleadError, match=r"not-flash.*wrong size"):
        open_port(f"{URL}?state={state}")


@settings(max_examples=60, deadline=None)
@given(st.text(max_size=40))
def test_no_url_is_a_traceback(text):
    with contextlib.suppress(PhaseleadError):
        open_device(parse_url("sim://" + text)).close()


def test_a_read_takes_its_timeout_in_virtual_time():
    port = open_port(URL, timeout_s=0.5)
    assert port.read(10) == b""
    assert port.device.tick == 2500
    port.timeout = 0
    assert port.read(10) == b""
    assert port.device.tick == 2500


def test_polling_in_waiting_lets_time_pass():
    port = open_port(URL)
    port.write(b"\0")
    Session(port).submit(wire.HelloRequest())
    while port.in_waiting < 50:
        pass
    assert 0 < port.device.tick < 20


def test_the_line_is_as_slow_as_its_baud_rate():
    ticks = {}
    for baud in (115_200, 2_000_000):
        with Device.open(f"{URL}?baud={baud}") as device:
            before = device.status().tick
            for _ in range(20):
                device.status()
            ticks[baud] = device.status().tick - before
    assert ticks[115_200] > 8 * ticks[2_000_000]


def test_a_closed_port_says_so():
    port = open_port(URL)
    port.close()
    port.close()
    with pytest.raises(serial.PortNotOpenError):
        port.read(1)
    with pytest.raises(serial.PortNotOpenError):
        port.write(b"x")


def test_true_positions_belong_to_the_ticks_of_the_recording():
    with Device.open(URL) as device:
        port = device.session.port
        port.trace_true_positions()
        device.set_axis("x", "open")
        device.set_path("x", "sine", swing=4, f_Hz=5)
        taken = device.capture(5000)
        first, x_um = port.true_positions()
        assert port.true_positions()[1].shape == (0, 3)
    measured = taken.axes["x"].adc.astype(float) * 280 / 65536 - 10
    truth = x_um[taken.ticks - first, 0]
    lag = (measured - truth).std()  # 80 us of the sensor's low-pass at 0.95 mm/s rms: a tick off would show
    assert 0.065 < lag < 0.09


@pytest.mark.parametrize("fault", [f for f in wire.Fault if f not in (wire.Fault.NONE, wire.Fault.HOST_TIMEOUT)])
def test_faults_can_be_injected_into_the_simulated_device(fault):
    with Device.open(URL, park_on_exit=False) as device:
        port = device.session.port
        device.set_axis("x", "pid", kp_V_per_um=0.017, ki_V_per_um_s=8.62, kd_V_s_per_um=2.33e-5)
        device.set_path("x", "sine", swing=60, f_Hz=5)
        device.arm()
        device.start("x")
        device.wait(0.1)
        port.device.inject(fault)
        port.advance(0.1)
        again = Device(Session(port, URL, nonce=device.session.nonce), park_on_exit=False)
        assert again.status().fault == fault.name.lower()
        assert again.status().state == "fault"
