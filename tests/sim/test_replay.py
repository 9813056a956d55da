"""Every recording runs again bit for bit, on every build; what cannot be run again says why."""

import contextlib
import os
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from phaselead.device import wire
from phaselead.device.capture import DeviceFault
from phaselead.device.device import Device
from phaselead.device.encode_model import device_model
from phaselead.device.stream import AxisStream, Gap
from phaselead.errors import BadInput
from phaselead.model.table import TableView
from phaselead.sim.device import load_library
from phaselead.sim.plant import built_in
from phaselead.sim.replaying import replay

ROOT = Path(__file__).parents[2]
URL = "sim://xyz250"
PAPER = {"kp_V_per_um": 0.017, "ki_V_per_um_s": 8.62, "kd_V_s_per_um": 2.33e-5}
TABLE_I = TableView(
    swing_V=(0.5, 10),
    f_Hz=(1, 20),
    a_um_per_V=(15.2536, 1.9619, -0.1013),
    b_deg=(1.9238, 0.7477, 0.0456, 0.0047, -0.0466, 0.0003),
    c_um=(-1.7893, 1.1365, 0.3635, -0.0463, -0.0140, -0.0150),
)


def model():
    stage = built_in("xyz250")
    axes = {name: axis.model_copy(update={"table": TABLE_I}) for name, axis in stage.axes.items()}
    return device_model(stage.model_copy(update={"axes": axes}))


def gains_of(mode):
    return PAPER if "pid" in mode else {}


def record(ticks, setup, *, axes="x", upload=True, **how):
    with Device.open(URL) as device:
        if upload:
            device.upload(model())
        setup(device)
        return device.capture(ticks, axes=axes, **how)


def sine(mode, swing, f_Hz, axes="x", **path):
    def setup(device):
        for axis in axes:
            device.set_axis(axis, mode, **gains_of(mode))
            device.set_path(axis, "sine", swing=swing, f_Hz=f_Hz, **path)

    return setup


def wave(device):
    device.upload_wave("x", np.clip(1.2 * np.abs(np.linspace(-1, 1, 1024)), 0, 1))
    device.set_axis("x", "ff_pid", **PAPER, derivative_filter_Hz=3000)
    device.set_path("x", "wave", swing=40, f_Hz=7)


def move(device):
    device.set_axis("y", "ff_pid", **PAPER)
    device.set_path("y", "move", swing=120, offset=0, ticks=3000)


def inverse_move(device):
    device.set_axis("z", "inverse_pid", **PAPER)
    device.set_path("z", "move", swing=90, offset=0, ticks=2500)


def inverse_wave(device):
    """Corners at the slew limit, and beyond what the inverse reaches."""
    device.upload_wave("x", np.clip(1.2 * np.abs(np.linspace(-1, 1, 1024)), 0, 1))
    device.set_axis("x", "inverse")
    device.set_path("x", "wave", swing=220, offset=10, f_Hz=31)


def wild(device):
    """Gains that oscillate from rail to rail of the output, so that every limiter works."""
    device.set_axis("x", "pid", kp_V_per_um=0.5, ki_V_per_um_s=300, kd_V_s_per_um=1e-3)
    device.set_path("x", "sine", swing=240, f_Hz=15)


RECORDINGS = {
    "open": lambda: record(200_000, sine("open", 8, 11), upload=False),
    "three axes ff_pid": lambda: record(150_000, sine("ff_pid", 60, 5, "xyz"), axes="xyz"),
    "pid": lambda: record(200_000, sine("pid", 60, 5)),
    "ff": lambda: record(150_000, sine("ff", 100, 20)),
    "waveform": lambda: record(150_000, wave),
    "move": lambda: record(50_000, move, axes="y"),
    "beyond the limits": lambda: record(100_000, sine("pid", 150, 100, offset=60)),
    "path that ends": lambda: record(30_000, sine("ff_pid", 60, 5, ticks=7777)),
    "inverse": lambda: record(30_000, sine("inverse", 60, 5)),
    "three axes inverse_pid": lambda: record(30_000, sine("inverse_pid", 60, 5, "xyz"), axes="xyz"),
    "inverse on a move": lambda: record(20_000, inverse_move, axes="z"),
    "inverse on a waveform": lambda: record(20_000, inverse_wave),
}
TOTAL_TICKS = 1_000_000


