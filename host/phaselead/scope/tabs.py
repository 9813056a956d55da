"""The tabs that are open, and which of them drives."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

RELOAD_S = 5.0
"""So long the tab that drove may come back before another can take over."""


@dataclass
class Tabs:
    """One tab drives, the others look on; every tab may stop the stage."""

    open: set[str] = field(default_factory=set)
    driver: str | None = None
    _left_s: float = 0.0

    def enter(self, tab: str) -> str:
        """A tab that opens, or is loaded again; its name from now on: a copy of one that is open gets its own."""
        name = tab if tab and tab not in self.open else f"{tab[:20]}.{time.monotonic_ns()}"
        self.open.add(name)
        if self.driver is None:
            self.driver = name
        return name

    def leave(self, tab: str) -> None:
        self.open.discard(tab)
        if tab == self.driver:
            self._left_s = time.monotonic()

    def may_take(self) -> bool:
        """Whether the tab that drove is gone for good."""
        gone = self.driver is None or self.driver not in self.open
        return gone and time.monotonic() - self._left_s > RELOAD_S

    def take(self, tab: str) -> bool:
        """Makes this tab the one that drives, where that is free."""
        if tab == self.driver or self.may_take():
            self.driver = tab
        return tab == self.driver
