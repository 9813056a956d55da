"""Worst-case stack of a firmware, from what the compiler leaves beside its object files (-fcallgraph-info=su)."""

from __future__ import annotations

import re
from collections import defaultdict
from pathlib import Path

from phaselead.errors import PhaseleadError

UNKNOWN_BYTES = 64
"""For functions of the C library, whose frames are not told; the deepest of those used has 40."""
EXCEPTION_FRAME = 36
"""Eight registers, and four bytes to align them: the FPU is off."""
INDIRECT = "__indirect_call"
PORT = ("tick_lock", "tick_unlock", "tick_drive", "erase", "program", "read")
"""What struct device_port points to. Any call through a pointer may be one of these."""
CALLS_NO_COMMAND = (
    "command_",
    "tick_interrupt",
    "device_",
    "model_store_",
    "flash_",
    "image_",
    "boot_",
    "update_",
    "journal_",
    "fault_log_",
    "read_sector",
    "move_on",
    "append",
    "put",
    "set_up",
)
"""Who begins so calls nothing else through a pointer; others may be where a command is called. A guess that is wrong
ends in a recursion, which is an error."""

_NODE = re.compile(r'node: \{ title: "([^"]+)" label: "[^"]*?(?:\\n(\d+) bytes \((\w+)[^"]*)?"')
_EDGE = re.compile(r'edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"')


def _name(title: str) -> str:
    """Static functions are titled file:name."""
    return title.rsplit(":", 1)[-1]


class CallGraph:
    """Frames and calls of every function of a build directory."""

    def __init__(self, build: Path) -> None:
        self.frames: dict[str, int] = {}
        self.calls: dict[str, set[str]] = defaultdict(set)
        files = sorted(build.rglob("*.ci"))
        if not files:
            raise PhaseleadError(f"{build}: no call graph; build the firmware with `make firmware`")
        for file in files:
            self._read(file.read_text("utf-8"))
        commands = {name for name in self.frames if name.startswith("command_") and name != "command_find"}
        for caller, callees in self.calls.items():
            if INDIRECT in callees:
                callees.remove(INDIRECT)
                callees |= set(PORT)
                if not caller.startswith(CALLS_NO_COMMAND):
                    callees |= commands

    def _read(self, text: str) -> None:
        for title, size, kind in _NODE.findall(text):
            if not size:
                continue
            if kind != "static":
                raise PhaseleadError(f"{_name(title)}: its stack depends on data, so it has no bound")
            name = _name(title)
            self.frames[name] = max(int(size), self.frames.get(name, 0))
        for source, target in _EDGE.findall(text):
            self.calls[_name(source)].add(_name(target))

    def worst(self, function: str, above: tuple[str, ...] = ()) -> tuple[int, tuple[str, ...]]:
        """Bytes that a call takes at most, and the chain of calls that takes them.

        Raises:
            PhaseleadError: the chain comes back to itself.
        """
        if function in above:
            raise PhaseleadError(f"{' -> '.join(above)} -> {function}: recursion has no bound")
        if function not in self.frames:
            return UNKNOWN_BYTES, (function,)
        deepest = max(
            (self.worst(callee, (*above, function)) for callee in sorted(self.calls[function])), default=(0, ())
        )
        return self.frames[function] + deepest[0], (function, *deepest[1])


def worst_stack(build: Path) -> tuple[int, list[tuple[int, tuple[str, ...]]]]:
    """Bytes of stack at most: main, the line's interrupt on top, the tick on top of that. And the three chains."""
    graph = CallGraph(build)
    main = "main" if "main" in graph.frames else "start"  # the linker may have put one into the other
    chains = [graph.worst(name) for name in (main, "serial_sent", "tick_interrupt")]
    return sum(size for size, _ in chains) + 2 * EXCEPTION_FRAME, chains
