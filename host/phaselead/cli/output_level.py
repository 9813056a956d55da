"""Whether a command keeps what it would tell a person to itself."""

from __future__ import annotations

from contextvars import ContextVar

QUIET = "--quiet"
quiet: ContextVar[bool] = ContextVar("quiet", default=False)
