"""The C decoder by itself: what the frame's CRC would hide."""

from __future__ import annotations

import ctypes
from typing import Any
from zlib import crc32

from cobs import cobs
from hypothesis import given, settings
from hypothesis import strategies as st

from phaselead.device import wire

NOTHING, FRAME, ERROR = 0, 1, 2


class Decoder(ctypes.Structure):
    _fields_ = [
        ("buffer", ctypes.c_char_p),
        ("capacity", ctypes.c_size_t),
        ("size", ctypes.c_size_t),
        ("left", ctypes.c_uint8),
        ("flags", ctypes.c_bool * 4),
    ]


def decode(library: Any, line: bytes, capacity: int) -> list[bytes | None]:
    """Frames of the line, None for each one lost; fails when a byte behind the buffer was touched."""
    decoder, guard = Decoder(), b"guard"
    buffer = ctypes.create_string_buffer(bytes(capacity) + guard, capacity + len(guard))
    library.cobs_decoder_init(ctypes.byref(decoder), buffer, ctypes.c_size_t(capacity))
    out: list[bytes | None] = []
    for byte in line:
        event = library.cobs_decoder_push(ctypes.byref(decoder), ctypes.c_uint8(byte))
        if event == FRAME:
            out.append(buffer.raw[: decoder.size])
        elif event == ERROR:
            out.append(None)
    assert buffer.raw[capacity:] == guard
    return out


def expected(piece: bytes, capacity: int) -> bytes | None:
    try:
        raw: bytes = cobs.decode(piece)
    except cobs.DecodeError:
        return None
    return raw if len(raw) <= capacity else None


blocks = st.one_of(
    st.binary(max_size=40),
    st.integers(250, 258).map(lambda n: b"\xff" + b"a" * n),
    st.binary(max_size=520).map(cobs.encode),
)


@settings(max_examples=300, deadline=None)
@given(line=st.lists(blocks, max_size=4).map(lambda p: b"\0".join(p) + b"\0"), capacity=st.integers(1, 600))
def test_any_line_decodes_as_the_package_does(line: bytes, capacity: int, codec_c: Any) -> None:
    pieces = [piece for piece in line.split(b"\0")[:-1] if piece]
    assert decode(codec_c.library, line, capacity) == [expected(piece, capacity) for piece in pieces]


def test_only_a_body_of_a_possible_length_is_opened(codec_c: Any) -> None:
    header, payload, size = ctypes.create_string_buffer(64), ctypes.c_char_p(), ctypes.c_size_t()
    codec_c.library.frame_open.restype = ctypes.c_bool
    shortest, longest = wire.HEADER.size, wire.HEADER.size + wire.MAX_PAYLOAD
    for length in (0, shortest - 1, shortest, longest, longest + 1, 4096):
        body = bytes(length)
        raw = body + crc32(body).to_bytes(4, "little")
        where = ctypes.byref(header), ctypes.byref(payload), ctypes.byref(size)
        opened = codec_c.library.frame_open(raw, ctypes.c_size_t(len(raw)), *where)
        assert opened == (shortest <= length <= longest)
