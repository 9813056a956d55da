"""Every command that moves the output, interrupted or cut off from the device at moments of all its length."""

from __future__ import annotations

import os
import shutil
import signal
from collections.abc import Callable
from random import Random
from zlib import crc32

import pytest
import serial

from phaselead import interrupt
from phaselead.device import wire
from phaselead.device.session import Refused, Session
from phaselead.device.update import HEADER
from phaselead.model.axis import AxisModel
from phaselead.model.stage_file import Stage, load_stage, save_stage
from phaselead.record import Recording, read_recording
from phaselead.sim import protocol_sim
from phaselead.sim.device import VirtualDevice
from phaselead.sim.plant import built_in, load_any, plant_parameters

pytestmark = pytest.mark.usefixtures("short_search")

MOMENTS = 12
"""Of each command; their places come from a seed."""
ZERO_V_CODE = 32768
COMMANDS = {
    "arm": ["arm"],
    "park": ["park"],
    "upload": ["upload", "STAGE", "--persist"],
    "track": ["track", "sine:40um@10Hz", "--mode", "pid", "--duration", "0.4", "-o", "RUN"],
    "track with a model": ["track", "sine:2V@10Hz", "--mode", "open", "--model", "STAGE", "--duration", "0.3"],
    "move": ["move", "x=40um", "--duration", "0.1", "--park"],
    "log record": ["log", "record", "--drive", "sine:3V@10Hz", "--duration", "0.4", "-o", "RUN"],
    "log record, listening": ["log", "record", "--duration", "0.3", "-o", "RUN"],
    "selftest": ["selftest", "--axis", "x", "--yes"],
    "status": ["status"],
    "info": ["info"],
    "doctor": ["doctor"],
    "stop": ["stop"],
    "where": ["where"],
    "hold": ["hold"],
    "limits": ["limits", "--axis", "x", "--u-max", "9V"],
    "log trigger": ["log", "trigger", "--on", "set_point"],
    "log faults": ["log", "faults"],
    "log pull": ["log", "pull", "-o", "RUN"],
    "flash --wire": ["flash", "--wire", "--image", "IMAGE"],
    "learn": ["learn", "sine:20um@20Hz", "--model", "KNOWN", "--trials", "1", "-o", "RUN"],
    "tune": ["tune", "--model", "KNOWN", "-o", "OUT"],
    "identify": ["identify", "-o", "OUT", "--levels", "1,2,3V", "--frequencies", "10,15,20Hz"],
}
LONG = {"identify": 2, "learn": 4, "tune": 1}
"""Moments of these: they take long, most of it between experiments."""


class Watched(VirtualDevice):
    """A device that outlives its port and calls ``act`` at one of the host's reads and writes."""

    def __init__(self) -> None:
        super().__init__(plant_parameters(load_any("xyz250"), 0))
        self.calls = 0
        self.moment = -1
        self.act: Callable[[], None] = lambda: None

    def _count(self) -> None:
        self.calls += 1
        if self.calls == self.moment:
            self.act()

    def write(self, data: bytes) -> int:
        self._count()
        return super().write(data)

    def run(self, ticks: int, want_bytes: int = 0) -> int:
        self._count()
        return super().run(ticks, want_bytes)

    def close(self) -> None:
        """It keeps its power."""


class Quiet:
    """A port to the device that counts as no call of the host."""

    def __init__(self, device: Watched) -> None:
        self.device, self.timeout, self._ran = device, 0.05, 0

    @property
    def clock_s(self) -> float:
        return self._ran / 5000

    @property
    def in_waiting(self) -> int:
        return self.device.readable

    def read(self, size: int = 1) -> bytes:
        self._ran += VirtualDevice.run(self.device, 250, size)
        return self.device.read(size)

    def write(self, data: bytes) -> int:
        return VirtualDevice.write(self.device, data)

    def close(self) -> None:
        """Nothing is open."""


def state_of(device: Watched) -> wire.StatusReply | None:
    interrupt.clear()
    device.read(device.readable)
    session = Session(Quiet(device))
    try:
        session.hello()
    except Refused:  # it is held by its last host: neither parked nor in a fault
        return None
    return session.request(wire.StatusRequest())


