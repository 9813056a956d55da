"""The fault log as a host reads it: whole, in pieces, and from a device of before."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from phaselead.device import Device, FaultLog, read_fault_log, wire

KEPT = 16


def latch_a_fault(device: Device) -> None:
    device.session.request(wire.SetTimeoutRequest(500))
    device.arm()
    device.session.listen(0.2)
    device.park()


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, FaultLog]:
    """A device whose log is full, and what it reads as over a good line in its next start."""
    url = f"sim://xyz250?state={tmp_path_factory.mktemp('log') / 'flash.bin'}"
    with Device.open(url) as device:
        for _ in range(KEPT + 2):
            latch_a_fault(device)
    with Device.open(url) as device:
        return url, read_fault_log(device)


def test_it_keeps_the_newest(kept: tuple[str, FaultLog]) -> None:
    _, log = kept
    assert (len(log), log.power_cycle) == (KEPT, 2)
    ticks = [fault.tick for fault in log]
    assert ticks == sorted(set(ticks))
    assert {(fault.fault, fault.state, fault.power_cycle) for fault in log} == {("host_timeout", "armed", 1)}


@pytest.mark.parametrize("seed", range(3))
def test_a_line_that_loses_bytes_gives_the_same(kept: tuple[str, FaultLog], tmp_path: Path, seed: int) -> None:
    url, log = kept
    flash = Path(url.partition("state=")[2])
    (tmp_path / "flash.bin").write_bytes(flash.read_bytes())
    noisy = f"faulty://sim://xyz250?state={tmp_path / 'flash.bin'}#lose=0.01&flip=1e-4&seed={seed}"
    with Device.open(noisy) as device:
        found = read_fault_log(device)
    assert found.faults == log.faults


def test_a_fault_between_two_pieces_is_in_its_place(
    kept: tuple[str, FaultLog], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    url, _ = kept
    (tmp_path / "flash.bin").write_bytes(Path(url.partition("state=")[2]).read_bytes())
    with Device.open(f"sim://xyz250?state={tmp_path / 'flash.bin'}") as device:
        ask, moments = device.session.request, iter([False, False, True])
        monkeypatch.setattr(device.session, "_piece", 32)

        def request(command: wire.Command[Any], *waits: Any) -> Any:
            if isinstance(command, wire.SnapshotReadRequest) and next(moments, False):
                latch_a_fault(device)
            return ask(command, *waits)

        monkeypatch.setattr(device.session, "request", request)
        found = read_fault_log(device)
        assert next(moments, None) is None
        monkeypatch.undo()
        assert found == read_fault_log(device)
        assert found.faults[-1].power_cycle == found.power_cycle


def test_a_device_of_before_gives_it_whole(kept: tuple[str, FaultLog]) -> None:
    url, log = kept
    with Device.open(url) as device:
        device.hello = replace(device.hello, wire_revision=2)
        assert read_fault_log(device).faults == log.faults


def test_without_a_fault_it_is_empty() -> None:
    with Device.open("sim://xyz250") as device:
        assert len(read_fault_log(device)) == 0
