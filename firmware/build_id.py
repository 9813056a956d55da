"""The build id: SHA-1 over the firmware's source, names and contents. The board and the host library share it."""

from __future__ import annotations

import hashlib
from pathlib import Path


def build_id(root: Path | str = ".") -> str:
    """Hex digest of every C file below ``root``/firmware."""
    root = Path(root)
    digest = hashlib.sha1()
    for path in sorted((root / "firmware").rglob("*.[ch]"), key=lambda path: path.relative_to(root).as_posix()):
        digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()
