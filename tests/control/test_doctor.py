"""The doctor finds what is wrong and says it in words; nothing moves meanwhile."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import phaselead as pl
from phaselead.control import doctor
from phaselead.control.doctor import Check, Diagnosis, hum_share
from phaselead.device import TICK_HZ, Device
from phaselead.device import Limits as HardLimits
from phaselead.model import AxisModel, Limits
from phaselead.record import AxisRecord, Recording
from phaselead.sim import built_in


@pytest.fixture(name="port", scope="module")
def _port(tmp_path_factory) -> str:
    """A device whose flash holds a model."""
    folder = tmp_path_factory.mktemp("doctor")
    port = f"sim://xyz250?state={folder / 'flash.bin'}"
    with pl.connect(port) as dev:
        dev.upload(pl.fit(dev.record("sine:5V@5Hz", duration=1)), persist=True)
    return port


def of(found: Diagnosis, name: str) -> Check:
    return next(check for check in found.checks if check.name == name)


def test_a_device_that_is_well(port):
    with pl.connect(port) as dev:
        before = dev.status().dac_codes
        found = dev.doctor()
        assert dev.status().dac_codes == before
        assert dev.status().state == "parked"
    assert found.healthy, str(found)
    assert "nothing is wrong" in str(found)
    assert "inverse" in of(found, "model").said
    for name in ("link", "tick", "fault", "limits x", "sensor y", "stream"):
        assert of(found, name).ok
    noise_nm = float(of(found, "sensor x").said.split("noise ")[1].split(" nm")[0])
    assert noise_nm == pytest.approx(10, rel=0.15)


def test_no_model_and_a_model_that_will_be_gone(port):
    with pl.connect() as dev:
        assert "none: `phaselead identify`" in of(dev.doctor(), "model").said
        dev.upload(pl.fit(dev.record("sine:5V@5Hz", duration=1)))
        found = of(dev.doctor(), "model")
    assert not found.ok
    assert "upload --persist" in found.said


def test_a_latched_fault_comes_with_its_explanation():
    with pl.connect() as dev:
        with pytest.raises(pl.DeviceFault):
            dev.track("sine:60um@5Hz", mode="pid", gains=(0.1, 8.62, 0))
        latched = dev.status().fault
        found = dev.doctor()
    assert latched != "none"
    assert f"{latched} is latched; `phaselead explain {latched}`" in of(found, "fault").said


def test_a_device_that_is_armed_is_not_listened_to():
    with pl.connect() as dev:
        dev.arm()
        found = dev.doctor()
        assert dev.status().state == "armed"
    assert "park" in of(found, "sensors").said


def sensor(x_codes: np.ndarray) -> Check:
    record = Recording(np.arange(len(x_codes)) / TICK_HZ, {"x": AxisRecord(None, x_codes * 280 / 65536 - 10)})
    return doctor._sensor("x", x_codes, record)


@pytest.mark.parametrize(
    ("codes", "word"),
    [
        (lambda noise, t: np.full(len(t), 40000), "without any noise"),
        (lambda noise, t: 65535 - np.abs(noise), "rail of its converter"),
        (lambda noise, t: 40000 + noise + 20 * np.sin(2 * np.pi * 50 * t), "mains hum at 50 Hz"),
        (lambda noise, t: 40000 + noise + 20 * np.sin(2 * np.pi * 60 * t), "mains hum at 60 Hz"),
        (lambda noise, t: 40000 + noise, None),
    ],
    ids=["frozen", "rail", "hum", "hum in America", "well"],
)
def test_what_a_sensor_at_rest_can_have(codes, word):
    t = np.arange(doctor.LISTENED_TICKS) / TICK_HZ
    noise = np.round(np.random.default_rng(3).normal(0, 3, len(t)))
    found = sensor(np.round(codes(noise, t)))
    assert found.ok == (word is None)
    assert word is None or word in found.said


def test_white_noise_has_no_hum():
    shares = [hum_share(np.random.default_rng(i).normal(size=doctor.LISTENED_TICKS), 50.0) for i in range(50)]
    assert max(shares) < 0.05


def test_a_slow_adapter_and_a_bad_line_are_told(monkeypatch):
    with Device.open("sim://xyz250") as device:
        monkeypatch.setattr(device.session, "now_s", iter(np.arange(1000) * 0.016).__next__)
        assert "latency timer" in doctor._link(device).said
        monkeypatch.undo()
        status = device.status()
        monkeypatch.setattr(device, "status", lambda: replace(status, rx_errors=3))
        found = doctor._link(device)
    assert not found.ok
    assert "3 frames damaged" in found.said


def test_hard_limits_that_are_tighter_than_the_model_are_told(tmp_path):
    with pl.connect(f"sim://xyz250?state={tmp_path / 'flash.bin'}") as dev:
        assert of(dev.doctor(), "hard limits").said == "none are set"
        dev.upload(built_in("xyz250"))
        dev.set_limits("x", u_max_V=10, slew_V_per_s=1000)
        found = of(dev.doctor(), "hard limits")
        assert found.ok, found.said
        dev.set_limits("x", u_max_V=6)
        found = of(dev.doctor(), "hard limits")
    assert not found.ok
    assert "x: u_max_V 10 is held to " in found.said


def test_hard_limits_that_are_lost_are_told():
    found = doctor._hard_limits(HardLimits({}, lost=True), {})
    assert not found.ok
    assert "set them again" in found.said


def test_what_the_line_lost_counts_as_lost():
    """Only what the device could not send was counted."""
    with pl.connect("faulty://sim://xyz250#lose=1e-4&seed=2") as dev:
        found = of(dev.doctor(), "stream")
    assert not found.ok


def test_limits_beyond_the_converter_are_told():
    assert not doctor._limits("x", AxisModel(limits=Limits(u_max_V=12.0))).ok


@pytest.mark.parametrize(("counts", "ok"), [({}, True), ({"overruns": 2}, False), ({"lost_ticks": 1}, False)])
def test_late_ticks_are_told(counts, ok):
    info = {"overruns": 0, "latched_late": 0, "lost_ticks": 0, "tick_rate_Hz": 5000} | counts
    assert doctor._timing(info).ok == ok
