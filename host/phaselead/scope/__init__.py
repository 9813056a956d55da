"""The live scope: a page on this computer that shows every tick of a device and drives it."""

from __future__ import annotations

from phaselead.scope.server import serve

__all__ = ["serve"]
