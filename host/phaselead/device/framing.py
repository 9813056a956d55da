"""Frames on the line: COBS(body, CRC-32) and a zero byte, where body is header and payload.

The CRC is CRC-32/ISO-HDLC (check value 0xCBF43926), which is zlib's.
"""

from __future__ import annotations

from dataclasses import dataclass
from zlib import crc32

from cobs import cobs

CRC_SIZE = 4


def encode_frame(body: bytes) -> bytes:
    """The bytes that go on the line for one body, delimiter included."""
    return bytes(cobs.encode(body + crc32(body).to_bytes(CRC_SIZE, "little"))) + b"\0"


def decode_frame(frame: bytes) -> bytes | None:
    """The body of one frame (without its delimiter), or None when COBS or CRC do not hold."""
    try:
        raw: bytes = cobs.decode(frame)
    except cobs.DecodeError:
        return None
    body = raw[:-CRC_SIZE]
    if len(raw) <= CRC_SIZE or crc32(body) != int.from_bytes(raw[-CRC_SIZE:], "little"):
        return None
    return body


@dataclass
class FrameReader:
    """Takes the line in arbitrary pieces and gives the bodies of the frames that survived.

    Whatever stands before the first delimiter may be the tail of a frame sent before we listened: no error is
    counted for it.
    """

    max_frame: int = 4096
    """More bytes than this without a delimiter are noise, and are dropped."""
    errors: int = 0
    """Pieces between delimiters that were no frame."""
    frames: int = 0
    received: int = 0
    """Bytes, of whatever kind."""
    _rest: bytes = b""
    _synchronised: bool = False

    @property
    def inside_frame(self) -> bool:
        """Whether the last chunk ended within a frame."""
        return bool(self._rest)

    def feed(self, chunk: bytes) -> list[bytes]:
        """Bodies (header and payload) of the frames that are completed by this chunk, in order."""
        self.received += len(chunk)
        pieces = chunk.split(b"\0")
        pieces[0] = self._rest + pieces[0]
        self._rest = pieces.pop()
        bodies = []
        for piece in pieces:
            if not piece:
                continue
            body = decode_frame(piece)
            if body is not None:
                bodies.append(body)
            elif self._synchronised:
                self.errors += 1
            self._synchronised = True
        if len(self._rest) > self.max_frame:
            self._rest = b""
            self.errors += 1
        self.frames += len(bodies)
        return bodies
