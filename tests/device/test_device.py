"""The facade against the firmware itself, in process and over a pseudo-terminal."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path
from zlib import crc32

import numpy as np
import pytest

from phaselead.device import wire
from phaselead.device.capture import DeviceFault
from phaselead.device.device import Device, model_field
from phaselead.device.encode_compensation import NO_COMPENSATION
from phaselead.device.quantities import converters
from phaselead.device.session import Refused
from phaselead.errors import BadInput, DeviceRefused, LinkError, PhaseleadError
from phaselead.serial_ports import list_ports, open_port
from phaselead.sim.device import Firmware

ROOT = Path(__file__).resolve().parents[2]
PAPER = {"kp_V_per_um": 0.004, "ki_V_per_um_s": 1.67, "kd_V_s_per_um": 2.39e-6}
AXIS = wire.AxisModel(
    flags=0,
    u_min_q24=-2 * 2**24,
    u_max_q24=10 * 2**24,
    u_park_q24=0,
    slew_q24=2**22,
    ramp_q24=2**20,
    dac_zero_code=32768,
    dac_codes_per_V_q16=3200 * 2**16,
    adc_zero_code=2341,
    adc_um_per_code_q32=18350080,
    swing_min_q24=0,
    swing_max_q24=0,
    f_min_q16=0,
    f_max_q16=0,
    a_q32=(0,) * 3,
    b_q40=(0,) * 6,
    c_q32=(0,) * 6,
    coupling_q28=(0,) * 3,
    error_limit_q16=0,
    error_ticks=0,
    oscillation_limit_q16=0,
    **NO_COMPENSATION,
)


def model_blob(**changes: int) -> bytes:
    rows = [tuple(2**28 if i == j else 0 for j in range(3)) for i in range(3)]
    x, y, z = (replace(AXIS, coupling_q28=row) for row in rows)
    axes = (x, replace(y, **changes), z)  # type: ignore[arg-type]
    return wire.Model(0x314C4850, bytes(32), axes).pack()


@pytest.fixture
def device() -> Iterator[Device]:
    with Device.open("sim://xyz250") as opened:
        yield opened


def test_an_open_loop_sine_is_the_sine_that_was_asked_for(device: Device) -> None:
    device.set_axis("x", "open")
    device.set_path("x", "sine", swing=5.0, offset=1.0, f_Hz=10.0)
    taken = device.capture(2500)
    assert (taken.gaps, taken.stream.lost_batches, taken.stream.dropped_ticks) == ([], 0, 0)
    rows = (taken.ticks >= taken.start_tick + 50) & (taken.ticks < taken.end_tick)  # the first ticks climb to 1 V
    t_s = (taken.ticks[rows] - taken.start_tick) / 5000
    dac = taken.axes["x"].dac
    assert dac is not None
    u_V = converters(taken.model)["x"].u_V(dac[rows])
    expected = 1.0 + 2.5 * (1 - np.cos(2 * np.pi * 10.0 * t_s))
    assert np.abs(u_V - expected).max() < 2 / 3200
    assert device.status().state == "parked"


def test_a_capture_can_be_executed_again_bit_for_bit(device: Device) -> None:
    device.upload_wave("z", np.abs(np.linspace(-1, 1, 1024)))
    for axis, kind in zip("xyz", ("sine", "move", "wave"), strict=True):
        device.set_axis(axis, "pid" if axis == "x" else "open", **PAPER)
        device.set_path(axis, kind, swing=4.0, f_Hz=7.0, ticks=2000)
    taken = device.capture(4000, axes="xyz")
    assert set(taken.waves) == {"z"}
    adc = np.stack([taken.axes[a].adc for a in "xyz"], axis=1)  # type: ignore[misc]
    dac = np.stack([taken.axes[a].dac for a in "xyz"], axis=1)  # type: ignore[misc]
    assert len(np.unique(dac[:, 2])) > 1000
    again, at = np.empty_like(dac), 0
    with Firmware() as firmware:
        send_wave(firmware, taken.session, 2, taken.waves["z"])
        firmware.restore(taken.session, taken.state)
        for tick, frame in [*taken.command_log, (int(taken.ticks[-1]) + 1, b"")]:
            n = min(tick - taken.first_tick, len(dac))
            again[at:n], at = firmware.run_codes(adc[at:n]), n
            firmware.write(frame)
    assert np.array_equal(again, dac)


def send_wave(firmware: Firmware, session: int, axis: int, data: bytes) -> None:
    from phaselead.device.framing import encode_frame

    chunks = [wire.WaveChunkRequest(axis, at // 4, data[at : at + 1024]) for at in range(0, 4096, 1024)]
    for i, m in enumerate([wire.HelloRequest(), *chunks, wire.WaveCommitRequest(axis, crc32(data))]):
        firmware.write(encode_frame(wire.HEADER.pack(m.NUMBER, 60000 + i, session) + m.pack()))
        firmware.run_codes(np.zeros((100, 3), np.uint16))


def test_status_and_info_are_words(device: Device) -> None:
    device.set_axis("y", "ff+pid" if device.read_model() else "pid")
    status = device.status().as_dict()
    assert (status["state"], status["fault"], status["fault_axis"]) == ("parked", "none", "")
    assert (status["modes"], status["at_rest"]) == (("idle", "pid", "idle"), "xyz")
    info = device.info()
    assert (info["target"], info["tick_rate_Hz"], info["model_loaded"]) == ("host", 5000, False)


def test_parking_what_is_parked_and_held_waits_until_it_is_home(device: Device) -> None:
    device.upload(model_blob(u_park_q24=5 * 2**24, ramp_q24=2**24 // 100))
    device.arm()
    device.park()
    with pytest.raises(Refused, match="0 V"):
        device.session.request(wire.UpdateRestartRequest())
    device.stop()
    status = device.status()
    assert (status.state, status.at_rest) == ("parked", "xz")
    device.park()
    assert device.status().at_rest == "xyz"
    device.persist()


def test_a_model_is_uploaded_read_back_and_kept(tmp_path: Path) -> None:
    url, blob = f"sim://xyz250?state={tmp_path / 'flash'}", model_blob()
    with Device.open(url) as device:
        assert device.read_model() is None
        assert device.upload(blob) == crc32(blob)
        assert int(device.status().model_crc, 16) == crc32(blob)
        assert device.persist() == 1
    with Device.open(url) as device:
        assert device.read_model() == blob
        assert device.info()["model_persisted"]


def test_info_says_how_the_model_is_now(device: Device) -> None:
    def told() -> tuple[bool, bool, str]:
        info = device.info()
        return info["model_loaded"], info["model_persisted"], info["model_crc"]

    assert told() == (False, False, "00000000")
    crc = f"{device.upload(model_blob()):08x}"
    assert told() == (True, False, crc)
    device.persist()
    assert told() == (True, True, crc)
    other = f"{device.upload(model_blob(ramp_q24=2**19)):08x}"
    assert told() == (True, False, other)
    device.hello = replace(device.hello, wire_revision=2)  # a device that tells it in its greeting alone
    assert told() == (False, False, "00000000")


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"u_max_q24": -(2**30)}, "axis y, u_max_q24"),
        ({"ramp_q24": 2**23}, "axis y, ramp_q24"),
        ({"flags": 8}, "axis y, flags"),
        ({"adc_um_per_code_q32": 0}, "axis y, adc_um_per_code_q32"),
    ],
)
def test_a_refused_field_is_named_and_the_old_model_stays(device: Device, change: dict[str, int], field: str) -> None:
    device.upload(model_blob())
    with pytest.raises(Refused, match=rf"\(model_invalid\): {field} failed its checks; the old model stays") as refusal:
        device.upload(model_blob(**change))
    assert ("the firmware is older" in str(refusal.value)) == ("flags" in change)
    assert device.read_model() == model_blob()


def test_every_model_field_has_its_name() -> None:
    assert model_field(101) == "axis y, flags"
    assert model_field(200 + len(fields(wire.AxisModel))) == "axis z, oscillation_limit_q16"
    assert "head" in model_field(999)


def test_the_device_is_asked_before_anything_moves(device: Device) -> None:
    with pytest.raises(DeviceRefused, match=r"set_path refused \(mode_unsupported\): the axis is idle"):
        device.set_path("x", "sine", swing=60.0, f_Hz=5.0)
    with pytest.raises(DeviceRefused, match=r"no_model.*upload"):
        device.set_axis("x", "ff")
    device.set_axis("x", "open")
    with pytest.raises(DeviceRefused, match=r"outside_limits"):
        device.set_path("x", "sine", swing=13.0, f_Hz=5.0)
    with pytest.raises(DeviceRefused, match=r"start refused \(bad_value\): an axis that is to start has no mode"):
        device.capture(100, axes="xy")
    assert device.status().state == "parked"


def test_bad_names_are_refused_on_this_side(device: Device) -> None:
    for call in (
        lambda: device.set_axis("w", "pid"),
        lambda: device.set_axis("x", "fly"),
        lambda: device.set_path("x", "circle"),
        lambda: device.set_path("xy", "hold"),
        lambda: device.start("q"),
    ):
        with pytest.raises(BadInput):
            call()


def test_a_fault_is_named_and_cleared_by_park(device: Device) -> None:
    device.set_axis("x", "pid", **PAPER)
    device.set_path("x", "hold", offset=1.0)
    simulated = device.session.port.device  # type: ignore[attr-defined]

    def clip(done: int) -> None:
        if 1000 < done < 2000:
            simulated.inject(wire.Fault.ADC_RAIL, 0)

    with pytest.raises(DeviceFault, match="fault adc_rail on axis x") as caught:
        device.capture(200_000, progress=clip)
    assert caught.value.capture.gaps == []
    assert 1000 < len(caught.value.capture.ticks) < 3000
    assert device.status().state == "fault"
    with pytest.raises(DeviceRefused, match="adc_rail"):
        device.park(clear_fault=False)
    device.park()
    assert (device.status().state, device.status().fault) == ("parked", "none")


def test_a_device_that_restarts_in_mid_capture_is_noticed() -> None:
    device = Device.open("sim://xyz250", park_on_exit=False)
    device.set_axis("x", "open")
    device.set_path("x", "sine", swing=5.0, f_Hz=5.0)
    plugs = [device.session.port.device]  # type: ignore[attr-defined]

    def pull_the_plug(done: int) -> None:
        if done > 1000 and plugs:
            plugs.pop().inject(wire.Fault.CORE_LOST, 0)

    with device, pytest.raises(LinkError, match="has restarted or another host has taken it; run the command again"):
        device.capture(200_000, progress=pull_the_plug)


def test_waiting_keeps_the_device_from_timing_out(device: Device) -> None:
    device.set_axis("x", "open")
    device.set_path("x", "hold", offset=2.0)
    device.arm()
    device.start("x")
    status = device.wait(3.0)
    assert (status.state, status.fault) == ("running", "none")
    assert status.dac_codes[0] == 32768 + 2 * 3200


def test_stop_needs_no_session() -> None:
    assert Device.stop_now("sim://xyz250").status == wire.Status.OK


@pytest.fixture
def terminal() -> Iterator[str]:
    code = "from phaselead.sim.pty import serve; serve('sim://xyz250')"
    environment = os.environ | {"PYTHONPATH": str(ROOT / "host")}
    server = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, env=environment)
    assert server.stdout is not None
    yield server.stdout.readline().strip()
    server.terminate()
    server.wait(timeout=10)


def test_the_same_over_a_terminal(terminal: str) -> None:
    with Device.open(terminal) as device:
        device.set_axis("x", "open")
        device.set_path("x", "sine", swing=5.0, f_Hz=20.0)
        taken = device.capture(1500)
        assert taken.gaps == []
        assert len(taken.ticks) >= 1500
        with pytest.raises(LinkError, match=r"is in use by another program; close that program"):
            open_port(terminal)
    with Device.open(terminal) as device:  # the device lived on, and lets a new session in
        assert device.status().tick > taken.end_tick
        assert device.status().modes[0] == "idle"


@pytest.mark.parametrize(
    ("url", "message"),
    [
        ("/dev/ttyNothing", r"port /dev/ttyNothing does not exist; `phaselead ports` lists"),
        ("/dev/null", r"/dev/null is not a serial port"),
        ("/tmp", r"/tmp is not a serial port"),
        ("warp://x", r"warp://x: unknown kind of port; use a device path or sim://"),
        ("sim://nothing.toml", r"nothing\.toml"),
    ],
)
def test_a_port_that_cannot_be_opened_is_explained_in_one_line(url: str, message: str) -> None:
    with pytest.raises(PhaseleadError, match=message) as caught:
        open_port(url)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("number", "words"), [(13, "no permission; join the group"), (16, "is in use")])
def test_permission_and_busy_are_told_apart(monkeypatch: pytest.MonkeyPatch, number: int, words: str) -> None:
    import serial

    def fail(self: object) -> None:
        raise serial.SerialException(number, "could not open port: OS says no")

    monkeypatch.setattr(serial.Serial, "open", fail)
    with pytest.raises(LinkError, match=words):
        open_port("/dev/ttyX")


def test_dtr_and_rts_are_low_before_a_real_port_is_opened(monkeypatch: pytest.MonkeyPatch) -> None:
    import serial

    seen = []

    def look(self: serial.Serial) -> None:
        seen.append((self.dtr, self.rts, self.exclusive, self.baudrate))

    monkeypatch.setattr(serial.Serial, "open", look)
    open_port("/dev/ttyX")
    assert seen == [(False, False, True, 2_000_000)]


def test_listing_ports_opens_none(monkeypatch: pytest.MonkeyPatch) -> None:
    import serial

    monkeypatch.setattr(serial.Serial, "open", lambda self: pytest.fail("opened a port"))
    assert isinstance(list_ports(), list)