@pytest.fixture
def device(monkeypatch):
    """What sim://xyz250 leads to; a rehearsal has a device of its own."""
    monkeypatch.setattr("phaselead.device.session.LEFT_ARMED_S", 0.0)  # a device that is held says so at once
    watched, rehearsed = Watched(), protocol_sim.open_device
    monkeypatch.setattr(
        protocol_sim, "open_device", lambda parsed: watched if parsed.stage == "xyz250" else rehearsed(parsed)
    )
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGHUP)
    yield watched
    for number, handler in zip((signal.SIGINT, signal.SIGTERM, signal.SIGHUP), before, strict=True):
        signal.signal(number, handler)
    interrupt.clear()
    VirtualDevice.close(watched)


def image(address):
    """Of a firmware for the simulated device: a header, and a body that nobody runs."""
    body = bytes(i * 31 & 0xFF for i in range(600))
    header = HEADER.pack(0x3149_4C50, 0, HEADER.size + len(body), address, 1 << 16, b"host", bytes([0x22] * 20))
    return header[:4] + crc32(header[8:] + body).to_bytes(4, "little") + header[8:] + body


def freeze(device):
    """What `log pull` fetches, as an interlock that opens freezes it; the fault is cleared."""
    VirtualDevice.inject(device, wire.Fault.INTERLOCK)
    VirtualDevice.run(device, 500)
    session = Session(Quiet(device))
    session.hello()
    session.request(wire.ClearFaultRequest())


def words(name, folder):
    stage = folder / "stage.toml"
    if not stage.exists():
        save_stage(stage, Stage(name="mine", axes={"x": AxisModel()}))
        save_stage(folder / "known.toml", built_in("xyz250"))
        (folder / "update.bin").write_bytes(image(0x0802_0000) + image(0x0804_0000))
    places = {"STAGE": str(stage), "RUN": str(folder / "run.h5"), "OUT": str(folder / "run.toml")}
    places |= {"KNOWN": str(folder / "known.toml"), "IMAGE": str(folder / "update.bin")}
    return [*(places.get(word, word) for word in COMMANDS[name]), "--port", "sim://xyz250"]


CALLS: dict[str, int] = {"tune": 9000}
"""That a command makes when nothing happens to it; where it is not given it is counted."""


def moments(run, device, name, folder):
    """Calls at which to interrupt it, spread over all that it makes."""
    if name not in CALLS:
        if name == "log pull":
            freeze(device)
            device.calls = 0
        outcome = run(*words(name, folder))
        assert outcome.status in (0, 1), outcome.err
        CALLS[name] = max(1, device.calls - 2)
        forget(folder)
    random, calls = Random(name), CALLS[name]
    if name in LONG:
        return sorted(random.randint(1, calls) for _ in range(LONG[name]))
    ends_and_late = {1, 2, round(0.8 * calls), round(0.9 * calls), calls}
    return sorted(ends_and_late | {random.randint(1, calls) for _ in range(MOMENTS)})


def whole_or_none(folder):
    """No file under the output's name, or a whole one; no half one anywhere."""
    assert [path.name for path in folder.iterdir() if ".part" in path.name] == []
    if (folder / "run.h5").exists():
        read_recording(str(folder / "run.h5"))
        assert not (folder / "run.h5.journal").exists()
    if (folder / "run.toml").exists():
        load_stage(folder / "run.toml")


def recovered(run, folder) -> Recording | None:
    """What ``log recover`` makes of the journal that a command left behind, if it did."""
    journal, output = folder / "run.h5.journal", folder / "run.h5"
    if not journal.exists():
        return None
    outcome = run("log", "recover", journal, "-o", output)
    assert outcome.status == 0, outcome.err
    return read_recording(str(output))


def forget(folder):
    """What an earlier moment has left, the records of an identification too."""
    for left in folder.glob("run.*"):
        if left.is_dir():
            shutil.rmtree(left)
        else:
            left.unlink()


def again(device, folder, moment, act, name=""):
    forget(folder)
    interrupt.clear()
    VirtualDevice.inject(device, wire.Fault.CORE_LOST)
    session = Session(Quiet(device))
    session.hello()
    session.request(wire.ClearFaultRequest())
    if name == "log pull":
        freeze(device)
    device.calls, device.moment, device.act = 0, moment, act


