"""Request and reply over a line that loses, repeats and bends what is sent."""

from __future__ import annotations

import threading
from collections.abc import Callable

import pytest
from fake_device import FakeDevice, FakePort, NoisePort
from hypothesis import given, settings
from hypothesis import strategies as st

from phaselead.device import wire
from phaselead.device.framing import FrameReader, encode_frame
from phaselead.device.session import Refused, Session, SessionLostError
from phaselead.errors import DeviceRefused, LinkError


def open_session(device: FakeDevice) -> Session:
    session = Session(FakePort(device), "fake")
    session.hello()
    return session


def on_nth(n: int, change: Callable[[bytes], list[bytes]]) -> Callable[[bytes], list[bytes]]:
    """Applies ``change`` to the n-th frame alone, counted from 0."""
    count = iter(range(10**9))
    return lambda frame: change(frame) if next(count) == n else [frame]


def bent(frame: bytes) -> list[bytes]:
    return [frame[:5] + bytes([frame[5] ^ 0x55 or 1]) + frame[6:]]


def test_commands_reach_the_device_once_and_in_order() -> None:
    device = FakeDevice()
    session = open_session(device)
    assert session.request(wire.ArmRequest(0)).tick == device.heard
    session.request(wire.ParkRequest())
    assert device.executed == ["hello", "arm", "park"]
    assert session.retries == 0


@settings(max_examples=60, deadline=None)
@given(
    fates=st.lists(st.sampled_from(["ok", "ok", "lost", "twice", "bent", "noise"]), max_size=20),
    uplink=st.booleans(),
)
def test_every_command_acts_exactly_once_whatever_the_line_does(fates: list[str], uplink: bool) -> None:
    queue, misses = list(fates), 0

    def fate(frame: bytes) -> list[bytes]:
        nonlocal misses
        kind = queue.pop(0) if queue else "ok"
        misses = misses + 1 if kind in ("lost", "bent") else 0
        if misses > 2:  # a line that is dead for longer than every attempt is another test
            misses, kind = 0, "ok"
        noise = [b"\x13\x37\0", frame]
        return {"ok": [frame], "lost": [], "twice": [frame, frame], "bent": bent(frame), "noise": noise}[kind]

    device = FakeDevice()
    session = open_session(device)
    device.on_frame, device.on_command = (fate, device.on_command) if not uplink else (device.on_frame, fate)
    for command in (wire.ArmRequest(0), wire.StartRequest(1), wire.ParkRequest(), wire.SetTimeoutRequest(9)):
        session.request(command)
    assert device.executed == ["hello", "arm", "start", "park", "set_timeout"]


def test_the_hello_tells_when_tick_0_was_but_not_of_a_port_with_a_time_of_its_own(monkeypatch) -> None:
    assert open_session(FakeDevice(tick=7000)).tick_0_unix_s is None
    monkeypatch.setattr(Session, "virtual", False)
    monkeypatch.setattr("phaselead.device.session.time.time", lambda: 1.7e9)
    device = FakeDevice(tick=7000)
    session = open_session(device)
    assert session.tick_0_unix_s == pytest.approx(1.7e9 - 7000 / 5000, abs=0.05)
    device.tick = 0  # it was started again
    session.renew()
    assert session.tick_0_unix_s == pytest.approx(1.7e9, abs=0.05)


def test_lost_reply_is_asked_for_again_with_the_very_same_frame() -> None:
    device = FakeDevice()
    session = open_session(device)
    written: list[bytes] = []
    device.on_command = lambda frame: (written.append(frame.lstrip(b"\0")), [frame])[1]  # type: ignore[func-returns-value]
    device.on_frame = on_nth(0, lambda frame: [])
    session.request(wire.ArmRequest(7))
    assert len(written) == 2
    assert written[0] == written[1]
    assert session.retries == 1


def test_a_dead_line_is_reported_after_the_attempts() -> None:
    device = FakeDevice()
    session = open_session(device)
    device.on_frame = lambda frame: []
    with pytest.raises(LinkError, match=r"fake stopped answering \(status, 28 attempts\); check cable"):
        session.request(wire.StatusRequest())
    assert 2.9 < device.tick / 5000 < 3.3  # 12 x 0.05 + 8 x 0.1 + 8 x 0.2 s of the device's time


def test_refusal_names_command_status_and_remedy() -> None:
    session = open_session(FakeDevice(status_of={wire.ArmRequest: wire.Status.MUST_NAME_MODEL}))
    with pytest.raises(
        Refused, match=r"arm refused \(must_name_model\): its model is a fallback; arm naming"
    ) as caught:
        session.request(wire.ArmRequest(0))
    assert (caught.value.command, caught.value.status) == ("arm", wire.Status.MUST_NAME_MODEL)
    assert isinstance(caught.value, DeviceRefused)


def test_every_status_has_words() -> None:
    for status in wire.Status:
        if status != wire.Status.OK:
            text = str(Refused("arm", status))
            assert "unknown to this version" not in text
            assert "\n" not in text
    assert "status 99" in str(Refused("arm", 99))


