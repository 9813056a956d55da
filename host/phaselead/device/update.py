"""A new firmware over the wire: into the slot that does not run, tried, and confirmed once it has spoken.

The device keeps the image before until then, and goes back to it by itself when the new one does not report in.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from zlib import crc32

from phaselead.device import wire
from phaselead.device.session import FLASH_WAITS_S, Greeting, Refused, Session
from phaselead.device.status import target_of
from phaselead.errors import BadInput, LinkError, PhaseleadError
from phaselead.result import Facts
from phaselead.serial_ports import open_port

HEADER = struct.Struct("<5I24s20s")
"""struct image_header of firmware/app/image.h."""
MAGIC = 0x3149_4C50
CRC_FROM = 8
TO_ZERO_S = 30.0
"""An output of 10 V is ramped to 0 V at the model's own pace, by default in 0.2 s."""
RESTART_S = 0.1
"""The device restarts 20 ms after it was told to."""
BACK_TRIES = 6
"""Of 1.4 s each: it is back within 50 ms, or with the image before after the 4.1 s of the bootloader's watchdog."""


@dataclass(frozen=True)
class Image:
    """A firmware image as it will lie in flash. ``version`` is major, minor, patch."""

    content: bytes
    address: int
    version: tuple[int, int, int]
    target: str
    build_id: str


def parse_images(content: bytes, name: str) -> list[Image]:
    """The images of an update file, which follow each other. Raises BadInput when one of them is not whole."""
    images, at = [], 0
    while at < len(content):
        if len(content) - at < HEADER.size:
            raise BadInput(f"{name}: ends in the middle of a header; build it again with `make firmware`")
        magic, crc, length, address, version, target, build_id = HEADER.unpack_from(content, at)
        whole = content[at : at + length]
        if magic != MAGIC:
            raise BadInput(f"{name}: is no firmware image; give the update.bin that `make firmware` leaves")
        if len(whole) < max(length, HEADER.size) or crc32(whole[CRC_FROM:]) != crc:
            raise BadInput(f"{name}: an image in it is damaged; build it again with `make firmware`")
        numbers = version >> 16, version >> 8 & 0xFF, version & 0xFF
        images.append(Image(whole, address, numbers, target_of(target), build_id.hex()))
        at += length
    if not images:
        raise BadInput(f"{name}: is empty; give the update.bin that `make firmware` leaves")
    return images


def read_images(path: Path) -> list[Image]:
    """Reads an update file. Raises BadInput when it cannot be read or holds no whole image."""
    try:
        return parse_images(path.read_bytes(), str(path))
    except OSError as error:
        raise BadInput(f"{path}: cannot be read ({error.strerror}); give an update.bin, or build one") from None


def fitting(images: Sequence[Image], target: str, address: int) -> Image:
    """The image for a board's free slot. Raises BadInput when there is none."""
    if target not in {image.target for image in images}:
        raise BadInput(f"the image is for a {images[0].target}, the device is a {target}; build it for that board")
    for image in images:
        if (image.target, image.address) == (target, address):
            return image
    raise BadInput(f"no image is linked for 0x{address:08x}; give the whole update.bin, for both slots")


def _begin(session: Session, image: Image) -> None:
    """Waits for outputs that are still on their way to 0 V."""
    until_s = session.now_s() + TO_ZERO_S
    while True:
        try:
            session.request(wire.UpdateBeginRequest(image.content[: HEADER.size]), FLASH_WAITS_S)
            return
        except Refused as refused:
            if refused.status != wire.Status.BUSY or session.now_s() > until_s:
                raise
        session.listen(RESTART_S)


def send(session: Session, image: Image, on_progress: Callable[[float], None] = lambda share: None) -> None:
    """Puts an image into the free slot and on trial; the device runs on. Raises Refused or LinkError."""
    _begin(session, image)
    body = image.content[HEADER.size :]

    def piece(at: int, length: int, waits_s: Sequence[float]) -> tuple[int, int]:
        data = body[at : at + length]
        session.request(wire.UpdateChunkRequest(HEADER.size + at, data), waits_s)
        on_progress((at + len(data)) / len(body))
        return at + len(data), len(body)

    session.transfer(piece)
    session.request(wire.UpdateCommitRequest(), FLASH_WAITS_S)


def _back(old: Session) -> tuple[Session, Greeting]:
    """The device after its restart, on the same port. Raises LinkError when it does not come back."""
    for left in reversed(range(BACK_TRIES)):
        session = Session(old.port, old.name)
        try:
            return session, session.greet()
        except LinkError:
            if left == 0:
                raise
    raise AssertionError


def confirm(session: Session, build_id: str) -> None:
    """Tells the device that its image is to stay. Raises Refused when it runs another build."""
    session.request(wire.UpdateConfirmRequest(bytes.fromhex(build_id)), FLASH_WAITS_S)


def update(port: str, images: Sequence[Image], on_progress: Callable[[float], None] = lambda share: None) -> Facts:
    """Replaces a device's firmware, of whatever version: board, build_id, replaced, version, slot, runs_it.

    A device that runs the build already is only told that it is to stay. The outputs are at 0 V all the while.

    Raises:
        BadInput: the images are for another board.
        Refused: the device is armed or running, or has no image slots.
        LinkError: it stopped answering; it keeps the image it had, or goes back to it.
        PhaseleadError: the new image did not report in, and the device went back.
    """
    line = open_port(port)
    try:
        session = Session(line, port)
        before = session.greet()
        info = session.request(wire.UpdateInfoRequest())
        image = fitting(images, before.target, info.free_address)
        if before.build_id != image.build_id:
            send(session, image, on_progress)
            session.request(wire.UpdateRestartRequest())
            session.listen(RESTART_S)
            session, after = _back(session)
            if after.build_id != image.build_id:
                raise PhaseleadError(
                    f"the new image did not start; the device is back at build {after.build_id[:12]}, nothing is lost"
                )
        confirm(session, image.build_id)
        info = session.request(wire.UpdateInfoRequest())
    finally:
        line.close()
    return Facts(
        {
            "board": image.target,
            "build_id": image.build_id,
            "replaced": before.build_id,
            "version": ".".join(str(part) for part in image.version),
            "slot": "AB"[info.slot],
            "runs_it": True,
        }
    )