@pytest.fixture(scope="module")
def recordings():
    return {name: make() for name, make in RECORDINGS.items()}


def test_a_million_ticks_replay_bit_for_bit(recordings):
    assert sum(len(capture.ticks) for capture in recordings.values()) >= TOTAL_TICKS
    for name, capture in recordings.items():
        assert not capture.gaps, name
        assert replay(capture) is None, name


def other_builds():
    flags = {
        "gcc -O0": ["gcc", "-O0"],
        "gcc -O3": ["gcc", "-O3"],
        "clang -O2": ["clang", "-O2"],
        "clang -O0": ["clang", "-O0"],
    }
    return [pytest.param(command, id=name) for name, command in flags.items()]


def build(command, path):
    if shutil.which(command[0]) is None:
        pytest.skip(f"{command[0]} is not installed")
    folders = ("firmware/core", "firmware/app", "firmware/port/host", "host/phaselead/sim/kernel")
    sources = [str(source) for folder in folders for source in sorted((ROOT / folder).glob("*.c"))]
    includes = [f"-I{ROOT / 'firmware'}", f"-I{ROOT / 'host/phaselead/sim/kernel'}"]
    flags = ["-std=c11", "-shared", "-fPIC", "-ffp-contract=off", *includes]
    subprocess.run([*command, *flags, *sources, "-lm", "-o", str(path)], check=True, env=os.environ)
    return load_library(str(path))


@pytest.mark.parametrize("command", other_builds())
def test_every_build_gives_the_same_bits(recordings, tmp_path_factory, command):
    library = build(command, tmp_path_factory.mktemp("build") / "firmware.so")
    for name, capture in recordings.items():
        assert replay(capture, library) is None, name


def test_an_oscillating_loop_replays_too():
    """With gains this wild the output hits slew and clamp, and the sensor its rails: a fault, and the way home."""
    with pytest.raises(DeviceFault) as fault:
        record(100_000, wild)
    capture = fault.value.capture
    assert capture.status.fault == wire.Fault.ADC_RAIL
    assert replay(capture) is None


def test_a_host_timeout_in_a_recording_comes_again():
    with Device.open(URL, park_on_exit=False) as device:
        sine("open", 4, 5)(device)
        device.set_timeout(500)
        with pytest.raises(DeviceFault) as fault:
            device.capture(20_000)
    capture = fault.value.capture
    assert capture.status.fault == wire.Fault.HOST_TIMEOUT
    assert replay(capture) is None
    assert replay(replace(capture, events=[])) is not None  # retries feed it too, so it comes from the recording


@pytest.mark.parametrize("fault", [wire.Fault.INTERLOCK, wire.Fault.TICK_LOST, wire.Fault.TICK_OVERRUN])
def test_a_fault_from_outside_comes_again_in_its_tick(fault):
    with Device.open(URL, park_on_exit=False) as device:
        sine("open", 4, 5)(device)
        port = device.session.port

        def inject(done):
            if done > 3000:
                port.device.inject(fault)

        with pytest.raises(DeviceFault) as raised:
            device.capture(20_000, progress=inject)
    capture = raised.value.capture
    assert capture.status.fault == fault
    assert replay(capture) is None
    without = replace(capture, events=[])
    assert replay(without) is not None  # the event carries it


