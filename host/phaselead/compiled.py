"""The compiled parts of the package, as ctypes sees them."""

from __future__ import annotations

import ctypes
from importlib.util import find_spec

from phaselead.errors import PhaseleadError


def kernel_of(module: str, *functions: str) -> ctypes.CDLL:
    """The shared library of a room, e.g. "phaselead.model._kernel". Raises PhaseleadError where it is not built, or was
    built before it had these ``functions``."""
    room, spec = module.split(".")[1], find_spec(module)
    if spec is None or spec.origin is None:
        raise PhaseleadError(f"the {room} kernel is not built; run: python setup.py build_ext --inplace")
    kernel = ctypes.CDLL(spec.origin)
    if not all(hasattr(kernel, name) for name in functions):
        raise PhaseleadError(f"the {room} kernel is of an older build; run: python setup.py build_ext --inplace")
    return kernel