@pytest.mark.parametrize(
    ("command", "status", "words"),
    [
        (wire.StartRequest(1), wire.Status.BAD_VALUE, "no mode or no path yet; set both"),
        (wire.SetPathRequest(0, 1, 1, 0, 1, 0), wire.Status.MODE_UNSUPPORTED, "the axis is idle; set its mode first"),
        (wire.SetPathRequest(0, 1, 1, 0, 1, 0), wire.Status.NO_MODEL, "it holds no model"),
    ],
)
def test_a_command_says_more_where_it_can(command, status, words) -> None:
    session = open_session(FakeDevice(status_of={type(command): status}))
    with pytest.raises(Refused, match=words):
        session.request(command)


def test_a_device_that_restarted_is_not_mistaken_for_the_old_one() -> None:
    device = FakeDevice()
    session = open_session(device)
    device.restart()
    with pytest.raises(SessionLostError, match=r"has restarted or another host has taken it; run the command again"):
        session.request(wire.StartRequest(1))
    assert device.state == wire.State.PARKED


def test_replies_to_another_session_are_nobodys() -> None:
    device = FakeDevice()
    session = open_session(device)
    device.on_frame = on_nth(0, lambda frame: [])
    reply = wire.ArmReply(wire.Status.OK, 12345).pack()
    device.out += encode_frame(wire.HEADER.pack(wire.ArmReply.NUMBER, 2, session.nonce ^ 1) + reply)
    assert session.request(wire.ArmRequest(0)).tick != 12345
    assert session.strays == 1


def test_a_reply_to_another_command_is_nobodys_even_with_our_number() -> None:
    device = FakeDevice()
    session = open_session(device)
    header = wire.HEADER.pack(wire.StatusReply.NUMBER, 2, session.nonce)
    device.out += encode_frame(header + wire.REPLY_HEAD.pack(wire.Status.BUSY, 1))
    session.request(wire.ArmRequest(0))
    assert session.strays == 1


def test_a_late_reply_is_not_taken_for_the_next_command() -> None:
    device = FakeDevice()
    session = open_session(device)
    late: list[bytes] = []
    device.on_frame = on_nth(0, lambda frame: late.append(frame) or [])  # type: ignore[func-returns-value]
    session.request(wire.ArmRequest(0))
    device.out += late[0]
    reply = session.request(wire.StatusRequest())
    assert reply.state == wire.State.ARMED
    assert session.strays == 1


def test_silence_is_said_to_be_silence() -> None:
    session = Session(NoisePort(FakeDevice(), text=b""), "/dev/ttyX")
    with pytest.raises(LinkError, match=r"nothing answers on /dev/ttyX; check cable and power"):
        session.hello()


@pytest.mark.parametrize("text", [b"login: \r\n", b"\0\0\xff", bytes(range(256)), b"\x01"])
def test_garbage_is_said_to_be_garbage(text: bytes) -> None:
    session = Session(NoisePort(FakeDevice(), text=text), "/dev/ttyX")
    with pytest.raises(LinkError, match=r"/dev/ttyX speaks, but not phaselead .*wrong port, wrong baud rate"):
        session.hello()


@pytest.mark.parametrize(
    ("version", "remedy"),
    [
        (wire.VERSION - 1, "flash the firmware of this version"),
        (wire.VERSION, "one of them is no release"),
        (wire.VERSION + 1, "update phaselead"),
    ],
)
def test_another_version_of_the_wire_says_which_side_to_update(version: int, remedy: str) -> None:
    session = Session(FakePort(FakeDevice(fingerprint=0x12345678, version=version)), "fake")
    with pytest.raises(LinkError, match=rf"another version of the wire \({version}, 0x12345678; this .*; {remedy}"):
        session.hello()


def hello_reply(size: int) -> Callable[[bytes], list[bytes]]:
    def reply(frame: bytes) -> list[bytes]:
        (body,) = FrameReader().feed(frame)
        payload = wire.REPLY_HEAD.pack(0, 5) + (0xABCD).to_bytes(4, "little") + bytes([0xEE]) * (size - 13)
        return [encode_frame(body[: wire.HEADER.size] + payload)]

    return reply


@pytest.mark.parametrize(("size", "version"), [(13, "1"), (75, "1"), (120, "61166")])
def test_a_hello_of_any_length_is_understood_so_far(size: int, version: str) -> None:
    """75 bytes are those of version 1, which did not tell its number."""
    session = Session(FakePort(FakeDevice(on_frame=hello_reply(size))), "fake")
    with pytest.raises(LinkError, match=rf"another version of the wire \({version}, 0x0000ABCD"):
        session.hello()


def greeting_reply(numbers: bytes, size: int) -> Callable[[bytes], list[bytes]]:
    def reply(frame: bytes) -> list[bytes]:
        (body,) = FrameReader().feed(frame)
        payload = wire.REPLY_HEAD.pack(0, 5) + (0xABCD).to_bytes(4, "little") + numbers
        payload += bytes(range(20)) + b"nucleo_f446re".ljust(24, b"\0")
        return [encode_frame(body[: wire.HEADER.size] + payload.ljust(size, b"\x01"))]

    return reply


