"""Both codecs say the same, about every message and about every kind of rubbish."""

from __future__ import annotations

import ctypes
import json
import zlib
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
from cobs import cobs
from hypothesis import given, settings
from hypothesis import strategies as st

from phaselead.device import wire
from phaselead.device.framing import FrameReader, encode_frame

ROOT = Path(__file__).resolve().parents[2]
GOLDEN = json.loads((ROOT / "protocol" / "golden.json").read_text())["frames"]
NAMES = sorted({f["message"] for f in GOLDEN})


def class_of(name: str) -> type[Any]:
    return getattr(wire, "".join(part.capitalize() for part in name.split("_")))  # type: ignore[no-any-return]


def integers(base: str) -> st.SearchStrategy[int]:
    bits = int(base[1:])
    low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if base[0] == "i" else (0, (1 << bits) - 1)
    return st.integers(low, high)


def values(schema: Any, fields: Any) -> dict[str, st.SearchStrategy[Any]]:
    out: dict[str, st.SearchStrategy[Any]] = {}
    for f in fields:
        if f.is_tail:
            out[f.name] = st.binary(max_size=wire.MAX_PAYLOAD - schema.size(fields))
        elif f.is_blob:
            out[f.name] = st.binary(min_size=f.count, max_size=f.count)
        else:
            record = schema.records.get(f.base)
            one = st.builds(class_of(f.base), **values(schema, record.fields)) if record else integers(f.base)
            out[f.name] = st.tuples(*[one] * f.count) if f.count else one
    return out


def message_of(schema: Any, name: str) -> st.SearchStrategy[Any]:
    fields = next(m.fields for m in schema.messages if m.full_name == name)
    return st.builds(class_of(name), **values(schema, fields))


def header(message: Any, request: int, session: int) -> bytes:
    return wire.HEADER.pack(message.NUMBER, request, session)


def accepted(line: bytes) -> list[bytes]:
    """What the host's codec makes of a line: every message it accepts, packed again into a frame."""
    frames = []
    for body in FrameReader().feed(line):
        if len(body) < wire.HEADER.size or body[0] not in wire.MESSAGES:
            continue
        try:
            message = wire.MESSAGES[body[0]].unpack(body[wire.HEADER.size :])
        except wire.WireError:
            continue
        frames.append(encode_frame(body[: wire.HEADER.size] + message.pack()))
    return frames


@pytest.mark.parametrize("name", NAMES)
def test_random_messages_pack_alike_and_return(name: str, schema: Any, codec_c: Any, line_c: Any) -> None:
    fields = next(m.fields for m in schema.messages if m.full_name == name)

    @settings(max_examples=12, deadline=None)
    @given(message=message_of(schema, name), request=st.integers(0, 0xFFFF), session=st.integers(0, 2**64 - 1))
    def law(message: Any, request: int, session: int) -> None:
        payload = message.pack()
        assert type(message).unpack(payload) == message
        assert codec_c.pack(name, fields, message) == payload
        frame = encode_frame(header(message, request, session) + payload)
        assert line_c.accepted(frame) == [frame]

    law()


def test_random_model_packs_alike(schema: Any, codec_c: Any) -> None:
    fields = schema.records["model"].fields

    @settings(max_examples=20, deadline=None)
    @given(model=st.builds(wire.Model, **values(schema, fields)))
    def law(model: wire.Model) -> None:
        payload = model.pack()
        assert wire.Model.unpack(payload) == model
        assert codec_c.pack("model", fields, model) == payload

    law()


@pytest.mark.parametrize("golden", GOLDEN, ids=[f"{f['message']}-{i}" for i, f in enumerate(GOLDEN)])
def test_golden_frame(golden: dict[str, Any], schema: Any, codec_c: Any, line_c: Any) -> None:
    frame = bytes.fromhex(golden["frame"])
    (body,) = FrameReader().feed(frame)
    assert wire.HEADER.unpack_from(body) == (golden["type"], golden["id"], golden["session"])
    message = wire.MESSAGES[golden["type"]].unpack(body[wire.HEADER.size :])
    assert type(message) is class_of(golden["message"])
    fields = next(m.fields for m in schema.messages if m.full_name == golden["message"])
    for f in fields:
        value, want = getattr(message, f.name), golden["fields"][f.name]
        if isinstance(value, bytes):
            value = value.hex()
        if f.base in schema.records:
            value = tuple(asdict(record) for record in value)
        assert value == (tuple(want) if f.count and not f.is_blob else want), f.name
    assert encode_frame(body[: wire.HEADER.size] + message.pack()) == frame
    assert codec_c.pack(golden["message"], fields, message) == body[wire.HEADER.size :]
    assert line_c.accepted(frame) == [frame]


frames = st.sampled_from([bytes.fromhex(f["frame"]) for f in GOLDEN])
edits = st.lists(st.tuples(st.sampled_from("sdi"), st.integers(0, 400), st.integers(0, 255)), max_size=3)


