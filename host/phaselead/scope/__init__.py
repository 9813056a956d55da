"""The live scope: a page on this computer that shows every tick of a device and drives it."""

from __future__ import annotations

from phaselead.scope.hub import Hub
from phaselead.scope.samples import TRACES, Samples
from phaselead.scope.server import serve

__all__ = ["TRACES", "Hub", "Samples", "serve"]