@pytest.mark.parametrize(("numbers", "size"), [(b"", 75), (b"\2\0\1\0", 79), (b"\3\0\0\0", 120)])
def test_a_device_of_any_version_says_its_board(numbers: bytes, size: int) -> None:
    """Version 1 sends neither number nor revision: build id and board are four bytes earlier."""
    greeting = Session(FakePort(FakeDevice(on_frame=greeting_reply(numbers, size))), "fake").greet()
    assert (greeting.fingerprint, greeting.target) == (0xABCD, "nucleo_f446re")
    assert greeting.build_id == bytes(range(20)).hex()


@pytest.mark.parametrize("begin", [Session.hello, Session.greet])
def test_a_second_host_is_told_to_wait(begin: Callable[[Session], object]) -> None:
    session = Session(FakePort(FakeDevice(status_of={wire.HelloRequest: wire.Status.BUSY})), "fake")
    with pytest.raises(DeviceRefused, match=r"hello refused \(busy\): another host is driving it"):
        begin(session)


def test_a_port_that_goes_away_is_reported() -> None:
    device = FakeDevice()
    session = open_session(device)

    def gone(*_: object) -> bytes:
        raise OSError(5, "Input/output error")

    session.port.read = gone  # type: ignore[method-assign]
    with pytest.raises(LinkError, match="has gone away"):
        session.request(wire.StatusRequest())


def test_no_other_thread_speaks_while_one_reads_or_sends() -> None:
    """A device was kept alive by one thread while another waited for an edge: one of them found that what was there
    had been taken, and said that the port had gone away."""
    free: list[bool] = []

    class Watched(FakePort):
        def read(self, size: int) -> bytes:
            self.look()
            return super().read(size)

        def write(self, data: bytes) -> int:
            self.look()
            return super().write(data)

        def look(self) -> None:
            other = threading.Thread(target=self.speak)
            other.start()
            other.join()

        def speak(self) -> None:
            free.append(session.lock.acquire(blocking=False))
            if free[-1]:
                session.lock.release()

    session = Session(Watched(FakeDevice()), "fake")
    session.hello()
    session.pump(64)
    session.resend(session.submit(wire.StatusRequest()))
    assert len(free) >= 4
    assert not any(free)


def test_the_log_holds_what_was_sent_and_when_it_took_effect() -> None:
    device = FakeDevice()
    session = open_session(device)
    session.log = []
    device.on_frame = on_nth(1, lambda frame: [])
    first = session.request(wire.ArmRequest(0))
    second = session.request(wire.StartRequest(1))
    assert [tick for tick, _ in session.log] == [first.tick, second.tick]
    numbers = [FrameReader().feed(frame)[0][0] for _, frame in session.log]
    assert numbers == [wire.ArmRequest.NUMBER, wire.StartRequest.NUMBER]


def test_identifiers_wrap_around_without_zero() -> None:
    session = open_session(FakeDevice())
    session.last_id = 0xFFFE
    for want in (0xFFFF, 1, 2):
        assert session.submit(wire.StatusRequest()).id == want


@settings(max_examples=100, deadline=None)
@given(
    bodies=st.lists(st.binary(min_size=1, max_size=300), max_size=6),
    cuts=st.lists(st.integers(1, 60), min_size=1),
)
def test_frames_survive_any_cutting_of_the_line(bodies: list[bytes], cuts: list[int]) -> None:
    line, reader, got = b"".join(map(encode_frame, bodies)), FrameReader(), []
    for i in range(10**6):
        if not line:
            break
        cut = cuts[i % len(cuts)]
        got += reader.feed(line[:cut])
        line = line[cut:]
    assert got == bodies
    assert (reader.errors, reader.frames) == (0, len(bodies))


def test_the_tail_of_a_frame_we_did_not_hear_begin_is_no_error() -> None:
    reader = FrameReader()
    assert reader.feed(b"tail\0" + encode_frame(b"whole")) == [b"whole"]
    assert reader.errors == 0
    reader.feed(b"bent\0")
    assert reader.errors == 1


def test_endless_noise_does_not_fill_the_memory() -> None:
    reader = FrameReader()
    for _ in range(100):
        reader.feed(b"\x01" * 1000)
    assert reader.errors > 10
    assert len(reader._rest) <= reader.max_frame
    assert reader.feed(b"\0" + encode_frame(b"whole")) == [b"whole"]


def test_a_host_that_slept_looks_at_what_came_meanwhile() -> None:
    """A jump of the clock over every deadline, with the reply already there."""

    class SleepyPort(FakePort):
        slept_s = 0.0

        @property
        def clock_s(self) -> float:
            return super().clock_s + self.slept_s

        def read(self, size: int = 1) -> bytes:
            if self.device.out and self.slept_s == 0:
                self.slept_s = 3600.0
                return b""
            return super().read(size)

    session = Session(SleepyPort(FakeDevice()), "fake")
    session.hello()
    assert session.retries == 0
    assert session.now_s() >= 3600