@st.composite
def lines(draw: st.DrawFn) -> bytes:
    """Frames, whole, bent and cut, with noise between them."""
    out = b""
    for _ in range(draw(st.integers(1, 4))):
        piece = bytearray(draw(frames))
        for kind, at, byte in draw(edits):
            at %= len(piece)
            if kind == "s":
                piece[at] = byte
            elif kind == "d" and len(piece) > 1:
                del piece[at]
            else:
                piece.insert(at, byte)
        cut = draw(st.integers(0, len(piece)))
        out += bytes(piece if draw(st.booleans()) else piece[:cut]) + draw(st.binary(max_size=6))
    return out


@settings(max_examples=300, deadline=None)
@given(line=lines())
def test_codecs_accept_the_same_of_a_bent_line(line: bytes, line_c: Any) -> None:
    assert line_c.accepted(line) == accepted(line)


@settings(max_examples=150, deadline=None)
@given(number=st.integers(0, 255), payload=st.binary(max_size=100), known=st.sampled_from(sorted(wire.MESSAGES)))
def test_codecs_accept_the_same_of_any_payload(number: int, payload: bytes, known: int, line_c: Any) -> None:
    for kind in (number, known):
        size = wire.MESSAGES[kind].SIZE if kind in wire.MESSAGES else 0
        for cut in (payload, (payload * 2 + bytes(size))[:size], bytes(size + 1), bytes(max(size - 1, 0))):
            line = encode_frame(wire.HEADER.pack(kind, 1, 2) + cut)
            fitted = kind in wire.MESSAGES and not wire.MESSAGES[kind].TAIL and len(cut) != size
            assert line_c.accepted(line) == ([] if fitted else accepted(line))  # the device fits it before


def test_both_refuse_a_payload_over_the_limit(line_c: Any) -> None:
    fits, over = bytes(wire.MAX_PAYLOAD), bytes(wire.MAX_PAYLOAD + 1)
    for payload, kept in ((fits, 1), (over, 0)):
        line = encode_frame(wire.HEADER.pack(wire.Samples.NUMBER, 0, 0) + payload)
        assert len(line_c.accepted(line)) == len(accepted(line)) == kept


@settings(max_examples=100, deadline=None)
@given(noise=st.binary(min_size=1, max_size=3000))
def test_a_frame_after_any_noise_is_read(noise: bytes, line_c: Any) -> None:
    frame = bytes.fromhex(GOLDEN[0]["frame"])
    assert line_c.accepted(noise + b"\0" + frame)[-1] == accepted(noise + b"\0" + frame)[-1] == frame


@settings(max_examples=200, deadline=None)
@given(raw=st.one_of(st.binary(max_size=1200), st.integers(250, 260).map(lambda n: b"\1" * n)))
def test_cobs_is_the_cobs_of_the_package(raw: bytes, codec_c: Any) -> None:
    out = ctypes.create_string_buffer(len(raw) + len(raw) // 254 + 1)
    codec_c.library.cobs_encode.restype = ctypes.c_size_t
    size = codec_c.library.cobs_encode(raw, ctypes.c_size_t(len(raw)), out)
    assert out.raw[:size] == cobs.encode(raw)


@settings(max_examples=50, deadline=None)
@given(raw=st.binary(max_size=600), cut=st.integers(0, 600))
def test_crc_is_zlibs_in_one_piece_and_in_two(raw: bytes, cut: int, codec_c: Any) -> None:
    crc = codec_c.library.crc32
    crc.restype, crc.argtypes = ctypes.c_uint32, [ctypes.c_uint32, ctypes.c_char_p, ctypes.c_size_t]
    first = crc(0, raw[:cut], len(raw[:cut]))
    assert crc(0, raw, len(raw)) == crc(first, raw[cut:], len(raw[cut:])) == zlib.crc32(raw)


def test_crc_check_value(codec_c: Any) -> None:
    codec_c.library.crc32.restype = ctypes.c_uint32
    assert codec_c.library.crc32(0, b"123456789", ctypes.c_size_t(9)) == 0xCBF43926 == zlib.crc32(b"123456789")


def test_a_value_that_does_not_fit_is_named() -> None:
    with pytest.raises(wire.WireError, match="arm"):
        wire.ArmRequest(model_crc=1 << 32).pack()
    with pytest.raises(wire.WireError, match=r"hello reply\.build_id: 20 bytes expected, got 3"):
        wire.HelloReply(0, 0, 0, 2, 0, b"abc", b"", 0, 0, 0, 0, 0, 0, 0, 0).pack()
    with pytest.raises(wire.WireError, match="model: 3 axes expected, got 0"):
        wire.Model(0, bytes(32), ()).pack()
    with pytest.raises(wire.WireError, match="status reply: at least 65 bytes expected, got 64"):
        wire.StatusReply.unpack(bytes(64))
    with pytest.raises(wire.WireError, match="do not fit, at most 1148"):
        wire.ModelChunkRequest(0, bytes(1149)).pack()