def test_a_recording_may_begin_and_end_in_full_swing():
    with Device.open(URL) as device:
        device.upload(model())
        sine("ff_pid", 60, 5, "xy")(device)
        device.arm()
        device.start("xy")
        device.wait(0.33)
        first = device.capture(20_000, axes="xy", start=False, park=False)
        device.wait(0.05)
        second = device.capture(20_000, axes="xyz", start=False)
        short = device.capture(3000, axes="x", park=False)
    short = replace(short, command_log=[entry for entry in short.command_log if entry[0] <= short.start_tick])
    dac = short.axes["x"].dac.copy()
    dac[-1] ^= 1
    assert replay(with_axis(short, "x", replace(short.axes["x"], dac=dac))) == short.ticks[-1]
    for capture in (first, second, short):
        assert capture.first_tick > 1000
        assert replay(capture) is None


def test_the_first_tick_that_differs_is_named(recordings):
    capture = recordings["pid"]
    axis = capture.axes["x"]
    for row in (0, 1, 77_777, len(capture.ticks) - 1):
        dac = axis.dac.copy()
        dac[row] ^= 1
        changed = with_axis(capture, "x", replace(axis, dac=dac))
        assert replay(changed) == capture.ticks[row]


def test_one_adc_code_changes_what_follows(recordings):
    capture = recordings["pid"]
    axis = capture.axes["x"]
    adc = axis.adc.copy()
    adc[50_000] ^= 0x40
    difference = replay(with_axis(capture, "x", replace(axis, adc=adc)))
    assert difference == capture.ticks[50_000]


def with_axis(capture, name, stream):
    return replace(capture, stream=replace(capture.stream, axes={**capture.axes, name: stream}))


def cut(stream, keep):
    names = ("reference", "adc", "dac", "feedforward", "feedback")
    return AxisStream(**{name: getattr(stream, name)[keep] for name in names})


def gapped(capture):
    keep = np.ones(len(capture.ticks), bool)
    keep[1000:1100] = False
    stream = capture.stream
    axes = {name: cut(axis, keep) for name, axis in capture.axes.items()}
    gaps = [Gap(int(stream.ticks[1000]), 100)]
    return replace(capture, stream=replace(stream, ticks=stream.ticks[keep], axes=axes, gaps=gaps))


def test_what_is_missing_is_named(recordings):
    capture, three = recordings["pid"], recordings["three axes ff_pid"]
    axis, stream = capture.axes["x"], capture.stream
    hello = replace(capture.hello, schema_fingerprint=capture.hello.schema_fingerprint ^ 1)
    broken = {
        "wire schema": replace(capture, hello=hello),
        "decimated by 4": replace(capture, stream=replace(stream, decimation=4)),
        "ADC codes of axis x": with_axis(capture, "x", replace(axis, adc=None)),
        "DAC codes of axis x": with_axis(capture, "x", replace(axis, dac=None)),
        f"ticks from {capture.ticks[1000]} on": gapped(capture),
        "lacks the control state": replace(capture, state=b""),
        "not one of this firmware": replace(capture, state=capture.state[:-1]),
        "of another tick": replace(capture, state=b"\1" + bytes(7) + capture.state[8:]),
        "holds no ticks": replace(capture, stream=replace(stream, ticks=stream.ticks[:0])),
        "lacks axis z": replace(three, stream=replace(three.stream, axes={a: three.axes[a] for a in "xy"})),
        "lacks the model": replace(recordings["ff"], model=None),
        "lacks the model ": replace(recordings["inverse"], model=None),
        "lacks the waveform": replace(recordings["waveform"], waves={}),
        "is refused by this firmware": replace(recordings["ff"], model=bytes(wire.Model.SIZE)),
    }
    for words, capture in broken.items():
        with pytest.raises(BadInput, match=words) as refusal:
            replay(capture)
        assert "\n" not in str(refusal.value)


def test_any_state_bytes_are_refused_or_run(recordings):
    """A damaged recording must not crash the process that replays it."""
    rng = np.random.default_rng(5)
    for name, rounds in (("path that ends", 300), ("three axes inverse_pid", 100)):
        capture = recordings[name]
        for _ in range(rounds):
            state = bytearray(capture.state)
            for at in rng.integers(8, len(state), 3):
                state[at] = rng.integers(256)
            with contextlib.suppress(BadInput):
                replay(replace(capture, state=bytes(state)))
