"""A capture keeps every tick or says which are missing, and leaves the output parked whatever happens."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from fake_device import BATCH_TICKS, MODEL, STATE, FakeDevice, FakePort
from hypothesis import given, settings
from hypothesis import strategies as st

from phaselead.device import wire
from phaselead.device.capture import DeviceFault
from phaselead.device.device import Device
from phaselead.device.framing import FrameReader
from phaselead.device.session import Refused, Session
from phaselead.device.stream import Capture, Gap
from phaselead.errors import BadInput, LinkError

ADC = wire.Channel.ADC


def open_device(fake: FakeDevice) -> Device:
    return Device(Session(FakePort(fake), "fake"))


def take(fake: FakeDevice, ticks: int = 3000, **options: Any) -> Capture:
    return open_device(fake).capture(ticks, channels=ADC, **options)


def drop_batches(lost: set[int]) -> Callable[[bytes], list[bytes]]:
    count = iter(range(10**9))

    def fate(frame: bytes) -> list[bytes]:
        body = FrameReader().feed(frame)[0]
        return [] if body[0] == wire.Samples.NUMBER and next(count) in lost else [frame]

    return fate


def test_a_capture_holds_every_tick_and_what_a_replay_needs() -> None:
    fake = FakeDevice()
    fake.run(137)
    taken = take(fake, 3000)
    assert taken.gaps == []
    assert np.array_equal(taken.ticks, np.arange(taken.first_tick, taken.first_tick + len(taken.ticks)))
    adc = taken.axes["x"].adc
    assert adc is not None
    assert np.array_equal(adc, taken.ticks % 65536)
    assert taken.first_tick <= taken.start_tick
    assert taken.end_tick == taken.start_tick + 3000
    assert taken.ticks[-1] >= taken.end_tick
    assert (taken.state, taken.model) == (STATE, MODEL)
    assert taken.stream.lost_batches == taken.stream.dropped_ticks == 0
    assert taken.session == fake.session
    assert fake.state == wire.State.PARKED
    assert fake.stream is None


def test_the_log_holds_the_commands_from_the_streams_beginning_on() -> None:
    fake = FakeDevice()
    taken = take(fake)
    names = [wire.MESSAGES[FrameReader().feed(frame)[0][0]].NAME for _, frame in taken.command_log]
    executed = fake.executed[fake.executed.index("stream_start") + 1 :]
    assert names == executed
    ticks = [tick for tick, _ in taken.command_log]
    assert ticks == sorted(ticks)
    assert ticks[names.index("start")] + 1 == taken.start_tick


def test_the_host_timeout_is_fed_by_device_time() -> None:
    fake = FakeDevice()
    gaps: list[int] = []

    def watch(data: bytes) -> list[bytes]:
        if fake.state == wire.State.RUNNING:
            gaps.append(fake.tick - fake.heard)
        return [data]

    fake.on_command = watch
    take(fake, 20_000)
    assert len(gaps) > 10
    assert max(gaps) < 2500  # half of the second the device waits


@settings(max_examples=25, deadline=None)
@given(lost=st.sets(st.integers(0, 70), max_size=6))
def test_lost_batches_are_gaps_and_nothing_else_is(lost: set[int]) -> None:
    fake = FakeDevice(on_frame=drop_batches(lost))
    taken = take(fake, 2000)
    sent = range(taken.first_tick, taken.first_tick + fake.taken)
    missing = {t for gap in taken.gaps for t in range(gap.first_tick, gap.first_tick + gap.ticks)}
    assert missing == set(sent) - set(taken.ticks.tolist())
    in_front_of_the_last = {n for n in lost if (n + 1) * BATCH_TICKS < fake.taken}
    assert taken.stream.lost_batches >= len(in_front_of_the_last) - (not len(taken.ticks))


def test_what_is_missing_is_counted_over_the_rows_that_are_recorded() -> None:
    """From where the paths begin; from the begin of the stream where a fault came on the way to them."""
    taken = take(FakeDevice(), 2000)
    taken = replace(taken, start_tick=taken.first_tick + 100)
    gap = Gap(taken.first_tick + 1, 2)
    holed = replace(taken, stream=replace(taken.stream, gaps=[gap]))
    assert (holed.recorded_from, holed.missing) == (taken.start_tick, 0)
    fault = replace(taken.status, fault=wire.Fault.ADC_RAIL, fault_tick=taken.start_tick - 1)
    ended = replace(holed, status=fault)
    assert (ended.recorded_from, ended.missing) == (taken.first_tick, 2)
    late = replace(holed, status=replace(fault, fault_tick=taken.start_tick))
    assert (late.recorded_from, late.missing) == (taken.start_tick, 0)


def test_a_lost_last_batch_is_a_gap() -> None:
    fake = FakeDevice()
    last = take(fake, 2000).ticks[-1]
    batches = -(-(int(last) + 1) // BATCH_TICKS)
    taken = take(FakeDevice(on_frame=drop_batches(set(range(batches - 2, 200)))), 2000) if batches > 2 else None
    assert taken is not None
    (gap,) = taken.gaps
    assert gap.first_tick == taken.ticks[-1] + 1


def test_everything_lost_is_one_gap() -> None:
    fake = FakeDevice(on_frame=drop_batches(set(range(10**4))))
    with pytest.raises(LinkError, match="the stream from fake stopped"):
        take(fake, 2000)
    assert fake.state == wire.State.PARKED


@settings(max_examples=25, deadline=None)
@given(fates=st.lists(st.sampled_from(["ok", "ok", "ok", "lost", "twice"]), max_size=120))
def test_lost_and_repeated_replies_cost_nothing(fates: list[str]) -> None:
    queue, misses = list(fates), 0

    def fate(frame: bytes) -> list[bytes]:
        nonlocal misses
        if FrameReader().feed(frame)[0][0] == wire.Samples.NUMBER:
            return [frame]
        kind = queue.pop(0) if queue else "ok"
        misses = misses + 1 if kind == "lost" else 0
        if misses > 2:
            misses, kind = 0, "ok"
        return {"ok": [frame], "lost": [], "twice": [frame, frame]}[kind]

    fake = FakeDevice()
    device = open_device(fake)
    fake.on_frame = fate
    taken = device.capture(3000, channels=ADC)
    assert taken.gaps == []
    assert fake.executed.count("start") == fake.executed.count("arm") == 1
    assert fake.state == wire.State.PARKED


def test_a_fault_ends_the_capture_and_brings_what_was_recorded() -> None:
    fake = FakeDevice(fault_tick=1500)
    with pytest.raises(DeviceFault, match=r"adc_rail on axis x at tick 1500; `phaselead explain adc_rail`") as caught:
        take(fake, 100_000)
    taken = caught.value.capture
    assert taken.ticks[-1] == 1499
    assert taken.gaps == []
    assert taken.events[-1].kind == wire.EventKind.FAULT
    assert fake.executed[-2:] == ["status", "stream_stop"]
    assert "park" in fake.executed


def test_a_fault_is_looked_into_at_once() -> None:
    latest = 0
    for fault_tick in range(1000, 2500, 100):  # wherever it falls between two turns of the status
        fake, asked = FakeDevice(fault_tick=fault_tick), []

        def watch(data: bytes, fake: FakeDevice = fake, asked: list[int] = asked) -> list[bytes]:
            if fake.state == wire.State.FAULT:
                asked.append(fake.tick)
            return [data]

        fake.on_command = watch
        with pytest.raises(DeviceFault):
            take(fake, 100_000)
        latest = max(latest, asked[0] - fault_tick)
    assert latest <= 600


def test_ctrl_c_parks_before_it_goes_on() -> None:
    fake = FakeDevice()

    def press(done: int) -> None:
        if done > 500:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        take(fake, 100_000, progress=press)
    assert fake.state == wire.State.PARKED
    assert fake.stream is None


def test_ctrl_c_anywhere_in_a_session_parks() -> None:
    fake = FakeDevice()
    device = open_device(fake)

    def interrupted() -> None:
        with device:
            device.arm()
            device.start("x")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert fake.state == wire.State.PARKED
    assert isinstance(device.session.port, FakePort)
    assert device.session.port.closed


def test_leaving_the_session_parks_and_waits_for_it() -> None:
    fake = FakeDevice()
    with open_device(fake) as device:
        device.arm()
    assert fake.state == wire.State.PARKED
    fake = FakeDevice()
    with Device(Session(FakePort(fake), "fake"), park_on_exit=False) as device:
        device.arm()
    assert fake.state == wire.State.ARMED


def test_a_device_that_restarts_in_mid_capture_is_noticed() -> None:
    fake = FakeDevice()

    def pull_the_plug(done: int) -> None:
        if done > 1000 and fake.state == wire.State.RUNNING:
            fake.restart()

    with pytest.raises(LinkError, match=r"has restarted or another host|stream from fake stopped"):
        take(fake, 100_000, progress=pull_the_plug)


def test_progress_and_raw_bytes_are_handed_out() -> None:
    fake, done, raw = FakeDevice(), [], bytearray()
    taken = take(fake, 3000, progress=done.append, sink=raw.extend)
    assert done == sorted(done)
    assert done[-1] == 3000
    samples = [b for b in FrameReader().feed(bytes(raw)) if b[0] == wire.Samples.NUMBER]
    assert sum(len(b) - 31 for b in samples) == 2 * len(taken.ticks)


def test_a_stream_beyond_the_line_is_refused_with_the_arithmetic() -> None:
    fake = FakeDevice()
    device = open_device(fake)
    answer = wire.StreamStartReply(wire.Status.BAUD_BUDGET, 5, 213000, 190000, 0)
    fake._do = lambda command: answer  # type: ignore[method-assign]
    with pytest.raises(Refused, match=r"36 bytes a tick make 213000 bytes/s .* the line carries 190000"):
        device.capture(1000, axes="xyz")


def test_without_start_nothing_moves() -> None:
    fake = FakeDevice()
    taken = take(fake, 1000, start=False, park=False)
    assert taken.start_tick == -1
    assert "arm" not in fake.executed
    assert len(taken.ticks) >= 1000


def test_decimation_is_no_gap() -> None:
    fake = FakeDevice()
    fake.run(3)
    taken = take(fake, 4000, decimation=8)
    assert taken.gaps == []
    assert set(np.diff(taken.ticks)) == {8}


def test_nonsense_is_refused_before_anything_is_sent() -> None:
    fake = FakeDevice()
    for options in ({"ticks": 0}, {"axes": ""}, {"axes": "xx"}, {"axes": "w"}):
        with pytest.raises(BadInput):
            open_device(fake).capture(**{"ticks": 10, **options})  # type: ignore[arg-type]
    assert set(fake.executed) == {"hello"}


def test_gap_arithmetic_at_the_beginning() -> None:
    taken = take(FakeDevice(on_frame=drop_batches({0, 1})), 2000)
    assert taken.gaps == [Gap(taken.first_tick, 2 * BATCH_TICKS)]
    assert taken.stream.lost_batches == 2
