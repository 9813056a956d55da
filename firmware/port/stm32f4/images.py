"""The images of a firmware after linking: build id and CRC in their headers, and both in one file for an update.

update.bin is the image for slot A and then that for slot B, each as long as its header (app/image.h) says.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path
from zlib import crc32

HEADER = struct.Struct("<5I24s20s")
MAGIC = 0x31494C50
SLOTS = (0x0802_0000, 0x0804_0000)
CRC_AT, CRC_FROM, LENGTH_AT, BUILD_ID_AT = 4, 8, 8, 44
LOAD = 1


def segments(elf: bytes) -> list[tuple[int, int, int]]:
    """Offset in the file, address in flash and size of everything that an ELF file has loaded."""
    (table,), (entry_size, count) = struct.unpack_from("<I", elf, 28), struct.unpack_from("<HH", elf, 42)
    found = []
    for at in range(table, table + entry_size * count, entry_size):
        kind, offset, _, address, size = struct.unpack_from("<5I", elf, at)
        if kind == LOAD and size:
            found.append((offset, address, size))
    return sorted(found, key=lambda segment: segment[1])


def flash(elf: bytes) -> dict[int, bytes]:
    """What an ELF file puts into flash, by address."""
    return {address: elf[offset : offset + size] for offset, address, size in segments(elf)}


def image(elf: bytes) -> bytes:
    """The image in an ELF file, as it lies in its slot. Raises ValueError when there is none."""
    parts = flash(elf)
    for slot in SLOTS:
        inside = {address: part for address, part in parts.items() if slot <= address < slot + 0x20000}
        if not inside:
            continue
        whole = bytearray(b"\xff" * (max(address + len(part) for address, part in inside.items()) - slot))
        for address, part in inside.items():
            whole[address - slot : address - slot + len(part)] = part
        return bytes(whole[: struct.unpack_from("<I", whole, LENGTH_AT)[0]])
    raise ValueError("there is no image in it")


def finish(path: Path, build_id: str) -> None:
    """Writes build id and CRC into the header of a linked image."""
    elf = bytearray(path.read_bytes())
    at = next(offset for offset, address, _ in segments(elf) if address in SLOTS)
    elf[at + BUILD_ID_AT : at + HEADER.size] = bytes.fromhex(build_id)
    struct.pack_into("<I", elf, at + CRC_AT, crc32(image(elf)[CRC_FROM:]))
    path.write_bytes(elf)


def bundle(elves: Sequence[Path], to: Path) -> None:
    """Writes the images of some ELF files into one."""
    to.write_bytes(b"".join(image(path.read_bytes()) for path in elves))