@pytest.mark.parametrize("name", COMMANDS)
def test_ctrl_c_leaves_the_output_parked_at_any_moment(run, device, tmp_path, name):
    for moment in moments(run, device, name, tmp_path):
        again(device, tmp_path, moment, lambda: signal.raise_signal(signal.SIGINT), name)
        outcome = run(*words(name, tmp_path))
        assert outcome.error is None, (moment, outcome)
        if device.calls < moment:
            continue  # it was done before: what is asked of a device that has moved before may differ by a call
        assert (outcome.status, outcome.err.count("\n")) == (130, 1), (moment, outcome)
        status = state_of(device)
        assert status is not None, (moment, outcome.err)
        assert status.state == wire.State.PARKED, (moment, outcome.err)
        assert status.dac_codes == (ZERO_V_CODE,) * 3
        whole_or_none(tmp_path)
        recovered(run, tmp_path)


@pytest.mark.parametrize("name", COMMANDS)
def test_a_cable_that_is_pulled_at_any_moment_is_told_and_the_device_parks(run, device, tmp_path, monkeypatch, name):
    def pull():
        def gone(*_):
            raise serial.SerialException("device disconnected")

        patch.setattr(Watched, "run", gone)
        patch.setattr(Watched, "write", gone)

    for moment in moments(run, device, name, tmp_path):
        with monkeypatch.context() as patch:
            again(device, tmp_path, moment, pull, name)
            outcome = run(*words(name, tmp_path))
        assert outcome.error is None, (moment, outcome)
        assert (outcome.status, outcome.err.count("\n")) in ((3, 1), (0, 0)), (moment, outcome)
        VirtualDevice.run(device, 10_000)
        status = state_of(device)
        assert status.at_rest == 7, (moment, outcome.err)
        assert status.dac_codes == (ZERO_V_CODE,) * 3 or name == "arm"
        whole_or_none(tmp_path)
        recovered(run, tmp_path)


@pytest.mark.parametrize("name", ["track", "log record"])
def test_a_program_that_is_killed_leaves_all_that_it_received(run, device, tmp_path, monkeypatch, name):
    """As kill -9: nothing more is written, sent or removed.

    At 0.8 and 0.9 of its calls it is sure to have received samples; how many of the random moments do is their matter.
    """

    class Killed(BaseException):
        pass

    def kill():
        def dead(*_, **__):
            raise Killed

        for place in ("write", "run"):
            patch.setattr(Watched, place, dead)
        for place in ("phaselead.record.journal.JournalWriter._write", "os.replace", "os.remove", "os.unlink"):
            patch.setattr(place, dead)
        dead()

    seen = 0
    for moment in moments(run, device, name, tmp_path):
        with monkeypatch.context() as patch:
            again(device, tmp_path, moment, kill)
            with pytest.raises(Killed):
                run(*words(name, tmp_path))
        VirtualDevice.run(device, 10_000)
        assert state_of(device).at_rest == 7
        journal = tmp_path / "run.h5.journal"
        if journal.exists() and os.path.getsize(journal) > 20_000:
            recording = recovered(run, tmp_path)
            assert recording is not None
            assert len(recording.t_s) > 0
            assert recording.meta["ended"] == "broken off"
            seen += 1
    assert seen >= 2


@pytest.mark.parametrize(("once", "times", "done"), [(False, 1, 1), (False, 3, 3), (True, 1, 1), (True, 2, 1)])
def test_an_interrupt_that_is_held_comes_when_it_is_let_go(once, times, done):
    """With ``once`` the second of them does not wait."""
    before, passed = signal.signal(signal.SIGINT, signal.default_int_handler), []

    @interrupt.held(once=once)
    def interrupted() -> None:
        for _ in range(times):
            signal.raise_signal(signal.SIGINT)
            passed.append(1)

    try:
        with pytest.raises(KeyboardInterrupt):
            interrupted()
        assert len(passed) == done
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
        with interrupt.held():
            interrupt.raise_if_held()
    finally:
        signal.signal(signal.SIGINT, before)
