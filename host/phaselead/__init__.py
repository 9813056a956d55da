"""phaselead: identify, drive and understand piezo stages.

    import phaselead as pl

    model = pl.fit("kept/*.h5")
    print(pl.verify(model, "other.csv"))
    with pl.connect("sim://xyz250") as dev:
        dev.upload(model)
        run = dev.track("sine:60um@5Hz", mode="ff+pid")

Names are loaded when they are first used: the numerical libraries take longer to import than most calls take.
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

from phaselead.version import VERSION

if TYPE_CHECKING:
    from phaselead.api import (
        campaign,
        demo,
        explain,
        export,
        fit,
        flash,
        gap,
        gap_next,
        gcs,
        import_recordings,
        load,
        loop,
        plot,
        ports,
        predict,
        read,
        recording,
        recover,
        replay,
        scope,
        sim,
        stop,
        verify,
        write_report,
    )
    from phaselead.control import Controller, Learned, Loop, Run, Tuned, connect
    from phaselead.device import DeviceFault
    from phaselead.errors import BadInput, DeviceRefused, LinkError, PhaseleadError
    from phaselead.gap import GapResult
    from phaselead.identify import FitResult, Verifications
    from phaselead.model import Gains, Stage
    from phaselead.record import Recording, Recordings

__version__ = VERSION

__all__ = [
    "BadInput",
    "Controller",
    "DeviceFault",
    "DeviceRefused",
    "FitResult",
    "Gains",
    "GapResult",
    "Learned",
    "LinkError",
    "Loop",
    "PhaseleadError",
    "Recording",
    "Recordings",
    "Run",
    "Stage",
    "Tuned",
    "Verifications",
    "__version__",
    "campaign",
    "connect",
    "demo",
    "explain",
    "export",
    "fit",
    "flash",
    "gap",
    "gap_next",
    "gcs",
    "import_recordings",
    "load",
    "loop",
    "plot",
    "ports",
    "predict",
    "read",
    "recording",
    "recover",
    "replay",
    "scope",
    "sim",
    "stop",
    "verify",
    "write_report",
]

_ROOMS = {
    "control": ("Controller", "Learned", "Loop", "Run", "Tuned", "connect"),
    "device": ("DeviceFault",),
    "errors": ("BadInput", "DeviceRefused", "LinkError", "PhaseleadError"),
    "gap": ("GapResult",),
    "identify": ("FitResult", "Verifications"),
    "model": ("Gains", "Stage"),
    "record": ("Recording", "Recordings"),
}
"""Where a public name comes from; those that are not here are functions of ``api``."""
_ROOM_OF = {name: room for room, names in _ROOMS.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'phaselead' has no attribute {name!r}")
    found = getattr(import_module(f"phaselead.{_ROOM_OF.get(name, 'api')}"), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted(__all__)


class _Face(ModuleType):
    """``pl.gap``, ``pl.gcs``, ``pl.scope``, ``pl.sim`` and ``pl.demo`` are functions, although packages inside have the
    same names: an import of one of those (``from phaselead.gap import ...``) must not put the package in the function's
    place."""

    def __setattr__(self, name: str, value: object) -> None:
        if not (name in __all__ and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Face
