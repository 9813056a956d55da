"""The compiled parts of the package, as ctypes sees them."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

from phaselead.errors import PhaseleadError

SUFFIX = EXTENSION_SUFFIXES[-1]
"""The plain one, .so or .pyd, as setup.py names them: one library serves every version of Python."""


def library_path(module: str) -> Path | None:
    """The file of a shared library of the package, e.g. "phaselead.model._kernel"; None where it is not built."""
    path = Path(__file__).parent.joinpath(*module.split(".")[1:]).with_suffix(SUFFIX)
    return path if path.is_file() else None


def kernel_of(module: str, *functions: str, sizes: Mapping[str, type[ctypes.Structure]] | None = None) -> ctypes.CDLL:
    """The shared library of a room, e.g. "phaselead.model._kernel". Raises PhaseleadError where it is not built, or was
    built before it had these ``functions`` or these structures. ``sizes``: by the name of a function that gives the
    size of a structure, what it is here."""
    room, path = module.split(".")[1], library_path(module)
    if path is None:
        raise PhaseleadError(f"the {room} kernel is not built; run: python setup.py build_ext --inplace")
    kernel = ctypes.CDLL(str(path))
    known = {name: ctypes.sizeof(structure) for name, structure in (sizes or {}).items()}
    if not all(hasattr(kernel, name) for name in (*functions, *known)) or any(
        getattr(kernel, name)() != size for name, size in known.items()
    ):
        raise PhaseleadError(f"the {room} kernel is of an older build; run: python setup.py build_ext --inplace")
    return kernel
