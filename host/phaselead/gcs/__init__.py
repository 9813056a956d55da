"""PI's General Command Set: other people's programs drive a stage as if it were one of PI's."""

from __future__ import annotations

from phaselead.gcs.server import Served, serve

__all__ = ["Served", "serve"]
